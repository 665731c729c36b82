# SPDX-License-Identifier: Apache-2.0
"""Boxes and pixel counts of a frame's objects, computed on first access.

A frame may be read long after the stream has advanced: its placement and cameras are kept, and the scene is placed
again for the measurement. Every render places the scene first, so that other frames are not affected. A frame may also
outlive the scene, which is then made again from its descriptions: measuring every frame that is kept when a stream
closes would take longer, and to keep their scenes would fill the device.

Measurements that do not depend on occluders are cached by view and object: static objects in front of a static camera
are measured once.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from dynamics.lru_cache import LRUCache
from dynamics.rotation import matrix_from_quaternion
from tiscene.device import runtime
from tiscene.frame.measurements import AmodalMask, OrientedBox, StoredMeasurements
from tiscene.frame.object_table import ObjectState, ObjectTable
from tiscene.render.annotations.amodal_masks import PartInView, PixelCounter
from tiscene.render.annotations.measured_property import Measured
from tiscene.render.annotations.measurement_kernels import (
    BEHIND,
    BOX,
    CLIP,
    EXTENT_COLUMNS,
    IN_FRONT,
    WORLD,
    measure_extents,
)
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.view import View
from tiscene.scene.assembly import MIN_EXTENT
from tiscene.scene.camera import Camera
from tiscene.scene.description import SceneDescription
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, Placement

KEPT_VIEWS = 4
_MAX_COORDINATE = 1e7  # px, of projections of points near the camera's plane
_NO_BOX = OrientedBox((np.nan,) * 3, (np.nan,) * 3, (1.0, 0.0, 0.0, 0.0))


@dataclass(eq=False)
class _CachedMeasurements:
    """Cached measurements of one object in one view.

    Attributes:
        signature: All inputs they depend on.
        world_bounds: float64 [2, 3], m.
        parts: Its instances in view.
        amodal_mask: None until it is needed.
    """

    signature: bytes
    world_bounds: NDArray[np.float64]
    parts: list[PartInView]
    amodal_mask: AmodalMask | None = None

    @property
    def amodal_box(self) -> NDArray[np.float64]:
        """float64 [4], px, around all parts."""
        every = np.array([part.box for part in self.parts]).reshape(-1, 4)
        return np.concatenate([every[:, :2].min(axis=0), every[:, 2:].max(axis=0)])


class _Instruments:
    """What measures on the device.

    Attributes:
        scene: The scene.
        labels: Renders `instance` where a frame has no such buffer.
        pixels: Computes amodal masks.
    """

    def __init__(self, scene: DeviceScene) -> None:
        self.scene = scene
        self.labels = LabelPass(scene)
        self.pixels = PixelCounter(scene)


class Measurer:
    """Measures objects of a scene's frames.

    Args:
        scene: The scene.
    """

    def __init__(self, scene: DeviceScene) -> None:
        self._instruments: _Instruments | None = _Instruments(scene)
        self._descriptions: Sequence[SceneDescription] = ()
        self._caches: LRUCache[tuple[Camera, int, int], dict[int, _CachedMeasurements]] = LRUCache(KEPT_VIEWS)

    @property
    def instruments(self) -> _Instruments:
        """What measures; after `close` made again, in place of what was made so for other frames."""
        if self._instruments is not None and self._instruments.scene.is_unfinished:
            self.close()
        if self._instruments is None:
            for other in list(_reopened):
                other.close()
            scene = DeviceScene()
            for description in self._descriptions:
                scene.add(description)
            self._instruments = _Instruments(scene)
            _reopened.add(self)
        return self._instruments

    def close(self) -> None:
        """Let go of the scene, and of all that is on the device."""
        with runtime.ONE_THREAD:  # not in the middle of a measurement
            if self._instruments is not None:
                self._descriptions = [description for _, description in self._instruments.scene.descriptions]
            self._instruments = None
            _reopened.discard(self)

    def table(
        self,
        placement: Placement,
        view: View,
        states: Sequence[ObjectState],
        instance: NDArray[np.int32] | None = None,
    ) -> ObjectTable:
        """Return the table of `frame.objects`.

        Args:
            placement: Of the frame.
            view: Of the frame.
            states: The objects alive at the frame.
            instance: The frame's buffer of that name, int32 [h, w]; None: rendered when needed.
        """
        # A copy: users may write to the frame's buffers.
        return ObjectTable(
            states, SceneMeasures(self, placement, view, states, None if instance is None else instance.copy())
        )

    def cache_of(self, view: View) -> dict[int, _CachedMeasurements]:
        """Return the cache of a view, by object id, which the caller updates."""
        return self._caches.get((view.current, view.width, view.height), dict)


_reopened: weakref.WeakSet[Measurer] = weakref.WeakSet()  # the one whose scene was made again, if frames hold it


class SceneMeasures:
    """ObjectMeasurements (see `tiscene.frame.measurements`) of a scene in a view."""

    def __init__(
        self,
        measurer: Measurer,
        placement: Placement,
        view: View,
        states: Sequence[ObjectState],
        instance: NDArray[np.int32] | None,
    ) -> None:
        """Hold the frame.

        Args:
            measurer: Of the scene.
            placement: Of the frame.
            view: Of the frame.
            states: The objects, one row each.
            instance: The frame's buffer, int32 [h, w]; None: rendered when needed.
        """
        self._measurer = measurer
        self._placement = placement
        self._view = view
        self._states = states
        self._ids = np.array([state.id for state in states], np.int32)
        self._instance = instance

    @property
    def _scene(self) -> DeviceScene:
        return self._measurer.instruments.scene

    def __reduce__(self) -> tuple[type[StoredMeasurements], tuple[object, ...]]:
        """Pickle and copy as StoredMeasurements, since device arrays cannot leave the process."""
        return StoredMeasurements, tuple(getattr(self, field.name) for field in fields(StoredMeasurements))

    @Measured
    def _visible(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Visible pixels [n] and the boxes around them [n, 4]."""
        image = self._instance
        if image is None:
            self._scene.place(self._placement, (CURRENT,))
            image = self._measurer.instruments.labels.render(self._view, ("instance",))["instance"]
        height, width = image.shape
        order = np.argsort(self._ids)
        # Runs of equal ids in a line.
        begins = np.ones((height, width), bool)
        begins[:, 1:] = image[:, 1:] != image[:, :-1]
        first = np.flatnonzero(begins)
        length = np.diff(np.append(first, height * width))
        ids = image.ravel()[first]
        rows = np.searchsorted(self._ids[order], ids)
        mine = (ids > 0) & (rows < len(order))
        mine[mine] = self._ids[order[rows[mine]]] == ids[mine]
        rows, first, length = order[rows[mine]], first[mine], length[mine]
        y, x = np.divmod(first, width)
        count = len(order)
        boxes = np.empty((4, count))
        boxes[:2], boxes[2:] = np.inf, -np.inf
        for corner, value, extreme in (
            (0, x, np.minimum),
            (1, y, np.minimum),
            (2, x + length, np.maximum),
            (3, y + 1, np.maximum),
        ):
            extreme.at(boxes[corner], rows, value.astype(np.float64))
        pixels = np.bincount(rows, length, count).astype(np.int64)
        return pixels, np.where(pixels[:, None] > 0, boxes.T, np.nan)

    @property
    def visible_pixels(self) -> NDArray[np.int64]:
        """int64 [n]."""
        return self._visible[0]

    @property
    def visible_box(self) -> NDArray[np.float64]:
        """float64 [n, 4], px; nan where nothing is visible."""
        return self._visible[1]

    @Measured
    def _parts(self) -> list[NDArray[np.int64]]:
        """Rows of each object's instances."""
        placed = self._placement
        present = np.flatnonzero(placed.present[CURRENT])
        present = present[np.argsort(placed.instance_id[present], kind="stable")]
        ids = placed.instance_id[present]
        first, last = np.searchsorted(ids, self._ids), np.searchsorted(ids, self._ids, side="right")
        return [present[a:b] for a, b in zip(first.tolist(), last.tolist(), strict=True)]

    def _signatures(self, objects: Sequence[int]) -> list[bytes]:
        """Return all inputs of the measurements of some objects in a view, as bytes."""
        placed = self._placement
        count = len(placed.mesh)
        poses, boxes = placed.world_from_object[CURRENT].reshape(count, 12), placed.box_from_object.reshape(count, 12)
        inputs = placed.mesh[:, None], poses, boxes, *(() if placed.color is None else (placed.color[CURRENT],))
        rows = np.hstack([np.ascontiguousarray(each).view(np.uint8) for each in inputs])
        data, width = rows.tobytes(), rows.shape[1]
        every = [self._parts[row] for row in objects]
        signatures = [b"".join([data[row * width : (row + 1) * width] for row in parts.tolist()]) for parts in every]
        changing = self._scene.changing_meshes()
        if changing.any():
            now = repr(placed.seconds[CURRENT]).encode()
            for number, parts in enumerate(every):
                if changing[placed.mesh[parts]].any():
                    signatures[number] += now
        return signatures

    @Measured
    def _objects(self) -> list[_CachedMeasurements]:
        """Measurements of each object; those missing in the cache are made."""
        return self._measured(range(len(self._ids)))

    def _measured(self, rows: Sequence[int]) -> list[_CachedMeasurements]:
        """Return the measurements of the objects in some rows; those missing in the cache are made."""
        known, present = self._measurer.cache_of(self._view), self._ids.tolist()
        for gone in known.keys() - set(present):
            del known[gone]
        ids = [present[row] for row in rows]
        new = {
            id: (row, signature)
            for id, row, signature in zip(ids, rows, self._signatures(rows), strict=True)
            if id not in known or known[id].signature != signature
        }
        known.update(zip(new, self._measure(*zip(*new.values(), strict=True)) if new else (), strict=True))
        return [known[id] for id in ids]

    def _measure(self, rows: Sequence[int], signatures: Sequence[bytes]) -> list[_CachedMeasurements]:
        """Measure the objects in some rows, whose signatures these are."""
        parts = [self._parts[row] for row in rows]
        extents = self._extents(np.concatenate([np.zeros(0, np.int64), *parts]))
        ends = np.cumsum([0, *(len(each) for each in parts)])
        result = []
        for number, signature in enumerate(signatures):
            mine = extents[ends[number] : ends[number + 1]]
            corners = mine[:, WORLD : WORLD + 6].reshape(-1, 2, 3)
            bounds = np.full((2, 3), np.nan)
            if (corners[:, 0] <= corners[:, 1]).any():
                bounds = np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])
            in_view = []
            for place, (instance, extent) in enumerate(zip(parts[number].tolist(), mine, strict=True)):
                cut = bool(extent[BEHIND])
                if extent[IN_FRONT]:
                    window = self._box_in_front(instance, extent[CLIP]) if cut else extent[BOX : BOX + 4]
                    in_view.append(PartInView(place, np.clip(window, -_MAX_COORDINATE, _MAX_COORDINATE), cut))
            result.append(_CachedMeasurements(signature, bounds, in_view))
        return result

    def _extents(self, instances: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return `measure_extents` of instances, float64 [i, EXTENT_COLUMNS]."""
        scene, placed, view = self._scene, self._placement, self._view
        found = np.zeros((len(instances), EXTENT_COLUMNS))
        if not len(instances):
            return found
        if scene.deforms:
            scene.place(placed, (CURRENT,))
        rows = [scene.vertex_rows(mesh) for mesh in placed.mesh[instances].tolist()]
        measure_extents(
            scene.vertex_position, np.array([[each.start, each.stop] for each in rows], np.int32),
            placed.world_from_object[CURRENT, instances].reshape(-1, 12),
            view.camera_from_world()[CURRENT].ravel(), view.current.near, float(view.focal_lengths()[CURRENT]),
            int(view.orthographic), 0.5 * view.width, 0.5 * view.height, found,
        )  # fmt: skip
        return found

    def _box_in_front(self, instance: int, near: float) -> NDArray[np.float64]:
        """Return the image-space box, px, of an instance clipped at a depth, m."""
        placed, camera = self._placement, self._view.camera_from_world()[CURRENT]
        mesh = self._scene.meshes[placed.mesh[instance]]
        positions = mesh.positions
        if mesh.deformation is not None:
            positions = mesh.deformation.at(placed.seconds[CURRENT])[0]
        matrix = placed.world_from_object[CURRENT, instance]
        points = (positions @ matrix[:, :3].T + matrix[:, 3]) @ camera[:, :3].T + camera[:, 3]
        inside = points[:, 2] >= near
        edges = np.concatenate([mesh.triangles[:, [0, 1]], mesh.triangles[:, [1, 2]], mesh.triangles[:, [2, 0]]])
        edges = edges[inside[edges[:, 0]] != inside[edges[:, 1]]]
        a, b = points[edges[:, 0]], points[edges[:, 1]]
        fraction = (near - a[:, 2]) / (b[:, 2] - a[:, 2])
        points = np.concatenate([points[inside], a + fraction[:, None] * (b - a)])
        center = 0.5 * self._view.width, 0.5 * self._view.height
        depths = np.ones((len(points), 1)) if self._view.orthographic else points[:, 2:]
        pixels = points[:, :2] / depths * self._view.focal_lengths()[CURRENT] + center
        return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])

    @Measured
    def world_bounds(self) -> NDArray[np.float64]:
        """float64 [n, 2, 3], m; nan for an object without geometry."""
        return np.array([each.world_bounds for each in self._objects]).reshape(-1, 2, 3)

    @Measured
    def box_3d(self) -> list[OrientedBox]:
        """Oriented boxes in which `object_coordinates` are measured."""
        return [
            _oriented_box(state) if len(parts) else _NO_BOX
            for state, parts in zip(self._states, self._parts, strict=True)
        ]

    @Measured
    def amodal_box(self) -> NDArray[np.float64]:
        """float64 [n, 4], px; nan where nothing is in front of the camera."""
        boxes = [each.amodal_box if each.parts else (np.nan,) * 4 for each in self._objects]
        return np.array(boxes, np.float64).reshape(-1, 4)

    @Measured
    def amodal_masks(self) -> list[AmodalMask]:
        """Amodal mask of each object."""
        return self._masks(range(len(self._ids)), self._objects)

    def _masks(self, rows: Sequence[int], objects: Sequence[_CachedMeasurements]) -> list[AmodalMask]:
        """Return the amodal masks of the objects in some rows, given their measurements, which then have them."""
        new = [(row, each) for row, each in zip(rows, objects, strict=True) if each.amodal_mask is None]
        if new:
            self._scene.place(self._placement, (CURRENT,))
            parts = [[part.of(self._parts[row]) for part in each.parts] for row, each in new]
            for (_, each), mask in zip(new, self._measurer.instruments.pixels.count(self._view, parts), strict=True):
                each.amodal_mask = mask
        return [each.amodal_mask for each in objects if each.amodal_mask is not None]

    @runtime.one_thread_at_a_time
    def amodal_counts(self, rows: Sequence[int]) -> NDArray[np.int64]:
        """Return `pixels_in_frame` and `amodal_pixels` of some rows: int64 [n, 2]; others are not measured."""
        rows = list(rows)
        masks = self._masks(rows, self._measured(rows))
        return np.array([(each.inside, each.inside + each.outside) for each in masks], np.int64).reshape(-1, 2)

    @Measured
    def pixels_in_frame(self) -> NDArray[np.int64]:
        """int64 [n]: pixels of the amodal mask inside the image."""
        return np.array([each.inside for each in self.amodal_masks], np.int64)

    @Measured
    def amodal_pixels(self) -> NDArray[np.int64]:
        """int64 [n]: pixels of the amodal mask on an unbounded image; subsampled outside."""
        return np.array([each.inside + each.outside for each in self.amodal_masks], np.int64)

    def amodal_mask(self, row: int) -> NDArray[np.bool_]:
        """Return the pixels in the image that an object would cover without occluders: bool [h, w]."""
        return self.amodal_masks[row].mask()


def _oriented_box(state: ObjectState) -> OrientedBox:
    """Return the box of an object, from its pose."""
    low, high = np.array(state.box)
    center = matrix_from_quaternion(state.rotation) @ (0.5 * (low + high)) + state.position
    x, y, z = center.tolist()
    width, height, depth = np.maximum(high - low, MIN_EXTENT).tolist()
    return OrientedBox((x, y, z), (width, height, depth), state.rotation)
