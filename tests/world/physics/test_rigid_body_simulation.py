# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies against closed forms; seeking, checkpoints and repeatability."""

import hashlib
import math

import numpy as np
import pytest

pytest.importorskip("mujoco")

from dynamics import ArgumentError, RigidBody
from dynamics.rotation import conjugate, multiply, quaternion, rotate
from tests.world.physics.fake_physics_world import FakePhysicsWorld, ball, box, dropped, pose
from tiscene.errors import ScenarioError
from tiscene.world.physics.part_shapes import PartShape

FLOOR = (pose(y=-0.5), box(5, 0.5, 5))
PLATE = PartShape(
    "hull", np.zeros(3), np.array([1.0, 0.0, 1.0]), np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1.0]])
)


def digest(simulation, frames):
    state = hashlib.sha256()
    for frame in frames:
        state.update(simulation.frame(frame).poses.tobytes())
    return state.hexdigest()


def stack(count=4):
    """Return a stack of cubes of 20 cm, a ball that hits it, and a block that pushes it later."""
    cubes = [(box(0.1, 0.1, 0.1), pose(y=0.1 + 0.2 * k), RigidBody()) for k in range(count)]
    return cubes


def test_ball_falls_on_the_parabola_and_rests_on_the_floor():
    simulation = dropped(height=1.6).simulation()
    for frame in range(14):
        np.testing.assert_allclose(
            simulation.frame(frame).poses[0, :3], (0, 1.6 - 0.5 * 9.81 * (frame / 25) ** 2, 0), atol=1e-9
        )
    assert simulation.frame(0).contacts == ()
    assert any((0, "stage", 0) in simulation.frame(frame).contacts for frame in range(13, 18))
    for frame in (60, 100, 200):
        assert simulation.frame(frame).poses[0, 1] == pytest.approx(0.1, abs=1e-3)


def test_thrown_ball_follows_its_parabola():
    world = dropped(height=1.0, velocity=(2.0, 3.0, -1.0), angular_velocity=(0.0, 5.0, 0.0))
    end = world.simulation().frame(15).poses[0]
    np.testing.assert_allclose(end[:3], (1.2, 1.0 + 1.8 - 0.5 * 9.81 * 0.36, -0.6), atol=1e-9)
    np.testing.assert_allclose(np.abs(end[3:]), (math.cos(1.5), 0, math.sin(1.5), 0), atol=1e-6)


@pytest.mark.parametrize("restitution", [0.5, 0.8])
def test_ball_bounces_to_the_height_of_its_restitution(restitution):
    simulation = dropped(height=1.1, restitution=restitution).simulation()
    heights = [simulation.frame(frame).poses[0, 1] - 0.1 for frame in range(40)]
    lowest = int(np.argmin(heights[:16]))
    assert max(heights[lowest : lowest + 24]) == pytest.approx(restitution**2, abs=0.06)


@pytest.mark.parametrize(("degrees", "friction"), [(30.0, 0.2), (20.0, 0.0), (40.0, 0.5)])
def test_block_slides_down_a_slope_with_the_acceleration_of_friction(degrees, friction):
    angle = math.radians(degrees)
    up = np.array([-math.sin(angle), math.cos(angle), 0.0])
    turned = (0.0, 0.0, degrees)
    slope = (pose(*(-0.5 * up), turned), box(20, 0.5, 2))
    body = RigidBody(friction=friction)
    world = FakePhysicsWorld([(box(0.1, 0.05, 0.1), pose(*(0.05 * up), turned), body)], [slope])
    simulation = world.simulation()
    start = simulation.frame(0).poses[0, :3]
    moved = np.linalg.norm(simulation.frame(25).poses[0, :3] - start)
    assert moved == pytest.approx(0.5 * 9.81 * (math.sin(angle) - friction * math.cos(angle)), rel=0.03)


def test_block_stays_on_a_slope_that_friction_holds():
    turned, up = (0.0, 0.0, 20.0), np.array([-math.sin(math.radians(20)), math.cos(math.radians(20)), 0.0])
    world = FakePhysicsWorld(
        [(box(0.1, 0.05, 0.1), pose(*(0.05 * up), turned), RigidBody(friction=0.6))],
        [(pose(*(-0.5 * up), turned), box(20, 0.5, 2))],
    )
    simulation = world.simulation()
    assert np.linalg.norm(simulation.frame(250).poses[0, :3] - simulation.frame(5).poses[0, :3]) < 2e-3


