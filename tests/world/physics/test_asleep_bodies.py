# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies that stay in their places until they are touched."""

from __future__ import annotations

import numpy as np
import pytest

from dynamics import RigidBody
from tests.world.physics.fake_physics_world import FakePhysicsWorld, ball, box, pose
from tests.world.physics.test_joints import pendulum

FLOOR = (pose(y=-0.5), box(5, 0.5, 5))
ASLEEP = RigidBody(starts_asleep=True, velocity=(1.0, 0.0, 0.0))
HIT = 0.32  # s: a ball falls by 0.5 m


def paths(simulation, frames):
    return np.array([simulation.frame(frame).poses for frame in range(frames)])


def row_of_balls(*others, **named):
    """A ball asleep in mid-air at 1 m, one that falls on it from 0.5 m higher, and others."""
    bodies = [(ball(0.1), pose(y=1.0), ASLEEP), (ball(0.1), pose(y=1.7), RigidBody()), *others]
    return FakePhysicsWorld(bodies, [FLOOR], fps=100, **named)


def test_body_asleep_stays_until_it_is_hit():
    found = paths(row_of_balls().simulation(), 120)
    before, at_start = int(HIT * 100) - 1, found[0, 0]
    np.testing.assert_array_equal(found[: before + 1, 0], np.tile(at_start, (before + 1, 1)))
    assert found[60, 0, 1] < 0.95
    assert found[119, 0, 1] == pytest.approx(0.1, abs=0.01)


def test_momentum_is_kept_when_a_body_is_woken():
    """The hit body has its mass, unlike a wall: two equal balls share the speed of the faster one."""
    found = paths(row_of_balls().simulation(), 45)[:, :, 1]
    after = int(HIT * 100) + 4
    speeds = (found[after + 4] - found[after]) * 25.0
    shared = -(9.81 * HIT) / 2.0 - 9.81 * 0.06
    assert speeds == pytest.approx([shared, shared], abs=0.15)


def test_bodies_asleep_that_touch_each_other_wake_one_after_the_other():
    pile = [(box(0.1, 0.1, 0.1), pose(x=2.0, y=y), RigidBody(starts_asleep=True)) for y in (1.0, 1.2)]
    alone = FakePhysicsWorld(pile, [FLOOR], fps=100)
    assert np.ptp(paths(alone.simulation(), 50), axis=0).max() == 0.0  # they do not wake each other
    hit = FakePhysicsWorld([*pile, (ball(0.1), pose(x=2.0, y=1.6), RigidBody())], [FLOOR], fps=100)
    end = hit.simulation().frame(200).poses[:, 1]
    assert end[0] == pytest.approx(0.1, abs=0.02)
    assert end[1] < 0.35


def test_movers_wake_a_body_only_if_they_move():
    def shelf(speed):
        return (box(0.5, 0.05, 0.5), lambda time: pose(x=speed * time, y=0.85))

    for speed, wakes in ((0.0, False), (0.5, True)):
        world = FakePhysicsWorld(
            [(box(0.1, 0.1, 0.1), pose(y=0.9995), RigidBody(starts_asleep=True))], [FLOOR], [shelf(speed)], fps=100
        )
        moved = np.abs(world.simulation().frame(50).poses[0, :3] - (0.0, 0.9995, 0.0)).max()
        assert (moved > 0.05) == wakes
        assert (moved == 0.0) == (not wakes)


def test_body_that_is_moved_is_awake():
    world = FakePhysicsWorld([(ball(0.1), pose(y=1.0), ASLEEP)], [FLOOR], moved={10: {0: pose(y=2.0)}}, fps=100)
    found = paths(world.simulation(), 40)[:, 0, 1]
    assert (found[:10] == 1.0).all()
    assert found[30] == pytest.approx(2.0 - 0.5 * 9.81 * 0.2**2, abs=1e-6)


@pytest.mark.parametrize("frame", [5, 20, 33, 40, 90])
def test_seek_returns_the_same_bytes_as_playing(frame):
    played, sought = row_of_balls().simulation(), row_of_balls().simulation()
    expected = paths(played, frame + 1)[frame]
    sought.frame(100)
    np.testing.assert_array_equal(sought.frame(frame).poses, expected)
    np.testing.assert_array_equal(played.frame(frame).poses, expected)


def test_bodies_that_come_and_go_wake_nothing():
    """A new model begins where others left."""
    visitor = (ball(0.1), pose(x=3.0, y=0.5), RigidBody())
    simulation = row_of_balls(visitor, life={2: (10, 20)}).simulation()
    for frame in range(25):
        np.testing.assert_array_equal(simulation.frame(frame).poses[0], pose(y=1.0))


def test_bodies_that_joints_hold_are_awake():
    asleep, awake = (pendulum(60.0, starts_asleep=each).simulation().frame(50).poses for each in (True, False))
    np.testing.assert_array_equal(asleep, awake)
