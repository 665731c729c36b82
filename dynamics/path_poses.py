# SPDX-License-Identifier: Apache-2.0
"""Poses of bodies on their paths, without collisions.

Evaluates closed-form tracks in a kernel and Stepped dynamics in Python, at the times that each body's clock shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from dynamics.bodies import Body, columns
from dynamics.clocks import Clocks, Window, exact
from dynamics.closed_form import check_closed_form
from dynamics.dynamic import Array, Track
from dynamics.quadrature import GAUSS
from dynamics.random_bounce import UniformMovementRandomBounce
from dynamics.stepped_dynamic import Stepped
from dynamics.timings import ALWAYS, AssignedWindows, Timing
from dynamics.trajectory_kernel import evaluate

# A clock as a track whose parameter is its time in seconds; longer than any stream.
_CLOCK = Track(2.0**40, 2.0**40, False)


class Paths:
    """The paths of bodies on their clocks; a bouncing body stays at its start pose."""

    def __init__(self, bodies: Sequence[Body], timings: Timing | AssignedWindows, label: str = "bodies") -> None:
        """Build the tracks and clocks.

        Args:
            bodies: The bodies.
            timings: When each body's clock runs.
            label: What error messages call the sequence of bodies.

        Raises:
            ArgumentError: For timings that cannot apply to these bodies.
            ArgumentTypeError: For a dynamic that is neither closed-form nor Stepped nor bouncing.
        """
        self._tracks = [_tracks(body, f"{label}[{row}] ({body.name!r}): dynamic") for row, body in enumerate(bodies)]
        self._all_static = not any(body.duration for body in bodies)
        self._columns: tuple[Any, ...] = (*columns(self._tracks).arrays(), GAUSS)
        self._stepped = {row: states for row, body in enumerate(bodies) if (states := body.states) is not None}
        births = [exact(body.birth) for body in bodies]
        windows = _windows(bodies, timings)
        self._clocks = Clocks(windows, births, self._tracks)
        self._seconds = Clocks(windows, births, [[_CLOCK]] * len(bodies))
        self._static_poses: Array | None = None

    def __len__(self) -> int:
        return len(self._tracks)

    def seconds(self, time: Fraction) -> Array:
        """Return the time [n], seconds, that each body's clock shows at a world time."""
        return self._seconds.parameters(time)

    def poses(self, times: Sequence[Fraction]) -> Array:
        """Return the poses of all bodies at some world times: float64 [times, n, 7]. Taichi must be running."""
        if not len(self):
            return np.zeros((len(times), 0, 7))
        if self._all_static and self._static_poses is None:
            self._static_poses = self._evaluate([Fraction(0)])
        poses: Array
        if self._static_poses is not None:
            poses = np.repeat(self._static_poses, len(times), axis=0)
        else:
            poses = self._evaluate(times)
        if self._stepped:
            for row, time in enumerate(times):
                clocks = self._seconds.parameters(time).tolist()
                for body, states in self._stepped.items():
                    poses[row, body] = states.pose_at(clocks[body])
        return poses

    def _evaluate(self, times: Sequence[Fraction]) -> Array:
        poses = np.zeros((len(times) * len(self), 7))
        evaluate(*self._columns, np.array([self._clocks.parameters(time) for time in times]), poses)
        return poses.reshape(len(times), len(self), 7)


def _tracks(body: Body, name: str) -> tuple[Track, ...]:
    if not isinstance(body.dynamic, UniformMovementRandomBounce | Stepped):
        check_closed_form(body.dynamic, name)
    return body.tracks


def _windows(bodies: Sequence[Body], timings: Timing | AssignedWindows) -> list[Window]:
    """Return when each body's clock runs; bodies that are not timed always run."""
    timed = [row for row, body in enumerate(bodies) if body.timed]
    windows = [ALWAYS] * len(bodies)
    timed_windows = timings.windows([(bodies[row].name, bodies[row].dynamic) for row in timed])
    for row, window in zip(timed, timed_windows, strict=True):
        windows[row] = window
    return windows
