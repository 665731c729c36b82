# SPDX-License-Identifier: Apache-2.0
"""Movers that follow paths among obstacles, and walls around them."""

from fractions import Fraction

import numpy as np
import taichi as ti

from dynamics import (
    Body,
    CatmullWaypoints,
    Simulation,
    Still,
    Waypoint,
)
from dynamics import body_layout as at
from dynamics.colliding_bodies import Mover
from dynamics.contact import ARM, MAX_TOUCHES, NORMAL, NOTHING, OBSTACLE, TOUCH_COLUMNS, TOUCH_KIND
from dynamics.kernel_types import Doubles2, Floats2, Ints1, Ints2
from dynamics.path_following import advance_following, slide
from dynamics.stepped_simulation import SteppedSimulation
from tests.dynamics.room_movers import CUBE, LINE, PILLAR, ROOM, bouncer, gaps, mover_gap, run
from tests.dynamics.solids import cube, obstacles, spheres_at


def test_follower_slides_around_obstacle_and_returns_exactly_to_path():
    mover = Mover(Body(LINE, name="f"), cube(0.2))
    simulation = SteppedSimulation([mover], fps=25, obstacles=obstacles(PILLAR))
    path = Simulation([Body(LINE, name="f")])
    blocked, exact = [], []
    poses = run(simulation, 300)
    for k in range(300):
        blocked.append(bool(simulation.frame(k).blocked[0]) if k > 283 else None)
        exact.append(poses[k].tobytes() == path.poses(Fraction(k, 25)).tobytes())
    assert gaps(simulation, poses, PILLAR)[0] > 0.0
    assert all(exact[:15]), "exactly on its path until it touches the pillar"
    assert 0.3 < np.mean(exact) < 0.95
    away = np.flatnonzero(~np.array(exact))
    assert exact[99], "back on its path before the loop ends"
    assert np.abs(poses[away, 0, 2]).max() > 0.1, "goes around the pillar"
    moved = np.linalg.norm(np.diff(poses[:, 0, :3], axis=0), axis=1)
    assert moved.max() < (2.0 * 1.2 + 1.0) / 25 + 0.01


def test_follower_without_contacts_has_exactly_the_poses_of_its_path():
    loop = CatmullWaypoints([Waypoint((1, 0, 0)), Waypoint((0, 1, 0), (0, 170, 0)), Waypoint((-1, 0, 1))], 1.3)
    simulation = SteppedSimulation([Mover(Body(loop), CUBE), Mover(Body(Still(), (0, -1, 0)), CUBE)], fps=25,
                                   obstacles=obstacles(ROOM))  # fmt: skip
    path = Simulation([Body(loop), Body(Still(), (0, -1, 0))])
    for k in range(100):
        assert simulation.frame(k).poses.tobytes() == path.poses(Fraction(k, 25)).tobytes()
        assert not simulation.frame(k).blocked.any()


def test_mover_without_shape_passes_through_everything():
    movers = [Mover(Body(LINE, name="f")), Mover(bouncer(direction=(0, 1, 0)).body)]
    simulation = SteppedSimulation(movers, fps=25, obstacles=obstacles(PILLAR, ROOM))
    poses = run(simulation, 60)
    path = Simulation([Body(LINE, name="f")])
    for k in range(60):
        assert poses[k, :1].tobytes() == path.poses(Fraction(k, 25)).tobytes()
    np.testing.assert_allclose(poses[:, 1, 1], 1.5 * np.arange(60) / 25, atol=1e-12)


def test_follower_and_bouncer_collide_without_penetration():
    movers = [Mover(Body(LINE, name="f"), CUBE), bouncer("b", (0.9, 0.05, 0.0), direction=(-1, 0, 0))]
    simulation = SteppedSimulation(movers, fps=25, obstacles=obstacles(ROOM))
    poses = run(simulation, 120)
    assert min(mover_gap(simulation, pose) for pose in poses) > 0.0
    again = SteppedSimulation(movers, fps=25, obstacles=obstacles(ROOM))
    met = [(k, c) for k in range(120) for c in again.frame(k).contacts if c.kind == "mover"]
    assert (met[0][1].mover, met[0][1].other) in ((0, 1), (1, 0))


def test_walls_hold_limited_movers_only():
    """The walls are a box about the origin; one mover starts outside of it."""

    def walls(time):
        return np.array([[1, 0, 0, 1], [-1, 0, 0, 1], [0, 1, 0, 1], [0, -1, 0, 1], [0, 0, 1, 1], [0, 0, -1, 1]], float)

    movers = [
        bouncer("in"),
        bouncer("out", (0.0, 2.5, 0.0), direction=(0, 1, 0)),
        bouncer("free", (0.0, 5.0, 0.0), direction=(0, 1, 0), limited=False),
    ]
    simulation = SteppedSimulation(movers, fps=25, walls=walls)
    poses = run(simulation, 300)
    inside = [1.0 - max((np.abs(c) + r[:, None]).max() for c, r in [spheres_at(CUBE, pose)]) for pose in poses[:, 0]]
    assert min(inside) > 0.0
    outside = [(np.abs(c) + r[:, None]).max() - 1.0 for c, r in (spheres_at(CUBE, pose) for pose in poses[:, 1])]
    assert outside[0] > 1.0
    assert max(outside[50:]) < 0.0
    np.testing.assert_allclose(poses[-1, 2, :3], (0.0, 5.0 + 1.5 * 299 / 25, 0.0), atol=1e-9)


