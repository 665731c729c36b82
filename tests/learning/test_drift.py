# SPDX-License-Identifier: Apache-2.0
"""Schedules of drift, and phases that drift."""

import numpy as np
import pytest

from tests.learning.small_course import BALL, CHAIR, SMALL, same
from tiscene.errors import ArgumentError, UnknownName
from tiscene.learning.course import Course
from tiscene.learning.drift import Cycle, Drift, Mix, Ramp, Step
from tiscene.learning.phase import Phase
from tiscene.stream.stream import Stream


def test_schedules_have_the_positions_of_their_definitions():
    assert [Step(3).position(k, 2) for k in (0, 2, 3, 9)] == [0, 0, 1, 1]
    assert [Step((2, 4)).position(k, 3) for k in range(6)] == [0, 0, 1, 1, 2, 2]
    assert [Ramp(2, 6, steps=4).position(k, 2) for k in range(8)] == [0, 0, 0, 0.25, 0.5, 0.75, 1, 1]
    assert [Cycle(2).position(k, 3) for k in range(8)] == [0, 0, 1, 1, 2, 2, 0, 0]
    mix = [Mix(100, 1100, block=1).position(k, 2) for k in range(1200)]
    assert mix[:100] == [0] * 100
    assert mix[1100:] == [1] * 100
    for start in range(100, 1100, 200):
        share, expected = np.mean(mix[start : start + 200]), (start) / 1000
        assert abs(share - expected) < 4 * np.sqrt(expected * (1 - expected) / 200) + 0.01
    blocks = np.array([Mix(0, 200, block=20).position(k, 2) for k in range(200)]).reshape(10, 20)
    assert (blocks == blocks[:, :1]).all()


def test_schedules_name_their_events():
    assert Step((5, 50)).events(20, 3) == [5]
    assert Ramp(5, 9).events(20, 2) == [5]
    assert Mix(30, 40).events(20, 2) == []
    assert Cycle(6).events(20, 2) == [6, 12, 18]


@pytest.mark.parametrize(
    "make",
    [
        lambda: Step((3, 3)),
        lambda: Ramp(4, 4),
        lambda: Mix(0, 5, block=0),
        lambda: Cycle(0),
        lambda: Drift("speed", (1.0,), Step(1)),
        lambda: Drift("speed", (1.0, 2.0), "step"),
        lambda: Drift("scenario", (1.0, 2.0), Step(1)),
    ],
)
def test_wrong_schedules_are_refused(make):
    with pytest.raises(ArgumentError, match="="):
        make()


def test_numbers_are_interpolated_and_other_values_are_not():
    ramp = Drift("illumination", (1.0, 0.5), Ramp(0, 4, steps=4))
    assert [ramp.value(k) for k in range(5)] == [1.0, 0.875, 0.75, 0.625, 0.5]
    assert [Drift("materials", ("a", "b"), Ramp(0, 4)).value(k) for k in range(5)] == ["a", "a", "a", "b", "b"]


def test_drift_of_scenarios_shows_each_at_its_frames_in_equal_motion():
    drift = Drift("scenario", (BALL, CHAIR), Cycle(2))
    course = Course([Phase("drifting", BALL, frames=6, drift=drift)], **SMALL)
    names = list(course.categories.values())[1:]
    settings = {"width": 32, "height": 24, "buffers": SMALL["buffers"], "quality": "fast", "categories": names}
    streams = Stream(BALL, **settings), Stream(CHAIR, **settings)
    for k in (5, 0, 2, 3, 4, 1):  # out of order
        assert same(course[k], streams[k // 2 % 2][k])
        assert course[k].objects.by_name("mover").position == streams[0][k].objects.by_name("mover").position
    assert course.events() == {2: "scenario", 4: "scenario"}


def test_two_factors_drift_at_once():
    first = Drift("illumination", (0.0, -2.0), Step(2))
    phase = Phase("both", BALL, frames=4, drift=[first, Drift("scenario", (BALL, CHAIR), Step(3))])
    assert [each.factor for each in phase.drift] == ["scenario", "illumination"]  # which changes both scenarios
    assert phase.positions(2) == (0.0, 1.0)
    assert phase.events(25) == {2: "illumination", 3: "scenario"}
    dim = phase.scenario_at((1.0, 1.0))
    assert dim.objects == CHAIR.objects
    assert dim != CHAIR


def test_drifts_that_contradict_each_other_or_their_schedule_are_refused():
    first, second = (Drift("illumination", values, Step(1)) for values in ((0.0, -2.0), (0.0, 1.0)))
    with pytest.raises(ArgumentError, match="phase 'a': drift: two drifts of 'illumination'"):
        Phase("a", BALL, frames=3, drift=[first, second])
    with pytest.raises(ArgumentError, match=r"schedule=Step.*: has 3 changes; 2 values need 1"):
        Drift("illumination", (0.0, -2.0), Step((1, 2, 3)))
    with pytest.raises(UnknownName, match="Did you mean 'illumination'"):
        Drift("ilumination", (0.0, -2.0), Step(1))
    with pytest.raises(ArgumentError, match="must be finite"):
        Drift("illumination", (0.0, float("nan")), Step(1))
    with pytest.raises(ArgumentError, match=r"at=1.5: must be a whole number"):
        Step(1.5)
    late = Phase("late", BALL, frames=3, drift=Drift("illumination", (0.0, -2.0), Step(3)))
    with pytest.warns(UserWarning, match=r"phase 'late': drift of 'illumination' changes nothing in 3 frames: .*Step"):
        Course([late], **SMALL)
