# SPDX-License-Identifier: Apache-2.0
"""Selection of the cached paths of some pixels, as smaller blocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.memory import device_array, upload
from tiscene.render.integrators.incremental.path_cache import PathBlock, PathCache
from tiscene.render.integrators.incremental.path_recording import gather_paths
from tiscene.render.integrators.path.path_state import FEATURE_COLUMNS
from tiscene.render.intersect.ray_queue import ray, upload_pixels

_GROWTH = 1.5  # arrays are allocated larger than needed, so that they are rarely reallocated


class PathSelection:
    """Arrays that successive blocks of selected paths share."""

    def __init__(self) -> None:
        self._rows = self._paths = 0
        self._rays = self._light = self._features = None

    def blocks(self, cache: PathCache, ranks: NDArray[np.int64]) -> Iterator[tuple[PathBlock, Any]]:
        """Yield for each block of a cache the paths of the selected pixels, if any.

        Args:
            cache: The cached paths.
            ranks: Indices into `cache.order` of the selected pixels, increasing.

        Yields:
            The block, whose paths are numbered from 0, and its pixels as `upload_pixels` makes them. Both are valid
            until the next one is requested.
        """
        spp = cache.spp
        for block in cache.blocks:
            first, end = np.searchsorted(ranks * spp, (block.first, block.first + block.count))
            selected = ranks[first:end]
            if len(selected) == 0:
                continue
            paths = (selected[:, None] * spp - block.first + np.arange(spp)).ravel()
            lengths = block.host_offsets[paths + 1] - block.host_offsets[paths]
            host_offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
            rows = int(host_offsets[-1])
            self._reserve(rows, len(paths))
            offsets = upload(host_offsets)
            gather_paths(
                len(paths), paths.astype(np.int32), offsets, block.offsets, block.rays, block.light,
                block.features, self._rays, self._light, self._features,
            )  # fmt: skip
            pixels = upload_pixels(cache.order[selected], *cache.size)
            selection = replace(
                block, first=0, count=len(paths), rows=rows, offsets=offsets,
                rays=self._rays, light=self._light, features=self._features,
            )  # fmt: skip
            yield selection, pixels

    def _reserve(self, rows: int, paths: int) -> None:
        """Allocate arrays for at least this many records and paths."""
        if rows > self._rows:
            self._rows = int(_GROWTH * rows)
            self._rays, self._light = device_array(ray, self._rows), device_array(ti.f32, (self._rows, 3))
        if paths > self._paths:
            self._paths = int(_GROWTH * paths)
            self._features = device_array(ti.f32, (self._paths, FEATURE_COLUMNS))
