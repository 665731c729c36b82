# SPDX-License-Identifier: Apache-2.0
"""Waypoint loops against closed forms, scipy and the numpy reference."""

import itertools
import math

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from dynamics import AllTogether, Body, CatmullWaypoints, Keyframes, LinearWaypoints, Simulation, Waypoint
from tests.reference import motion

POINTS = np.array([(0.0, 1.0, 0.0), (2.0, 1.0, 0.5), (1.0, 2.0, 2.0), (-0.5, 0.2, 1.0), (-1.0, 1.5, -2.0)])
ANGLES = np.array([(0.0, 0.0, 0.0), (10.0, 80.0, -20.0), (-35.0, 190.0, 5.0), (70.0, 250.0, 60.0), (5.0, 300.0, 170.0)])
WAYPOINTS = tuple(Waypoint(tuple(p), tuple(a)) for p, a in zip(POINTS, ANGLES, strict=True))
CLOCKS = (0.0, 0.31, 1.0, 2.999, 3.7, 4.0, 4.98, 5.0, 12.34)
EVERY = [
    kind(WAYPOINTS, 5.0, pacing=pacing, rotation=rotation)
    for kind in (LinearWaypoints, CatmullWaypoints)
    for pacing in ("equal_time", "arc_length")
    for rotation in ("quaternion", "euler")
]


def poses(path: object, clocks: object) -> np.ndarray:
    simulation = Simulation([Body(path)], AllTogether(0.0))
    return np.array([simulation.poses(clock)[0] for clock in clocks])


def rotations(poses: np.ndarray) -> Rotation:
    return Rotation.from_quat(poses[:, [4, 5, 6, 3]])


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (rotations(a) * rotations(b).inv()).magnitude()


@pytest.mark.parametrize("path", EVERY, ids=lambda path: f"{type(path).__name__}-{path.pacing}-{path.rotation}")
def test_paths_match_reference(path):
    ours = poses(path, CLOCKS)
    theirs = np.array([motion.pose(path, clock) for clock in CLOCKS])
    # The reference finds arc lengths on a polyline.
    close = 1e-13 if path.pacing == "equal_time" else 2e-5
    np.testing.assert_allclose(ours[:, :3], theirs[:, :3], atol=close)
    assert angle_between(ours, theirs).max() < (1e-13 if path.pacing == "equal_time" else 1e-4)
    np.testing.assert_allclose(np.linalg.norm(ours[:, 3:], axis=1), 1.0, atol=1e-15)


@pytest.mark.parametrize("kind", [LinearWaypoints, CatmullWaypoints])
def test_equal_time_pacing_reaches_each_waypoint_exactly(kind):
    path = kind(WAYPOINTS, total_time=3.3)
    found = poses(path, [0.66 * i for i in range(4)] + [2.64, 3.3, 3.96])
    assert (found[:5, :3] == POINTS).all()
    assert (found[5:, :3] == POINTS[:2]).all()
    expected = np.array(
        [np.concatenate([p, motion.quaternion_of_euler(a)]) for p, a in zip(POINTS, ANGLES, strict=True)]
    )
    assert angle_between(found[:5], expected).max() < 1e-7


def test_linear_waypoints_match_scipy_interp_and_slerp():
    clocks = np.linspace(0, 5, 101)[:-1]
    found = poses(LinearWaypoints(WAYPOINTS, total_time=5.0), clocks)
    closed = np.concatenate([POINTS, POINTS[:1]])
    expected = np.stack([np.interp(clocks, range(6), closed[:, axis]) for axis in range(3)], axis=1)
    np.testing.assert_allclose(found[:, :3], expected, atol=1e-14)
    keys = Rotation.from_quat([motion.quaternion_of_euler(a)[[1, 2, 3, 0]] for a in (*ANGLES, ANGLES[0])])
    assert (rotations(found) * Slerp(range(6), keys)(clocks).inv()).magnitude().max() < 1e-7


def test_what_pauses_has_the_same_numbers_at_all_times():
    pause = Waypoint((0.3, 1.2, -0.7), (-10.0, 20.0, 5.0))
    found = poses(Keyframes((0.0, 0.2, 1.0), [Waypoint((0.0, 1.0, 0.0)), pause, pause]), np.linspace(0.21, 0.99, 40))
    assert (found == found[0]).all()


