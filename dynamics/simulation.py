# SPDX-License-Identifier: Apache-2.0
"""Simulation: all bodies and their timings; a time in, poses out."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Rational

import numpy as np
from numpy.typing import NDArray

from dynamics import argument_checks
from dynamics.bodies import Body
from dynamics.clocks import exact
from dynamics.errors import ArgumentTypeError
from dynamics.path_poses import Paths
from dynamics.random_bounce import UniformMovementRandomBounce
from dynamics.timings import AllTogether, Timing


class Simulation:
    """Moves bodies. Taichi must run when poses are asked for (with float64, which its CPU and CUDA backends have).

    A pose is a pure function of (bodies, timings, time), and of its own body alone but for the timings' turns: the same
    bits for any number of threads, in any order of asking, with any other bodies beside it.
    """

    def __init__(self, bodies: Sequence[Body], timings: Timing | None = None) -> None:
        """timings: default AllTogether(0). Raises ValueError if they cannot work, TypeError for what bounces."""
        self.bodies = tuple(bodies)
        self.timings = AllTogether(0.0) if timings is None else timings
        for row, body in enumerate(self.bodies):
            if isinstance(body.dynamic, UniformMovementRandomBounce):
                raise ArgumentTypeError(
                    f"bodies[{row}] ({body.name!r}): dynamic={body.dynamic!r}: must be a path, such as "
                    "CatmullWaypoints; a SteppedSimulation moves what bounces"
                )
        self._paths = Paths(self.bodies, self.timings)

    def poses(self, time: float | Rational) -> NDArray[np.float64]:
        """Where every body is at `time`, s: float64 [n, 7], position (m) and unit quaternion (w, x, y, z).

        A float stands for the decimal number it prints as; pass Fraction(k, fps) for frame k of a stream. Before its
        birth a body is where it will appear; times before 0 show the world as it starts.
        """
        argument_checks.number(time, "time")
        poses: NDArray[np.float64] = self._paths.poses([exact(time)])[0]
        return poses
