# SPDX-License-Identifier: Apache-2.0
"""Tests for paths on which no collision is possible, so that nothing needs to be simulated.

All are conservative: bodies count as spheres about their origins, paths as the balls of `dynamics.path_cover`, and time
does not count.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynamics.colliding_bodies import Mover
from dynamics.contact import MAX_TOUCHES, TOUCH_COLUMNS
from dynamics.dynamic import ClosedForm
from dynamics.obstacles import Obstacles
from dynamics.path_cover import cover_path
from dynamics.surface_overlap import boxes_touch
from dynamics.sweep_obstacles import obstacle_distances

MARGIN = 0.005  # m


@dataclass(frozen=True, eq=False)
class PathBounds:
    """Where a mover may be, wherever on its path it is.

    Attributes:
        balls: float64 [n, 4], centers and radii, m; together they contain the mover on all of its path.
        is_static: Whether it never moves.
    """

    balls: NDArray[np.float64]
    is_static: bool

    @classmethod
    def of(cls, mover: Mover) -> PathBounds | None:
        """Return the bounds of a mover's path; None for a dynamic without a closed form, whose path is unbounded."""
        if not isinstance(mover.body.dynamic, ClosedForm):
            return None
        balls = cover_path(mover.body.tracks)
        balls[:, 3] += (mover.shape.reach if mover.shape else 0.0) + MARGIN
        return cls(balls, not mover.body.duration)

    @cached_property
    def box(self) -> NDArray[np.float64]:
        """Lowest and highest corner [2, 3] of the box around all balls, m."""
        centers, radii = self.balls[:, :3], self.balls[:, 3:]
        return np.stack([(centers - radii).min(axis=0), (centers + radii).max(axis=0)])

    def may_meet_any(self, others: Iterable[PathBounds]) -> bool:
        """Return whether a mover may touch one of others. Two static movers do not count."""
        boxes = [each.box for each in others if not (self.is_static and each.is_static)]
        return bool(boxes) and bool(boxes_touch(self.box, np.array(boxes)).any())

    def is_clear_of(self, obstacles: Obstacles) -> bool:
        """Return whether the mover cannot touch an obstacle."""
        points = self.balls.astype(np.float32)
        touches = np.zeros((MAX_TOUCHES, TOUCH_COLUMNS), dtype=np.float32)
        obstacle_distances(points, 2.0 * float(self.balls[:, 3].max()), touches, *obstacles.arguments())
        return bool((points[:, 3] >= self.balls[:, 3]).all())
