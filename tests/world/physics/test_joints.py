# SPDX-License-Identifier: Apache-2.0
"""Bodies that hang on others, against closed forms; loops; seeking and repeatability."""

import math
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("mujoco")

from scipy.special import ellipk

from dynamics import RigidBody
from dynamics.rotation import conjugate, multiply, rotate
from tests.world.physics.fake_physics_world import FakePhysicsWorld, ball, box, pose
from tests.world.physics.test_rigid_body_simulation import FLOOR, digest
from tiscene.scenario.joints import (
    DistanceJoint,
    FixedJoint,
    PrismaticJoint,
    RevoluteJoint,
    SphericalJoint,
)
from tiscene.world.physics.joint_tree import compose

G = 9.81
PIVOT = np.array([0.3, 2.0, -1.0])


def hinge(**named):
    return RevoluteJoint("a", axis="Z", **named)


def pendulum(degrees, length=1.0, radius=0.05, joint=None, **named):
    """Return a ball that hangs on a point of the world, `degrees` from the lowest one."""
    arm = pose(y=length)
    start = compose(np.array([*PIVOT, 1.0, 0, 0, 0]), compose(pose(rotation=(0, 0, degrees)), pose(y=-length)))
    joined = [(joint or hinge(), 0, None, arm, np.array([*PIVOT, 1.0, 0.0, 0.0, 0.0]))]
    return FakePhysicsWorld([(ball(radius), start, RigidBody(**named))], joined=joined, fps=100)


def angles(simulation, frames, number=0):
    """Return the angles of a body about z, rad, without jumps."""
    turns = np.array([simulation.frame(frame).poses[number, 3:] for frame in range(frames)])
    return np.unwrap(2.0 * np.arctan2(turns[:, 3], turns[:, 0]))


def period(values, fps=100):
    """Return the mean time between rises through 0, s, by linear interpolation."""
    at = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    times = (at - values[at] / (values[at + 1] - values[at])) / fps
    return (times[-1] - times[0]) / (len(times) - 1)


def swing(degrees, length=1.0, radius=0.05):
    """Return the period of a ball as a physical pendulum: 4 K(sin^2(a / 2)) sqrt(I / (m g l)), s."""
    reduced = length + 0.4 * radius**2 / length
    return 4.0 * math.sqrt(reduced / G) * ellipk(math.sin(math.radians(degrees) / 2.0) ** 2)


@pytest.mark.parametrize("degrees", [2.0, 60.0, 120.0, 170.0])
def test_pendulum_has_the_period_of_the_elliptic_integral_and_keeps_its_energy(degrees):
    frames = 2000
    found = angles(pendulum(degrees).simulation(), frames)
    assert period(found) == pytest.approx(swing(degrees), rel=1e-7)
    late = found[-int(100 * 2 * swing(degrees)) :]
    assert math.degrees(late.max()) == pytest.approx(degrees, abs=0.02)
    assert math.degrees(late.min()) == pytest.approx(-degrees, abs=0.02)


def test_pendulum_of_small_amplitude_follows_a_cosine():
    found = angles(pendulum(1.0).simulation(), 400)
    rate = 2.0 * math.pi / swing(1.0)
    np.testing.assert_allclose(found, math.radians(1.0) * np.cos(rate * np.arange(400) / 100), atol=1e-7)


def test_pendulum_stays_at_its_pivot():
    simulation = pendulum(120.0).simulation()
    for frame in range(0, 300, 7):
        place = simulation.frame(frame).poses[0]
        np.testing.assert_allclose(compose(place, pose(y=1.0))[:3], PIVOT, atol=1e-12)
        assert place[2] == pytest.approx(-1.0, abs=1e-12)


def test_hinge_that_is_described_from_the_other_side_is_the_same():
    world = pendulum(50.0)
    _, _, _, arm, pivot = world.joined[0]
    plain, flipped = world.simulation(), pendulum(50.0)
    flipped.rigid.append((ball(0.02), pose(y=50.0), RigidBody()))
    flipped.joined = [(FixedJoint("b"), 1, None, pose(), pivot), (hinge(), 1, 0, pose(), arm)]
    np.testing.assert_allclose(flipped.simulation().frame(150).poses[0], plain.frame(150).poses[0], atol=1e-9)


