# SPDX-License-Identifier: Apache-2.0
"""Poses and argument errors of Still, Orbit, LookAt, Keyframes and Composite."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dynamics import Body, Composite, Dynamic, Keyframes, LinearWaypoints, LookAt, Orbit, Simulation, Still, Waypoint
from dynamics.rotation import quaternion, rotate

LINE = LinearWaypoints([Waypoint((0, 0, 0)), Waypoint((4, 0, 0))], total_time=8.0)


def pose(body: Body, time: float) -> np.ndarray:
    return Simulation([body]).poses(time)[0]


def test_still_body_stays_where_it_is_placed():
    body = Body(position=(1, 2, 3), rotation=(10, 20, 30))
    expected = [1, 2, 3, *quaternion((10, 20, 30))]
    for time in (-1, 0, 5, 10**9):
        np.testing.assert_allclose(pose(body, time), expected, atol=1e-15)
    assert Still().loop_time == 0.0


def test_orbit_rotates_start_pose_about_axis():
    body = Body(Orbit(center=(1, 0, 0), period=8.0), position=(1, 1, 2), rotation=(0, 30, 0))
    np.testing.assert_allclose(pose(body, 0)[:3], (1, 1, 2), atol=1e-15)
    # A quarter turn about +y takes +z to +x.
    quarter = pose(body, 2)
    np.testing.assert_allclose(quarter[:3], (3, 1, 0), atol=1e-15)
    np.testing.assert_allclose(quarter[3:], quaternion((0, 120, 0)), atol=1e-15)
    np.testing.assert_allclose(pose(body, 4)[:3], (1, 1, -2), atol=1e-15)
    assert pose(body, 8).tobytes() == pose(body, 0).tobytes()
    tilted = Orbit(axis=(0, 0, 2), period=4.0)
    np.testing.assert_allclose(pose(Body(tilted, (1, 0, 5)), 1)[:3], (0, 1, 5), atol=1e-15)


@pytest.mark.parametrize("target", [(0, 0, 0), (5, 1, -3), (-2, 4, 1), (0.1, -7, 0.2), (3, 0, 9)])
def test_look_at_points_minus_z_at_target_and_stays_upright(target):
    body = Body(LookAt(target, LINE), position=(9, 9, 9))
    for time in (1.0, 3.3, 6.5):
        found = pose(body, time)
        np.testing.assert_allclose(found[:3], pose(Body(LINE), time)[:3])
        toward = np.subtract(target, found[:3])
        forward, right, up = (rotate(found[3:], axis) for axis in ((0, 0, -1), (1, 0, 0), (0, 1, 0)))
        np.testing.assert_allclose(forward, toward / np.linalg.norm(toward), atol=1e-14)
        assert abs(right[1]) < 1e-14
        assert up[1] > 0


def test_look_at_parallel_to_up_gives_a_rotation():
    for target in ((0, 5, 0), (0, -5, 0)):
        found = pose(Body(LookAt(target)), 0)
        np.testing.assert_allclose(np.linalg.norm(found[3:]), 1.0)
        np.testing.assert_allclose(rotate(found[3:], (0, 0, -1)), np.sign(target), atol=1e-14)
    # At the target itself the direction is undefined; the rotation stays.
    np.testing.assert_allclose(pose(Body(LookAt((1, 2, 3)), (1, 2, 3), (0, 40, 0)), 0)[3:], quaternion((0, 40, 0)))


def test_keyframes_hold_at_both_ends_and_interpolate_between_keys():
    keys = [Waypoint((0, 0, 0)), Waypoint((1, 0, 0), (0, 90, 0)), Waypoint((1, 3, 0), (0, 90, 90))]
    body = Body(Keyframes((0.5, 1.0, 4.0), keys))
    xs = [pose(body, time)[:2].tolist() for time in (0, 0.5, 0.75, 1.0, 2.0, 4.0, 400)]
    np.testing.assert_allclose(xs, [(0, 0), (0, 0), (0.5, 0), (1, 0), (1, 1), (1, 3), (1, 3)], atol=1e-15)
    half = Rotation.from_quat(pose(body, 0.75)[[4, 5, 6, 3]]).as_rotvec()
    np.testing.assert_allclose(half, (0, math.pi / 4, 0), atol=1e-14)
    again = Body(Keyframes((0.5, 1.0, 4.0), keys, repeat=True))
    np.testing.assert_allclose(pose(again, 6.0)[:2], (1, 1), atol=1e-15)
    assert Keyframes((0.5, 1.0, 4.0), keys).loop_time == math.inf
    assert Keyframes((0.5, 1.0, 4.0), keys, repeat=True).loop_time == 4.0


def test_composite_part_moves_in_frame_of_previous_parts():
    # The cart faces left; the second part is half a meter ahead in its frame.
    cart = LinearWaypoints([Waypoint((0, 0, 0), (0, 90, 0)), Waypoint((4, 0, 0), (0, 90, 0))], total_time=8.0)
    ahead = LinearWaypoints([Waypoint((0, 0, -0.5)), Waypoint((0, 0, -1.5))], total_time=4.0)
    found = pose(Body(Composite((cart, ahead))), 1.0)
    np.testing.assert_allclose(found[:3], (1 - 1.0, 0, 0), atol=1e-15)
    spinning = pose(Body(Composite((LINE, Orbit(period=4.0)))), 1.0)
    np.testing.assert_allclose(spinning, [1, 0, 0, *quaternion((0, 90, 0))], atol=1e-15)
    placed = pose(Body(Composite((Still(), Orbit(period=4.0))), (7, 8, 9)), 2.0)
    np.testing.assert_allclose(placed, [7, 8, 9, *quaternion((0, 180, 0))], atol=1e-15)


def test_composite_loop_time_is_least_common_multiple():
    assert Composite((LINE, Orbit(period=3.0))).loop_time == 24.0
    assert Composite((Orbit(period=0.3), Still(), Orbit(period=0.2))).loop_time == 0.6
    assert Composite((Still(),)).loop_time == 0.0
    assert Composite((Orbit(period=0.3), Orbit(period=1e308))).loop_time == math.inf
    assert Composite((LINE, Keyframes((0, 1), LINE.waypoints))).loop_time == math.inf


class NotClosedForm(Dynamic):
    loop_time = math.inf


@pytest.mark.parametrize(
    ("error", "message", "make"),
    [
        (ValueError, "axis=.*must have a direction", lambda: Orbit(axis=(0, 0, 0))),
        (ValueError, "period=-1: must be greater than 0", lambda: Orbit(period=-1)),
        (ValueError, "center=.*3 numbers, not 2", lambda: Orbit(center=(0, 1))),
        (ValueError, "up=.*must have a direction", lambda: LookAt((0, 0, 0), up=(0, 0, 0))),
        (TypeError, "motion=3: must be a Dynamic", lambda: LookAt((0, 0, 0), 3)),
        (TypeError, "an instance, not the class", lambda: LookAt((0, 0, 0), Orbit)),
        (TypeError, "motion=.*must be a dynamic in closed form", lambda: LookAt((0, 0, 0), NotClosedForm())),
        (ValueError, "times=.*2 numbers, not 3", lambda: Keyframes((0, 1, 2), LINE.waypoints)),
        (ValueError, "times=.*must begin at 0 or later and increase", lambda: Keyframes((1, 1), LINE.waypoints)),
        (ValueError, "times=.*must begin at 0 or later", lambda: Keyframes((-1, 1), LINE.waypoints)),
        (TypeError, "repeat='no'", lambda: Keyframes((0, 1), LINE.waypoints, "no")),
        (ValueError, "one dynamic or more", lambda: Composite(())),
        (TypeError, "parts=.*must be a sequence", lambda: Composite(LINE)),
        (TypeError, r"parts\[1\]=None: must be a Dynamic", lambda: Composite((LINE, None))),
        (
            ValueError,
            r"parts\[1\]: LookAt aims at a point",
            lambda: Composite((LINE, LookAt((0, 0, 0)))),
        ),
        (TypeError, "dynamic=None: must be a Dynamic", lambda: Body(None)),
        (ValueError, "birth=-1: must not be negative", lambda: Body(birth=-1)),
        (TypeError, "timed=1: must be True or False", lambda: Body(timed=1)),
        (TypeError, "name=3: must be a string", lambda: Body(name=3)),
        (TypeError, r"bodies\[0\] \(''\): dynamic=.*closed form", lambda: Simulation([Body(NotClosedForm())])),
    ],
)
def test_invalid_arguments_raise_errors_that_name_them(error, message, make):
    with pytest.raises(error, match=message):
        make()