def test_catmull_waypoints_match_hermite_spline_with_central_differences():
    clocks = np.linspace(0, 5, 101)[:-1]
    found = poses(CatmullWaypoints(WAYPOINTS, total_time=5.0), clocks)
    tangents = (np.roll(POINTS, -1, axis=0) - np.roll(POINTS, 1, axis=0)) / 2
    spline = CubicHermiteSpline(range(6), np.r_[POINTS, POINTS[:1]], np.r_[tangents, tangents[:1]])
    np.testing.assert_allclose(found[:, :3], spline(clocks), atol=1e-13)


def test_catmull_velocity_and_angular_velocity_are_continuous():
    step = 1e-4
    path = CatmullWaypoints(WAYPOINTS, total_time=5.0)
    for knot in range(5, 10):
        before, at, after = poses(path, [knot - step, knot, knot + step])
        speed = np.linalg.norm(after[:3] - before[:3]) / (2 * step)
        np.testing.assert_allclose(after[:3] - at[:3], at[:3] - before[:3], atol=20 * step * step * max(speed, 1))
        left = (rotations(at[None]) * rotations(before[None]).inv()).as_rotvec()
        right = (rotations(after[None]) * rotations(at[None]).inv()).as_rotvec()
        np.testing.assert_allclose(left, right, atol=40 * step * step)


def test_squad_of_uniform_turn_is_that_turn():
    turn = CatmullWaypoints([Waypoint((0, 0, 0), (0, 60 * i, 0)) for i in range(6)], total_time=6.0)
    clocks = np.linspace(0, 6, 25)
    expected = Rotation.from_euler("y", 60 * clocks[:, None], degrees=True)
    assert (rotations(poses(turn, clocks)) * expected.inv()).magnitude().max() < 1e-7


@pytest.mark.parametrize("kind", [LinearWaypoints, CatmullWaypoints])
def test_arc_length_pacing_has_constant_speed(kind):
    path = kind(WAYPOINTS, total_time=5.0, pacing="arc_length")
    clocks = np.linspace(0, 5, 2001)
    found = poses(path, clocks)[:, :3]
    steps = np.linalg.norm(np.diff(found, axis=0), axis=1)
    if kind is LinearWaypoints:
        length = np.linalg.norm(np.roll(POINTS, -1, axis=0) - POINTS, axis=1)
        assert found[0].tolist() == POINTS[0].tolist()
        arrival = 5.0 * np.cumsum(length) / length.sum()
        np.testing.assert_allclose(poses(path, arrival[:-1])[:, :3], POINTS[1:], atol=1e-13)
    # Chords cut corners: most steps are equal, none is longer.
    assert np.percentile(steps, 5) > steps.max() * 0.999
    assert steps.max() * 2000 == pytest.approx(_length(kind), rel=2e-6)


def _length(kind: type) -> float:
    closed = [*POINTS, POINTS[0]]
    if kind is LinearWaypoints:
        return sum(math.dist(a, b) for a, b in itertools.pairwise(closed))
    u = np.linspace(0, 5, 200001)
    tangents = (np.roll(POINTS, -1, axis=0) - np.roll(POINTS, 1, axis=0)) / 2
    derivative = CubicHermiteSpline(range(6), closed, np.r_[tangents, tangents[:1]]).derivative()
    return float(np.trapezoid(np.linalg.norm(derivative(u), axis=1), u))


def test_arc_length_pacing_is_smooth_across_table_entries_and_segments():
    path = CatmullWaypoints(WAYPOINTS, total_time=5.0, pacing="arc_length")
    clocks = np.linspace(0.0, 5.0, 6001)
    steps = np.linalg.norm(np.diff(poses(path, clocks)[:, :3], axis=0), axis=1)
    # Chords of the tightest bend are shorter by a thousandth.
    assert steps.max() / steps.min() - 1 < 2e-3


def test_quaternion_sign_does_not_matter():
    flipped = [Waypoint(w.position, tuple(-motion.quaternion_of_euler(w.rotation))) for w in WAYPOINTS[::2]]
    plain = [Waypoint(w.position, tuple(motion.quaternion_of_euler(w.rotation))) for w in WAYPOINTS[::2]]
    clocks = np.linspace(0, 4, 41)
    for kind in (LinearWaypoints, CatmullWaypoints):
        one, other = poses(kind(plain, 3.0), clocks), poses(kind([plain[0], *flipped[1:]], 3.0), clocks)
        assert angle_between(one, other).max() < 1e-6


