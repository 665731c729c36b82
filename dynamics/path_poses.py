# SPDX-License-Identifier: Apache-2.0
"""Paths: where bodies would be if nothing were in their way."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from dynamics.bodies import Body, columns
from dynamics.clocks import Clocks, Window, exact
from dynamics.closed_form import check_closed_form
from dynamics.dynamic import Array, Track, fixed
from dynamics.quadrature import GAUSS
from dynamics.random_bounce import UniformMovementRandomBounce
from dynamics.stepped_dynamic import Stepped, SteppedStates
from dynamics.timings import ALWAYS, Timing
from dynamics.trajectory_kernel import evaluate

# A clock as a track whose parameter is its time in seconds; longer than any stream.
_CLOCK = Track(2.0**40, 2.0**40, False)


class Paths:
    """The paths of bodies on their clocks. What bounces has none: it stays at its start."""

    def __init__(self, bodies: Sequence[Body], timings: Timing, label: str = "bodies") -> None:
        """label: what error messages call the bodies. Raises ValueError for timings that cannot work, TypeError."""
        self._tracks = [_tracks(body, f"{label}[{row}] ({body.name!r}): dynamic") for row, body in enumerate(bodies)]
        self._fixed = not any(track.duration for tracks in self._tracks for track in tracks)
        self._columns: tuple[Any, ...] = (*columns(self._tracks).arrays(), GAUSS)
        self._scripts = {
            row: SteppedStates(body.dynamic, body.start, body.name)
            for row, body in enumerate(bodies)
            if isinstance(body.dynamic, Stepped)
        }
        births = [exact(body.birth) for body in bodies]
        windows = _windows(bodies, timings)
        self._clocks = Clocks(windows, births, self._tracks)
        self._seconds = Clocks(windows, births, [[_CLOCK]] * len(bodies))
        self._standing: Array | None = None

    def __len__(self) -> int:
        return len(self._tracks)

    def seconds(self, time: Fraction) -> Array:
        """What every body's clock shows at a time of the world, s: [n]."""
        return self._seconds.parameters(time)

    def poses(self, times: Sequence[Fraction]) -> Array:
        """All bodies at some times of the world: float64 [times, n, 7]. Taichi must run."""
        if not len(self):
            return np.zeros((len(times), 0, 7))
        if self._fixed and self._standing is None:
            self._standing = self._evaluated([Fraction(0)])
        poses: Array
        if self._standing is not None:
            poses = np.repeat(self._standing, len(times), axis=0)
        else:
            poses = self._evaluated(times)
        if self._scripts:
            for row, time in enumerate(times):
                clocks = self._seconds.parameters(time).tolist()
                for body, script in self._scripts.items():
                    poses[row, body] = script.at(clocks[body])
        return poses

    def _evaluated(self, times: Sequence[Fraction]) -> Array:
        poses = np.zeros((len(times) * len(self), 7))
        evaluate(*self._columns, np.array([self._clocks.parameters(time) for time in times]), poses)
        return poses.reshape(len(times), len(self), 7)


def _tracks(body: Body, name: str) -> tuple[Track, ...]:
    if isinstance(body.dynamic, UniformMovementRandomBounce | Stepped):
        return (fixed(body.start),)
    return check_closed_form(body.dynamic, name).tracks(body.start)


def _windows(bodies: Sequence[Body], timings: Timing) -> list[Window]:
    """When each body's clock runs."""
    timed = [row for row, body in enumerate(bodies) if body.timed]
    windows = [ALWAYS] * len(bodies)
    answer = timings.windows([(bodies[row].name, bodies[row].dynamic) for row in timed])
    for row, window in zip(timed, answer, strict=True):
        windows[row] = window
    return windows