@pytest.mark.parametrize(("count", "frames"), [(5, 500), pytest.param(20, 250, marks=pytest.mark.slow)])
def test_stack_rests(count, frames):
    simulation = FakePhysicsWorld(stack(count), [FLOOR]).simulation()
    settled, later = simulation.frame(25).poses, simulation.frame(frames).poses
    assert np.abs(later - settled).max() < 1e-3
    np.testing.assert_allclose(later[:, 1], 0.1 + 0.2 * np.arange(count), atol=5e-3)


@pytest.mark.parametrize("friction", [0.3, 1.0])
def test_block_begins_to_slide_at_the_angle_of_its_friction(friction):
    def moved(degrees):
        angle = math.radians(degrees)
        up, turned = np.array([-math.sin(angle), math.cos(angle), 0.0]), (0.0, 0.0, degrees)
        block = box(0.2, 0.05, 0.2), pose(*(0.05 * up), turned), RigidBody(friction=friction)
        simulation = FakePhysicsWorld([block], [(pose(*(-0.5 * up), turned), box(30, 0.5, 3))]).simulation()
        return np.linalg.norm(simulation.frame(60).poses[0, :3] - simulation.frame(10).poses[0, :3])

    angle = math.degrees(math.atan(friction))
    assert moved(angle - 0.5) < 1e-3
    assert moved(angle + 0.5) > 0.1


def test_mover_pushes_and_carries_others_and_is_not_pushed():
    rigid = [(box(0.1, 0.1, 0.1), pose(x=0.5, y=0.1), RigidBody()), (ball(0.05), pose(x=-2.0, y=0.25), RigidBody())]
    pusher = box(0.1, 0.1, 0.3), lambda time: pose(x=0.2 * time, y=0.1)
    carrier = box(0.3, 0.05, 0.3), lambda time: pose(x=-2.0, y=0.1, z=-0.3 * time)
    rigid[1] = (box(0.05, 0.05, 0.05), pose(x=-2.0, y=0.2), RigidBody())
    simulation = FakePhysicsWorld(rigid, [FLOOR], [pusher, carrier]).simulation()
    simulation.frame(50)
    assert simulation.frame(50).poses[0, 0] == pytest.approx(0.2 * 2.0 + 0.2, abs=0.01)
    assert simulation.frame(50).poses[1, 2] == pytest.approx(-0.6, abs=0.02)
    assert (0, "body", 2) in simulation.frame(50).contacts


def test_walls_hold_bodies_and_pull_them_in():
    planes = np.array([(1, 0, 0, 1), (-1, 0, 0, 1), (0, 1, 0, 5), (0, -1, 0, 5), (0, 0, 1, 1), (0, 0, -1, 1)], float)
    thrown = (ball(0.1), pose(y=0.1), RigidBody(velocity=(4.0, 0.0, 0.0), friction=0.0))
    outside = (ball(0.1), pose(x=-3.0, y=0.1, z=0.5), RigidBody())
    simulation = FakePhysicsWorld([thrown, outside], [FLOOR], planes=planes).simulation()
    for frame in (1, 5, 10, 30, 60):
        assert (np.abs(simulation.frame(frame).poses[:, 0]) < 0.93).all()
    assert any((0, "wall", 1) in simulation.frame(frame).contacts for frame in range(3, 10))


def test_seek_returns_the_same_bytes_as_playing_with_bodies_that_come_go_and_are_moved():
    def make():
        rigid = [*stack(3), (ball(0.1), pose(x=-1.0, y=0.3), RigidBody(velocity=(3.0, 1.0, 0.0), restitution=0.5))]
        rigid.append((box(0.05, 0.2, 0.05), pose(x=0.05, y=1.2), RigidBody()))
        moved = {33: {0: pose(x=1.0, y=0.5, rotation=(10.0, 20.0, 30.0))}}
        push = [(box(0.1, 0.1, 0.1), lambda time: pose(x=-1.0 + 0.4 * time, y=0.1))]
        return FakePhysicsWorld(rigid, [FLOOR], push, life={3: (5, 40), 4: (20, 10**9)}, moved=moved).simulation()

    played = make()
    states = [played.frame(frame) for frame in range(80)]
    assert states[33].poses[0, 1] == 0.5 != states[33].arrivals[0, 1]
    assert [len(state.numbers) for state in (states[4], states[5], states[20], states[41])] == [3, 4, 5, 5]
    assert len(states[42].numbers) == 4  # one more frame than it is alive, for motion
    for order in ([79, 3, 40, 39, 21, 33, 34], [33, 32, 20, 5, 78]):
        sought = make()
        for frame in order:
            found = sought.frame(frame)
            assert found.poses.tobytes() == states[frame].poses.tobytes(), frame
            assert found.arrivals.tobytes() == states[frame].arrivals.tobytes()
            assert found.contacts == states[frame].contacts


