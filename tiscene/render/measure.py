"""Boxes and pixel counts of a frame's objects, each computed when it is first asked for.

A frame may be looked at long after the stream has moved on: what is needed of that moment (placement and cameras) is
kept, and the scene is placed anew for the measurement. Every render places the scene first, so no other frame notices.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tiscene.camera import quaternion_from_matrix
from tiscene.render.integrators.labels import LabelPass
from tiscene.render.intersect import occluded_by_instance
from tiscene.render.measure_kernels import (
    BEHIND,
    BOX,
    COLUMNS,
    EXTENT_COLUMNS,
    IN_FRONT,
    OWNER,
    ROWS,
    STRIDE,
    WINDOW,
    WORLD,
    X,
    Y,
    measure_extents,
    pixel_rays,
)
from tiscene.render.objects import ObjectState, ObjectTable, OrientedBox
from tiscene.render.ray_arrays import AnyHitArrays
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, Placement

MAX_SAMPLES = 65536  # pixels of one object, outside of the picture
_BATCH = 1 << 18  # rays
_FARTHEST = 1e7  # px; where the projection of a point on the near plane may end up


@dataclass(frozen=True, eq=False)
class Measured:
    """Measures (see tiscene.render.objects) that have been taken: what is left of SceneMeasures in a pickle."""

    visible_pixels: NDArray[np.int64]
    visible_box: NDArray[np.float64]
    amodal_box: NDArray[np.float64]
    world_bounds: NDArray[np.float64]
    box_3d: list[OrientedBox]
    amodal_pixels: NDArray[np.int64]
    pixels_in_frame: NDArray[np.int64]


def object_table(scene: DeviceScene, placement: Placement, view: View, states: Sequence[ObjectState]) -> ObjectTable:
    """The rows of `frame.objects`. states: the objects alive at the frame, as its world tells."""
    ids = np.array([state.id for state in states], np.int32)
    return ObjectTable(states, SceneMeasures(scene, placement, view, ids))


class SceneMeasures:
    """Measures (see tiscene.render.objects) of what a scene showed in a view."""

    def __init__(self, scene: DeviceScene, placement: Placement, view: View, ids: NDArray[np.int32]) -> None:
        """ids: the objects to measure, one row each. placement: what the frame showed."""
        self._scene = scene
        self._placement = placement
        self._view = view
        self._ids = np.asarray(ids, np.int32)

    def __reduce__(self) -> tuple[type[Measured], tuple[object, ...]]:
        """Device arrays cannot leave the process: a copy or pickle takes the measures and forgets the scene."""
        return Measured, tuple(getattr(self, field.name) for field in fields(Measured))

    @cached_property
    def _parts(self) -> list[NDArray[np.int64]]:
        """For each object the rows of its instances."""
        placed = self._placement
        present = placed.present[CURRENT]
        return [np.flatnonzero((placed.instance_id == id) & present) for id in self._ids]

    def _vertices(self, instance: int) -> NDArray[np.float64]:
        """The vertices of an instance, [n, 3], m, world."""
        matrix = self._placement.world_from_object[CURRENT, instance]
        mesh = self._scene.meshes[self._placement.mesh[instance]]
        positions = mesh.positions
        if mesh.deformation is not None:
            positions = mesh.deformation.at(self._placement.seconds[CURRENT])[0]
        world: NDArray[np.float64] = positions @ matrix[:, :3].T + matrix[:, 3]
        return world

    @cached_property
    def _instance_image(self) -> NDArray[np.int32]:
        self._scene.place(self._placement, (CURRENT,))
        # Traced again, so that the buffers handed out may be written to, or never have been asked for.
        return LabelPass(self._scene).render(self._view, ("instance",))["instance"]

    @cached_property
    def visible_pixels(self) -> NDArray[np.int64]:
        """int64 [n]."""
        ids, counts = np.unique(self._instance_image, return_counts=True)
        found = dict(zip(ids.tolist(), counts.tolist(), strict=True))
        return np.array([found.get(id, 0) for id in self._ids.tolist()], np.int64)

    @cached_property
    def visible_box(self) -> NDArray[np.float64]:
        """float64 [n, 4], px; nan where nothing is visible."""
        boxes = np.full((len(self._ids), 4), np.nan)
        image = self._instance_image
        y, x = np.nonzero(image)
        order = np.argsort(image[y, x], kind="stable")
        y, x, ids = y[order], x[order], image[y, x][order]
        first = np.searchsorted(ids, self._ids)
        last = np.searchsorted(ids, self._ids, side="right")
        rows = np.flatnonzero(last > first)
        if len(rows):
            ends = np.stack([first[rows], last[rows] - 1], axis=1).ravel()
            boxes[rows, 1], boxes[rows, 3] = y[ends[::2]], y[ends[1::2]] + 1
            spans = np.stack([first[rows], last[rows]], axis=1).ravel()
            boxes[rows, 0] = np.minimum.reduceat(np.append(x, 0), spans)[::2]
            boxes[rows, 2] = np.maximum.reduceat(np.append(x, 0), spans)[::2] + 1
        return boxes

    @cached_property
    def world_bounds(self) -> NDArray[np.float64]:
        """float64 [n, 2, 3], m; nan for an object without geometry."""
        bounds = np.full((len(self._ids), 2, 3), np.nan)
        for row, parts in enumerate(self._parts):
            boxes = self._extents[parts, WORLD : WORLD + 6].reshape(-1, 2, 3)
            if (boxes[:, 0] <= boxes[:, 1]).any():
                bounds[row] = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        return bounds

    @cached_property
    def _extents(self) -> NDArray[np.float64]:
        """float64 [i, 12], what `measure_extents` says of each instance; nothing where it is no part of an object."""
        scene, placed, view = self._scene, self._placement, self._view
        every = np.concatenate([np.zeros(0, np.int64), *self._parts])
        if scene.deforms:
            scene.place(placed, (CURRENT,))
        rows = [scene.vertex_rows(mesh) for mesh in range(len(scene.meshes))]
        ends = np.array([[each.start, each.stop] for each in rows], np.int32).reshape(-1, 2)
        vertices = ends[placed.mesh[every]]
        found = np.zeros((len(every), EXTENT_COLUMNS))
        if len(every):
            measure_extents(
                scene.vertex_position, vertices, placed.world_from_object[CURRENT, every].reshape(-1, 12),
                view.camera_from_world()[CURRENT].ravel(), view.current.near, float(view.focal_lengths()[CURRENT]),
                0.5 * view.width, 0.5 * view.height, found,
            )  # fmt: skip
        extents = np.zeros((len(placed.mesh), EXTENT_COLUMNS))
        extents[every] = found
        return extents

    @cached_property
    def box_3d(self) -> list[OrientedBox]:
        """The boxes that `object_coordinates` are measured in."""
        # All parts share one box; that of the first leads from 0..1 to its mesh and on to the world.
        firsts = np.array([parts[0] if len(parts) else -1 for parts in self._parts], np.int64)
        some = firsts[firsts >= 0]
        box_from_mesh, world_from_mesh = np.zeros((2, len(some), 4, 4))
        box_from_mesh[:, :3] = self._placement.box_from_object[some]
        world_from_mesh[:, :3] = self._placement.world_from_object[CURRENT, some]
        box_from_mesh[:, 3, 3] = world_from_mesh[:, 3, 3] = 1.0
        world_from_box = world_from_mesh @ np.linalg.inv(box_from_mesh)
        edges = world_from_box[:, :3, :3]
        sizes = np.linalg.norm(edges, axis=1)
        centres = world_from_box[:, :3] @ (0.5, 0.5, 0.5, 1.0)
        rotations = _rotations_of(edges)
        nothing = (np.nan,) * 3
        boxes = [OrientedBox(nothing, nothing, (1.0, 0.0, 0.0, 0.0))] * len(firsts)
        for row, centre, size, rotation in zip(np.flatnonzero(firsts >= 0), centres, sizes, rotations, strict=True):
            boxes[row] = OrientedBox(tuple(centre.tolist()), tuple(size.tolist()), quaternion_from_matrix(rotation))
        return boxes

    @cached_property
    def _part_boxes(self) -> list[list[tuple[int, NDArray[np.float64], bool]]]:
        """For each object, of each part in sight: its row, its box in the picture, whether it reaches behind the near
        plane."""
        result = []
        for parts in self._parts:
            boxes = []
            for part in parts.tolist():
                cut = bool(self._extents[part, BEHIND])
                if self._extents[part, IN_FRONT]:
                    box = self._box_in_front(part) if cut else self._extents[part, BOX : BOX + 4]
                    boxes.append((part, np.clip(box, -_FARTHEST, _FARTHEST), cut))
            result.append(boxes)
        return result

    def _box_in_front(self, instance: int) -> NDArray[np.float64]:
        """The box in the picture, px, of what an instance shows beyond the near plane, which goes through it."""
        matrix = self._view.camera_from_world()[CURRENT]
        points = self._vertices(instance) @ matrix[:, :3].T + matrix[:, 3]
        near = self._view.current.near
        inside = points[:, 2] >= near
        triangles = self._scene.meshes[self._placement.mesh[instance]].triangles
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        edges = edges[inside[edges[:, 0]] != inside[edges[:, 1]]]
        a, b = points[edges[:, 0]], points[edges[:, 1]]
        share = (near - a[:, 2]) / (b[:, 2] - a[:, 2])
        points = np.concatenate([points[inside], a + share[:, None] * (b - a)])
        centre = 0.5 * self._view.width, 0.5 * self._view.height
        pixels = points[:, :2] / points[:, 2:] * self._view.focal_lengths()[CURRENT] + centre
        return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])

    @cached_property
    def amodal_box(self) -> NDArray[np.float64]:
        """float64 [n, 4], px; nan where nothing is in front of the near plane."""
        boxes = np.full((len(self._ids), 4), np.nan)
        for row, parts in enumerate(self._part_boxes):
            if parts:
                every = np.stack([box for _, box, _ in parts])
                boxes[row] = *every[:, :2].min(axis=0), *every[:, 2:].max(axis=0)
        return boxes

    @cached_property
    def _counts(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Pixels of each object if it were alone: in the picture, and outside of it."""
        count = len(self._ids)
        inside, outside = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self._scene.place(self._placement, (CURRENT,))
        several = np.array([len(parts) > 1 for parts in self._part_boxes], bool)
        for windows in self._batches():
            samples = self._hits(windows)
            place = samples[:, [X, Y]]
            within = ((place >= 0) & (place < (self._view.width, self._view.height))).all(axis=1)
            owner = windows[samples[:, WINDOW], OWNER]
            pixels = windows[samples[:, WINDOW], STRIDE].astype(np.int64) ** 2
            # A pixel counts once, however many parts of the object it shows.
            first = ~several[owner]
            others = np.flatnonzero(~first)
            first[others[_distinct(samples[others, X], samples[others, Y], owner[others])]] = True
            inside += _sums(owner[within & first], pixels[within & first], count)
            outside += _sums(owner[~within & first], pixels[~within & first], count)
        return inside, outside

    def _batches(self) -> Iterator[NDArray[np.int32]]:
        """The windows of all objects (see `pixel_rays`), some objects at a time."""
        waiting: list[tuple[int, ...]] = []
        size = 0
        for row, parts in enumerate(self._part_boxes):
            windows = self._windows(row, parts)
            waiting += windows
            size += sum(window[COLUMNS] * window[ROWS] for window in windows)
            if size >= _BATCH or (row + 1 == len(self._ids) and size):
                yield np.array(waiting, np.int32)
                waiting, size = [], 0

    def _windows(self, row: int, parts: list[tuple[int, NDArray[np.float64], bool]]) -> list[tuple[int, ...]]:
        """The pixels that decide an object's count.

        Those in the picture all, at stride 1; outside of it every s-th in both axes, s so that they fit the budget.
        """
        width, height = self._view.width, self._view.height
        windows, around = [], []
        for part, box, cut in parts:
            # A pixel more on each side: the boxes are of exact projections, the rays of rounded directions.
            x0, y0 = (math.floor(v) - 1 for v in box[:2].tolist())
            x1, y1 = (math.ceil(v) + 1 for v in box[2:].tolist())
            around.append((part, x0, y0, x1, y1))
            if cut:  # what lies between the camera and its near plane may appear anywhere
                x0, y0, x1, y1 = 0, 0, width, height
            x0, y0 = max(x0, 0), max(y0, 0)
            windows.append((part, row, x0, y0, min(x1, width) - x0, min(y1, height) - y0, 1, 0))
        area = sum((x1 - x0) * (y1 - y0) for _, x0, y0, x1, y1 in around)
        stride = max(1, math.ceil(math.sqrt(area / MAX_SAMPLES)))
        for part, x0, y0, x1, y1 in around:
            if x0 < 0 or y0 < 0 or x1 > width or y1 > height:
                x0, y0 = -(-x0 // stride) * stride, -(-y0 // stride) * stride
                windows.append((part, row, x0, y0, -((x0 - x1) // stride), -((y0 - y1) // stride), stride, 1))
        return [window for window in windows if window[COLUMNS] > 0 and window[ROWS] > 0]

    def _hits(self, windows: NDArray[np.int32]) -> NDArray[np.int32]:
        """int32 [n, 3], x, y and window of the pixels at whose centre a ray meets the window's instance."""
        firsts = np.cumsum([0, *(windows[:, COLUMNS] * windows[:, ROWS])]).astype(np.int32)
        count = int(firsts[-1])
        samples = np.empty((count, 3), np.int32)
        wave = AnyHitArrays(count)
        pixel_rays(
            self._view.array(), windows, firsts, self._view.width, self._view.height, samples, wave.rays, wave.targets
        )
        occluded_by_instance(self._scene, CURRENT, wave.rays, wave.queue, wave.targets, count, wave.result)
        met: NDArray[np.int32] = samples[wave.result.to_numpy()[:count] > 0]
        return met

    @cached_property
    def pixels_in_frame(self) -> NDArray[np.int64]:
        """int64 [n]: pixels in the picture if the object were alone."""
        return self._counts[0]

    @cached_property
    def amodal_pixels(self) -> NDArray[np.int64]:
        """int64 [n]: pixels if the object were alone on a picture without edges."""
        return self._counts[0] + self._counts[1]


def _distinct(x: NDArray[np.int32], y: NDArray[np.int32], owner: NDArray[np.int32]) -> NDArray[np.int64]:
    """The row of one sample for each pixel of each object."""
    order = np.lexsort((x, y, owner))
    places = np.stack([x[order], y[order], owner[order]])
    first = np.ones(len(order), bool)
    first[1:] = (places[:, 1:] != places[:, :-1]).any(axis=0)
    return order[first]


def _sums(rows: NDArray[np.int32], values: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """The sum of the values of each row."""
    return np.bincount(rows, values, count).astype(np.int64)  # doubles count exactly far beyond any picture


def _rotations_of(edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotations whose axes are nearest to the columns of matrices [n, 3, 3] (polar factors), never mirrored."""
    left, _, right = np.linalg.svd(edges / np.maximum(np.linalg.norm(edges, axis=1, keepdims=True), 1e-30))
    left[np.linalg.det(left @ right) < 0.0, :, 2] *= -1.0
    rotations: NDArray[np.float64] = left @ right
    return rotations
