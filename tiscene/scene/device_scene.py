# SPDX-License-Identifier: Apache-2.0
"""DeviceScene: meshes, materials, textures and lights as device arrays, and the trees that rays traverse."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from dynamics.whole_changes import WholeChanges, as_a_whole
from tiscene.device import runtime
from tiscene.device.memory import device_array, upload
from tiscene.errors import ArgumentError
from tiscene.scene.affine_maps import inverted, transformed_boxes
from tiscene.scene.bvh.blas import Blas
from tiscene.scene.bvh.bvh import Bvh
from tiscene.scene.bvh.bvh_copy import BvhCopy
from tiscene.scene.bvh.obstacle_tree import MeshTrees
from tiscene.scene.bvh.rebraid import MAX_SPLIT, PARTS
from tiscene.scene.bvh.template_trees import add_meshes_of
from tiscene.scene.deforming_mesh import BLOCKS, TIMES, DeformingMesh
from tiscene.scene.description import Light, Mesh, SceneDescription
from tiscene.scene.instance_upload import (
    INFO_BLAS,
    INFO_COLUMNS,
    NO_INSTANCES,
    attribute_flags,
    info_rows,
    stacked,
    upload_packed,
)
from tiscene.scene.lights.emissive_meshes import EmissiveMeshes
from tiscene.scene.lights.light_table import LightTable
from tiscene.scene.material_table import MaterialTable
from tiscene.scene.placement import CURRENT, MOVERS, NEXT, PREVIOUS, Placement
from tiscene.scene.reused_arrays import MeshGroup, ReusedArrays
from tiscene.scene.textures.atlas import TextureAtlas
from tiscene.scene.transient_meshes import TransientMeshes, resident


class DeviceScene(WholeChanges):
    """A growing set of meshes, materials, textures and lights, and the transforms of the instances.

    It is empty at first: `add` descriptions, `place` the instances, then render. Placing is cheap and done for every
    frame; adding builds trees. Neither compiles kernels after the first time. Creating one starts Taichi.

    Args:
        traversal: Layout of the trees, "bvh8" or "bvh2". None: the layout for the device.
        stage_trees: Trees of the first description to be added, if another scene has built them.

    Attributes:
        traversal: The layout.
        materials: All materials.
        textures: All textures.
        lights: The lights of the latest placement.
        emissive: The meshes that emit light.
        descriptions: The descriptions that were added, each with the row of its first mesh.
        placement: The latest placement.
        instance_boxes: float64 [3, i, 6], world boxes by time, m, of absent instances as well.
        bounds: float64 [2, 3], lowest and highest corner of the instances at CURRENT, m; zeros if there are none.

        vertex_position: f32 [n, 3], object space, m. A deforming mesh has three consecutive blocks: its vertices at
            CURRENT, NEXT and PREVIOUS. Device arrays of meshes are replaced by the first `place` after an `add`.
        vertex_normal: f32 [n, 3]; zeros for a mesh without normals.
        vertex_uv: f32 [n + 3 c, 2]; zeros for a mesh without uv. After the n vertices come three rows for each of the c
            vertices of meshes with colors: second uv, red and green, blue and opacity.
        triangle_vertices: i32 [m, 3], rows of `vertex_position`.
        triangle_material: i32 [m], rows of `materials`.
        triangle_part: i32 [m], part of the mesh.
        instance_info: i32 [i, 22], at CURRENT; `instances_at` returns that of other times. Columns: 0 reference of the
            BLAS, 1 first triangle, 2 instance id, 3 category id, 4 mesh row, 5 flags (HAS_NORMALS | HAS_UV | MIRRORED |
            HAS_COLORS | OWN_COLOR | OWN_OPACITY), 6 first part, 7 number of vertices of a deforming mesh, else 0, 8
            first row of colors minus 3 times the first vertex, 9 to 16 references of the BLAS's parts (`bvh.rebraid`),
            17 class of light links, 18 to 21 bits of an f32 color and opacity of the instance's own.
            Device arrays of instances are replaced by every `place`.
        world_from_instance: f32 [3, i, 12], by time, row-major 3x4, m.
        instance_from_world: f32 [3, i, 12], the inverse.
        box_from_instance: f32 [i, 12], from the mesh's space to the object's bounding box, 0..1.

    Raises:
        ArgumentError: The layout is unknown.
    """

    def __init__(self, traversal: str | None = None, stage_trees: MeshTrees | None = None) -> None:
        architecture = runtime.start()
        self.traversal = traversal or ("bvh2" if architecture == "cuda" else "bvh8")
        self._stage_trees = stage_trees
        self._bvh = Bvh(self.traversal) if stage_trees is None else BvhCopy(stage_trees.bvh)
        self.materials = MaterialTable()
        self._arrays = (None if stage_trees is None else stage_trees.take_arrays()) or ReusedArrays()
        if stage_trees is not None:
            # Not `__del__`, see `BvhCopy`.
            weakref.finalize(self, stage_trees.keep_arrays, self._arrays).atexit = False
        self.textures = TextureAtlas(self._arrays.texture_words, self._arrays.texture_floats)
        self.lights = LightTable()
        self.descriptions: list[tuple[int, SceneDescription]] = []
        self._meshes: list[Mesh] = []
        self._blas: list[Blas] = []
        self.emissive = EmissiveMeshes()
        self._first_triangles: list[int] = [0]
        self._first_textures: list[int] = []  # by description
        self._first_materials: list[int] = []
        self._groups: list[MeshGroup] = []  # the resident meshes, by description
        self._transient = TransientMeshes()
        self._deforming: dict[int, DeformingMesh] = {}  # by mesh row
        self.instance_count, self.placement = 0, NO_INSTANCES
        self._mesh_table = self._placed_meshes = np.zeros((0, 6), np.int32)  # the latter: when instances were placed
        self.bounds: NDArray[np.float64] = np.zeros((2, 3))
        self._hittable, self.instance_boxes = np.zeros((3, 0), bool), np.zeros((3, 0, 6))
        self.instance_info: Any = None
        self._frame_roots: dict[int, Any] = {}
        self._pending: list[NDArray[Any]] | None = None  # values of the arrays of instances, not on the device yet
        self._info_at: dict[int, Any] = {}  # at other times than CURRENT, if a mesh deforms
        self._mesh_arrays_are_stale = True
        self._upload_meshes()
        self._inverse, self._determinant = np.zeros((3, 0, 3, 4)), np.zeros((3, 0))
        self._upload_instances()

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        """The meshes as they were added, by row."""
        return tuple(self._meshes)

    @property
    def mesh_boxes(self) -> NDArray[np.float64]:
        """Corners of each mesh at the times of the latest placement, [3, n, 2, 3]: lowest, highest; object space, m."""
        return self._boxes

    @property
    def nodes(self) -> Any:
        """The nodes of all trees, for `tiscene.render.intersect`."""
        return self._bvh.nodes

    @property
    def leaf_blocks(self) -> Any:
        """The triangles in the leaves of the trees, for `tiscene.render.intersect`."""
        return self._bvh.leaf_blocks

    @property
    def trees(self) -> MeshTrees:
        """The trees of the meshes, for collisions."""
        return MeshTrees(self._bvh, self._blas)

    def copied_stage_trees(self) -> MeshTrees:
        """Return the trees of the first description, for other scenes that begin with it."""
        count = len(self.descriptions[0][1].meshes)
        return self._stage_trees or MeshTrees(BvhCopy(self._bvh, self._stage_rows), self._blas[:count])

    def instances_at(self, time: int) -> Any:
        """Return `instance_info` for rays at a time; deforming meshes have a tree for each time."""
        return self._info_at.get(time, self.instance_info)

    @property
    def deforms(self) -> bool:
        """Whether some mesh deforms or is transient, so that frames are placed one by one."""
        return bool(self._deforming or self._transient)

    def changing_meshes(self) -> NDArray[np.bool_]:
        """Return for each mesh whether it deforms, or one of its materials varies over time."""
        result = np.array(self.emissive.varying, bool)
        result[list(self._deforming)] = True
        return result

    def vertex_rows(self, mesh: int) -> range:
        """Return the rows of `vertex_position` of a mesh at CURRENT; where some `deforms`, it is placed before."""
        self._upload_meshes()
        first = int(self._first_vertices[mesh])
        return range(first, first + len(self._meshes[mesh].positions))

    def tlas_root(self, time: int) -> int:
        """Return the reference of the TLAS at a time, or of MOVERS. Raises ArgumentError if it was not placed."""
        return self._bvh.root(time)

    @as_a_whole
    def add(self, description: SceneDescription) -> int:
        """Append a stage or template; return the row of its first mesh.

        Rows of meshes, materials and textures continue those of earlier descriptions. Call `place` before rendering.
        """
        first_mesh = len(self._meshes)
        self.descriptions.append((first_mesh, description))
        self._first_textures.append(self.textures.append(description.textures))
        materials = description.materials, self._first_textures[-1], description.material_tracks
        self._first_materials.append(self.materials.append(*materials))
        meshes, is_stage = resident(description.meshes), len(self.descriptions) == 1
        self._groups.append(MeshGroup(meshes, self._first_materials[-1]))
        if is_stage and self._stage_trees is not None:
            self._blas += self._stage_trees.blas
        else:
            self._blas += add_meshes_of(description, self._bvh, self._first_triangles[-1], keep=not is_stage)
        if is_stage:
            self._stage_rows = self._bvh.used_rows
            self.lights.place(self.lights_of(self.placement), self._first_textures)
        self.emissive.add(description)
        for row, mesh in enumerate(meshes, first_mesh):
            first_triangle = self._first_triangles[-1]
            if mesh.deformation is not None:
                shape = mesh.positions.astype(np.float32), mesh.triangles.astype(np.int32), first_triangle
                copies = [self._bvh.add_mesh(*shape, deforms=True) for _ in TIMES]
                self._deforming[row] = DeformingMesh(mesh, mesh.deformation, copies)
            self._first_triangles.append(first_triangle + len(mesh.triangles))
        self._meshes += description.meshes
        self._transient.add(description.meshes, first_mesh, self._first_materials[-1])
        self._bvh.clear_instances()
        self._mesh_arrays_are_stale = True
        return first_mesh

    @as_a_whole
    def place(self, placement: Placement, times: Iterable[int] = (CURRENT,)) -> None:
        """Place the instances of a frame, and build the TLAS for each of `times`.

        A TLAS leaves out instances that are absent, empty, or have a singular transform. Placing the same object again
        builds only what is missing.

        Args:
            placement: The instances.
            times: PREVIOUS, CURRENT and NEXT, as needed.

        Raises:
            ArgumentError: The placement refers to a mesh that was not added.
        """
        times = set(times)
        if placement is self.placement and times <= self._bvh.placed():
            return
        self._upload_meshes()
        count = len(placement.mesh)
        if count and not 0 <= placement.mesh.min() <= placement.mesh.max() < len(self._meshes):
            rows = f"{placement.mesh.min()} to {placement.mesh.max()}"
            raise ArgumentError(f"placement.mesh has rows from {rows}, but the last mesh is {len(self._meshes) - 1}")
        for row, room, blas in self._transient.write(placement, self._meshes, self._arrays, self._bvh):
            self._first_vertices[row], self._first_triangles[row] = room.first_vertex, room.first_triangle
            self._mesh_is_empty[row] = blas.empty
            self._mesh_table = self._mesh_table.copy()  # it is compared with that of the instances uploaded last
            self._mesh_table[row, :2] = blas.entry, room.first_triangle
        self.lights.place(self.lights_of(placement), self._first_textures)
        varying = placement.materials or ()
        self.materials.place((self._first_materials[place] + row, each) for place, row, each in varying)
        self.emissive.place(varying)
        for row, deforming in self._deforming.items():
            first = int(self._first_vertices[row])
            deforming.move(placement.seconds, first, self.vertex_position, self.vertex_normal)
            self._boxes[:, row] = deforming.boxes
            for time in times & set(TIMES):
                deforming.refit(time, self._bvh, self.vertex_position, self.triangle_vertices)
        self._place_instances(placement)
        self.place_mesh_lights(self.lights, self.emissive.of(placement.mesh))
        for time in sorted(times):
            names = self._split_instances(time, np.flatnonzero(self._hittable[time]).astype(np.int32))
            self._bvh.place(time, *names, capacity=count + PARTS * MAX_SPLIT)
        self._write_instances()
        here = self.instance_boxes[CURRENT, self._hittable[CURRENT]]
        self.bounds = np.array((here[:, :3].min(axis=0), here[:, 3:].max(axis=0)) if len(here) else np.zeros((2, 3)))

    @as_a_whole
    def place_frames(self, placements: Sequence[Placement], times: Iterable[int] = (CURRENT,)) -> None:
        """Place the instances of several frames at once: those of a frame follow those of the one before.

        Their trees are in `frame_roots`. Lights are those of the first; varying materials and deforming meshes stay.

        Args:
            placements: The instances of each frame.
            times: PREVIOUS, CURRENT and NEXT, as needed.
        """
        self._upload_meshes()
        times = sorted(times)
        self.lights.place(self.lights_of(placements[0]), self._first_textures)
        self._place_instances(stacked(placements))
        self._bvh.reserve_trees(len(placements) * len(times))
        ends = np.cumsum([len(each.mesh) for each in placements]).tolist()
        for frame, (end, each) in enumerate(zip(ends, placements, strict=True)):
            for time in times:
                rows = end - len(each.mesh) + np.flatnonzero(self._hittable[time, end - len(each.mesh) : end])
                names = self._split_instances(time, rows.astype(np.int32))
                self._bvh.place((time, frame), *names, capacity=len(each.mesh) + PARTS * MAX_SPLIT)
        self._write_instances()
        roots = {time: [self._bvh.root((time, frame)) for frame in range(len(placements))] for time in times}
        self._frame_roots = {time: upload(np.array(each, np.int32)) for time, each in roots.items()}

    def lights_of(self, placement: Placement) -> tuple[tuple[int, Light], ...]:
        """Return the lights of a placement, each with the row of the description whose textures it reads."""
        stage = self.descriptions[0][1].lights if self.descriptions else ()
        return tuple((0, light) for light in stage) if placement.lights is None else placement.lights

    def frame_roots(self, time: int) -> Any:
        """Return the references of the TLAS of each frame of `place_frames` at a time, an i32 device array.

        Raises:
            ArgumentError: It was not placed at that time.
        """
        if time not in self._frame_roots or (time, 0) not in self._bvh.placed():
            raise ArgumentError(f"time={time}: no frames are placed there; name it in place_frames(..., times=...)")
        return self._frame_roots[time]

    def _place_instances(self, placement: Placement) -> None:
        # A frame is often placed twice: as it is, and without what moves.
        matrices, before = placement.world_from_object, self.placement
        if moved := matrices is not before.world_from_object or placement.box_from_object is not before.box_from_object:
            self._inverse, self._determinant = inverted(matrices)
        changed = self._deforming or self._mesh_table is not self._placed_meshes or not placement.resembles(before)
        self.placement, self._placed_meshes = placement, self._mesh_table
        if changed:
            self.instance_boxes = transformed_boxes(self._boxes[:, placement.mesh], matrices)
        if changed or self.traversal == "bvh2" or (self._determinant < 0.0).any():
            self._upload_instances(moved)
        self._hittable = placement.present & (self._determinant != 0.0) & ~self._mesh_is_empty[placement.mesh]
        self._bvh.clear_instances()

    def _write_instances(self) -> None:
        """Upload what `_upload_instances` has left to be uploaded together with the TLAS: all, for a GPU."""
        if self._pending is not None:
            upload_packed(self._pending, self._bvh.take_unwritten(), self._instance_arrays(), self._bvh.nodes)
            self._pending = None

    def _instance_arrays(self) -> tuple[Any, ...]:
        return self.instance_info, self.world_from_instance, self.instance_from_world, self.box_from_instance

    def _split_instances(self, time: int, rows: NDArray[np.int32]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Return world boxes and names for the TLAS: of the instances, and of the parts of large ones instead."""
        boxes, placed = self.instance_boxes[time, rows], self.placement
        if not len(rows) or self.traversal == "bvh2":
            return boxes, rows
        return self._parts.split(boxes, rows, placed.mesh[rows], placed.world_from_object[time, rows])

    def place_mesh_lights(self, lights: LightTable, emitting: NDArray[np.bool_]) -> None:
        """Place in a table the lights that the meshes of some emissive instances are, bool [n], at CURRENT."""
        rows, meshes = np.flatnonzero(self._hittable[CURRENT] & emitting), self.placement.mesh
        found = ((row, self.emissive.lights[meshes[row]]) for row in rows.tolist())
        placed = [(row, light) for row, light in found if light]
        lights.place_meshes(placed, self.placement.world_from_object[CURRENT, rows])

    def place_movers(self, moving: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Build the TLAS MOVERS over some of the instances at CURRENT; return their world boxes [n, 6], m."""
        rows: NDArray[np.int32] = np.flatnonzero(self._hittable[CURRENT] & moving).astype(np.int32)
        boxes: NDArray[np.float64] = self.instance_boxes[CURRENT, rows]
        self._bvh.place(MOVERS, boxes, rows, capacity=self.instance_count)
        return boxes

    def _upload_meshes(self) -> None:
        if not self._mesh_arrays_are_stale:
            return
        meshes, rooms = self._meshes, tuple(room.size for room in self._transient.rooms)
        groups = [*self._groups, MeshGroup(rooms, 0)] if rooms else self._groups
        vertex_counts = np.array([len(mesh.positions) for group in groups for mesh in group.meshes], np.int64)
        copies = np.array([len(BLOCKS) if row in self._deforming else 1 for row in range(len(vertex_counts))], np.int64)
        self._first_vertices = np.cumsum([0, *(vertex_counts * copies)])
        arrays, first_colors = self._arrays, self._arrays.write_meshes(groups, self._first_vertices, copies)
        self._transient.clear(self._first_vertices[len(meshes) : -1].tolist(), self._first_triangles[-1])
        self.vertex_position, self.vertex_normal = arrays.vertex_position.array, arrays.vertex_normal.array
        self.vertex_uv, self.triangle_vertices = arrays.vertex_uv.array, arrays.triangle_vertices.array
        self.triangle_material, self.triangle_part = arrays.triangle_material.array, arrays.triangle_part.array
        entries = [blas.entry for blas in self._blas]
        self._parts = self._bvh.parts(self._blas)
        self._mesh_is_empty = np.array([blas.empty for blas in self._blas], bool)
        self._boxes = np.array([[blas.box for blas in self._blas]] * 3).reshape(3, -1, 2, 3)
        for row, deforming in self._deforming.items():
            entries[row] = deforming.blas[CURRENT].entry
            self._mesh_is_empty[row] = deforming.blas[CURRENT].empty
            self._parts.entries[row] = 0
            deforming.invalidate()
        colors, links = first_colors - 3 * self._first_vertices[:-1], [mesh.link_class for mesh in meshes]
        flags = [attribute_flags(mesh) for mesh in meshes]
        columns = [entries, self._first_triangles[:-1], flags, np.where(copies > 1, vertex_counts, 0), colors, links]
        self._mesh_table = np.array([each[: len(meshes)] for each in columns], np.int32).T.reshape(-1, 6)
        self._mesh_arrays_are_stale = False

    def _upload_instances(self, moved: bool = True) -> None:
        """Upload what is placed; moved: whether matrices differ from those that are there."""
        placement, count = self.placement, len(self.placement.mesh)
        mirrored = np.where(placement.present, self._determinant, 0.0).min(axis=0) < 0.0
        rows_at = partial(info_rows, placement, self._mesh_table, self._parts.entries, mirrored)
        info = rows_at(CURRENT)
        if count != self.instance_count or self.instance_info is None:
            rows = max(count, 1)
            self.instance_info = device_array(ti.i32, (rows, INFO_COLUMNS))
            self.world_from_instance, self.instance_from_world = (device_array(ti.f32, (3, rows, 12)) for _ in range(2))
            self.box_from_instance = device_array(ti.f32, (rows, 12))
        self.instance_count = count
        self._info_at = {}
        if count and (self._deforming or placement.color_varies):
            for time in (PREVIOUS, NEXT):
                then = rows_at(time)
                for row, deforming in self._deforming.items():
                    then[placement.mesh == row, INFO_BLAS] = deforming.blas[time].entry
                self._info_at[time] = upload(then)
        if not count:
            return
        values, on_card = [info], self.traversal == "bvh2"
        if moved or on_card:
            matrices = placement.world_from_object, self._inverse, placement.box_from_object
            values += [each.astype(np.float32) for each in matrices]
        if on_card:
            self._pending = values
            return
        for array, each in zip(self._instance_arrays(), values, strict=False):
            array.from_numpy(each.reshape(array.shape))