def test_checkpoints_make_seeking_cheap_in_bounded_memory(monkeypatch):
    from tiscene.world.physics import rigid_body_simulation

    monkeypatch.setattr(rigid_body_simulation, "MAX_CHECKPOINTS", 8)
    simulation = dropped().simulation()
    expected = simulation.frame(299).poses.tobytes()
    assert simulation.checkpoint_count <= 8
    simulation.frame(0)
    before = simulation.simulated_frames
    assert simulation.frame(299).poses.tobytes() == expected
    assert simulation.simulated_frames - before <= 64


def test_edit_keeps_earlier_frames_and_changes_later_ones():
    world = dropped(height=2.0)
    simulation = world.simulation()
    before = [simulation.frame(frame).poses.copy() for frame in range(12)]
    world.moved[6] = {0: pose(y=5.0)}
    simulation.amend(6)
    for frame in range(6):
        assert simulation.frame(frame).poses.tobytes() == before[frame].tobytes()
    assert simulation.frame(6).poses[0, 1] == 5.0
    assert simulation.frame(6).arrivals.tobytes() == before[6].tobytes()
    assert simulation.frame(8).poses[0, 1] == pytest.approx(5.0 - 0.5 * 9.81 * 0.08**2, abs=1e-9)


def test_body_that_is_placed_inside_of_something_is_moved_out_without_a_jump():
    cubes = [(box(0.1, 0.1, 0.1), pose(y=0.06 + 0.2 * k), RigidBody()) for k in range(3)]
    simulation = FakePhysicsWorld(cubes, [FLOOR]).simulation()
    heights = np.array([simulation.frame(frame).poses[:, 1] for frame in range(30)])
    assert heights[0, 0] == 0.06
    np.testing.assert_allclose(heights[29], 0.1 + 0.2 * np.arange(3), atol=5e-3)
    assert (heights[:, :].max(axis=0) < 0.13 + 0.2 * np.arange(3)).all()


@pytest.mark.parametrize(
    ("movers", "static", "owner"),
    [([(PLATE, lambda _time: pose())], [FLOOR], "object ''"), ([], [(pose(), PLATE)], "a part of the stage")],
)
def test_shape_without_volume_is_named(movers, static, owner):
    simulation = FakePhysicsWorld([(ball(0.1), pose(y=1.0), RigidBody())], static, movers).simulation()
    with pytest.raises(ScenarioError, match=f"^{owner} has a shape that cannot be simulated: .*coplanar"):
        simulation.frame(1)


