# SPDX-License-Identifier: Apache-2.0
"""ScenarioRanges: the ranges that `Scenario.sample` draws from, which control a stream's visual complexity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

from dynamics import argument_checks
from tiscene.errors import ArgumentError, ArgumentTypeError

DYNAMICS = ("still", "linear", "catmull", "bounce")


@dataclass(frozen=True)
class ScenarioRanges:
    """Validated ranges; `Scenario.sample` documents each. One number stands for a range of one value.

    Raises:
        ArgumentError: a value is not a range, or can never be met.
    """

    objects: tuple[int, int] = (1, 3)
    templates: Sequence[str] | None = None
    dynamics: Sequence[str] = ("catmull",)
    speed: tuple[float, float] = (0.2, 0.8)
    angular_speed: tuple[float, float] = (0.0, 0.8)
    waypoints: tuple[int, int] = (3, 5)
    scale: tuple[float, float] = (1.0, 1.0)
    depth: tuple[float, float] = (1.0, 5.0)
    region: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)
    in_view: tuple[float, float] = (1.0, 1.0)
    occlusion: tuple[float, float] = (0.0, 0.0)
    min_size: float = 0.03
    frames: int | None = None
    life: tuple[int, int] | None = None
    wait_time: float = 0.0
    aspect: float = 4.0 / 3.0

    def __post_init__(self) -> None:
        for name, least, most in (("objects", 0, math.inf), ("waypoints", 2, 64), ("life", 1, math.inf)):
            if name != "life" or self.life is not None:
                self._set(name, whole_range_of(getattr(self, name), name, least, most))
        for name, most in (("speed", math.inf), ("angular_speed", math.inf), ("in_view", 1.0), ("occlusion", 1.0)):
            self._set(name, range_of(getattr(self, name), name, most))
        for name in ("scale", "depth"):
            self._set(name, range_of(getattr(self, name), name, argument_checks.MAX_POSITION))
            if getattr(self, name)[0] <= 0.0:
                raise ArgumentError(f"{name}={getattr(self, name)}: must be greater than 0")
        self._set("dynamics", words_of(self.dynamics, "dynamics"))
        for word in self.dynamics:
            if word not in DYNAMICS:
                raise ArgumentError(f"dynamics: {word!r} is not one of {', '.join(map(repr, DYNAMICS))}")
        if self.templates is not None:
            self._set("templates", words_of(self.templates, "templates"))
        moving = set(self.dynamics) - {"still"}
        if moving and self.speed[0] <= 0.0:
            raise ArgumentError(f"speed={self.speed}: moving objects need a speed above 0; or use dynamics=('still',)")
        left, top, right, bottom = argument_checks.numbers(self.region, "region", 4)
        if not (0.0 <= left < right <= 1.0 and 0.0 <= top < bottom <= 1.0):
            raise ArgumentError(f"region={self.region}: must be left < right and top < bottom, within 0..1")
        if self.occlusion[0] > 0.0 and self.in_view[1] == 0.0:
            raise ArgumentError("occlusion is a fraction of the path in view, but in_view=0 leaves none; raise in_view")
        self._set("frames", argument_checks.optional(check_frames)(self.frames, "frames"))
        if self.life is not None and self.frames is None:
            raise ArgumentError(f"life={self.life}: give the length of the stream too, frames=")
        if self.life is not None and self.frames is not None and self.life[1] > self.frames:
            raise ArgumentError(f"life={self.life} is longer than the stream: frames={self.frames}")
        min_size = argument_checks.number(self.min_size, "min_size")
        if not 0.0 <= min_size <= 1.0:
            raise ArgumentError(
                f"min_size={self.min_size!r}: must be a fraction of the image's height, 0 <= min_size <= 1"
            )
        self._set("min_size", min_size)
        self._set("aspect", argument_checks.positive(self.aspect, "aspect"))
        self._set("wait_time", argument_checks.not_negative(self.wait_time, "wait_time"))

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)


def check_frames(value: Any, name: str) -> int:
    """Return `value`, the length of a stream, as an int of 1 or more."""
    return argument_checks.integer(value, name, 1)


def range_of(value: Any, name: str, most: float, least: float = 0.0) -> tuple[float, float]:
    """Return `value` as (low, high) within least..most."""
    values = (value, value) if isinstance(value, Real) else value
    if not argument_checks.is_series(values):
        raise ArgumentTypeError(f"{name}={value!r}: must be a number or a range (low, high)")
    low, high = argument_checks.numbers(values, name, 2)
    if not least <= low <= high <= most:
        limits = f"must be {least:g} or more" if most == math.inf else f"must lie within {least:g}..{most:g}"
        raise ArgumentError(f"{name}={value!r}: {limits}, low before high")
    return (low, high)


def whole_range_of(value: Any, name: str, least: int, most: float) -> tuple[int, int]:
    """Return `value` as whole numbers (low, high) within least..most."""
    low, high = range_of(value, name, math.inf)
    if low != int(low) or high != int(high) or low < least or high > most:
        limits = f"{least} or more" if most == math.inf else f"from {least} to {most:g}"
        raise ArgumentError(f"{name}={value!r}: must be whole numbers, {limits}")
    return (int(low), int(high))


def words_of(value: Any, name: str) -> tuple[str, ...]:
    """Return `value`, names, as a tuple."""
    if isinstance(value, str) or not isinstance(value, Sequence) or not all(isinstance(each, str) for each in value):
        raise ArgumentError(f"{name}={value!r}: must be a sequence of names")
    if not value:
        raise ArgumentError(f"{name}: name at least one")
    return tuple(value)
