# SPDX-License-Identifier: Apache-2.0
"""ObjectRegistry: identities, labels, meshes and boxes of all objects of a world: everything that no frame changes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ScenarioError
from tiscene.scenario.edits import ObjectHistory
from tiscene.scenario.objects import Object
from tiscene.scene.animation import InstanceTrack, quaternions
from tiscene.scene.assembly import ObjectParts, bounding_box, box_matrices, corners, joined, rigid
from tiscene.scene.camera import Quaternion, Vector3
from tiscene.scene.description import Light, SceneDescription, Template, mesh_boxes
from tiscene.world.category_ids import CategoryIds
from tiscene.world.lights import AttachedLight
from tiscene.world.stage_animation import AnimatedInstances, box_over_time, changing, scaled

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WorldObject:
    """A live object at one frame.

    Attributes:
        id: value in the `instance` buffer.
        name: the scenario's id, or the prim's name.
        template: name of its template; "" for objects of the stage.
        category: semantic label; "" for none.
        category_id: value in the `semantic` buffer.
        prim_path: "" for objects of the scenario.
        position: origin of the object's axes, m.
        rotation: unit quaternion (w, x, y, z). Scale is part of the box, not of the axes.
        velocity: of the origin, from this frame to the next along its trajectory, m/s.
        box: lowest and highest corner around the object in its own axes, m.
        first_frame: first frame of its lifespan.
        last_frame: last frame of its lifespan; None: no end.
        blocked: whether an obstacle kept it from its trajectory since the frame before.
        parts: names of the values 1, 2, ... in the `part` buffer; () for an object of one part.
        asset: name of the asset that it is a copy of; "" for none.
    """

    id: int
    name: str
    template: str
    category: str
    category_id: int
    prim_path: str
    position: Vector3
    rotation: Quaternion
    velocity: Vector3
    box: tuple[Vector3, Vector3]
    first_frame: int
    last_frame: int | None
    blocked: bool = False
    parts: tuple[str, ...] = ()
    asset: str = ""


@dataclass(frozen=True, eq=False)
class PlacementColumns:
    """The constant columns of a placement: one row per part (placed mesh), those of the stage first.

    Attributes:
        stage: number of parts of the stage.
        mesh: int32 [p], rows of meshes.
        instance_id: int32 [p].
        category_id: int32 [p].
        box_from_mesh: float64 [p, 3, 4], from the mesh's space to 0..1 in the box around the whole object.
        part: int32 [p], number of the first named part of the object that the mesh shows.
    """

    stage: int
    mesh: NDArray[np.int32]
    instance_id: NDArray[np.int32]
    category_id: NDArray[np.int32]
    box_from_mesh: Array
    part: NDArray[np.int32]


class ObjectRegistry:
    """The objects of a stage and of a scenario, as far as no frame changes them.

    It owns the numbering of meshes: rows count through `descriptions` in their order, and the device scene adds them in
    the same order.

    Args:
        stage: the stage.
        load_template: loads a template that the stage does not hold; raises TemplateNotFound.
        category_ids: assigns the ids of categories.

    Attributes:
        descriptions: the stage, then each template's description in the order in which templates were first needed.
        category_ids: ids of all categories.
        templates: templates by name.
        stage_rows: the stage's objects, posed as authored.
        object_rows: the scenario's objects, at their initial position.
        columns: constant columns of placements.
        stage_owner: int32 [stage parts], row of each part's object.
        owner: int32 [object parts], row of each part's object.
        matrix: float64 [object parts, 3, 4], each part's pose in its object's axes.
        stage_tracks: authored animation of the stage's parts.
        object_tracks: authored animation of the objects' parts.
        changing: bool [p], whether a part is animated or deforms.
        carried: lights of the objects' templates.
    """

    def __init__(
        self, stage: SceneDescription, load_template: Callable[[str], Template], category_ids: CategoryIds
    ) -> None:
        self.stage = stage
        self.descriptions = [stage]
        self.category_ids = category_ids
        self.templates: dict[str, Template] = {}
        for template in stage.templates:
            self.templates.setdefault(template.name, template)
        self._first_mesh: dict[str, int] = {}
        self._load_template = load_template
        for category in (*(each.category for each in stage.objects), *(each.category for each in stage.templates)):
            self.category_ids.of(category)
        self.stage_rows, self._stage_parts = self._settle_stage()
        self.stage_owner = self._stage_parts.owner
        self._stage_changing = changing(stage)[self._stage_order]
        self.carried: list[AttachedLight] = []
        self.object_rows: list[WorldObject] = []
        self._planned: list[Object] = []
        self._object_parts: list[ObjectParts] = []
        self.settle([])

    def surface(self, number: int) -> Array:
        """Return the collision surface of an object of the scenario: its template's colliders, else all its meshes.

        Args:
            number: row of the object.

        Returns:
            float64 [m, 3, 3], triangles in the object's axes, m.
        """
        planned = self._planned[number]
        description = self.template(planned).description
        solid = (*(each for each in description.instances if each.collides), *description.colliders)
        scale = np.diag([*np.broadcast_to(planned.scale, 3), 1.0])
        triangles = [np.zeros((0, 3, 3))]
        for each in solid or description.instances:
            mesh, matrix = description.meshes[each.mesh], (scale @ each.world_from_object)[:3]
            triangles.append((mesh.positions.astype(np.float64) @ matrix[:, :3].T + matrix[:, 3])[mesh.triangles])
        return np.concatenate(triangles)

    def _settle_stage(self) -> tuple[list[WorldObject], ObjectParts]:
        """Return rows and parts of the stage's objects. An object's axes are those of its first mesh, without scale."""
        stage = self.stage
        instance_owner = np.array([instance.object for instance in stage.instances], np.int32)
        self._stage_order = order = np.argsort(instance_owner, kind="stable")  # parts are instances grouped by object
        owner, part_of = instance_owner[order], np.argsort(order)
        placed = np.array([instance.world_from_object for instance in stage.instances]).reshape(-1, 4, 4)[order]
        meshes = np.array([instance.mesh for instance in stage.instances], np.int32)[order]
        self.stage_tracks = AnimatedInstances(
            placed[:, :3], [(part_of[track.instances], track) for track in stage.tracks]
        )
        some, first = np.unique(owner, return_index=True)  # objects with at least one mesh
        axes = np.tile(np.eye(4), (len(stage.objects), 1, 1))
        axes[some] = rigid(placed[first])
        own = np.linalg.inv(axes)[owner] @ placed
        every = mesh_boxes(stage.meshes, meshes.tolist(), own)
        boxes = np.zeros((len(stage.objects), 2, 3))
        if len(some):
            low, high = np.minimum.reduceat(every[:, 0], first), np.maximum.reduceat(every[:, 1], first)
            boxes[some] = np.where(low[:, :1, None] < np.inf, np.stack([low, high], axis=1), 0.0)
        for number in np.unique(owner[self.stage_tracks.rows]).tolist():
            rows = np.flatnonzero(owner == number)
            if len(rows) > 1:
                moments = self.stage_tracks.over_time(rows)
                boxes[number] = box_over_time(stage, meshes[rows].tolist(), moments, own=True)
        poses = zip(axes[:, :3, 3].tolist(), quaternions(axes[:, :3, :3]).tolist(), boxes, strict=True)
        objects = [
            WorldObject(
                id=number + 1,
                name=each.name,
                template="",
                category=each.category,
                category_id=self.category_ids.of(each.category),
                prim_path=each.prim_path,
                position=(x, y, z),
                rotation=tuple(rotation),
                velocity=(0.0, 0.0, 0.0),
                box=corners(box),
                first_frame=0,
                last_frame=None,
                parts=each.parts,
                asset=each.asset,
            )
            for number, (each, ((x, y, z), rotation, box)) in enumerate(zip(stage.objects, poses, strict=True))
        ]
        numbers = np.array([instance.part for instance in stage.instances], np.int32)[order]
        # Not axes @ own: the authored matrices are kept to the bit.
        return objects, ObjectParts(meshes, owner, placed[:, :3], box_matrices(boxes[owner], own), numbers)

    def settle(self, lives: Sequence[ObjectHistory]) -> None:
        """Add the scenario's objects that are new in `lives`, which begins with those added before."""
        for number in range(len(self.object_rows), len(lives)):
            row, parts = self._settle_object(number, lives[number].spec)
            self.object_rows.append(row)
            self._planned.append(lives[number].spec)
            self._object_parts.append(parts)
            description = self.template(lives[number].spec).description
            lights_scale = np.broadcast_to(lives[number].spec.scale, 3)
            place = next(at for at, each in enumerate(self.descriptions) if each is description)
            self.carried += [AttachedLight(number, place, _scaled(light, lights_scale)) for light in description.lights]
        objects = joined(self._object_parts)
        self.object_tracks = AnimatedInstances(objects.matrix, self._object_track_rows())
        changes = [self._stage_changing]
        changes += [changing(self.template(each).description) for each in self._planned]
        self.changing = np.concatenate(changes)
        self.owner = objects.owner
        self.matrix = objects.matrix
        self.columns = self._columns(objects)

    def _settle_object(self, number: int, each: Object) -> tuple[WorldObject, ObjectParts]:
        """Return row and parts of an object of the scenario."""
        template = self.template(each)
        description = template.description
        scale = np.diag([*np.broadcast_to(each.scale, 3), 1.0])
        own = [scale @ instance.world_from_object for instance in description.instances]
        meshes = [instance.mesh for instance in description.instances]
        box = bounding_box(description, meshes, own)
        if description.tracks:
            tracks = AnimatedInstances(
                np.array(own)[:, :3], [(track.instances, scaled(track, scale)) for track in description.tracks]
            )
            box = box_over_time(description, meshes, tracks.over_time(np.arange(len(own))), own=False)
        row = WorldObject(
            id=len(self.stage.objects) + number + 1,
            name=each.id,
            template=template.name,
            category=template.category,
            category_id=self.category_ids.of(template.category),
            prim_path="",
            position=each.position,
            rotation=(1.0, 0.0, 0.0, 0.0),
            velocity=(0.0, 0.0, 0.0),
            box=corners(box),
            first_frame=each.first_frame,
            last_frame=each.last_frame,
            parts=description.objects[0].parts if len(description.objects) == 1 else (),
            asset=next((whole.asset for whole in description.objects), "") or template.name,
        )
        parts = ObjectParts(
            np.array(meshes, dtype=np.int32) + self._first_mesh[each.template],
            np.full(len(meshes), number, dtype=np.int32),
            np.array([matrix[:3] for matrix in own]),
            box_matrices(np.tile(box, (len(own), 1, 1)), np.array(own)),
            np.array([instance.part for instance in description.instances], dtype=np.int32),
        )
        return row, parts

    def _object_track_rows(self) -> Iterator[tuple[NDArray[np.int64], InstanceTrack]]:
        """Yield the animation of the objects' templates, each track with the parts that it moves."""
        first = 0
        for planned, parts in zip(self._planned, self._object_parts, strict=True):
            scale = np.diag([*np.broadcast_to(planned.scale, 3), 1.0])
            for track in self.template(planned).description.tracks:
                yield first + track.instances.astype(np.int64), scaled(track, scale)
            first += len(parts.mesh)

    def template(self, each: Object) -> Template:
        """Return an object's template; its description is added to `descriptions` at first use."""
        if each.template not in self.templates:
            self.templates[each.template] = self._load_template(each.template)
        template = self.templates[each.template]
        if each.template not in self._first_mesh:
            if not template.description.instances:
                raise ScenarioError(f"object {each.id!r}: the template {each.template!r} has no mesh")
            self._first_mesh[each.template] = sum(len(description.meshes) for description in self.descriptions)
            self.descriptions.append(template.description)
        return template

    def _columns(self, objects: ObjectParts) -> PlacementColumns:
        stage = self._stage_parts
        rows = [self.stage_rows[owner] for owner in stage.owner] + [self.object_rows[row] for row in objects.owner]
        return PlacementColumns(
            len(stage.mesh),
            np.concatenate([stage.mesh, objects.mesh]),
            np.array([row.id for row in rows], dtype=np.int32),
            np.array([row.category_id for row in rows], dtype=np.int32),
            np.concatenate([stage.box_from_mesh, objects.box_from_mesh]),
            np.concatenate([stage.number, objects.number]),
        )


def _scaled(light: Light, scale: Array) -> Light:
    """Return a light of a template that is scaled about its origin. The light keeps its size."""
    matrix = light.world_from_light.copy()
    matrix[:3, 3] *= scale
    return replace(light, world_from_light=matrix)
