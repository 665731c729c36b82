# SPDX-License-Identifier: Apache-2.0
"""Estimate of the cost of an incremental frame: the fraction of probe paths that movers invalidate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tiscene.render.integrators.incremental.frame_scratch import FrameScratch
from tiscene.render.integrators.incremental.path_cache import PathCache, state_size
from tiscene.render.integrators.incremental.path_recording import SEGMENT
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_scene import PathScene
from tiscene.render.integrators.path.path_state import PathSamples, PathState
from tiscene.render.sampling.sobol import frame_key
from tiscene.render.view import View

PROBE_FRAME = -4  # frame number of the probe paths' random numbers
WIDTH = 32  # probe paths per row of the image


class ProbePaths:
    """Recorded paths, one per pixel, of a smaller image of a scene.

    Their random numbers are used by no image, so decisions based on them introduce no bias.

    Args:
        paths: Path tracer.
        scene: Data of the scene as placed at CURRENT, which should be without the movers.
        view: Camera and image size; the probe image has the same aspect ratio.
        seed: Seed of the random numbers.
        max_depth: Largest number of segments of a path.

    Attributes:
        cache: The paths; block: their only block.
        scratch: Arrays for tests of their rays.
    """

    def __init__(self, paths: PathPass, scene: PathScene, view: View, seed: int, max_depth: int) -> None:
        width = min(view.width, WIDTH)
        small = replace(view, width=width, height=-(-view.height * width // view.width))
        self.cache = PathCache(
            paths,
            [scene],
            small,
            PathState(state_size(small.width * small.height, 1)),
            samples=PathSamples(1, 0, frame_key(seed, PROBE_FRAME)),
            mover_key=0,
            max_depth=max_depth,
        )
        (self.block,) = self.cache.blocks
        self.scratch = FrameScratch([self.cache])
        self._is_segment = self.block.rays.to_numpy()[: self.block.rows, SEGMENT] >= 0.0

    def invalidated_fraction(self) -> float:
        """Return the fraction of the paths that have a segment that is blocked, as `scratch` says."""
        found = (self.scratch.blocked.to_numpy()[: self.block.rows] > 0) & self._is_segment
        found_before = np.concatenate([[0], np.cumsum(found)])
        offsets = self.block.host_offsets
        return float(np.mean(found_before[offsets[1:]] > found_before[offsets[:-1]]))
