# SPDX-License-Identifier: Apache-2.0
"""Things with an identity while a stage is read: their parts, and what UsdPhysics says of them."""

from __future__ import annotations

from dataclasses import dataclass, field

from pxr import Usd, UsdPhysics

from tiscene.scene.animation import InstanceTrack
from tiscene.scene.description import Collider, Instance, Matrix, SceneObject
from tiscene.usd.core.semantics import asset_name, name_label
from tiscene.usd.core.time_samples import TransformSamples, tracks_of


@dataclass
class StageObject:
    """What becomes one SceneObject once something of it is drawn. labeled: `category` is its own, not inherited.

    name_label: what its name says it is. parts: names of its meshes and their subsets. colliders: how many of its
    meshes are ones. asset: `asset_name`.
    """

    name: str
    path: str
    category: str
    labeled: bool
    name_label: str = ""
    asset: str = ""
    row: int | None = None
    parts: list[str] = field(default_factory=list)
    movable: bool = False
    colliders: int = 0

    @classmethod
    def of(cls, prim: Usd.Prim, category: str, labeled: bool) -> StageObject:
        """The thing that a prim is."""
        return cls(prim.GetName(), str(prim.GetPath()), category, labeled, name_label(prim), asset_name(prim))

    def add_parts(self, names: tuple[str, ...]) -> int:
        """The number of the first of some new parts."""
        self.parts += names
        return len(self.parts) - len(names)


class StageObjectTable:
    """Everything drawn, by the thing it is part of.

    Colliders are decided by the rules of UsdPhysics where a stage has a PhysicsScene: what has an enabled CollisionAPI
    collides. On other stages that goes for the things that have a collider; all of a thing without one collides.
    """

    def __init__(self, stage: Usd.Stage) -> None:
        self.things: list[StageObject] = []
        self._instances: list[tuple[int, StageObject, Matrix, int, bool | None]] = []
        self._samples: list[TransformSamples | None] = []  # of every instance
        self._colliders: list[tuple[int, StageObject, Matrix, str]] = []
        self._stage = stage

    def add(
        self,
        thing: StageObject,
        mesh: int,
        matrix: Matrix,
        names: tuple[str, ...],
        collides: bool | None,
        samples: TransformSamples | None = None,
    ) -> None:
        """A mesh of a thing. collides: None if no physics is authored on it. samples: where it is over time."""
        if thing.row is None:
            thing.row = len(self.things)
            self.things.append(thing)
        thing.colliders += collides is True
        self._instances.append((mesh, thing, matrix, thing.add_parts(names), collides))
        self._samples.append(samples)

    def add_collider(self, thing: StageObject, mesh: int, matrix: Matrix, path: str) -> None:
        """A mesh of a thing that is not drawn."""
        thing.colliders += 1
        self._colliders.append((mesh, thing, matrix, path))

    def colliders(self) -> tuple[Collider, ...]:
        """What is not drawn, in the order in which it was added."""
        return tuple(
            Collider(mesh, -1 if thing.row is None else thing.row, matrix, prim_path=path)
            for mesh, thing, matrix, path in self._colliders
        )

    def tracks(self) -> tuple[InstanceTrack, ...]:
        """How instances move, come and go by themselves."""
        return tracks_of(self._stage, self._samples)

    def instances(self) -> tuple[Instance, ...]:
        """In the order in which they were added."""
        strict = any(prim.IsA(UsdPhysics.Scene) for prim in self._stage.Traverse())
        return tuple(
            Instance(
                mesh,
                thing.row or 0,
                matrix,
                part,
                bool(collides) if strict or thing.colliders else collides is not False,
            )
            for mesh, thing, matrix, part, collides in self._instances
        )

    def objects(self, by_name: bool) -> tuple[SceneObject, ...]:
        """by_name: things without a label have the one that their names say."""
        return tuple(
            SceneObject(
                thing.name,
                thing.path,
                thing.category or (thing.name_label if by_name else ""),
                tuple(thing.parts) if len(thing.parts) > 1 else (),
                thing.movable,
                thing.asset,
            )
            for thing in self.things
        )


def collides(prim: Usd.Prim) -> bool | None:
    """Whether a gprim is an enabled collider; None if it has no CollisionAPI."""
    if not prim.HasAPI(UsdPhysics.CollisionAPI):
        return None
    return UsdPhysics.CollisionAPI(prim).GetCollisionEnabledAttr().Get() is not False


def is_rigid_body(prim: Usd.Prim) -> bool:
    """Whether a prim is an enabled rigid body."""
    return prim.HasAPI(UsdPhysics.RigidBodyAPI) and (
        UsdPhysics.RigidBodyAPI(prim).GetRigidBodyEnabledAttr().Get() is not False
    )
