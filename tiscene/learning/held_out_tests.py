# SPDX-License-Identifier: Apache-2.0
"""Tests on frames that were never shown: held-out frames of a phase, and the same frames with one factor changed."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from dynamics.argument_checks import positive
from dynamics.clocks import exact
from tiscene.errors import ArgumentError, ArgumentTypeError, counted
from tiscene.learning.phase import Phase, check_phases
from tiscene.scenario.scenario import Scenario

SEPARATOR = " | "  # between the name of a phase and what a test of it changes


def held_out(
    phases: Sequence[Phase], frames: int, start: int = 1000, step: int = 1, fps: float = 25.0
) -> tuple[Phase, ...]:
    """Return tests on later frames of the scenarios of phases, one for each phase that learns.

    The motion of a scenario goes on for ever. Where its objects collide, the first test steps through all frames before
    `start`, once. A warning names tests that show what their phase has shown, as where all motion repeats.

    Args:
        phases: of a course.
        frames: of each test.
        start: first frame of the tests in their scenarios.
        step: frames of the scenario from one frame of a test to the next.
        fps: frames per second of the course, to know which frames are alike.
    """
    positive(fps, "fps")
    tests = []
    for phase in check_phases(phases, "phases"):
        if phase.evaluate:
            continue
        test = replace(phase, frames=frames, laps=None, start=start, step=step, supervision=None, drift=())
        if not phase.drift and (count := _shown_before(phase, test, fps)):
            text = f"held_out: test {test.name!r}: its phase has shown {count} of its {counted(frames, 'frame')}"
            warnings.warn(f"{text}; choose a later start=, or other paths where all motion repeats", stacklevel=2)
        tests.append(test)
    return tuple(tests)


def counterfactuals(
    phases: Sequence[Phase],
    factors: Mapping[str, Sequence[Any]],
    frames: int,
    *,
    start: int = 0,
    step: int = 1,
    seed: int = 0,
) -> tuple[Phase, ...]:
    """Return tests on the frames of phases with one factor changed, and everything else as it is.

    Args:
        phases: of a course.
        factors: values by name of a factor of `Scenario.with_factor`, such as {"illumination": ["night"]}.
        frames: of each test.
        start: first frame of the tests in their scenarios.
        step: frames of the scenario from one frame of a test to the next.
        seed: of the factors' draws.

    Returns:
        A test for each phase that learns and each value, named "phase | factor value". They belong to no phase, so they
        count as held out.

    Raises:
        UnknownName, ArgumentError, ScenarioError: a scenario cannot have a factor.
    """
    if not factors:
        raise ArgumentError("factors={}: name one factor or more")
    for name, values in factors.items():
        if isinstance(values, str) or not isinstance(values, Iterable):
            raise ArgumentTypeError(f"factors: {name}={values!r}: must be a list of values")
    tests = []
    for phase in check_phases(phases, "phases"):
        if phase.evaluate:
            continue
        assert isinstance(phase.scenario, Scenario)  # since Phase.__post_init__
        for name, values in factors.items():
            for value in values:
                scenario = phase.scenario.with_factor(name, value, seed=seed)
                title = f"{phase.name}{SEPARATOR}{name}" + ("" if value is None else f" {value}")
                tests.append(Phase(title, scenario, frames=frames, start=start, step=step, evaluate=True))
    return tuple(tests)


def _shown_before(phase: Phase, test: Phase, fps: float) -> int:
    """Return how many frames of a test are frames of its phase, or of another lap of the same motion."""
    laps = replace(phase, lap_of=None).laps_of_motion()
    begin, lap = 0, 0
    if laps is not None:
        begin, lap = math.ceil(laps.start * exact(fps)), (laps.period * exact(fps)).numerator

    def first_lap(frame: int) -> int:
        return begin + (frame - begin) % lap if lap and frame >= begin else frame

    shown, tested = ([first_lap(each.start + each.step * k) for k in range(each.length(fps))] for each in (phase, test))
    return sum(map(set(shown).__contains__, tested))
