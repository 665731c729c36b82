# SPDX-License-Identifier: Apache-2.0
"""ObjectRegistry: identities, labels, meshes and boxes of all objects of a world: everything that no frame changes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynamics.lru_cache import LRUCache
from tiscene.errors import ScenarioError
from tiscene.frame.object_table import ObjectState
from tiscene.scenario.edits import ObjectHistory
from tiscene.scenario.objects import Object
from tiscene.scene.affine_maps import inverted
from tiscene.scene.animation import quaternions
from tiscene.scene.assembly import ObjectParts, box_matrices, corners, instance_colors, joined, object_matrices, rigid
from tiscene.scene.camera import Vector3
from tiscene.scene.description import SceneDescription, Template, mesh_boxes
from tiscene.world.category_ids import CategoryIds
from tiscene.world.lights import AttachedLight
from tiscene.world.object_geometry import ObjectGeometry
from tiscene.world.stage_animation import AnimatedInstances, ColoredInstances, box_over_time, changing, changing_within

Array = NDArray[np.float64]
MAX_GEOMETRIES = 256  # of templates and scales
MAX_SURFACES = 16  # likewise


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


@dataclass(frozen=True, eq=False)
class ObjectSelection:
    """Some objects of the scenario beside the stage, with the columns of a placement of both.

    Attributes:
        rows: the objects, as ascending rows of `EditLog.histories`.
        objects: the same at their initial position.
        columns: constant columns of placements.
        owner: int32 [object parts], which of the objects each part belongs to, 0 for the first.
        matrix: float64 [object parts, 3, 4], each part's pose in its object's axes.
        tracks: authored animation of the objects' parts.
        colors: colors of the objects' parts.
        changing: bool [p], whether a part is animated or deforms.
        lights: lights of the objects' templates.
    """

    rows: tuple[int, ...]
    objects: tuple[ObjectState, ...]
    columns: PlacementColumns
    owner: NDArray[np.int32]
    matrix: Array
    tracks: AnimatedInstances
    colors: ColoredInstances
    changing: NDArray[np.bool_]
    lights: tuple[AttachedLight, ...]


class ObjectRegistry:
    """The objects of a stage and of a scenario, as far as no frame changes them.

    It owns the numbering of meshes: rows count through `descriptions` in their order, and the device scene adds them in
    the same order. Of objects only those of recent selections are kept.

    Args:
        stage: the stage.
        load_template: loads a template that the stage does not hold; raises TemplateNotFound.
        category_ids: assigns the ids of categories.
        histories: the scenario's objects. It may grow; see `settle`.

    Attributes:
        descriptions: the stage, then each template's description in the order in which templates were first needed.
        category_ids: ids of all categories.
        templates: templates by name.
        stage_rows: the stage's objects, posed as authored.
        stage_owner: int32 [stage parts], row of each part's object.
        stage_tracks: authored animation of the stage's parts.
        stage_colors: colors of the stage's parts.
        stage_poses: authored transforms of the stage's objects, and their animation.
        first_light_frame: first frame at which an object whose template has lights is known; None: none is.
    """

    def __init__(
        self,
        stage: SceneDescription,
        load_template: Callable[[str], Template],
        category_ids: CategoryIds,
        histories: Sequence[ObjectHistory],
    ) -> None:
        self.stage = stage
        self.descriptions = [stage]
        self.category_ids = category_ids
        self.templates: dict[str, Template] = {}
        for template in stage.templates:
            self.templates.setdefault(template.name, template)
        self._loaded = dict(self.templates)
        self._first_mesh: dict[str, int] = {}
        self._load_template = load_template
        for category in (*(each.category for each in stage.objects), *(each.category for each in stage.templates)):
            self.category_ids.of(category)
        self.stage_rows, stage_parts = self._settle_stage()
        self.stage_owner = stage_parts.owner
        self._stage_changing = changing(stage, is_stage=True)[self._stage_order]
        self._stage_columns = PlacementColumns(
            len(stage_parts.mesh),
            stage_parts.mesh,
            np.array([self.stage_rows[owner].id for owner in stage_parts.owner], dtype=np.int32),
            np.array([self.stage_rows[owner].category_id for owner in stage_parts.owner], dtype=np.int32),
            stage_parts.box_from_mesh,
            stage_parts.number,
        )
        self.first_light_frame: int | None = None
        self._histories = histories
        self._settled = 0
        self._geometries: LRUCache[tuple[str, Vector3], ObjectGeometry] = LRUCache(MAX_GEOMETRIES)
        self._surfaces: LRUCache[tuple[object, ...], Array] = LRUCache(MAX_SURFACES)
        self._entries: dict[int, tuple[ObjectState, ObjectGeometry]] = {}
        self._selection: ObjectSelection | None = None
        self.settle()

    def surface(self, spec: Object) -> Array:
        """Return the collision surface of an object: its template's colliders, else all its meshes.

        Objects of one template and scale share it, as long as it is kept.

        Args:
            spec: the object.

        Returns:
            float64 [m, 3, 3], triangles in the object's axes, m.
        """
        return self._surfaces.get((spec.template, spec.scale), lambda: self._new_surface(spec))

    def _new_surface(self, spec: Object) -> Array:
        description = self.template(spec).description
        solid = (*(each for each in description.instances if each.collides), *description.colliders)
        scale = np.diag([*np.broadcast_to(spec.scale, 3), 1.0])
        triangles = [np.zeros((0, 3, 3))]
        for each in solid or description.instances:
            mesh, matrix = description.meshes[each.mesh], (scale @ each.world_from_object)[:3]
            triangles.append((mesh.positions.astype(np.float64) @ matrix[:, :3].T + matrix[:, 3])[mesh.triangles])
        return np.concatenate(triangles)

    def _settle_stage(self) -> tuple[list[ObjectState], ObjectParts]:
        """Return rows and parts of the stage's objects. An object's axes are those of its prim, without scale."""
        stage = self.stage
        instance_owner = np.array([instance.object for instance in stage.instances], np.int32)
        self._stage_order = order = np.argsort(instance_owner, kind="stable")  # parts are instances grouped by object
        owner, part_of = instance_owner[order], np.argsort(order)
        placed = np.array([instance.world_from_object for instance in stage.instances]).reshape(-1, 4, 4)[order]
        meshes = np.array([instance.mesh for instance in stage.instances], np.int32)[order]
        self.stage_tracks = AnimatedInstances(
            placed[:, :3], [(part_of[track.instances], track) for track in stage.tracks]
        )
        colors = instance_colors(stage)[order]
        self.stage_colors = ColoredInstances(colors, [(part_of[each.instances], each) for each in stage.color_tracks])
        some, first = np.unique(owner, return_index=True)  # objects with at least one mesh
        authored = object_matrices(stage)
        self.stage_poses = AnimatedInstances(
            authored[:, :3], [(track.instances, track) for track in stage.object_tracks]
        )
        axes = rigid(authored)
        own = np.linalg.inv(axes)[owner] @ placed
        every = mesh_boxes(stage.meshes, meshes.tolist(), own)
        boxes = np.zeros((len(stage.objects), 2, 3))
        if len(some):
            low, high = np.minimum.reduceat(every[:, 0], first), np.maximum.reduceat(every[:, 1], first)
            boxes[some] = np.where(low[:, :1, None] < np.inf, np.stack([low, high], axis=1), 0.0)
        for number in changing_within(self.stage_tracks, self.stage_poses, owner):
            rows = np.flatnonzero(owner == number)
            times, moments = self.stage_tracks.times(rows), self.stage_tracks.over_time(rows)
            into = np.tile(np.eye(4), (len(times), 1, 1))  # the prim's space, then the object's axes at authored scale
            into[:, :3] = inverted(np.array([self.stage_poses.at(time)[0][number] for time in times]))[0]
            into = np.linalg.inv(axes[number]) @ authored[number] @ into
            boxes[number] = box_over_time(stage, meshes[rows].tolist(), moments, into)
        poses = zip(axes[:, :3, 3].tolist(), quaternions(axes[:, :3, :3]).tolist(), boxes, strict=True)
        objects = [
            ObjectState(
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
        return objects, ObjectParts(meshes, owner, placed[:, :3], box_matrices(boxes[owner], own), numbers, colors)

    def settle(self) -> None:
        """Register the templates and categories of objects that are new in `histories`."""
        for history in self._histories[self._settled :]:
            template = self._used(history.spec)
            self.category_ids.of(template.category)
            if template.description.lights:
                known = history.spawned or 0
                self.first_light_frame = min(known, known if self.first_light_frame is None else self.first_light_frame)
        self._settled = len(self._histories)

    def id_of(self, row: int) -> int:
        """Return the instance id of an object of the scenario."""
        return len(self.stage.objects) + row + 1

    def row_of(self, id: int) -> int | None:
        """Return the row of an object of the scenario by its instance id; None if it is of the stage or unknown."""
        row = id - len(self.stage.objects) - 1
        return row if 0 <= row < self._settled else None

    def select(self, rows: tuple[int, ...]) -> ObjectSelection:
        """Return some objects of the scenario, by ascending rows. The last selection is kept."""
        if self._selection is None or self._selection.rows != rows:
            self._selection = self._select(rows)
        return self._selection

    def _select(self, rows: tuple[int, ...]) -> ObjectSelection:
        if len(self._entries) > 2 * len(rows):
            self._entries = {row: self._entries[row] for row in rows if row in self._entries}
        entries = [self._entry(row) for row in rows]
        parts = [
            replace(geometry.parts, owner=np.full(len(geometry.parts.mesh), place, np.int32))
            for place, (_, geometry) in enumerate(entries)
        ]
        objects = joined(parts)
        first = np.cumsum([0, *(len(each.mesh) for each in parts)]).tolist()
        tracks = [
            (first[place] + track.instances.astype(np.int64), track)
            for place, (_, geometry) in enumerate(entries)
            for track in geometry.tracks
        ]
        color_tracks = [
            (first[place] + track.instances.astype(np.int64), track)
            for place, (_, geometry) in enumerate(entries)
            for track in geometry.color_tracks
        ]
        lights = [
            AttachedLight(row, number, geometry.description, light, geometry.light_tracks.get(number))
            for row, (_, geometry) in zip(rows, entries, strict=True)
            for number, light in enumerate(geometry.lights)
        ]
        stage = self._stage_columns
        ids = np.array([each.id for each, _ in entries], np.int32)
        categories = np.array([each.category_id for each, _ in entries], np.int32)
        return ObjectSelection(
            rows=rows,
            objects=tuple(each for each, _ in entries),
            columns=PlacementColumns(
                stage.stage,
                np.concatenate([stage.mesh, objects.mesh]),
                np.concatenate([stage.instance_id, ids[objects.owner]]),
                np.concatenate([stage.category_id, categories[objects.owner]]),
                np.concatenate([stage.box_from_mesh, objects.box_from_mesh]),
                np.concatenate([stage.part, objects.number]),
            ),
            owner=objects.owner,
            matrix=objects.matrix,
            tracks=AnimatedInstances(objects.matrix, tracks),
            colors=ColoredInstances(objects.color, color_tracks),
            changing=np.concatenate([self._stage_changing, *(geometry.changing for _, geometry in entries)]),
            lights=tuple(lights),
        )

    def _entry(self, row: int) -> tuple[ObjectState, ObjectGeometry]:
        if row not in self._entries:
            spec = self._histories[row].spec
            template, geometry = self.template(spec), self._geometry(spec)
            whole = template.description.objects
            world_object = ObjectState(
                id=self.id_of(row),
                name=spec.id,
                template=template.name,
                category=template.category,
                category_id=self.category_ids.of(template.category),
                prim_path="",
                position=spec.position,
                rotation=(1.0, 0.0, 0.0, 0.0),
                velocity=(0.0, 0.0, 0.0),
                box=geometry.box,
                first_frame=spec.first_frame,
                last_frame=spec.last_frame,
                parts=whole[0].parts if len(whole) == 1 else (),
                asset=next((each.asset for each in whole), "") or template.name,
            )
            self._entries[row] = world_object, geometry
        return self._entries[row]

    def _geometry(self, spec: Object) -> ObjectGeometry:
        """Return the geometry of an object; objects of one template and scale share it."""
        x, y, z = np.broadcast_to(spec.scale, 3).tolist()

        def new() -> ObjectGeometry:
            description = self.template(spec).description
            place = next(at for at, each in enumerate(self.descriptions) if each is description)
            return ObjectGeometry.of(description, place, self._first_mesh[spec.template], (x, y, z))

        return self._geometries.get((spec.template, (x, y, z)), new)

    def template(self, each: Object) -> Template:
        """Return the template of an object, which need not be registered."""
        if each.template not in self._loaded:
            self._loaded[each.template] = self._load_template(each.template)
        template = self._loaded[each.template]
        if not template.description.instances:
            raise ScenarioError(f"object {each.id!r}: the template {each.template!r} has no mesh")
        return template

    def _used(self, each: Object) -> Template:
        """Return an object's template; its description is added to `descriptions` at first use."""
        template = self.templates[each.template] = self.template(each)
        if each.template not in self._first_mesh:
            self._first_mesh[each.template] = sum(len(description.meshes) for description in self.descriptions)
            self.descriptions.append(template.description)
        return template
