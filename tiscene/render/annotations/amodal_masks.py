# SPDX-License-Identifier: Apache-2.0
"""Amodal masks: the pixels that objects would cover without occluders, by rays against single instances.

Occlusion rays are enough where all of a mesh is opaque. Holes of leaves and lace are those of the label pass.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tiscene.frame.measurements import AmodalMask
from tiscene.render.annotations.measurement_kernels import (
    COLUMNS,
    INSTANCE,
    OWNER,
    ROWS,
    STRIDE,
    WINDOW,
    X,
    Y,
    pixel_rays,
)
from tiscene.render.integrators.labels.first_hits import first_hits
from tiscene.render.intersect.ray_queue import RayWave
from tiscene.render.intersect.trace import occluded_by_instance
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import MOVERS

MAX_SAMPLES = 16384  # rays per object outside of the image; more pixels are subsampled
_BATCH = 1 << 18  # rays traced at once


@dataclass(frozen=True, eq=False)
class PartInView:
    """An instance of an object in front of the camera.

    Attributes:
        instance: Row of the instance, or its index among the object's instances (see `of`).
        box: float64 [4], x0, y0, x1, y1, px, not clipped to the image.
        cut: Whether a part of it is nearer than the clipping plane, see `measure_extents`.
    """

    instance: int
    box: NDArray[np.float64]
    cut: bool

    def of(self, rows: NDArray[np.int64]) -> PartInView:
        """Return the part with `instance` as a row, given the rows of the object's instances."""
        return replace(self, instance=int(rows[self.instance]))


