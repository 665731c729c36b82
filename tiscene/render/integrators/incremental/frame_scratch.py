# SPDX-License-Identifier: Apache-2.0
"""Device arrays for the computation of one incremental frame."""

from collections.abc import Sequence

import numpy as np
import taichi as ti

from tiscene.device.memory import device_array, upload
from tiscene.render.integrators.incremental.path_cache import PathCache
from tiscene.render.integrators.incremental.retrace_kernels import CORRECTION_COLUMNS, MOVER_COLUMNS
from tiscene.render.integrators.path.path_state import chunks_for


class FrameScratch:
    """Arrays that the blocks of a frame use one after another, and the frame's sums.

    Args:
        caches: Cached paths of the image; arrays have room for their largest block.
        coverage_rows: Rays of a `MoverCoverage` that are tested together.

    Attributes:
        rows, paths, steps: Capacity: recorded rays, paths, segments per path.
        blocked: i32 [rows], whether a mover blocks each recorded ray.
        candidates: i32 [rows], recorded rays near movers.
        shadow_rows: i32 [rows], recorded shadow rays that partially opaque movers may let pass.
        row_chunks: Scratch of compactions over rows.
        change: f32 [paths, 3], change of each path's light.
        invalidated: i32 [paths, 2], restart state and step of invalidated paths.
        path_chunks: Scratch of compactions over paths.
        restart_queue: i32 [paths], invalidated paths by step.
        correction: f32 [pixels, CORRECTION_COLUMNS].
        mover_sums: f32 [pixels, MOVER_COLUMNS].
    """

    def __init__(self, caches: Sequence[PathCache], coverage_rows: int = 0) -> None:
        self.rows = max(coverage_rows, *(cache.max_rows for cache in caches))
        self.paths = max(cache.state.size for cache in caches)
        self.steps = max(cache.steps for cache in caches)
        self.blocked = device_array(ti.i32, (self.rows,))
        self.candidates = device_array(ti.i32, (self.rows,))
        self.shadow_rows = device_array(ti.i32, (self.rows,))
        self.row_chunks = device_array(ti.i32, (chunks_for(self.rows),))
        self.change = device_array(ti.f32, (self.paths, 3))
        self.invalidated = device_array(ti.i32, (self.paths, 2))
        self.path_chunks = device_array(ti.i32, (chunks_for(self.paths) * self.steps,))
        self.restart_queue = device_array(ti.i32, (self.paths,))
        pixels = int(caches[0].mean.shape[0])
        self.correction = upload(np.zeros((pixels, CORRECTION_COLUMNS), np.float32))
        self.mover_sums = upload(np.zeros((pixels, MOVER_COLUMNS), np.float32))

    def fits(self, caches: Sequence[PathCache], coverage_rows: int = 0) -> bool:
        """Return whether there is room for other caches of the same image size."""
        return self.rows >= coverage_rows and all(
            self.rows >= cache.max_rows and self.steps >= cache.steps and self.paths >= cache.state.size
            for cache in caches
        )