def test_conical_pendulum_turns_at_its_closed_form():
    """A ball in a socket circles at constant height."""
    angle = math.radians(30.0)
    rate = math.sqrt(G / (1.0 * math.cos(angle)))  # of a point mass; the ball is small
    world = pendulum(30.0, radius=0.005, joint=SphericalJoint("a"), angular_velocity=(0.0, rate, 0.0))
    speed = rate * math.sin(angle)
    world.rigid[0] = (*world.rigid[0][:2], RigidBody(velocity=(0.0, 0.0, -speed), angular_velocity=(0.0, rate, 0.0)))
    simulation = world.simulation()
    for frame in range(0, 300, 10):
        x, y, z = simulation.frame(frame).poses[0, :3] - PIVOT
        assert y == pytest.approx(-math.cos(angle), abs=2e-3)
        turned = rate * frame / 100
        np.testing.assert_allclose(
            (x, z), (math.sin(angle) * math.cos(turned), -math.sin(angle) * math.sin(turned)), atol=6e-3
        )


def test_slider_falls_along_its_axis_up_to_its_limit():
    tilted = pose(y=3.0, rotation=(0.0, 0.0, 30.0))
    joint = PrismaticJoint("a", axis="X", lower_limit=-0.6)
    world = FakePhysicsWorld(
        [(box(0.1, 0.1, 0.1), tilted, RigidBody())], joined=[(joint, 0, None, pose(), tilted)], fps=100
    )
    simulation = world.simulation()
    moved = 0.5 * G * math.sin(math.radians(30.0)) * 0.3**2
    expected = np.array([0.0, 3.0, 0.0]) - moved * rotate(tilted[3:], (1.0, 0.0, 0.0))
    np.testing.assert_allclose(simulation.frame(30).poses[0, :3], expected, atol=1e-9)
    np.testing.assert_allclose(simulation.frame(30).poses[0, 3:], tilted[3:], atol=1e-12)
    assert np.linalg.norm(simulation.frame(200).poses[0, :3] - tilted[:3]) == pytest.approx(0.6, abs=2e-3)


@pytest.mark.parametrize("flip", [False, True])
def test_hinge_stops_at_its_limit(flip):
    """A bar that falls about its end is held 40 degrees below the horizontal, whichever of the two is the parent."""
    bar, end = box(0.5, 0.02, 0.05), pose(x=-0.5)
    post = pose(x=-0.5, y=2.0)
    joint = hinge(lower_limit=-40.0, upper_limit=10.0)
    rigid, joined = [(bar, pose(y=2.0), RigidBody())], [(joint, 0, None, end, post)]
    if flip:
        rigid.append((ball(0.02), post, RigidBody()))
        turned = hinge(lower_limit=-10.0, upper_limit=40.0)
        joined = [(FixedJoint("b"), 1, None, pose(), post), (turned, 1, 0, pose(), end)]
    simulation = FakePhysicsWorld(rigid, joined=joined, fps=100).simulation()
    found = np.degrees(angles(simulation, 400))
    assert found.min() > -42.0
    assert found[-1] == pytest.approx(-40.0, abs=0.5)


@pytest.mark.parametrize("axis", ["Y", "Z"])
@pytest.mark.parametrize("limit", [20.0, 75.0, 120.0])
def test_ball_in_a_socket_stops_at_its_cone(axis, limit):
    """A pendulum above its pivot falls in any direction until its axis is at the limit."""
    turned = {"Y": (0.0, 0.0, 0.0), "Z": (90.0, 0.0, 0.0)}[axis]  # the axis of the frames is up
    joint = SphericalJoint("a", axis=axis, cone_angle=limit)
    arm = np.array([0.0, -0.5, 0.0, *pose(rotation=tuple(-each for each in turned))[3:]])
    frame = np.array([*PIVOT, *pose(rotation=tuple(-each for each in turned))[3:]])
    start = compose(np.array([*PIVOT, 1.0, 0, 0, 0]), compose(pose(rotation=(3.0, 0, 4.0)), pose(y=0.5)))
    world = FakePhysicsWorld([(ball(0.05), start, RigidBody())], joined=[(joint, 0, None, arm, frame)], fps=100)
    simulation = world.simulation()
    directions = [simulation.frame(frame).poses[0, :3] - PIVOT for frame in range(0, 600, 2)]
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 0.5, atol=1e-9)
    angles = np.degrees(np.arccos(np.array(directions)[:, 1] / 0.5))
    assert angles.max() == pytest.approx(limit, abs=1.0)
    assert angles[-1] == pytest.approx(limit, abs=0.5)  # it rests there
    x, _, z = directions[-1]
    if limit < 90.0:
        assert math.degrees(math.atan2(z, x)) == pytest.approx(math.degrees(math.atan2(3.0, -4.0)), abs=20.0)


