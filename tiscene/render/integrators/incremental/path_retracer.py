# SPDX-License-Identifier: Apache-2.0
"""Retracing of cached paths: the change of each pixel's light by the movers of a frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device.kernel_types import float8
from tiscene.device.memory import device_array
from tiscene.device.prefix_sums import scans_in_blocks
from tiscene.render.integrators.incremental import retrace_kernels as kernels
from tiscene.render.integrators.incremental.frame_scratch import FrameScratch
from tiscene.render.integrators.incremental.mover_bounds import cluster_boxes
from tiscene.render.integrators.incremental.mover_culling import cull_rays
from tiscene.render.integrators.incremental.path_cache import PathBlock, PathCache
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_scene import PathScene
from tiscene.render.integrators.path.path_state import PathSamples
from tiscene.render.intersect.trace import occluded
from tiscene.render.lights.intersect import WEIGHTED
from tiscene.scene.placement import MOVERS

SINGLE_PIXEL_SPP = 1 << 30  # rays without pixels: as if all were samples of one, so that the row alone numbers them


class PathRetracer:
    """Finds the cached paths that movers invalidate, and traces them again among the movers.

    Args:
        paths: Path tracer of the cached paths.
        mis: Which emission counts that paths find, see `lights.intersect`.
    """

    def __init__(self, paths: PathPass, mis: int = WEIGHTED) -> None:
        self.scene = paths.scene
        self._paths, self._mis = paths, mis
        self._mover_boxes = device_array(float8, 6)

    def place_movers(self, moving: NDArray[np.bool_]) -> None:
        """Build the tree MOVERS of the moving instances placed at CURRENT, and upload boxes around them."""
        self._mover_boxes.from_numpy(cluster_boxes(self.scene.place_movers(moving)).T.copy())

    def test(self, rays: Any, count: int, scratch: FrameScratch) -> int:
        """Set `scratch.blocked` of each ray to whether a mover blocks it; return the number of rays near movers."""
        with self._paths.vector_mode():
            near = cull_rays(
                rays, count, self._mover_boxes, scratch.blocked, scratch.candidates, scratch.row_chunks,
                scans_in_blocks(),
            )  # fmt: skip
        if near:
            occluded(self.scene, MOVERS, rays, scratch.candidates, near, scratch.blocked)
        return int(near)

    def retrace(
        self,
        scene: PathScene,
        cache: PathCache,
        block: PathBlock,
        pixels: Any,
        factors: NDArray[np.float32],
        scratch: FrameScratch,
        previous_paths: int = 0,
    ) -> None:
        """Trace the invalidated paths of a block again and add the changes of its pixels to the frame's sums.

        Args:
            scene: Data of the scene with the movers.
            cache: The cache that the block belongs to.
            block: Cached paths.
            pixels: Their pixels.
            factors: float32 [groups, 3], intensity of each light group.
            scratch: Arrays with room for the block; `correction` and `mover_sums` are the frame's sums.
            previous_paths: Paths per pixel that the sums contain already.
        """
        state, first = cache.state, block.first
        near = self.test(block.rays, block.rows, scratch)
        if (scene.any_coverage or scene.any_shadow_links) and near:
            self._pass_movers(scene, cache, block, near, scratch)
        restart_offsets = np.zeros(cache.steps + 1, np.int32)
        kernels.find_invalidated(
            block.count, cache.steps, block.offsets, block.rays, block.light, factors, block.restart, scratch.blocked,
            state.rays, state.state, state.features, state.status,
            scratch.change, scratch.invalidated, scratch.path_chunks, scratch.restart_queue, restart_offsets,
            scans_in_blocks(),
        )  # fmt: skip
        live = 0
        for step in range(cache.steps):
            begin, end = int(restart_offsets[step]), int(restart_offsets[step + 1])
            kernels.append_restarts(scratch.restart_queue, begin, end, state.queue, live)
            live += end - begin
            if live:
                live, shadows = self._paths.advance(
                    scene, state, live, first, step, cache.samples, cache.max_depth, self._mis
                )
                if shadows:
                    self._paths.cast_shadows(scene, state, shadows, first, step, cache.samples)
        kernels.accumulate_corrections(
            pixels, first, block.count, cache.spp, scratch.invalidated, block.restart, block.features,
            state.status, state.occluded, state.state, state.features, scratch.change, previous_paths,
            scratch.correction, scratch.mover_sums,
        )  # fmt: skip

    def _pass_movers(
        self, scene: PathScene, cache: PathCache, block: PathBlock, near: int, scratch: FrameScratch
    ) -> None:
        """Unblock the shadow rays that alpha-rejected movers let pass, and movers that cast no shadow of their light.

        The recorded rays passed the static surfaces. The movers' opacity is sampled with random numbers of its own.
        """
        state = cache.state
        count = kernels.select_blocked_shadow_rays(
            scratch.candidates, near, block.rays, scratch.blocked, scratch.shadow_rows, scratch.row_chunks,
            scans_in_blocks(),
        )  # fmt: skip
        samples = PathSamples(SINGLE_PIXEL_SPP, 0, cache.mover_key)
        for begin in range(0, count, state.size):
            rays = min(state.size, count - begin)
            kernels.gather_shadow_rays(
                scratch.shadow_rows, begin, rays, block.rays, state.shadow_rays, state.shadow_queue
            )
            self._paths.cast_shadows(scene, state, rays, begin, block.number, samples, tree=MOVERS)
            kernels.scatter_occlusion(scratch.shadow_rows, begin, rays, state.occluded, scratch.blocked)
