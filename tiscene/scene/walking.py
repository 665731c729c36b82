# SPDX-License-Identifier: Apache-2.0
"""Walking: along which world axes a camera goes step by step, unlike one that turns, rests or jumps."""

from __future__ import annotations

import numpy as np

from tiscene.scene.camera import Vector3

Axes = frozenset[int]  # of 0 (x), 1 (y), 2 (z)
STRIDE = 0.5  # m; a camera that moves farther in one frame jumps
STILL = 1e-3  # m; up to which a camera does not move along an axis


def walked_axes(before: Vector3, after: Vector3) -> Axes:
    """Return along which axes a camera walks when it goes from one position (m) to another; none if it jumps."""
    steps = np.abs(np.subtract(after, before))
    return Axes() if np.linalg.norm(steps) > STRIDE else Axes(np.flatnonzero(steps > STILL).tolist())