def test_euler_rotation_keeps_turns_above_180_degrees():
    path = LinearWaypoints([Waypoint((0, 0, 0), (0, 0, 0)), Waypoint((1, 0, 0), (0, 270, 0))], 2.0, rotation="euler")
    found = rotations(poses(path, [0.5, 1.5])).as_euler("yxz", degrees=True)[:, 0]
    # 135 on the way up; the closing segment leads from 270 to 360, the nearest equivalent of 0.
    np.testing.assert_allclose(found, [135.0, -45.0], atol=1e-10)
    shortest = rotations(poses(LinearWaypoints(path.waypoints, 2.0), [0.5])).as_euler("yxz", degrees=True)[0, 0]
    assert shortest == pytest.approx(-45.0)


def test_two_waypoints_go_there_and_back():
    path = CatmullWaypoints([Waypoint((0, 0, 0)), Waypoint((2, 0, 0))], total_time=2.0)
    assert poses(path, [0.5, 1.0, 1.5])[:, 0].tolist() == [1.0, 2.0, 1.0]


def test_paths_store_plain_floats_and_compare():
    path = LinearWaypoints([Waypoint(np.arange(3), np.zeros(3)), Waypoint([1, 2, 3], [0, 0, 0, 2])], 4)
    assert path.waypoints[0] == Waypoint((0.0, 1.0, 2.0), (0.0, 0.0, 0.0))
    assert isinstance(path.waypoints[0].position[0], float)
    assert path.waypoints[1].rotation == (0.0, 0.0, 0.0, 2.0)
    assert path == LinearWaypoints(path.waypoints, 4.0)
    assert hash(path) == hash(LinearWaypoints(path.waypoints, 4.0))
    assert path != CatmullWaypoints(path.waypoints, 4.0)
    assert (path.total_time, path.loop_time, path.pacing, path.rotation) == (4.0, 4.0, "equal_time", "quaternion")


TWO = (Waypoint((0, 0, 0)), Waypoint((1, 0, 0)))


@pytest.mark.parametrize(
    ("error", "message", "make"),
    [
        (ValueError, "position=.*must be 3 numbers, not 2", lambda: Waypoint((0, 1))),
        (TypeError, "position='abc': must be 3 numbers", lambda: Waypoint("abc")),
        (TypeError, r"position\[1\]='b': must be a number", lambda: Waypoint((0, "b", 0))),
        (TypeError, r"position\[0\]=True: must be a number", lambda: Waypoint((True, 0, 0))),
        (ValueError, r"position\[2\]=nan: must be finite", lambda: Waypoint((0, 0, math.nan))),
        (ValueError, "rotation=.*must be 3 or 4 numbers, not 2", lambda: Waypoint((0, 0, 0), (1, 2))),
        (ValueError, "rotation=.*must not be zero", lambda: Waypoint((0, 0, 0), (0, 0, 0, 0))),
        (ValueError, "rotation=.*nor longer than", lambda: Waypoint((0, 0, 0), (1e200, 0, 0, 0))),
        (ValueError, "2 or more, not 1", lambda: LinearWaypoints(TWO[:1])),
        (ValueError, "2 or more, not 0", lambda: CatmullWaypoints([])),
        (TypeError, r"waypoints\[1\]=.*must be a Waypoint", lambda: LinearWaypoints([TWO[0], (1, 0, 0)])),
        (TypeError, "waypoints=3: must be a sequence", lambda: LinearWaypoints(3)),
        (ValueError, "total_time=0: must be greater than 0", lambda: LinearWaypoints(TWO, 0)),
        (ValueError, "total_time=inf: must be finite", lambda: LinearWaypoints(TWO, math.inf)),
        (TypeError, "total_time='1': must be a number", lambda: LinearWaypoints(TWO, "1")),
        (ValueError, "pacing='fast': must be one of", lambda: LinearWaypoints(TWO, pacing="fast")),
        (ValueError, "rotation='slerp': must be one of", lambda: CatmullWaypoints(TWO, rotation="slerp")),
        (
            ValueError,
            r"waypoints\[1\].rotation=.* is a quaternion",
            lambda: LinearWaypoints([TWO[0], Waypoint((1, 0, 0), (1, 0, 0, 0))], rotation="euler"),
        ),
        (
            ValueError,
            r"from waypoints\[2\] to waypoints\[0\] has zero length; use pacing='equal_time'",
            lambda: LinearWaypoints([*TWO, TWO[0]], pacing="arc_length"),
        ),
    ],
)
def test_invalid_arguments_raise_errors_that_name_them(error, message, make):
    with pytest.raises(error, match=message):
        make()
