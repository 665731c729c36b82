# SPDX-License-Identifier: Apache-2.0
"""StageObjectTable: objects, instances and colliders collected while a stage is traversed, with their physics.

A `StageObject` gathers the meshes of one object and becomes a SceneObject when the traversal ends. Which meshes collide
is decided by UsdPhysics (`StageObjectTable`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from pxr import Usd, UsdPhysics

from tiscene.scene.animation import ColorTrack, InstanceTrack
from tiscene.scene.description import Collider, Instance, Matrix, SceneObject
from tiscene.usd.core.semantics import asset_name, name_label, object_name
from tiscene.usd.core.time_samples import ColorSamples, TransformSamples, color_tracks_of, tracks_of
from tiscene.usd.core.transform import is_singular


@dataclass
class StageObject:
    """An object while the stage is read. It becomes a SceneObject once one of its meshes is drawn.

    Attributes:
        name: name of its prim or of its object in Blender, with the id in brackets for a point of an instancer.
        path: path of its prim.
        category: semantic label, "" for none.
        is_labeled: whether the label is authored on the object or within it, not inherited from a group.
        name_label: category derived from its name.
        asset: name of its asset, "" for none.
        matrix: float64 4x4, world from its prim or point, m.
        samples: the same over time; None: static.
        row: row of the SceneObject; None: not drawn so far.
        parts: names of its meshes and their subsets.
        movable: whether it is a rigid body.
        colliders: number of its meshes that are colliders.
    """

    name: str
    path: str
    category: str
    is_labeled: bool
    name_label: str = ""
    asset: str = ""
    matrix: Matrix = field(default_factory=lambda: np.eye(4))
    samples: TransformSamples | None = None
    row: int | None = None
    parts: list[str] = field(default_factory=list)
    movable: bool = False
    colliders: int = 0

    @classmethod
    def of(
        cls,
        prim: Usd.Prim,
        category: str,
        is_labeled: bool,
        matrix: Matrix,
        samples: TransformSamples | None = None,
    ) -> StageObject:
        """Return a new object for a prim."""
        names = name_label(prim), asset_name(prim)
        matrix = first_shown(matrix, samples)
        return cls(object_name(prim), str(prim.GetPath()), category, is_labeled, *names, matrix, samples)


class _Instance(NamedTuple):
    """A drawn mesh, see `StageObjectTable.add`; `part` is the number of its first part."""

    mesh: int
    owner: StageObject
    matrix: Matrix
    part: int
    collides: bool | None
    samples: TransformSamples | None
    color: ColorSamples | None


class StageObjectTable:
    """Drawn meshes and colliders, by the object that they belong to.

    On a stage with a PhysicsScene exactly the prims with an enabled CollisionAPI collide. On other stages that holds
    for objects with at least one collider; all meshes of an object without any collide.
    """

    def __init__(self, stage: Usd.Stage) -> None:
        self._objects: list[StageObject] = []
        self._instances: list[_Instance] = []
        self._colliders: list[tuple[int, StageObject, Matrix, str]] = []
        self._stage = stage

    def add(
        self,
        owner: StageObject,
        mesh: int,
        matrix: Matrix,
        names: tuple[str, ...],
        collides: bool | None,
        samples: TransformSamples | None = None,
        *,
        continues: bool = False,
        color: ColorSamples | None = None,
    ) -> None:
        """Add a drawn mesh of an object.

        Args:
            owner: the object.
            mesh: row of the mesh.
            matrix: float64 4x4, world from mesh, m.
            names: names of the mesh's parts.
            collides: whether it is a collider; None: no physics is authored on it.
            samples: its transform and presence over time; None: static.
            continues: whether it is the shape that the mesh added before has at other times, with the same parts.
            color: its color; None: that of the mesh.
        """
        if owner.row is None:
            owner.row = len(self._objects)
            self._objects.append(owner)
        owner.colliders += collides is True
        if not continues:
            owner.parts += names
        part = len(owner.parts) - len(names)
        self._instances.append(_Instance(mesh, owner, matrix, part, collides, samples, color))

    def add_collider(self, owner: StageObject, mesh: int, matrix: Matrix, path: str) -> None:
        """Add a collider that is not drawn, such as one of purpose "guide".

        Args:
            owner: the object that it belongs to.
            mesh: row of the mesh.
            matrix: float64 4x4, world from mesh, m.
            path: path of its prim.
        """
        owner.colliders += 1
        self._colliders.append((mesh, owner, matrix, path))

    def colliders(self) -> tuple[Collider, ...]:
        """Return the colliders that are not drawn, in the order of `add_collider`."""
        return tuple(
            Collider(mesh, -1 if owner.row is None else owner.row, matrix, prim_path=path)
            for mesh, owner, matrix, path in self._colliders
        )

    def tracks(self) -> tuple[InstanceTrack, ...]:
        """Return the animation of the instances."""
        return tracks_of(self._stage, [each.samples for each in self._instances])

    def color_tracks(self) -> tuple[ColorTrack, ...]:
        """Return how the colors of instances vary."""
        return color_tracks_of(self._stage, [each.color for each in self._instances])

    def object_tracks(self) -> tuple[InstanceTrack, ...]:
        """Return the transforms over time of the objects that move."""
        return tracks_of(self._stage, [each.samples for each in self._objects])

    def instances(self) -> tuple[Instance, ...]:
        """Return the instances in the order of `add`."""
        has_physics_scene = any(prim.IsA(UsdPhysics.Scene) for prim in self._stage.Traverse())
        return tuple(
            Instance(
                each.mesh,
                each.owner.row or 0,
                each.matrix,
                each.part,
                bool(each.collides) if has_physics_scene or each.owner.colliders else each.collides is not False,
                None if each.color is None else each.color.color,
            )
            for each in self._instances
        )

    def objects(self, by_name: bool) -> tuple[SceneObject, ...]:
        """Return the objects.

        Args:
            by_name: whether the category of an object without a label is derived from its name.
        """
        return tuple(
            SceneObject(
                each.name,
                each.path,
                each.category or (each.name_label if by_name else ""),
                tuple(each.parts) if len(each.parts) > 1 else (),
                each.movable,
                each.asset,
                each.matrix,
            )
            for each in self._objects
        )


def first_shown(matrix: Matrix, samples: TransformSamples | None) -> Matrix:
    """Return the transform of a prim, or where that flattens it, the first one over time that does not."""
    if samples is None or not is_singular(matrix):
        return matrix
    return next((each for each in samples.matrices if not is_singular(each)), matrix)


def collides(prim: Usd.Prim) -> bool | None:
    """Return whether a gprim is an enabled collider; None if it has no CollisionAPI."""
    if not prim.HasAPI(UsdPhysics.CollisionAPI):
        return None
    return UsdPhysics.CollisionAPI(prim).GetCollisionEnabledAttr().Get() is not False


def may_collide(prim: Usd.Prim) -> bool:
    """Return whether an object collides: not if all colliders that it has are disabled."""
    states = [collides(each) for each in Usd.PrimRange(prim, Usd.TraverseInstanceProxies())]
    return True in states or False not in states


def is_rigid_body(prim: Usd.Prim) -> bool:
    """Return whether a prim is an enabled rigid body."""
    return prim.HasAPI(UsdPhysics.RigidBodyAPI) and (
        UsdPhysics.RigidBodyAPI(prim).GetRigidBodyEnabledAttr().Get() is not False
    )
