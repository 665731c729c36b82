"""Boxes and pixel counts of a frame's objects, each computed when it is first asked for.

A frame may be looked at long after the stream has moved on: what is needed of that moment (placement and cameras) is
kept, and the scene is placed anew for the measurement. Every render places the scene first, so no other frame notices.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tiscene.camera import quaternion_from_matrix
from tiscene.render.integrators.labels import LabelPass
from tiscene.render.intersect import occluded_by_instance
from tiscene.render.measure_kernels import pixel_rays
from tiscene.render.objects import ObjectState, ObjectTable, OrientedBox
from tiscene.render.ray_arrays import AnyHitArrays
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, Placement

MAX_SAMPLES = 65536  # pixels of one object, outside of the picture
_BATCH = 1 << 18  # rays
X, Y, INSTANCE, OWNER, STRIDE = 0, 1, 2, 3, 4  # columns of samples
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
        positions = self._scene.meshes[self._placement.mesh[instance]].positions
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
        for row in np.flatnonzero(last > first):
            own = slice(first[row], last[row])
            boxes[row] = x[own].min(), y[own].min(), x[own].max() + 1, y[own].max() + 1
        return boxes

    @cached_property
    def world_bounds(self) -> NDArray[np.float64]:
        """float64 [n, 2, 3], m; nan for an object without geometry."""
        bounds = np.full((len(self._ids), 2, 3), np.nan)
        for row, parts in enumerate(self._parts):
            vertices = [self._vertices(part) for part in parts]
            if sum(map(len, vertices)):
                every = np.concatenate(vertices)
                bounds[row] = every.min(axis=0), every.max(axis=0)
        return bounds

    @cached_property
    def box_3d(self) -> list[OrientedBox]:
        """The boxes that `object_coordinates` are measured in."""
        return [self._oriented_box(parts) for parts in self._parts]

    def _oriented_box(self, parts: NDArray[np.int64]) -> OrientedBox:
        if len(parts) == 0:
            nothing = (np.nan,) * 3
            return OrientedBox(nothing, nothing, (1.0, 0.0, 0.0, 0.0))
        # All parts share one box; that of the first leads from 0..1 to its mesh and on to the world.
        box_from_mesh, world_from_mesh = np.eye(4), np.eye(4)
        box_from_mesh[:3] = self._placement.box_from_object[parts[0]]
        world_from_mesh[:3] = self._placement.world_from_object[CURRENT, parts[0]]
        world_from_box = world_from_mesh @ np.linalg.inv(box_from_mesh)
        edges = world_from_box[:3, :3]
        size = np.linalg.norm(edges, axis=0)
        centre = world_from_box[:3] @ (0.5, 0.5, 0.5, 1.0)
        return OrientedBox(tuple(centre.tolist()), tuple(size.tolist()), quaternion_from_matrix(_rotation_of(edges)))

    @cached_property
    def _part_boxes(self) -> list[list[tuple[int, NDArray[np.float64], bool]]]:
        """For each object, of each part in sight: its row, its box in the picture, whether it reaches behind the near
        plane."""
        result = []
        for parts in self._parts:
            boxes = []
            for part in parts.tolist():
                points, cut = self._in_front(part)
                if len(points):
                    pixels = np.clip(self._project(points), -_FARTHEST, _FARTHEST)
                    boxes.append((part, np.concatenate([pixels.min(axis=0), pixels.max(axis=0)]), cut))
            result.append(boxes)
        return result

    def _in_front(self, instance: int) -> tuple[NDArray[np.float64], bool]:
        """Points in camera coordinates that span what an instance shows beyond the near plane; whether it was cut."""
        matrix = self._view.camera_from_world()[CURRENT]
        points = self._vertices(instance) @ matrix[:, :3].T + matrix[:, 3]
        near = self._view.current.near
        inside = points[:, 2] >= near
        if inside.all():
            return points, False
        triangles = self._scene.meshes[self._placement.mesh[instance]].triangles
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        edges = edges[inside[edges[:, 0]] != inside[edges[:, 1]]]
        a, b = points[edges[:, 0]], points[edges[:, 1]]
        share = (near - a[:, 2]) / (b[:, 2] - a[:, 2])
        return np.concatenate([points[inside], a + share[:, None] * (b - a)]), True

    def _project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Camera coordinates to px; whole numbers are corners of pixels."""
        focal = self._view.focal_lengths()[CURRENT]
        pixels: NDArray[np.float64] = points[:, :2] / points[:, 2:] * focal + (
            0.5 * self._view.width,
            0.5 * self._view.height,
        )
        return pixels

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
        for samples in self._batches():
            # A pixel counts once, however many parts of the object it shows.
            seen = _distinct(samples[self._hits(samples)])
            within = ((seen[:, :2] >= 0) & (seen[:, :2] < (self._view.width, self._view.height))).all(axis=1)
            pixels = seen[:, STRIDE].astype(np.int64) ** 2
            inside += _sums(seen[within, OWNER], pixels[within], count)
            outside += _sums(seen[~within, OWNER], pixels[~within], count)
        return inside, outside

    def _batches(self) -> Iterator[NDArray[np.int32]]:
        """The samples of all objects, some objects at a time."""
        waiting: list[NDArray[np.int32]] = []
        for row, parts in enumerate(self._part_boxes):
            waiting.append(self._samples(row, parts))
            if sum(map(len, waiting)) >= _BATCH:
                yield np.concatenate(waiting)
                waiting = []
        if waiting:
            yield np.concatenate(waiting)

    def _samples(self, row: int, parts: list[tuple[int, NDArray[np.float64], bool]]) -> NDArray[np.int32]:
        """The pixels that decide an object's count, int32 [n, 5]: x, y, instance, owner (the object's row), stride.

        Those in the picture all, at stride 1; outside of it every s-th in both axes, s so that they fit the budget.
        """
        width, height = self._view.width, self._view.height
        samples = []
        windows = []
        for part, box, cut in parts:
            # A pixel more on each side: the boxes are of exact projections, the rays of rounded directions.
            low = np.floor(box[:2]).astype(np.int64) - 1
            high = np.ceil(box[2:]).astype(np.int64) + 1
            windows.append((part, low, high))
            if cut:  # what lies between the camera and its near plane may appear anywhere
                low, high = np.zeros(2, np.int64), np.array([width, height])
            samples.append(_lattice(np.maximum(low, 0), np.minimum(high, (width, height)), 1, part, row))
        area = float(sum(np.prod((high - low).astype(np.float64)) for _, low, high in windows))
        stride = max(1, int(np.ceil(np.sqrt(area / MAX_SAMPLES))))
        for part, low, high in windows:
            around = _lattice(-(-low // stride) * stride, high, stride, part, row)
            outside = (around[:, :2] < 0).any(axis=1) | (around[:, :2] >= (width, height)).any(axis=1)
            samples.append(around[outside])
        return np.concatenate([np.zeros((0, 5), np.int32), *samples])

    def _hits(self, samples: NDArray[np.int32]) -> NDArray[np.bool_]:
        """For each sample (x, y, instance) whether the ray through that pixel's centre meets the instance."""
        wave = AnyHitArrays(len(samples))
        pixel_rays(
            self._view.array(), samples, len(samples), self._view.width, self._view.height, wave.rays, wave.targets
        )
        occluded_by_instance(self._scene, CURRENT, wave.rays, wave.queue, wave.targets, len(samples), wave.result)
        hit: NDArray[np.bool_] = wave.result.to_numpy()[: len(samples)] > 0
        return hit

    @cached_property
    def pixels_in_frame(self) -> NDArray[np.int64]:
        """int64 [n]: pixels in the picture if the object were alone."""
        return self._counts[0]

    @cached_property
    def amodal_pixels(self) -> NDArray[np.int64]:
        """int64 [n]: pixels if the object were alone on a picture without edges."""
        return self._counts[0] + self._counts[1]


def _lattice(
    low: NDArray[np.int64], high: NDArray[np.int64], stride: int, instance: int, row: int
) -> NDArray[np.int32]:
    """The points low, low + stride, ... below high in both axes, as samples."""
    x, y = np.meshgrid(np.arange(low[0], high[0], stride), np.arange(low[1], high[1], stride))
    samples = np.empty((x.size, 5), np.int32)
    samples[:, 0] = x.ravel()
    samples[:, 1] = y.ravel()
    samples[:, 2:] = instance, row, stride
    return samples


def _distinct(samples: NDArray[np.int32]) -> NDArray[np.int32]:
    """One sample of each pixel of each object."""
    order = np.lexsort((samples[:, X], samples[:, Y], samples[:, OWNER]))
    samples = samples[order]
    place = samples[:, [X, Y, OWNER]]
    first = np.ones(len(samples), bool)
    first[1:] = (place[1:] != place[:-1]).any(axis=1)
    return samples[first]


def _sums(rows: NDArray[np.int32], values: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """The sum of the values of each row."""
    return np.bincount(rows, values, count).astype(np.int64)  # doubles count exactly far beyond any picture


def _rotation_of(edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotation whose axes are nearest to the columns of a matrix (its polar factor), never a mirror image."""
    left, _, right = np.linalg.svd(edges / np.maximum(np.linalg.norm(edges, axis=0), 1e-30))
    if np.linalg.det(left @ right) < 0.0:
        left = left * (1.0, 1.0, -1.0)
    rotation: NDArray[np.float64] = left @ right
    return rotation
