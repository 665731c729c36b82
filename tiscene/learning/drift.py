# SPDX-License-Identifier: Apache-2.0
"""Drift: factors of a scenario that change with the frame number, by schedules that the evaluator knows.

Frame k of a drifting phase is frame k of the scenario whose factors have their values at k. So drift keeps streams
seekable, and what a factor does not touch, such as the motion under another light, is the same on both sides.

Schedules follow the kinds of drift of Gama et al., "A Survey on Concept Drift Adaptation" (2014): sudden (`Step`),
incremental (`Ramp`), gradual (`Mix`) and recurrent (`Cycle`).
"""

from __future__ import annotations

import bisect
import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynamics import argument_checks
from tiscene.errors import ArgumentError, UnknownName, counted
from tiscene.randomization.factors import FACTORS
from tiscene.scenario.scenario import Scenario

SCENARIO = "scenario"  # the factor whose values are whole scenarios
_MIX = 0x3107


class Schedule(ABC):
    """Which of several values a factor has at each frame of a phase."""

    @abstractmethod
    def position(self, k: int, count: int) -> float:
        """Return the position among `count` values at frame k, 0 to count - 1; fractions lie between two values."""

    @abstractmethod
    def events(self, frames: int, count: int) -> list[int]:
        """Return the frames of a phase of `frames` frames at which a change begins."""


@dataclass(frozen=True)
class Step(Schedule):
    """Sudden drift: from each frame of `at` on, the next value.

    Attributes:
        at: one frame, or several in ascending order.
    """

    at: int | Sequence[int]

    def __post_init__(self) -> None:
        at = tuple(self.at) if isinstance(self.at, Iterable) and not isinstance(self.at, str) else (self.at,)
        for frame in at:
            argument_checks.whole(frame, "at")
        if not at or any(b <= a for a, b in itertools.pairwise((-1, *at))):
            raise ArgumentError(f"at={self.at!r}: must be one or more frames from 0 on, ascending")
        object.__setattr__(self, "at", at)

    def position(self, k: int, count: int) -> float:
        return float(min(bisect.bisect_right(self.frames(), k), count - 1))

    def events(self, frames: int, count: int) -> list[int]:
        return [at for at in self.frames()[: count - 1] if 0 < at < frames]

    def frames(self) -> tuple[int, ...]:
        """Return the frames of the changes."""
        return self.at  # type: ignore[return-value]  # a tuple since __post_init__


@dataclass(frozen=True)
class _Transition(Schedule):
    """Drift that begins at one frame and ends at another."""

    start: int
    end: int

    def __post_init__(self) -> None:
        if not 0 <= argument_checks.whole(self.start, "start") < argument_checks.whole(self.end, "end"):
            raise ArgumentError(f"start={self.start!r}, end={self.end!r}: must be 0 <= start < end")

    def events(self, frames: int, count: int) -> list[int]:
        return [self.start] if 0 < self.start < frames else []

    def _done(self, k: int) -> float:
        """Return the fraction of the transition that is over at frame k."""
        return min(max((k - self.start) / (self.end - self.start), 0.0), 1.0)


@dataclass(frozen=True)
class Ramp(_Transition):
    """Incremental drift: through all values from frame `start` to frame `end`, in `steps` equal steps.

    Attributes:
        start: frame at which it begins. Each step is taken at its middle, so the first value holds half a step longer.
        end: frame at which it is over; the last value holds from half a step before.
        steps: number of steps. Numbers are interpolated between the values; of other values the nearest holds.
    """

    steps: int = 8

    def __post_init__(self) -> None:
        super().__post_init__()
        argument_checks.integer(self.steps, "steps", 1)

    def position(self, k: int, count: int) -> float:
        return round(self._done(k) * self.steps) / self.steps * (count - 1)


