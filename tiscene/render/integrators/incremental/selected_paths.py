# SPDX-License-Identifier: Apache-2.0
"""The kept paths of some pixels alone, as a block of their own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.memory import device_array, upload
from tiscene.render.integrators.incremental.path_cache import Block, PathCache
from tiscene.render.integrators.incremental.path_recording import gather
from tiscene.render.integrators.path.path_state import FEATURE_COLUMNS
from tiscene.render.intersect.ray_queue import ray, upload_pixels

_SPARE = 1.5  # arrays are made so many times larger than it takes, so that they are seldom made anew


class Selection:
    """Arrays that blocks of selected paths use one after another."""

    def __init__(self) -> None:
        self._rows = self._paths = 0
        self._rays = self._light = self._features = None

    def blocks(self, cache: PathCache, ranks: NDArray[np.int64]) -> Iterator[tuple[Block, Any]]:
        """Of each block of the cache what belongs to its pixels of these ranks, increasing; and the pixels
        themselves, which number the paths now."""
        spp = cache.numbers[0]
        for block in cache.blocks:
            first, end = np.searchsorted(ranks * spp, (block.first, block.first + block.count))
            here = ranks[first:end]
            if len(here) == 0:
                continue
            paths = (here[:, None] * spp - block.first + np.arange(spp)).ravel()
            offsets = np.concatenate([[0], np.cumsum(block.starts[paths + 1] - block.starts[paths])]).astype(np.int32)
            rows = int(offsets[-1])
            self._make_room(rows, len(paths))
            placed = upload(offsets)
            gather(
                len(paths), paths.astype(np.int32), placed, block.offsets, block.rays, block.light,
                block.features, self._rays, self._light, self._features,
            )  # fmt: skip
            pixels = upload_pixels(cache.order[here], *cache.size)
            yield (
                Block(
                    block.number,
                    0,
                    len(paths),
                    rows,
                    placed,
                    self._rays,
                    self._light,
                    block.restore,
                    self._features,
                ),
                pixels,
            )

    def _make_room(self, rows: int, paths: int) -> None:
        if rows > self._rows:
            self._rows = int(_SPARE * rows)
            self._rays, self._light = device_array(ray, self._rows), device_array(ti.f32, (self._rows, 3))
        if paths > self._paths:
            self._paths = int(_SPARE * paths)
            self._features = device_array(ti.f32, (self._paths, FEATURE_COLUMNS))
