# SPDX-License-Identifier: Apache-2.0
"""How many pixels objects would have alone, and which: rays that each ask whether they meet one instance."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tiscene.frame.object_table import AmodalMask
from tiscene.render.annotations.measurement_kernels import COLUMNS, OWNER, ROWS, STRIDE, WINDOW, X, Y, pixel_rays
from tiscene.render.intersect.ray_queue import AnyHitArrays
from tiscene.render.intersect.trace import occluded_by_instance
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT

MAX_SAMPLES = 16384  # pixels of one object, outside of the picture
_BATCH = 1 << 18  # rays


@dataclass(frozen=True, eq=False)
class PartInView:
    """A part of an object before the near plane.

    instance: its row, or its place among the rows of the object. box: float64 [4], in the picture or out of it, px.
    cut: whether it reaches behind the near plane too.
    """

    instance: int
    box: NDArray[np.float64]
    cut: bool

    def of(self, rows: NDArray[np.int64]) -> PartInView:
        """The part of an object with those rows, of which it has the place."""
        return replace(self, instance=int(rows[self.instance]))


class PixelCounter:
    """Counts pixels of objects that a DeviceScene has placed at CURRENT."""

    def __init__(self, scene: DeviceScene) -> None:
        self.scene = scene
        self._wave = AnyHitArrays()

    def count(self, view: View, objects: Sequence[Sequence[PartInView]]) -> list[AmodalMask]:
        """The pixels of each of the objects, given by their parts in view."""
        result: list[AmodalMask] = []
        waiting: list[list[tuple[int, ...]]] = []
        size = 0
        for parts in objects:
            waiting.append(_windows(view, len(waiting), parts))
            size += sum(window[COLUMNS] * window[ROWS] for window in waiting[-1])
            if size >= _BATCH:
                result += self._batch(view, waiting)
                waiting, size = [], 0
        return result + self._batch(view, waiting)

    def _batch(self, view: View, objects: Sequence[Sequence[tuple[int, ...]]]) -> list[AmodalMask]:
        """The pixels of objects with those windows."""
        windows = np.array([window for each in objects for window in each], np.int32).reshape(-1, 8)
        samples = self._hits(view, windows)
        owner = windows[samples[:, WINDOW], OWNER]
        several = np.array([len({window[0] for window in each}) > 1 for each in objects], bool)
        # A pixel counts once, however many parts of the object it shows.
        once = ~several[owner]
        others = np.flatnonzero(~once)
        once[others[_distinct(samples[others, X], samples[others, Y], owner[others])]] = True
        samples, owner = samples[once], owner[once]
        order = np.argsort(owner, kind="stable")
        samples, owner = samples[order], owner[order]
        ends = np.searchsorted(owner, np.arange(len(objects) + 1)).tolist()
        return [_alone(view, samples[a:b], windows) for a, b in itertools.pairwise(ends)]

    def _hits(self, view: View, windows: NDArray[np.int32]) -> NDArray[np.int32]:
        """int32 [n, 3], x, y and window of the pixels at whose center a ray meets the window's instance."""
        firsts = np.cumsum([0, *(windows[:, COLUMNS] * windows[:, ROWS])]).astype(np.int32)
        count = int(firsts[-1])
        samples = np.empty((count, 3), np.int32)
        if not count:
            return samples
        wave = self._wave.sized(count)
        pixel_rays(view.array(), windows, firsts, view.width, view.height, samples, wave.rays, wave.targets)
        occluded_by_instance(self.scene, CURRENT, wave.rays, wave.queue, wave.targets, count, wave.result)
        met: NDArray[np.int32] = samples[wave.result.to_numpy()[:count] > 0]
        return met


def _windows(view: View, row: int, parts: Sequence[PartInView]) -> list[tuple[int, ...]]:
    """The pixels that decide an object's count, as rows for `pixel_rays`.

    Those in the picture all, at stride 1; outside of it every s-th in both axes, s so that they fit the budget.
    """
    width, height = view.width, view.height
    windows, around = [], []
    for part in parts:
        # A pixel more on each side: the boxes are of exact projections, the rays of rounded directions.
        x0, y0 = (math.floor(v) - 1 for v in part.box[:2].tolist())
        x1, y1 = (math.ceil(v) + 1 for v in part.box[2:].tolist())
        around.append((part.instance, x0, y0, x1, y1))
        if part.cut:  # what lies between the camera and its near plane may appear anywhere
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


def _alone(view: View, samples: NDArray[np.int32], windows: NDArray[np.int32]) -> AmodalMask:
    """Of the distinct pixels of one object."""
    x, y = samples[:, X], samples[:, Y]
    within = (x >= 0) & (y >= 0) & (x < view.width) & (y < view.height)
    outside = int((windows[samples[~within, WINDOW], STRIDE].astype(np.int64) ** 2).sum())
    x, y = x[within], y[within]
    left, top, width, height = 0, 0, 0, 0
    if len(x):
        left, top = int(x.min()), int(y.min())
        width, height = int(x.max()) + 1 - left, int(y.max()) + 1 - top
    mask = np.zeros((height, width), bool)
    mask[y - top, x - left] = True
    return AmodalMask(len(x), outside, (view.height, view.width), (left, top, width, height), np.packbits(mask))


def _distinct(x: NDArray[np.int32], y: NDArray[np.int32], owner: NDArray[np.int32]) -> NDArray[np.int64]:
    """The row of one sample for each pixel of each object."""
    order = np.lexsort((x, y, owner))
    places = np.stack([x[order], y[order], owner[order]])
    first = np.ones(len(order), bool)
    first[1:] = (places[:, 1:] != places[:, :-1]).any(axis=0)
    return order[first]