@dataclass(frozen=True)
class Mix(_Transition):
    """Gradual drift: blocks of frames with the old and with the new value alternate; new ones become more frequent.

    Attributes:
        start: from here on blocks may have the next value.
        end: from here on all blocks have the last value.
        block: frames of a block.
        seed: of the blocks' random numbers.
    """

    block: int = 25
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        argument_checks.integer(self.block, "block", 1)
        argument_checks.integer(self.seed, "seed", 0)

    def position(self, k: int, count: int) -> float:
        if k < self.start or k >= self.end:
            return self._done(k) * (count - 1)
        block = (k - self.start) // self.block
        place = self._done(self.start + block * self.block) * (count - 1)
        drawn = np.random.default_rng((_MIX, self.seed, block)).random()
        return min(float(int(place) + (drawn < place - int(place))), count - 1.0)


@dataclass(frozen=True)
class Cycle(Schedule):
    """Recurrent drift: each value for `period` frames, then the next; after the last the first again.

    Attributes:
        period: frames of each value.
    """

    period: int

    def __post_init__(self) -> None:
        argument_checks.integer(self.period, "period", 1)

    def position(self, k: int, count: int) -> float:
        return float(k // self.period % count)

    def events(self, frames: int, count: int) -> list[int]:
        return list(range(self.period, frames, self.period))


@dataclass(frozen=True)
class Drift:
    """A factor whose value changes during a phase.

    Attributes:
        factor: name of a factor of `Scenario.with_factor`, such as "illumination"; or "scenario", whose values are
            scenarios.
        values: two or more values, in the order of the schedule. Values that are numbers are interpolated by `Ramp`.
        schedule: Step, Ramp, Mix or Cycle, or a schedule of your own.
        seed: of the factor's draws, where a value is a range.

    Raises:
        UnknownName: there is no such factor.
        ArgumentError: a value is out of range, or a Step has not one frame less than there are values.
    """

    factor: str
    values: Sequence[Any]
    schedule: Schedule
    seed: int = 0

    def __post_init__(self) -> None:
        if argument_checks.text(self.factor, "factor") not in (*FACTORS, SCENARIO):
            raise UnknownName("factor", self.factor, (*FACTORS, SCENARIO))
        if isinstance(self.values, str) or not isinstance(self.values, Sequence) or len(self.values) < 2:
            raise ArgumentError(f"values={self.values!r}: must be two or more values of {self.factor!r}")
        if any(isinstance(each, float) and not math.isfinite(each) for each in self.values):
            raise ArgumentError(f"values={self.values!r}: must be finite")
        if not isinstance(self.schedule, Schedule):
            raise ArgumentError(f"schedule={self.schedule!r}: must be a schedule, such as Step(at=100)")
        if self.factor == SCENARIO and not all(isinstance(each, Scenario) for each in self.values):
            raise ArgumentError(
                f"values={argument_checks.brief(self.values)}: the factor 'scenario' has scenarios as values"
            )
        if isinstance(self.schedule, Step) and len(self.schedule.frames()) != len(self.values) - 1:
            steps, count = len(self.schedule.frames()), len(self.values)
            raise ArgumentError(
                f"schedule={self.schedule!r}: has {counted(steps, 'change')}; "
                f"{counted(count, 'value needs', 'values need')} {count - 1}"
            )
        object.__setattr__(self, "values", tuple(self.values))

    def value(self, k: int) -> Any:
        """Return the factor's value at frame k of its phase."""
        return self.at(self.schedule.position(k, len(self.values)))

    def at(self, position: float) -> Any:
        """Return the value at a position of the schedule."""
        low = int(position)
        if position == low:
            return self.values[low]
        first, second, part = self.values[low], self.values[low + 1], position - low
        if argument_checks.is_number(first) and argument_checks.is_number(second):
            return (1.0 - part) * first + part * second
        return self.values[round(position)]

    def applied(self, scenario: Scenario, position: float) -> Scenario:
        """Return a scenario with the factor's value at a position of the schedule."""
        value = self.at(position)
        return value if self.factor == SCENARIO else scenario.with_factor(self.factor, value, seed=self.seed)