def test_cone_of_a_joint_that_closes_a_loop_is_kept():
    joint = SphericalJoint("a", axis="Y", cone_angle=30.0)
    (part, start, rigid), *_ = pendulum(5.0).rigid
    held = [
        (SphericalJoint("a"), 0, None, pose(y=1.0), np.array([*PIVOT, 1.0, 0.0, 0.0, 0.0])),
        (joint, 0, None, pose(y=1.0), np.array([*PIVOT, *pose(rotation=(0, 0, 50))[3:]])),
    ]
    world = FakePhysicsWorld([(part, start, rigid)], joined=held, fps=100)
    away = world.simulation().frame(300).poses[0, :3] - PIVOT
    assert math.degrees(math.atan2(away[0], -away[1])) == pytest.approx(20.0, abs=1.0)  # 30 from the cone's axis


def test_fixed_joint_holds_two_bodies_together():
    world = FakePhysicsWorld(
        [(box(0.1, 0.1, 0.1), pose(y=0.6), RigidBody()), (box(0.1, 0.1, 0.1), pose(x=0.3, y=0.6), RigidBody())],
        [FLOOR],
        joined=[(FixedJoint("b", "a"), 1, 0, pose(), pose(x=0.3))],
    )
    world.rigid[0] = (*world.rigid[0][:2], RigidBody(angular_velocity=(1.0, 2.0, 3.0)))
    simulation = world.simulation()
    for frame in (1, 10, 40):
        one, other = simulation.frame(frame).poses
        np.testing.assert_allclose(other[:3], compose(one, pose(x=0.3))[:3], atol=1e-9)
        np.testing.assert_allclose(np.abs(multiply(conjugate(one[3:]), other[3:])), (1, 0, 0, 0), atol=1e-9)


def energy(simulation, frame, parts, step=1e-3):
    """Return kinetic and potential energy of boxes by central differences of their poses over two frames, J."""
    before, here, after = (simulation.frame(each).poses for each in (frame - 1, frame, frame + 1))
    total = 0.0
    for row, (mass, half) in enumerate(parts):
        speed = (after[row, :3] - before[row, :3]) / (2.0 * step)
        turn = multiply(conjugate(before[row, 3:]), after[row, 3:])
        spin = np.sign(turn[0]) * turn[1:] / step
        inertia = mass / 3.0 * (half @ half - half**2)
        total += 0.5 * mass * speed @ speed + 0.5 * spin @ (inertia * spin) + mass * G * here[row, 1]
    return total


def test_chain_of_two_bars_keeps_its_energy():
    half = np.array([0.3, 0.02, 0.02])
    bars = [(box(*half), pose(x=0.3 + 0.6 * n, y=2.0), RigidBody()) for n in range(2)]
    joined = [
        (hinge(), 0, None, pose(x=-0.3), pose(y=2.0)),
        (RevoluteJoint("b", "a", axis="Z"), 1, 0, pose(x=-0.3), pose(x=0.3)),
    ]
    simulation = FakePhysicsWorld(bars, joined=joined, fps=1000).simulation()
    mass = 500.0 * 8.0 * half.prod()
    found = [energy(simulation, frame, [(mass, half)] * 2) for frame in range(1, 3000, 100)]
    swing = mass * G * 1.2  # between the highest and the lowest state
    assert np.ptp(found) < 1e-4 * swing


