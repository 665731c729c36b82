# SPDX-License-Identifier: Apache-2.0
"""Timings and clocks against values computed by hand."""

from fractions import Fraction

import numpy as np
import pytest

from dynamics import (
    AllTogether,
    AllTogetherTimings,
    Body,
    DictTimings,
    Keyframes,
    LinearWaypoints,
    Simulation,
    Still,
    Timing,
    WaitUntilComplete,
    WaitUntilCompleteTimings,
    Waypoint,
)
from dynamics.clocks import Clocks, Window, exact
from dynamics.dynamic import Track


def there_and_back(seconds: float) -> LinearWaypoints:
    """Return a path whose x goes from 0 to 1 and back; at the quarters it is 0, 0.5, 1, 0.5."""
    return LinearWaypoints([Waypoint((0, 0, 0)), Waypoint((1, 0, 0))], total_time=seconds)


def x(timing: Timing, times: list[float], *bodies: Body) -> list[list[float]]:
    simulation = Simulation(bodies, timing)
    return [np.round(simulation.poses(time)[:, 0], 12).tolist() for time in times]


def test_all_together_waits_once():
    bodies = Body(there_and_back(4.0)), Body(there_and_back(2.0))
    found = x(AllTogether(0.75), [0.0, 0.75, 1.75, 2.75, 4.75], *bodies)
    assert found == [[0, 0], [0, 0], [0.5, 1], [1, 0], [0, 0]]
    assert AllTogether() == AllTogether(1.0) == AllTogetherTimings(wait_time=1)


def test_wait_until_complete_takes_turns_and_repeats():
    bodies = Body(there_and_back(4.0)), Body(), Body(there_and_back(2.0))
    # wait 0-1, body 0 1-5, wait 5-6, body 2 6-8, wait 8-9, body 0 9-13, ...
    times = [0.5, 1.0, 3.0, 5.0, 5.5, 6.5, 7.0, 8.0, 8.5, 11.0, 15.0]
    found = x(WaitUntilComplete(1.0), times, *bodies)
    assert [row[0] for row in found] == [0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0]
    assert [row[1] for row in found] == [0] * 11
    assert [row[2] for row in found] == [0, 0, 0, 0, 0, 0.5, 1, 0, 0, 0, 1]
    once = x(WaitUntilCompleteTimings(1.0, repeat=False), times, *bodies)
    assert once[:9] == found[:9]
    assert once[9:] == [[0, 0, 0], [0, 0, 0]]


def test_dict_timings_pause_and_continue_bodies():
    bodies = Body(there_and_back(4.0), name="a"), Body(there_and_back(4.0), name="b"), Body(there_and_back(4.0))
    # b 0-1, a 1-2.5, b 2.5-3.5, a 3.5-5, ...
    found = x(DictTimings({"b": 1.0, 0: 1.5}), [0.0, 0.5, 1.0, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0], *bodies)
    assert [row[1] for row in found] == [0, 0.25, 0.5, 0.5, 0.5, 0.75, 1, 1, 1]
    assert [row[0] for row in found] == [0, 0, 0, 0.5, 0.75, 0.75, 0.75, 1, 0.5]
    assert [row[2] for row in found] == [0] * 9
    once = x(DictTimings({"b": 1.0, 0: 1.5}, repeat=False), [2.5, 5.0, 50.0], *bodies)
    assert once == [[0.75, 0.5, 0]] * 3


def test_clock_does_not_run_before_birth():
    path = there_and_back(4.0)
    found = x(AllTogether(0.5), [0.0, 2.0, 3.0, 4.0], Body(path), Body(path, birth=2), Body(path, birth=0.25))
    assert found[1:] == [[0.75, 0, 0.75], [0.75, 0.5, 0.75], [0.25, 1, 0.25]]
    # Born in the middle of its turn (0-1): only the rest of the turn counts.
    late = x(DictTimings({0: 1.0, 1: 1.0}), [0.75, 1.0, 1.5, 2.5], Body(path, birth=0.75), Body(path))
    assert [row[0] for row in late] == [0, 0.125, 0.125, 0.375]


def test_untimed_bodies_ignore_the_timings():
    camera = Body(there_and_back(4.0), timed=False)
    assert x(WaitUntilComplete(5.0), [1.0, 2.0], camera, Body(there_and_back(1.0))) == [[0.5, 0], [1, 0]]