def moved_part(part, offset):
    """Return a part at another place in the axes of its body."""
    return PartShape(part.kind, part.center + offset, part.half, part.points + offset)


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (0.1, -0.2, 0.3)])
@pytest.mark.parametrize(("spin", "tolerance"), [((3.0, 4.0, 0.0), 2e-5), ((12.0, 16.0, 5.0), 4e-4)])
def test_tumbling_body_keeps_energy_and_momentum(spin, tolerance, offset):
    """A box of three different sides, thrown so that it turns about all of its axes; its center of mass falls."""
    fps, half, velocity = 500, np.array([0.1, 0.25, 0.5]), np.array([1.0, 20.0, 3.0])
    thrown = RigidBody(velocity=tuple(velocity), angular_velocity=spin)
    simulation = FakePhysicsWorld([(moved_part(box(*half), offset), pose(), thrown)], fps=fps).simulation()
    inertia = (half @ half - half**2) / 3.0  # per mass
    first = inertia * spin
    energy = 0.5 * np.array(spin) @ first
    center_velocity = velocity + np.cross(spin, offset)
    for frame in range(0, 10 * fps, fps // 10):
        before, after = (simulation.frame(each).poses[0] for each in (frame, frame + 1))
        turn = multiply(conjugate(before[3:]), after[3:])
        angle = 2.0 * math.atan2(np.linalg.norm(turn[1:]), turn[0])
        axis = turn[1:] / np.linalg.norm(turn[1:])
        rate = fps * angle * axis
        halfway = multiply(before[3:], [math.cos(angle / 4.0), *(math.sin(angle / 4.0) * axis)])
        assert 0.5 * rate @ (inertia * rate) == pytest.approx(energy, rel=tolerance)
        np.testing.assert_allclose(rotate(halfway, inertia * rate), first, atol=tolerance * np.linalg.norm(first))
        time = frame / fps
        fallen = center_velocity * time - np.array([0.0, 0.5 * 9.81 * time**2, 0.0])
        np.testing.assert_allclose(before[:3] + rotate(before[3:], offset) - offset, fallen, atol=1e-8)


def test_bodies_of_given_mass_keep_their_momentum_when_they_collide():
    thrown = RigidBody(mass=6.0, velocity=(2.0, 0.0, 0.0), restitution=0.5)
    bodies = [(ball(0.1), pose(), thrown), (ball(0.1), pose(x=0.5), RigidBody(mass=1.5, density=3.0, restitution=0.5))]
    simulation = FakePhysicsWorld(bodies).simulation()
    one, other = (simulation.frame(30).poses - simulation.frame(29).poses)[:, 0] * 25
    assert other > 1.1 * one > 0.0
    assert 6.0 * one + 1.5 * other == pytest.approx(12.0, rel=1e-9)


def test_body_turns_about_its_given_center_of_mass():
    center = np.array([0.05, -0.1, 0.2])
    body = RigidBody(center_of_mass=tuple(center), velocity=(0.0, 6.0, 0.0), angular_velocity=(1.0, 3.0, -2.0))
    simulation = FakePhysicsWorld([(ball(0.1), pose(), body)]).simulation()
    upwards = 6.0 + np.cross(body.angular_velocity, center)[1]
    sideways = np.cross(body.angular_velocity, center)[[0, 2]]
    for frame in (5, 17, 25):
        position, turn = simulation.frame(frame).poses[0, :3], simulation.frame(frame).poses[0, 3:]
        time = frame / 25
        moved = np.array([sideways[0] * time, upwards * time - 0.5 * 9.81 * time**2, sideways[1] * time])
        np.testing.assert_allclose(position + rotate(turn, center), center + moved, atol=1e-8)


def test_body_of_given_inertia_wobbles_as_a_symmetric_top():
    """Its axis turns about its angular momentum L at |L| / I, for the moment I across the axis."""
    across, along, spin = 2.0, 3.0, np.array([0.5, 0.0, 4.0])
    axes = quaternion((0.0, 90.0, 0.0))  # the third principal axis is x
    rate = rotate(axes, spin)
    body = RigidBody(diagonal_inertia=(across, across, along), principal_axes=tuple(axes), angular_velocity=tuple(rate))
    simulation = FakePhysicsWorld([(ball(0.1), pose(), body)]).simulation()
    momentum = rotate(axes, spin * (across, across, along))
    axis = rotate(axes, (0.0, 0.0, 1.0))
    for frame in (10, 60, 120):
        angle = np.linalg.norm(momentum) / across * frame / 25
        turn = [math.cos(0.5 * angle), *(math.sin(0.5 * angle) * momentum / np.linalg.norm(momentum))]
        np.testing.assert_allclose(rotate(simulation.frame(frame).poses[0, 3:], axis), rotate(turn, axis), atol=1e-4)


@pytest.mark.parametrize(
    ("named", "message"),
    [
        ({"mass": 0.0}, "mass=0.0: must be greater than 0"),
        ({"diagonal_inertia": (1, 1, 3)}, r"diagonal_inertia=\(1, 1, 3\): none may be larger than the sum"),
        ({"diagonal_inertia": (1, 0, 1)}, r"diagonal_inertia=\(1, 0, 1\): must be greater than 0"),
        ({"center_of_mass": (0, 1e10, 0)}, "center_of_mass=.*: must be numbers from"),
    ],
)
def test_mass_that_no_body_has_is_refused(named, message):
    with pytest.raises(ArgumentError, match="^" + message):
        RigidBody(**named)
