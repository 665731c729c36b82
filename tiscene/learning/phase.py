# SPDX-License-Identifier: Apache-2.0
"""Phase: a part of a course; CourseFrame: a frame that knows its phase."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any

from dynamics import argument_checks
from tiscene.errors import ArgumentError, ScenarioError
from tiscene.frame.frame import Frame
from tiscene.learning.drift import SCENARIO, Drift
from tiscene.learning.laps import LapTimes, lap_times, loops_of
from tiscene.learning.supervision_rules import SupervisionRules
from tiscene.learning.teaching_policies import Policy
from tiscene.scenario.scenario import Scenario

MAX_LAP = 10_000_000  # frames; longer ones are a mistake


@dataclass(frozen=True)
class Phase:
    """A part of a course: some frames of one scenario, with a teacher of its own.

    Attributes:
        name: its name, unique in the course.
        scenario: a Scenario, or the name or file of a scene or scenario.
        frames: number of frames; None: by `laps`.
        laps: number of laps of what moves in the scenario, from `start` on; None: by `frames`.
        supervision: rules of the teacher, or its policy alone; None: it is silent.
        evaluate: whether the learner only predicts here, and never learns; such a phase has no teacher.
        start: frame of the scenario that the phase begins with; the same scenario and start show equal frames again.
        step: frames of the scenario from one frame of the phase to the next; flow stays that of the scenario.
        drift: factors that change during the phase.
        lap_of: id of the object whose loop is a lap, or "camera"; None: all motion together.

    Raises:
        ArgumentError: a value is out of range.
    """

    name: str
    scenario: Scenario | str
    frames: int | None = None
    laps: int | None = None
    supervision: SupervisionRules | Policy | None = None
    evaluate: bool = False
    start: int = 0
    step: int = 1
    drift: Sequence[Drift] = ()
    lap_of: str | None = None

    def __post_init__(self) -> None:
        argument_checks.text(self.name, "name")
        where = f"phase {self.name!r}"
        if isinstance(self.scenario, str | os.PathLike):
            object.__setattr__(self, "scenario", Scenario.load(self.scenario))
        if not isinstance(self.scenario, Scenario):
            given = argument_checks.brief(self.scenario)
            raise ArgumentError(f"{where}: scenario={given}: must be a Scenario, a scene's name or a file")
        if (self.frames is None) == (self.laps is None):
            raise ArgumentError(f"{where}: give either frames= or laps=")
        for name, low in (("frames", 1), ("laps", 1), ("start", 0), ("step", 1)):
            value = getattr(self, name)
            if value is not None:
                argument_checks.integer(value, f"{where}: {name}", low)
        argument_checks.flag(self.evaluate, f"{where}: evaluate")
        if self.evaluate and self.supervision is not None:
            raise ArgumentError(f"{where}: evaluate=True: the learner only predicts here; leave out supervision=")
        if isinstance(self.supervision, Policy):
            object.__setattr__(self, "supervision", SupervisionRules(self.supervision))
        elif not isinstance(self.supervision, SupervisionRules | None):
            expected = "a policy, such as OnePixelPerMovingObject(), or SupervisionRules(policy, budget=100)"
            raise ArgumentError(f"{where}: supervision={argument_checks.brief(self.supervision)}: must be {expected}")
        if isinstance(self.drift, Drift):
            object.__setattr__(self, "drift", (self.drift,))
        if not isinstance(self.drift, Iterable) or not all(isinstance(each, Drift) for each in self.drift):
            raise ArgumentError(f"{where}: drift={self.drift!r}: must be a Drift or a sequence of them")
        # Other factors change the scenario that holds at a frame.
        object.__setattr__(self, "drift", tuple(sorted(self.drift, key=lambda each: each.factor != SCENARIO)))
        factors = [each.factor for each in self.drift]
        if repeated := [each for row, each in enumerate(factors) if each in factors[:row]]:
            raise ArgumentError(f"{where}: drift: two drifts of {repeated[0]!r}; give one, with all values")

    def length(self, fps: float) -> int:
        """Return the number of frames.

        Raises:
            ScenarioError: it lasts laps, and the scenario has none, or laps of more than 10 million frames.
        """
        if self.frames is not None:
            return self.frames
        laps = lap_times(self._scenario(), self.lap_of)
        if (count := laps.frames(1, fps)) > MAX_LAP:
            loops = ", ".join(f"{name!r} {float(period):.3g} s" for name, period in loops_of(self._scenario()).items())
            cause = f"a lap has {count:.3g} frames, the least common multiple of all loops ({loops})"
            raise ScenarioError(f"phase {self.name!r}: {cause}; give frames=, or lap_of= what has a shorter loop")
        return len(range(0, laps.frames(self.laps or 1, fps, self.start), self.step))

    def laps_of_motion(self) -> LapTimes | None:
        """Return when the laps of its scenario begin; None: its motion never repeats, or nothing moves."""
        try:
            return lap_times(self._scenario(), self.lap_of)
        except ScenarioError:
            return None

    def events(self, fps: float) -> dict[int, str]:
        """Return the frames of the phase at which a factor begins to change, with the names of the factors."""
        found: dict[int, list[str]] = {}
        for each in self.drift:
            for frame in each.schedule.events(self.length(fps), len(each.values)):
                found.setdefault(frame, []).append(each.factor)
        return {frame: ", ".join(found[frame]) for frame in sorted(found)}

    def warn_of_idle_drift(self, length: int) -> None:
        """Warn of factors that keep one value in all `length` frames of the phase."""
        for each in self.drift:
            count = len(each.values)
            first = each.schedule.position(0, count)
            if all(each.schedule.position(k, count) == first for k in range(1, length)):
                cause = f"drift of {each.factor!r} changes nothing in {length} frames"
                warnings.warn(f"phase {self.name!r}: {cause}: schedule={each.schedule!r}", stacklevel=3)

    def positions(self, k: int) -> tuple[float, ...]:
        """Return the positions of the drifting factors at frame k of the phase."""
        return tuple(each.schedule.position(k, len(each.values)) for each in self.drift)

    def scenario_at(self, positions: Sequence[float]) -> Scenario:
        """Return the scenario with the drifting factors at some positions."""
        scenario = self._scenario()
        for each, position in zip(self.drift, positions, strict=True):
            scenario = each.applied(scenario, position)
        return scenario

    def _scenario(self) -> Scenario:
        assert isinstance(self.scenario, Scenario)
        return self.scenario


@dataclass(frozen=True, eq=False, repr=False)
class CourseFrame(Frame):
    """A frame of a course. `index` counts in the course; `time` is that of the scenario.

    Attributes:
        phase: name of its phase.
        phase_index: its number in the phase.
        boundary: whether it is the first frame of its phase.
        lap: number of the lap in the phase's scenario; None: its motion never repeats.
        moving: instance ids of the objects that move between the frames before and after it.
    """

    phase: str = ""
    phase_index: int = 0
    boundary: bool = False
    lap: int | None = None
    moving: frozenset[int] = frozenset()

    __eq__ = object.__eq__
    __hash__ = object.__hash__

    @classmethod
    def of(cls, frame: Frame, **others: Any) -> CourseFrame:
        """Return a frame of a stream as a frame of a course."""
        return cls(**{each.name: getattr(frame, each.name) for each in fields(Frame)} | others)


def check_phases(value: Any, name: str) -> tuple[Phase, ...]:
    """Return `value`, a sequence of phases with different names, as a tuple."""
    if (
        isinstance(value, Phase)
        or not isinstance(value, Sequence)
        or not all(isinstance(each, Phase) for each in value)
    ):
        raise ArgumentError(f"{name}={argument_checks.brief(value)}: must be a sequence of Phase(name, scenario, ...)")
    names = [each.name for each in value]
    for row, each in enumerate(names):
        if each in names[:row]:
            raise ArgumentError(f"{name}[{row}]: another one is called {each!r} already")
    return tuple(value)