class PixelCounter:
    """Computes amodal masks of objects that a DeviceScene has placed at CURRENT."""

    def __init__(self, scene: DeviceScene) -> None:
        self.scene = scene
        self._wave = RayWave()
        self._may_pass = np.zeros(0, bool)

    def count(self, view: View, objects: Sequence[Sequence[PartInView]]) -> list[AmodalMask]:
        """Return the mask of each object, given by its parts in view."""
        result: list[AmodalMask] = []
        pending: list[list[tuple[int, ...]]] = []
        size = 0
        for parts in objects:
            pending.append(_windows(view, len(pending), parts))
            size += sum(window[COLUMNS] * window[ROWS] for window in pending[-1])
            if size >= _BATCH:
                result += self._batch(view, pending)
                pending, size = [], 0
        return result + self._batch(view, pending)

    def _batch(self, view: View, objects: Sequence[Sequence[tuple[int, ...]]]) -> list[AmodalMask]:
        """Return the masks of objects, given by their windows."""
        windows = np.array([window for each in objects for window in each], np.int32).reshape(-1, 8)
        samples = self._hits(view, windows)
        owner = windows[samples[:, WINDOW], OWNER]
        several = np.array([len({window[0] for window in each}) > 1 for each in objects], bool)
        # A pixel counts once, whatever number of parts it shows.
        is_counted = ~several[owner]
        shared = np.flatnonzero(~is_counted)
        is_counted[shared[_distinct(samples[shared, X], samples[shared, Y], owner[shared])]] = True
        samples, owner = samples[is_counted], owner[is_counted]
        order = np.argsort(owner, kind="stable")
        samples, owner = samples[order], owner[order]
        ends = np.searchsorted(owner, np.arange(len(objects) + 1)).tolist()
        return [_mask_of(view, samples[a:b], windows) for a, b in itertools.pairwise(ends)]

    def _hits(self, view: View, windows: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return int32 [n, 3], x, y and window, of the pixels whose center rays hit the window's instance."""
        instances = windows[:, INSTANCE]
        may_pass = self._mesh_may_pass()[self.scene.placement.mesh[instances]]
        groups = [np.flatnonzero(instances == each) for each in np.unique(instances[may_pass])]
        found = [np.empty((0, 3), np.int32)]
        for rows in (np.flatnonzero(~may_pass), *groups):
            if len(rows):
                samples = self._hits_of(view, windows[rows], may_pass[rows[0]])
                samples[:, WINDOW] = rows[samples[:, WINDOW]]
                found.append(samples)
        return np.concatenate(found)

    def _hits_of(self, view: View, windows: NDArray[np.int32], may_pass: bool) -> NDArray[np.int32]:
        """Return `_hits` of windows of opaque instances, or of a single instance that rays may pass."""
        firsts = np.cumsum([0, *(windows[:, COLUMNS] * windows[:, ROWS])]).astype(np.int32)
        count = int(firsts[-1])
        samples = np.empty((count, 3), np.int32)
        wave = self._wave.reserved(count)
        targets, hit_target = wave.next_queues  # no ray continues where all of a mesh is opaque
        pixel_rays(view.array(), windows, firsts, view.width, view.height, samples, wave.rays, targets)
        if may_pass:
            self.scene.place_movers(np.arange(self.scene.instance_count) == windows[0, INSTANCE])
            first_hits(self.scene, MOVERS, wave, wave.queue, count)
            is_hit = wave.hit_ids.to_numpy()[:count, 0] >= 0
        else:
            occluded_by_instance(self.scene, wave.rays, wave.queue, targets, count, hit_target)
            is_hit = hit_target.to_numpy()[:count] > 0
        hits: NDArray[np.int32] = samples[is_hit]
        return hits

    def _mesh_may_pass(self) -> NDArray[np.bool_]:
        """Return for each mesh of the scene whether rays from the camera may pass some of its triangles."""
        if len(self._may_pass) != len(self.scene.meshes):
            table, first, result = np.array(self.scene.materials.may_pass, bool), 0, []
            for _, description in self.scene.descriptions:
                rows = table[first:]
                result += [rows.any() and rows[mesh.materials].any() for mesh in description.meshes]
                first += len(description.materials)
            self._may_pass = np.array(result, bool)
        return self._may_pass


def _windows(view: View, row: int, parts: Sequence[PartInView]) -> list[tuple[int, ...]]:
    """Return the pixels to trace for an object, as rows for `pixel_rays`.

    Inside the image all pixels; outside every s-th in both axes, with the stride s that keeps within MAX_SAMPLES.
    """
    width, height = view.width, view.height
    windows, around = [], []
    for part in parts:
        # One pixel more on each side: boxes are exact projections, rays have rounded directions.
        x0, y0 = (math.floor(v) - 1 for v in part.box[:2].tolist())
        x1, y1 = (math.ceil(v) + 1 for v in part.box[2:].tolist())
        around.append((part.instance, x0, y0, x1, y1))
        if part.cut:  # geometry in front of the clipping plane may project anywhere
            x0, y0, x1, y1 = 0, 0, width, height
        x0, y0 = max(x0, 0), max(y0, 0)
        windows.append((part.instance, row, x0, y0, min(x1, width) - x0, min(y1, height) - y0, 1, 0))
    area = sum((x1 - x0) * (y1 - y0) for _, x0, y0, x1, y1 in around)
    stride = max(1, math.ceil(math.sqrt(area / MAX_SAMPLES)))
    for instance, x0, y0, x1, y1 in around:
        if x0 < 0 or y0 < 0 or x1 > width or y1 > height:
            x0, y0 = -(-x0 // stride) * stride, -(-y0 // stride) * stride
            windows.append((instance, row, x0, y0, -((x0 - x1) // stride), -((y0 - y1) // stride), stride, 1))
    return [window for window in windows if window[COLUMNS] > 0 and window[ROWS] > 0]


def _mask_of(view: View, samples: NDArray[np.int32], windows: NDArray[np.int32]) -> AmodalMask:
    """Return the AmodalMask of the distinct pixels of one object."""
    x, y = samples[:, X], samples[:, Y]
    is_inside = (x >= 0) & (y >= 0) & (x < view.width) & (y < view.height)
    outside = int((windows[samples[~is_inside, WINDOW], STRIDE].astype(np.int64) ** 2).sum())
    x, y = x[is_inside], y[is_inside]
    left, top, width, height = 0, 0, 0, 0
    if len(x):
        left, top = int(x.min()), int(y.min())
        width, height = int(x.max()) + 1 - left, int(y.max()) + 1 - top
    mask = np.zeros((height, width), bool)
    mask[y - top, x - left] = True
    return AmodalMask(len(x), outside, (view.height, view.width), (left, top, width, height), np.packbits(mask))


def _distinct(x: NDArray[np.int32], y: NDArray[np.int32], owner: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the row of one sample for each distinct pixel of each object."""
    order = np.lexsort((x, y, owner))
    keys = np.stack([x[order], y[order], owner[order]])
    first = np.ones(len(order), bool)
    first[1:] = (keys[:, 1:] != keys[:, :-1]).any(axis=0)
    return order[first]