def test_pendulum_on_an_accelerated_mover_follows_its_pivot():
    """Its pivot falls freely after a second: from then on the ball turns about it at constant rate."""

    def path(time):
        fall = max(time - 1.0, 0.0)
        return pose(y=9.0 - 0.5 * G * fall**2)

    start = compose(compose(path(0.0), pose(rotation=(0, 0, 90))), pose(y=-1.0))
    world = FakePhysicsWorld(
        [(ball(0.05), start, RigidBody())],
        movers=[(ball(0.02), path)],
        joined=[(RevoluteJoint("a", "m", axis="Z"), 0, 1, pose(y=1.0), pose())],
        fps=200,
    )
    simulation = world.simulation()
    found = angles(simulation, 400)
    rates = np.diff(found)[203:] * 200
    assert np.ptp(rates) < 1e-2 * abs(rates.mean())
    still = pendulum(90.0)
    np.testing.assert_allclose(found[:200:2], angles(still.simulation(), 100), atol=2e-4)


def test_pendulum_on_an_accelerated_mover_hangs_along_the_apparent_gravity():
    def path(time):
        return pose(x=0.5 * 3.0 * time**2, y=3.0)

    tilt = -math.degrees(math.atan2(3.0, G))
    start = compose(compose(path(0.0), pose(rotation=(0, 0, tilt))), pose(y=-1.0))
    joined = [(RevoluteJoint("a", "m", axis="Z"), 0, 1, pose(y=1.0), pose())]
    world = FakePhysicsWorld([(ball(0.05), start, RigidBody())], movers=[(ball(0.02), path)], joined=joined, fps=100)
    np.testing.assert_allclose(np.degrees(angles(world.simulation(), 200)), tilt, atol=0.5)


def test_ball_on_a_rope_falls_until_the_rope_is_taut():
    joint = DistanceJoint("a", max_distance=1.0)
    world = FakePhysicsWorld(
        [(ball(0.1), pose(y=2.7), RigidBody())], joined=[(joint, 0, None, pose(), pose(y=3.0))], fps=100
    )
    simulation = world.simulation()
    heights = np.array([simulation.frame(frame).poses[0, 1] for frame in range(600)])
    np.testing.assert_allclose(heights[:30], 2.7 - 0.5 * G * (np.arange(30) / 100) ** 2, atol=1e-9)
    assert heights.min() > 2.0 - 0.02
    assert heights[-1] == pytest.approx(2.0, abs=2e-3)


def test_bar_of_two_hinges_stays_where_it_is_held():
    """The second hinge closes a loop."""
    bar = box(0.5, 0.02, 0.05)
    joined = [
        (hinge(), 0, None, pose(x=-0.5), pose(x=-0.5, y=2.0)),
        (hinge(), 0, None, pose(x=0.5), pose(x=0.5, y=2.0)),
    ]
    simulation = FakePhysicsWorld([(bar, pose(y=2.0), RigidBody())], joined=joined).simulation()
    np.testing.assert_allclose(simulation.frame(200).poses[0], pose(y=2.0), atol=1e-3)


@pytest.mark.parametrize("joint", [SphericalJoint("a"), FixedJoint("a")])
def test_loop_of_three_bodies_hangs_together(joint):
    bodies = [(ball(0.05), pose(x=0.3 * n, y=2.0), RigidBody()) for n in range(3)]
    hold = (FixedJoint("a"), 0, None, pose(), pose(y=2.0))
    links = [(SphericalJoint("a"), n, n - 1, pose(x=-0.15), pose(x=0.15)) for n in (1, 2)]
    closing = (joint, 2, None, pose(), pose(x=0.6, y=2.0))
    simulation = FakePhysicsWorld(bodies, joined=[hold, *links, closing]).simulation()
    end = simulation.frame(150).poses
    np.testing.assert_allclose(end[2, :3], (0.6, 2.0, 0.0), atol=3e-3)
    assert 1.99 < end[1, 1] <= 2.001


