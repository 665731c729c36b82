# SPDX-License-Identifier: Apache-2.0
"""Cache of the labels of static instances before a static camera: later frames redraw only the pixels that may change.

A pixel changes if the bounding box of a non-static instance may cover it, or if it shows a mirror. The bytes equal
those of drawing the whole image: a ray that hits only static instances finds the same hit whatever else is placed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.lru_cache import LRUCache
from tiscene.render.integrators.labels.coverage import CoverageSamples
from tiscene.render.view import View
from tiscene.scene.affine_maps import corners_of
from tiscene.scene.camera import Camera
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS, Placement

MAX_VIEWS = 4
MAX_PIXELS = 1 << 19  # larger images are not cached: this many take 130 MB with all buffers
ALL_TIMES = PREVIOUS, CURRENT, NEXT
MAX_CHANGED = 0.6  # fraction of the pixels; if more may change, the whole image is drawn
_MARGIN = 1e-3  # relative to a distance; far more than the rounding of rays and boxes


@dataclass(eq=False)
class StaticImage:
    """Labels of the static instances in a view.

    Attributes:
        arrays: Buffers by name, in NumPy or on the device.
        max_distance: float32 [h, w], m; instances beyond cannot change the pixel.
        mirrors: bool [h, w], pixels whose first hit is a mirror.
        samples: Coverage samples, if coverage is among the buffers.
    """

    arrays: dict[str, Any]
    max_distance: NDArray[np.float32]
    mirrors: NDArray[np.bool_]
    samples: CoverageSamples | None


@dataclass(eq=False)
class _ViewRecord:
    """The placement rendered last in a view, the instances static since the first time, and their image."""

    placement: Placement
    static: NDArray[np.bool_]
    image: StaticImage | None = None


class StaticLabelCache:
    """Images of the static instances of a scene, by view.

    Args:
        scene: The scene.
    """

    def __init__(self, scene: DeviceScene) -> None:
        self.scene = scene
        self._records: LRUCache[tuple[Camera, int, int], _ViewRecord] = LRUCache(MAX_VIEWS)

    def lookup(
        self,
        view: View,
        buffers: Iterable[str],
        times: Iterable[int],
        draw: Callable[[View, tuple[str, ...]], StaticImage],
    ) -> tuple[StaticImage, NDArray[np.bool_], NDArray[np.bool_]] | None:
        """Return the image of the static instances and what has to be drawn over it.

        Args:
            view: Camera and image size.
            buffers: Names of the label buffers.
            times: Times at which these buffers need the scene placed. It is placed the same way on return.
            draw: Draws an image of all that is placed.

        Returns:
            The image; bool [h, w], the pixels that may change; bool [n], the instances that are not static. None if
            the whole image has to be drawn: the view is new, changes too much or is too large to cache.
        """
        placement = self.scene.placement
        record = self._update(view, placement)
        if record is None or not record.static.any():
            return None
        if record.image is None or not record.image.arrays.keys() >= set(buffers):
            names = tuple(dict.fromkeys([*(record.image.arrays if record.image else ()), *buffers]))
            self.scene.place(replace(placement, present=placement.present & record.static), ALL_TIMES)
            record.image = draw(view, names)
            self.scene.place(placement, ALL_TIMES)
        changed = self._changed_pixels(view, np.flatnonzero(~record.static), times, record.image)
        if changed.mean() > MAX_CHANGED:
            return None
        return record.image, changed, ~record.static

    def _update(self, view: View, placement: Placement) -> _ViewRecord | None:
        """Update a view's record with a placement; None if the view is new or cannot be cached.

        Instances that have moved are static no more.
        """
        if not view.is_still or view.orthographic or view.width * view.height > MAX_PIXELS:
            return None
        key = view.current, view.width, view.height
        is_new = key not in self._records
        record = self._records.get(key, lambda: _ViewRecord(placement, ~self.scene.changing_meshes()[placement.mesh]))
        static = _unchanged(record.placement, placement, record.static)
        if static.sum() != record.static.sum():
            record.image = None
        record.static = static
        record.placement = placement
        return None if is_new else record

    def _changed_pixels(
        self, view: View, rows: NDArray[np.int64], times: Iterable[int], image: StaticImage
    ) -> NDArray[np.bool_]:
        """Return the pixels that instances may change at any of the times, bool [h, w].

        These are the pixels within the projected boxes of the instances, where the boxes are nearer than
        `max_distance`, and all mirrors if an instance is present at CURRENT.
        """
        placement, boxes = self.scene.placement, self.scene.mesh_boxes
        changed = np.zeros((view.height, view.width), bool)
        for time in times:
            present = placement.present[time, rows]
            if not present.any():
                continue
            if time == CURRENT:
                changed |= image.mirrors
            shown = rows[present]
            matrices = placement.world_from_object[time, shown]
            corners = corners_of(boxes[time, placement.mesh[shown]])
            world = np.einsum("nij,nkj->nki", matrices[:, :, :3], corners) + matrices[:, None, :, 3]
            for here, nearest in boxes_in_view(view, world):
                changed[here] |= image.max_distance[here] >= nearest
        return changed


def boxes_in_view(view: View, corners: NDArray[np.float64]) -> Iterator[tuple[tuple[slice, slice], float]]:
    """Yield rows and columns of the pixels that each visible box may cover at CURRENT, and its least distance, m.

    Args:
        view: The view, in perspective.
        corners: Of the boxes, world, [n, 8, 3], m.
    """
    size = np.array([view.width, view.height])
    camera, focal = view.camera_from_world()[CURRENT], view.focal_lengths()[CURRENT]
    seen = np.einsum("ij,nkj->nki", camera[:, :3], corners) + camera[:, 3]
    nearest = seen[..., 2].min(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = seen[..., :2] / seen[..., 2:] * focal + 0.5 * size
    low, high = np.floor(pixels.min(axis=1)) - 1.0, np.ceil(pixels.max(axis=1)) + 1.0
    crosses_camera_plane = nearest <= _MARGIN  # its projection is unbounded
    low[crosses_camera_plane], high[crosses_camera_plane] = 0.0, size
    low, high = np.clip(low, 0, size).astype(int), np.clip(high, 0, size).astype(int)
    sides = np.concatenate([seen[..., :2], -seen[..., :2]], axis=2) * focal
    sides += seen[..., 2:] * (0.5 * np.concatenate([size, size]) + 1.0)
    visible = (sides.max(axis=1) > 0.0).all(axis=1) & (seen[..., 2].max(axis=1) > 0.0)
    for (x0, y0), (x1, y1), z in zip(low[visible], high[visible], nearest[visible] * (1.0 - _MARGIN), strict=True):
        yield (slice(y0, y1), slice(x0, x1)), float(z)


def _unchanged(before: Placement, now: Placement, static: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which of the `static` instances are present at all times, do not move, and are as they were `before`."""
    result = np.zeros(len(now.mesh), bool)
    count = min(len(before.mesh), len(now.mesh))
    world = now.world_from_object[:, :count]
    same = static[:count] & now.present[:, :count].all(axis=0) & before.present[:, :count].all(axis=0)
    for a, b in ((world[0], world[1]), (world[2], world[1]), (before.world_from_object[CURRENT, :count], world[1])):
        same &= (a == b).all(axis=(1, 2))
    for a, b in zip(_identity(before, count), _identity(now, count), strict=True):
        same &= a == b
    if before.color is not None or now.color is not None:
        same &= _same_colors(before, now, count)
    same &= (before.box_from_object[:count] == now.box_from_object[:count]).all(axis=(1, 2))
    result[:count] = same
    return result


def _same_colors(before: Placement, now: Placement, count: int) -> NDArray[np.bool_]:
    """Return which of the first `count` instances have the same color at all times of both placements."""
    first, *others = (
        np.full((count, 4), np.nan, np.float32) if each.color is None else each.color[time, :count]
        for each in (before, now)
        for time in (PREVIOUS, CURRENT, NEXT)
    )
    result = np.ones(count, bool)
    for each in others:
        result &= ((each == first) | (np.isnan(each) & np.isnan(first))).all(axis=1)
    return result


def _identity(placement: Placement, count: int) -> tuple[NDArray[np.int32], ...]:
    """Return mesh, instance id, category and part of the first `count` instances."""
    part = np.zeros(count, np.int32) if placement.part is None else placement.part[:count]
    return placement.mesh[:count], placement.instance_id[:count], placement.category_id[:count], part
