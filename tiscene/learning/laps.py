# SPDX-License-Identifier: Apache-2.0
"""Laps: how long the objects, cameras and lights of a scenario take until all are back where they began.

Times are exact fractions, as in `dynamics.clocks`: a loop of 3.3 s at 30 frames per second has laps of 99 frames.
Collisions and lifespans are not considered.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from dynamics import Still
from dynamics.clocks import Window, common_multiple, exact
from tiscene.errors import ObjectNotFound, ScenarioError
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera

CAMERA = "camera"


@dataclass(frozen=True)
class LapTimes:
    """When the laps of a scenario begin.

    Attributes:
        start: begin of lap 0, s.
        period: length of a lap, s.
    """

    start: Fraction
    period: Fraction

    def frames(self, laps: int, fps: float, first: int = 0) -> int:
        """Return the number of frames from frame `first` on until a number of laps is complete."""
        start = max(self.start, first / exact(fps))
        return math.ceil((start + laps * self.period) * exact(fps)) - first

    def lap(self, frame: int, fps: float) -> int:
        """Return the number of the lap that a frame belongs to; frames before the start belong to lap 0."""
        return max(0, math.floor((Fraction(frame) / exact(fps) - self.start) / self.period))


def lap_times(scenario: Scenario, of: str | None = None) -> LapTimes:
    """Return the laps of a scenario: the time after which all its motion repeats.

    Args:
        scenario: the scenario.
        of: the object, by its id, or "camera": laps of this alone. None: of all objects, cameras and lights together.

    Raises:
        ObjectNotFound: there is no such object.
        ScenarioError: nothing moves, or something never returns.
    """
    periods = []
    for name, start, period in _periods(scenario):
        if of is not None and name != of:
            continue
        if period == math.inf:
            raise ScenarioError(f"{name!r} never returns to its start: it has no laps; give frames= or lap_of=")
        periods.append((start, exact(period)))
    if of is not None and not periods and of not in {CAMERA, *(each.id for each in scenario.objects)}:
        raise ObjectNotFound("object", of, [CAMERA, *(each.id for each in scenario.objects)])
    if not periods:
        raise ScenarioError(f"{of or 'the scenario'!r} does not move: it has no laps; give frames=")
    return LapTimes(
        max(start for start, _ in periods), functools.reduce(common_multiple, (each for _, each in periods))
    )


def loops_of(scenario: Scenario) -> dict[str, Fraction | float]:
    """Return the periods of everything that moves in a scenario by name, s; infinite where it never returns."""
    return {name: period for name, _, period in _periods(scenario)}


def _periods(scenario: Scenario) -> Iterator[tuple[str, Fraction, Fraction | float]]:
    """Yield name, start and period of everything that moves; the period is infinite where it never returns."""
    bodies = [(each.id, each.dynamic or Still()) for each in scenario.objects]
    for (name, dynamic), window in zip(bodies, scenario.timings.windows(bodies), strict=True):
        if dynamic.loop_time and (window.active is None or window.active > 0):
            yield name, window.start if window.cycle is None else Fraction(0), _period(dynamic.loop_time, window)
    for camera in scenario.cameras:
        if isinstance(camera, Camera) and camera.dynamic is not None and camera.dynamic.loop_time:
            yield CAMERA, Fraction(0), camera.dynamic.loop_time
        if isinstance(camera, Camera) and camera.lens is not None and camera.lens.times[-1] > 0.0:
            yield CAMERA, Fraction(0), math.inf
    for light in scenario.lights:
        if light.dynamic is not None and light.dynamic.loop_time:
            yield light.light, Fraction(0), light.dynamic.loop_time
        if light.times and light.times[-1] > 0.0:
            yield light.light, Fraction(0), light.times[-1] if light.repeat else math.inf


def _period(loop_time: float, window: Window) -> Fraction | float:
    """Return the period of a body whose clock runs in a window."""
    if math.isinf(loop_time) or (window.active is not None and window.cycle is None):
        return math.inf
    loop = exact(loop_time)
    if window.cycle is None or window.active is None:
        return loop
    # In each cycle the body goes on by `active`; after `turns` cycles that is a whole number of loops.
    turns = (window.active / loop).denominator
    return window.cycle * turns
