# SPDX-License-Identifier: Apache-2.0
"""The moving-camera pass: radiance of a frame from a light cache of the static scene, corrected where movers change it.

1. Paths are traced in the static scene. Wide lobes reflect the light of cells, which are computed first where the table
   lacks them; narrow lobes continue.
2. The rays of these paths, and those that the cells' light stands for at the first vertex, are tested against movers.
3. Pixels with a ray that a mover blocks are path traced twice, with and without movers and with the same random
   numbers. The difference corrects them.

What remains is an approximation: cells blur light over their size, and the light that movers take away or add is exact
at the first reflection only. Every frame is a function of its own inputs, not of previous frames.
"""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np
from numpy.typing import NDArray

from tiscene.render.integrators.incremental.base_image import ProgressCallback
from tiscene.render.integrators.incremental.base_image_cache import digest_of
from tiscene.render.integrators.light_cache.frame_batch import FrameBatch, FrameScene
from tiscene.render.integrators.light_cache.light_cache import LightCache
from tiscene.render.integrators.path.path_pass import PathImage, PathPass
from tiscene.render.integrators.path.path_state import PathSamples
from tiscene.render.sampling.sobol import frame_key, index_bits
from tiscene.render.view import View
from tiscene.scene.lights.light_kinds import MESH
from tiscene.scene.lights.light_table import INSTANCE, KIND
from tiscene.scene.placement import CURRENT, Placement

MAX_CACHES = 2  # static scenes whose light is kept
BATCH_PATHS = 1 << 18
# If movers change more of the paths than this, path tracing costs no more: half of the pixels then have such a path.
MAX_CHANGED = 0.15


class MovingCameraPass:
    """Renders radiance of a DeviceScene before any camera, with the light of what stands still from a cache.

    Args:
        paths: Path pass of the image size.
        cell_spp: Paths per cell.
        cell_width: Width of a cell, px; cells have up to this width, and more than half of it.
        memory_limit: Limit of the memory of cells, bytes; an attribute as well.
        progress: Called with the name of a stage and its completed fraction, 0..1.
    """

    def __init__(
        self, paths: PathPass, *, cell_spp: int, cell_width: float, memory_limit: int, progress: ProgressCallback
    ) -> None:
        self._paths, self.scene = paths, paths.scene
        self._cell_spp, self._cell_width = cell_spp, cell_width
        self.memory_limit = memory_limit
        self._progress = progress
        self._caches: dict[Hashable, LightCache] = {}  # least recently used first
        self.width, self.height = paths.width, paths.height
        self._batch: FrameBatch | None = None

    @property
    def caches(self) -> tuple[LightCache, ...]:
        """The caches in memory, the one used last at the end."""
        return tuple(self._caches.values())

    def render(
        self,
        view: View,
        placement: Placement,
        moving: NDArray[np.bool_],
        *,
        frame_index: int,
        seed: int,
        spp: int,
        max_depth: int,
    ) -> PathImage | None:
        """Render what the scene has placed at CURRENT.

        Args:
            view: Camera and image size.
            placement: What is placed.
            moving: bool [n], the instances whose light is not in the cache.
            frame_index: Frame number; with `seed` it selects the random numbers.
            seed: Seed of the random numbers.
            spp: Samples per pixel.
            max_depth: Largest number of segments of a path.

        Returns:
            The image; None if movers change so much that path tracing costs no more, or emit light, or if lights
            have links.
        """
        paths = self._paths
        paths.background = view.background
        present = placement.present[CURRENT]
        still, moving = present & ~moving, present & moving
        if self._emits(moving) or self.scene.lights.any_links:
            return None
        cache = self._cache(placement, still, seed, max_depth)
        scene = FrameScene(paths, moving, still)
        samples = PathSamples(spp, index_bits(spp), frame_key(seed, frame_index))
        total = self.width * self.height * spp
        size = max(1, min(total, BATCH_PATHS) // spp) * spp
        if self._batch is None or self._batch.size < size:
            self._batch = FrameBatch(paths, self._cell_width, size)
        changed = 0
        for first in range(0, total, size):
            changed += self._batch.trace(view, scene, cache, samples, max_depth, first, min(size, total - first))
            if changed > MAX_CHANGED * total:
                return None
        return paths.developed(spp)

    def _emits(self, moving: NDArray[np.bool_]) -> bool:
        """Return whether a mover is a light."""
        if not (self.scene.materials.any_emission and moving.any()):
            return False
        values = self.scene.lights.arrays(self.scene.textures).values.to_numpy()
        return bool(moving[values[values[:, KIND] == MESH, INSTANCE].astype(int)].any())

    def _cache(self, placement: Placement, still: NDArray[np.bool_], seed: int, max_depth: int) -> LightCache:
        """Return the cache of the static part of a placement."""
        lights = self.scene.lights.lights if placement.lights is None else placement.lights
        key = (
            np.flatnonzero(still).tobytes(),
            placement.mesh[still].tobytes(),
            placement.world_from_object[CURRENT, still].tobytes(),
            digest_of(lights),
            seed,
            max_depth,
        )
        cache = self._caches.pop(key, None) or LightCache(
            self._paths,
            seed=seed,
            spp=self._cell_spp,
            max_depth=max_depth,
            memory_limit=self.memory_limit // MAX_CACHES,
            progress=self._progress,
        )
        self._caches[key] = cache
        if len(self._caches) > MAX_CACHES:
            del self._caches[next(iter(self._caches))]
        return cache