def test_bouncers_that_start_far_outside_a_frustum_enter_it():
    """Behind its far wall, the way towards that wall leads through the side walls, which draw near."""
    s, c = np.sqrt(0.5), np.sqrt(0.5)
    planes = np.array(
        [[c, 0, -s, 0], [-c, 0, -s, 0], [0, c, -s, 0], [0, -c, -s, 0], [0, 0, -1, -0.1], [0, 0, 1, 6]], float
    )  # about -z, 90 degrees wide
    starts = [(0, 0, -12), (5, 0, -14), (-9, 9, -10), (4, 9, -3), (0, 0, 5), (3, -8, -6.5)]
    movers = [
        bouncer(f"{row}_{k}", position, direction=direction)
        for row, position in enumerate(starts)
        for k, direction in enumerate([(1, 0.3, 0), (-0.2, -1, -0.4)])
    ]
    poses = SteppedSimulation(movers, fps=25, walls=lambda time: planes).frame(280).poses
    for mover, pose in zip(movers, poses, strict=True):
        centers, radii = spheres_at(CUBE, pose)
        assert (centers @ planes[:, :3].T + planes[:, 3] - radii[:, None]).min() > -1e-3, mover.body.name


def test_moving_walls_push_movers():
    def walls(time):
        x = 0.8 * float(time)
        return np.array(
            [[1, 0, 0, 1 - x], [-1, 0, 0, 1 + x], [0, 1, 0, 1], [0, -1, 0, 1], [0, 0, 1, 1], [0, 0, -1, 1]], float
        )

    follower = Mover(Body(Still(), (0.0, 0.5, 0.0), name="still"), cube(0.2))
    simulation = SteppedSimulation([bouncer(speed=0.3), follower], fps=25, walls=walls)
    poses = run(simulation, 200)
    for row, mover in enumerate(simulation.movers):
        for k in range(0, 200, 10):
            centers, radii = spheres_at(mover.shape, poses[k, row])
            assert (centers[:, 0] - radii - 0.8 * k / 25 + 1.0).min() > -0.002


@ti.kernel
def run_slide(bodies: Doubles2, integers: Ints2, touches: Floats2, counts: Ints1):
    for body in range(bodies.shape[0]):
        slide(bodies, integers, touches, counts, body, 1.0)


@ti.kernel
def run_advance(bodies: Doubles2, integers: Ints2, touches: Floats2, counts: Ints1):
    for body in range(bodies.shape[0]):
        advance_following(bodies, integers, touches, counts, body, 1.0, NOTHING, 0)


def one_body(move, turn, *, farthest, passed=0.0):
    """Return the arrays of a body of radius 0.5 m that attempts a motion, and touches nothing."""
    bodies, integers = np.zeros((1, at.FLOAT_COLUMNS)), np.zeros((1, at.INTEGER_COLUMNS), np.int32)
    bodies[0, at.ROTATION], integers[0, at.GROUP_COUNT] = 1.0, 1
    bodies[0, at.MOVE : at.MOVE + 3], bodies[0, at.TURN : at.TURN + 3] = move, turn
    bodies[0, [at.RADIUS, at.MAX_DISPLACEMENT, at.PATH_LENGTH]] = 0.5, farthest, passed
    return bodies, integers, np.zeros((MAX_TOUCHES, TOUCH_COLUMNS), np.float32), np.zeros(1, np.int32)


def test_turn_into_a_touch_becomes_a_motion_that_keeps_the_touching_point():
    arrays = bodies, _, touches, counts = one_body((0, 0, 0), (0, 0, -0.01), farthest=1.0)
    counts[0], touches[0, TOUCH_KIND] = 1, OBSTACLE
    touches[0, NORMAL : NORMAL + 3], touches[0, ARM : ARM + 3] = (0, 1, 0), (0.5, 0, 0)
    run_slide(*arrays)
    move, turn = bodies[0, at.MOVE : at.MOVE + 3], bodies[0, at.TURN : at.TURN + 3]
    assert move[1] > 0.001
    np.testing.assert_allclose(move + np.cross(turn, (0.5, 0, 0)), 0.0, atol=1e-9)


def test_slide_goes_no_farther_than_what_is_left_of_the_substep():
    arrays = one_body((0.03, 0, 0), (0, 0, 0.02), farthest=0.05, passed=0.03)
    run_slide(*arrays)
    np.testing.assert_allclose(arrays[0][0, at.MOVE : at.TURN + 3], (0.015, 0, 0, 0, 0, 0.01))


def test_turn_counts_as_way_at_the_radius_of_the_body():
    arrays = one_body((0.03, 0, 0), (0, 0, 0.02), farthest=1.0, passed=0.1)
    run_advance(*arrays)
    np.testing.assert_allclose(arrays[0][0, at.PATH_LENGTH], 0.1 + 0.03 + 0.5 * 0.02)
