# SPDX-License-Identifier: Apache-2.0
"""How much of a picture a difference would have to trace again: asked of a few paths that no picture is made of."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tiscene.render.integrators.incremental.path_cache import PathCache, room_for
from tiscene.render.integrators.incremental.path_recording import SEGMENT
from tiscene.render.integrators.path.path_pass import PathPass, PathScene
from tiscene.render.integrators.path.path_state import PathState
from tiscene.render.sampling.sobol import frame_key
from tiscene.render.view import View

PROBE_FRAME = -4  # what stands for the frame in the keys of random numbers
WIDTH = 32  # paths in a row of the picture


class Probe:
    """Paths through a smaller picture of what a DeviceScene has placed at CURRENT, which should be all but the movers.

    What is decided by them biases no picture, as their random numbers are their own.
    """

    def __init__(self, paths: PathPass, scene: PathScene, view: View, seed: int, max_depth: int) -> None:
        width = min(view.width, WIDTH)
        small = replace(view, width=width, height=-(-view.height * width // view.width))
        self.cache = PathCache(
            paths,
            [scene],
            small,
            PathState(room_for(small.width * small.height, 1)),
            numbers=(1, 0, frame_key(seed, PROBE_FRAME)),
            movers_key=0,
            max_depth=max_depth,
        )
        (self.block,) = self.cache.blocks
        self._offsets = self.block.offsets.to_numpy()
        self._is_segment = self.block.rays.to_numpy()[: self.block.rows, SEGMENT] >= 0.0

    def cut_share(self, cut: Any) -> float:
        """How many of all paths would be traced again. cut: i32, as `IncrementalPass` has it of each of the block's rows."""
        found = (cut.to_numpy()[: self.block.rows] > 0) & self._is_segment
        so_far = np.concatenate([[0], np.cumsum(found)])
        return float(np.mean(so_far[self._offsets[1:]] > so_far[self._offsets[:-1]]))
