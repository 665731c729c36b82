# SPDX-License-Identifier: Apache-2.0
"""MoverPath: how an object with given poses moves in the steps between two frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import conjugate, matrix_from_quaternion, multiply

Array = NDArray[np.float64]


@dataclass(eq=False)
class MoverPath:
    """The way of a mover between two frames, at constant velocity.

    Attributes:
        start: Pose [7] at the first frame.
        end: Pose [7] at the second.
        before: Its motion [6] in the step before; None if nothing hangs on it.
    """

    start: Array
    end: Array
    before: Array | None = None

    def at(self, part: int, parts: int, step: float) -> tuple[Array, Array]:
        """Return pose [7] and motion [6] at the start of a step."""
        turn = multiply(self.end[3:], conjugate(self.start[3:]))
        turn = -turn if turn[0] < 0.0 else turn
        angle = 2.0 * math.atan2(float(np.linalg.norm(turn[1:])), float(turn[0]))
        axis = turn[1:] / max(float(np.linalg.norm(turn[1:])), 1e-300)
        share = part / parts
        partly = np.array([math.cos(0.5 * share * angle), *(math.sin(0.5 * share * angle) * axis)])
        rotation = multiply(partly, self.start[3:])
        pose = np.concatenate([self.start[:3] + share * (self.end[:3] - self.start[:3]), rotation])
        spin = matrix_from_quaternion(rotation).T @ (axis * (angle / (parts * step)))
        return pose, np.concatenate([(self.end[:3] - self.start[:3]) / (parts * step), spin])
