# SPDX-License-Identifier: Apache-2.0
"""Exact clocks: from the time of the world to the parameter of every track, in whole numbers until the last step.

A stream may run for ten million frames; k / fps rounded, or a phase summed up, would have drifted by then. Here times
are rational: a float stands for the decimal number it was written as (0.1 is one tenth), everything is counted in
ticks of a common denominator, and only the final quotient is rounded to a float. So a loop of 3.3 s at 30 frames per
second has the very same poses every 99 frames, for ever.
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
    """The rational number that a time stands for: of a float, its shortest decimal."""
    if isinstance(seconds, Rational):
        return Fraction(int(seconds.numerator), int(seconds.denominator))
    return Fraction(repr(float(seconds)))


@dataclass(frozen=True)
class Window:
    """When a body's clock runs: from `start` on, `active` seconds (None: for ever), in every `cycle` (None: once)."""

    start: Fraction
    active: Fraction | None = None
    cycle: Fraction | None = None

    def times(self) -> tuple[Fraction, ...]:
        return tuple(time for time in (self.start, self.active, self.cycle) if time is not None)


class Clocks:
    """The clocks of several bodies. A body's clock counts the time during which it was both born and active."""

    def __init__(
        self, windows: Sequence[Window], births: Sequence[Fraction], tracks: Sequence[Sequence[Track]]
    ) -> None:
        """windows, births (world time, not negative), tracks: one each per body."""
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
        """u of every track, body after body, at a time of the world."""
        # One tick of the world's time is 1 / scale of a tick of the windows; all the rest is multiplied by scale.
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
    """A Window in whole ticks."""

    start: int
    active: int | None
    cycle: int | None

    def elapsed(self, now: int, scale: int) -> int:
        """Active time before `now`, both in ticks / scale."""
        passed = 0
        if self.cycle is not None and self.active is not None:
            cycles, now = divmod(now, self.cycle * scale)
            passed = cycles * self.active * scale
        inside = max(now - self.start * scale, 0)
        return passed + (inside if self.active is None else min(inside, self.active * scale))
