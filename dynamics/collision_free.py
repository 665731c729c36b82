# SPDX-License-Identifier: Apache-2.0
"""Tests for paths on which no collision is possible, so that nothing needs to be simulated.

All are conservative: bodies count as spheres about their origins, and time does not count.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from dynamics.bodies import Body
from dynamics.clocks import exact
from dynamics.closed_form import Still
from dynamics.colliding_bodies import Mover
from dynamics.contact import MAX_TOUCHES, TOUCH_COLUMNS
from dynamics.dynamic import ClosedForm
from dynamics.obstacles import Obstacles
from dynamics.simulation import Simulation
from dynamics.sweep_obstacles import obstacle_distances

SAMPLES = 64  # positions per loop
MARGIN = 0.005  # m


@dataclass(frozen=True, eq=False)
class PathBounds:
    """Where a mover may be, wherever on its path it is.

    Attributes:
        positions: float64 [n, 3], positions along its loop, m; one for a static body.
        size: Radius of a sphere about each position; together they contain the mover on all of its path, m.
    """

    positions: NDArray[np.float64]
    size: float

    @classmethod
    def of(cls, mover: Mover) -> PathBounds | None:
        """Return the bounds of a mover's path; None for a dynamic without a loop, whose path is unbounded."""
        positions = _positions(mover.body)
        if positions is None:
            return None
        # Between two samples a path deviates by less than their distance.
        advance = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).max(initial=0.0))
        return cls(positions, (mover.shape.reach if mover.shape else 0.0) + advance + MARGIN)

    @property
    def is_static(self) -> bool:
        """Whether it is one position."""
        return len(self.positions) == 1

    def may_meet(self, other: PathBounds) -> bool:
        """Return whether a mover may touch another one. Two static movers do not count."""
        if self.is_static and other.is_static:
            return False
        gap = np.maximum(
            self.positions.min(axis=0) - other.positions.max(axis=0),
            other.positions.min(axis=0) - self.positions.max(axis=0),
        )
        return bool((gap <= self.size + other.size).all())

    def is_clear_of(self, obstacles: Obstacles) -> bool:
        """Return whether the mover cannot touch an obstacle."""
        limit = 2.0 * self.size
        points = np.zeros((len(self.positions), 4), dtype=np.float32)
        points[:, :3] = self.positions
        touches = np.zeros((MAX_TOUCHES, TOUCH_COLUMNS), dtype=np.float32)
        obstacle_distances(points, limit, touches, *obstacles.arguments())
        return float(points[:, 3].min()) >= self.size


def _positions(body: Body) -> NDArray[np.float64] | None:
    dynamic = body.dynamic
    if isinstance(dynamic, Still):
        return np.array([body.position])
    if not isinstance(dynamic, ClosedForm) or math.isinf(dynamic.loop_time):
        return None
    alone = Simulation([body.alone()])
    if dynamic.loop_time == 0.0:
        return alone.poses(0)[:, :3]
    loop = exact(dynamic.loop_time)
    return alone.poses_at([loop * Fraction(i, SAMPLES) for i in range(SAMPLES + 1)])[:, 0, :3]