def test_joined_bodies_collide_only_if_asked():
    """Two balls that overlap are pushed apart where they collide."""

    def apart(collide):
        bodies = [(ball(0.1), pose(y=3.0), RigidBody()), (ball(0.1), pose(x=0.15, y=3.0), RigidBody())]
        joint = DistanceJoint("b", "a", max_distance=1.0, collide=collide)
        simulation = FakePhysicsWorld(bodies, joined=[(joint, 1, 0, pose(), pose())]).simulation()
        one, other = simulation.frame(5).poses
        return np.linalg.norm(one[:3] - other[:3])

    assert apart(False) == pytest.approx(0.15, abs=1e-9)
    assert apart(True) > 0.195


def test_stack_beside_a_pendulum_rests():
    """Joints change the integration of all bodies."""
    world = pendulum(90.0)
    world.static, world.fps = [FLOOR], 25
    world.rigid += [(box(0.1, 0.1, 0.1), pose(x=3.0, y=0.1 + 0.2 * n), RigidBody()) for n in range(4)]
    world.rigid.append((ball(0.1), pose(x=-2.0, y=1.1), RigidBody(restitution=0.8)))
    simulation = world.simulation()
    settled, later = simulation.frame(25).poses, simulation.frame(250).poses
    assert np.abs(later[1:5] - settled[1:5]).max() < 1e-3
    np.testing.assert_allclose(later[1:5, 1], 0.1 + 0.2 * np.arange(4), atol=5e-3)
    bounced = max(simulation.frame(frame).poses[5, 1] for frame in range(14, 40)) - 0.1
    assert bounced == pytest.approx(0.64, abs=0.06)
    np.testing.assert_allclose(simulation.frame(10).poses[5, 1], 1.1 - 0.5 * G * 0.4**2, atol=1e-9)


def hanging():
    """Return a chain that hangs on a mover, from which the lowest part is taken, and which a ball hits."""
    half = 0.15
    bars = [(box(0.03, half, 0.03), pose(y=2.0 - half - 2 * half * n), RigidBody()) for n in range(3)]
    thrown = ball(0.1), pose(x=-1.5, y=1.2), RigidBody(velocity=(3.0, 2.0, 0.1), restitution=0.4)
    links = [(SphericalJoint("b"), n, n - 1, pose(y=half), pose(y=-half)) for n in (1, 2)]
    top = (RevoluteJoint("a", axis="Z"), 0, 4, pose(y=half), pose())
    mover = ball(0.02), lambda time: pose(x=0.3 * math.sin(3.0 * time), y=2.0, rotation=(0.0, 40.0 * time, 0.0))
    moved = {25: {1: pose(x=0.6, y=1.5, rotation=(0.0, 0.0, 50.0))}}
    return FakePhysicsWorld(
        [*bars, thrown], [FLOOR], [mover], life={2: (0, 40), 3: (8, 10**9)}, moved=moved, joined=[top, *links]
    )


def test_seek_returns_the_same_bytes_as_playing():
    played = hanging().simulation()
    states = [played.frame(frame) for frame in range(60)]
    for order in ([59, 3, 41, 40, 9, 25, 26], [25, 24, 20, 8, 58]):
        sought = hanging().simulation()
        for frame in order:
            assert sought.frame(frame).poses.tobytes() == states[frame].poses.tobytes(), frame


def test_bodies_that_come_and_go_do_not_move_a_chain():
    """A new model continues the motion of the one before."""
    world = hanging()
    world.moved, world.life = {}, {3: (30, 10**9)}
    world.rigid[3] = (ball(0.1), pose(x=5.0, y=1.2), RigidBody())
    alone = hanging()
    alone.moved, alone.life = {}, {3: (10**8, 10**9)}
    with_ball, without = world.simulation().frame(59).poses, alone.simulation().frame(59).poses
    np.testing.assert_allclose(with_ball[:3], without[:3], atol=1e-7)


PROGRAM = """
from tests.world.physics.test_joints import digest, hanging
print(digest(hanging().simulation(), {frames}))
"""


def test_two_processes_give_the_same_bytes():
    program = PROGRAM.format(frames=[55, 10, 54])
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == digest(hanging().simulation(), [55, 10, 54])
