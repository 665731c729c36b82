# SPDX-License-Identifier: Apache-2.0
"""Simulation: poses of all bodies at any time, without collisions."""

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
    """Poses of bodies that do not collide, as a pure function of (bodies, timings, time).

    A pose depends on its own body alone, apart from the turns that timings assign: the same bits for any number of
    threads, any order of calls and any other bodies. Taichi must be running when poses are requested, on a backend with
    float64 (CPU and CUDA have it).

    Attributes:
        bodies: The bodies.
        timings: When each body's clock runs.
    """

    def __init__(self, bodies: Sequence[Body], timings: Timing | None = None) -> None:
        """Prepare the trajectories of `bodies`.

        Args:
            bodies: Bodies whose dynamics are closed-form or Stepped.
            timings: When each body's clock runs; None: AllTogether(0).

        Raises:
            ArgumentError: For timings that cannot apply to these bodies.
            ArgumentTypeError: For a bouncing body.
        """
        self.bodies = tuple(bodies)
        self.timings = AllTogether(0.0) if timings is None else timings
        for row, body in enumerate(self.bodies):
            if isinstance(body.dynamic, UniformMovementRandomBounce):
                raise ArgumentTypeError(
                    f"bodies[{row}] ({body.name!r}): dynamic={body.dynamic!r}: must be a path, such as "
                    "CatmullWaypoints; bouncing bodies need a SteppedSimulation"
                )
        self._paths = Paths(self.bodies, self.timings)

    def poses(self, time: float | Rational) -> NDArray[np.float64]:
        """Return the poses of all bodies at a time.

        Args:
            time: World time, seconds. A float stands for the decimal number that it prints as; pass Fraction(k, fps)
                for frame k of a stream. Times before 0 give the poses at 0; a body that is not born yet is at its start
                pose.

        Returns:
            float64 [n, 7], position (meters) and unit quaternion (w, x, y, z).
        """
        poses: NDArray[np.float64] = self.poses_at([time])[0]
        return poses

    def poses_at(self, times: Sequence[float | Rational]) -> NDArray[np.float64]:
        """Return the poses of all bodies at several times at once.

        Args:
            times: World times, seconds, as of `poses`.

        Returns:
            float64 [times, n, 7], the poses of each time.
        """
        for time in times:
            argument_checks.number(time, "time")
        poses: NDArray[np.float64] = self._paths.poses([exact(time) for time in times])
        return poses
