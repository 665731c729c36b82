# SPDX-License-Identifier: Apache-2.0
"""Exact clocks: from world time to the parameter of every track, in integers until the last step.

A stream may run for ten million frames; rounded times k / fps, or an accumulated phase, would drift. Here times are
rational: a float stands for the decimal number that it prints as (0.1 is one tenth), times are counted in ticks of a
common denominator, and only the final quotient is rounded to a float. A loop of 3.3 s at 30 frames per second therefore
has identical poses every 99 frames, forever.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from numbers import Rational

import numpy as np
from numpy.typing import NDArray

from dynamics.dynamic import Track


def exact(seconds: float | Rational) -> Fraction:
    """Return the rational number that a time stands for: for a float, its shortest decimal."""
    if isinstance(seconds, Rational):
        return Fraction(int(seconds.numerator), int(seconds.denominator))
    return Fraction(repr(float(seconds)))


def common_multiple(a: Fraction, b: Fraction) -> Fraction:
    """Return the least common multiple of two positive times, s: the shortest time that both divide."""
    return Fraction(math.lcm(a.numerator, b.numerator), math.gcd(a.denominator, b.denominator))


@dataclass(frozen=True)
class Window:
    """When a body's clock runs.

    Args:
        start: World time at which it starts, seconds.
        active: Seconds for which it runs; None: forever.
        cycle: Period, seconds, after which the window repeats; None: once.
    """

    start: Fraction
    active: Fraction | None = None
    cycle: Fraction | None = None

    def times(self) -> tuple[Fraction, ...]:
        """Return those of the three times that are set."""
        return tuple(time for time in (self.start, self.active, self.cycle) if time is not None)


class Clocks:
    """The clocks of several bodies; each counts the time during which its body is both born and active."""

    def __init__(
        self, windows: Sequence[Window], births: Sequence[Fraction], tracks: Sequence[Sequence[Track]]
    ) -> None:
        """Convert all times to ticks of a common denominator.

        Args:
            windows: When each body's clock may run.
            births: World time, not negative, at which each body appears.
            tracks: The tracks of each body.
        """
        durations = [exact(track.duration) for body in tracks for track in body if track.duration is not None]
        times = [time for window in windows for time in window.times()]
        self._ticks = math.lcm(*(time.denominator for time in (*times, *births, *durations)))
        self._bodies = [
            (
                _TickWindow(self._count(window.start), self._optional(window.active), self._optional(window.cycle)),
                self._count(birth),
                [self._track(track) for track in body],
            )
            for window, birth, body in zip(windows, births, tracks, strict=True)
        ]

    def parameters(self, time: Fraction) -> NDArray[np.float64]:
        """Return u of every track, body after body, at a world time."""
        # `now` is in units of 1 / scale ticks; all other times are multiplied by scale.
        now, scale = time.numerator * self._ticks, time.denominator
        values = []
        for window, birth, tracks in self._bodies:
            clock = 0
            if now > birth * scale:
                clock = window.elapsed(now, scale) - window.elapsed(birth, 1) * scale
            for duration, (span, parts), repeat in tracks:
                whole = duration * scale
                if whole:
                    inside = clock % whole if repeat else min(clock, whole)
                    values.append(inside * span / (whole * parts))
                else:
                    values.append(0.0)
        return np.array(values or [0.0])  # a device array cannot be empty

    def _count(self, time: Fraction) -> int:
        return time.numerator * (self._ticks // time.denominator)

    def _optional(self, time: Fraction | None) -> int | None:
        return None if time is None else self._count(time)

    def _track(self, track: Track) -> tuple[int, tuple[int, int], bool]:
        duration = 0 if track.duration is None else self._count(exact(track.duration))
        return duration, track.span.as_integer_ratio(), track.repeat


@dataclass(frozen=True)
class _TickWindow:
    """A Window in integer ticks."""

    start: int
    active: int | None
    cycle: int | None

    def elapsed(self, now: int, scale: int) -> int:
        """Return the active time before `now`, both in ticks / scale."""
        passed = 0
        if self.cycle is not None and self.active is not None:
            cycles, now = divmod(now, self.cycle * scale)
            passed = cycles * self.active * scale
        inside = max(now - self.start * scale, 0)
        return passed + (inside if self.active is None else min(inside, self.active * scale))