def test_poses_are_identical_ten_million_frames_later():
    path = LinearWaypoints([Waypoint((0.1, 0, 0)), Waypoint((1, 0.7, 0)), Waypoint((0, 1, 3))], total_time=3.3)
    simulation = Simulation([Body(path)], AllTogether(0.7))
    # 3.3 s at 30 frames a second are 99 frames; the wait is 21.
    for frame in (0, 1, 50, 98):
        early, late = (
            simulation.poses(Fraction(21 + frame + 99 * loops, 30)).tobytes() for loops in (0, 10_000_000 // 99)
        )
        assert early == late


def test_exact_returns_the_decimal_that_a_float_prints_as():
    assert exact(0.1) == Fraction(1, 10)
    assert exact(3) == 3
    assert exact(Fraction(1, 3)) == Fraction(1, 3)
    assert exact(np.float64(29.97)) == Fraction(2997, 100)
    assert exact(np.int64(2**40)) == 2**40


def test_clock_parameters_are_rounded_once():
    windows = [Window(Fraction(1, 3)), Window(Fraction(1), Fraction(2), Fraction(5)), Window(Fraction(0), Fraction(0))]
    looping, holding, fixed = Track(3.0, 7.0, True), Track(3.0, 7.0, False), Track(None, 1.0, True)
    clocks = Clocks(windows, [Fraction(0)] * 3, [[looping, fixed], [looping, holding], [looping]])
    assert clocks.parameters(Fraction(-5)).tolist() == [0.0] * 5
    # Clocks: 4 - 1/3 = 11/3; one cycle (0-5) not ended: 2; never: 0.
    assert clocks.parameters(Fraction(4)).tolist() == [float(Fraction(11, 3) % 3 * 7 / 3), 0.0, 14 / 3, 14 / 3, 0.0]
    # Ten cycles of 2 s and 1 s of the eleventh: 21.
    assert clocks.parameters(Fraction(52)).tolist()[2:] == [0.0, 7.0, 0.0]


@pytest.mark.parametrize(
    ("error", "message", "make"),
    [
        (ValueError, "wait_time=-1: must not be negative", lambda: AllTogether(-1)),
        (TypeError, "wait_time='1': must be a number", lambda: WaitUntilComplete("1")),
        (TypeError, "repeat=1: must be True or False", lambda: WaitUntilComplete(1, 1)),
        (ValueError, "name one body or more", lambda: DictTimings({})),
        (TypeError, "must map bodies", lambda: DictTimings(3)),
        (TypeError, "must map bodies", lambda: DictTimings("ab")),
        (TypeError, "must be a pair", lambda: DictTimings([("a", 1.0, 2.0)])),
        (TypeError, "1.5 must be the index or the name", lambda: DictTimings({1.5: 1.0})),
        (TypeError, "True must be the index or the name", lambda: DictTimings({True: 1.0})),
        (ValueError, r"times\['a'\]=0: must be greater than 0", lambda: DictTimings({"a": 0})),
    ],
)
def test_invalid_arguments_raise_errors_that_name_them(error, message, make):
    with pytest.raises(error, match=message):
        make()


@pytest.mark.parametrize(
    ("message", "timing"),
    [
        ("the Keyframes of 'b' never returns", WaitUntilComplete(1.0)),
        ("no body 'c'; bodies 0 to 1 are: 'a', 'b'", DictTimings({"c": 1.0})),
        ("no body 2", DictTimings({2: 1.0})),
        ("no body -1", DictTimings({-1: 1.0})),
        (r"body 1 \('b'\) has two turns", DictTimings({"b": 1.0, 1: 2.0})),
    ],
)
def test_timings_that_do_not_fit_the_bodies_raise(message, timing):
    endless = Keyframes((0, 1), [Waypoint((0, 0, 0)), Waypoint((1, 0, 0))])
    with pytest.raises(ValueError, match=message):
        Simulation([Body(Still(), name="a"), Body(endless, name="b")], timing)


def test_dict_timings_keep_their_order_and_compare():
    timing = DictTimings({"b": 1, 0: 2})
    assert timing.times == (("b", 1.0), (0, 2.0))
    assert timing == DictTimings((("b", 1.0), (0, 2.0)))
    assert timing != DictTimings({0: 2, "b": 1})
    assert hash(timing) == hash(DictTimings(timing.times))
