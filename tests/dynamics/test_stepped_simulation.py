# SPDX-License-Identifier: Apache-2.0
"""SteppedSimulation: no penetration, no tunneling, and exactly repeatable frames."""

import hashlib
import math
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from dynamics import (
    AllTogether,
    Body,
    CatmullWaypoints,
    DictTimings,
    LinearWaypoints,
    Simulation,
    Still,
    WaitUntilComplete,
    Waypoint,
)
from dynamics import stepped_simulation as module
from dynamics.colliding_bodies import Mover, Teleport
from dynamics.random_bounce import UniformMovementRandomBounce
from dynamics.sphere_proxy import cover
from dynamics.step_kernel import substep
from dynamics.stepped_simulation import SteppedSimulation
from dynamics.timings import AssignedWindows
from dynamics.trajectory_kernel import evaluate
from tests.dynamics.solids import ball, box, cube, obstacles, quad, spheres_at
from tests.reference.distance import sphere_gap

ROOM = box((4.0, 3.0, 4.0))
CUBE = cube(0.3)
ROD = cover(box((1.2, 0.02, 0.02)), max_spheres=96)


def bouncer(name="a", position=(0.0, 0.0, 0.0), shape=CUBE, speed=1.5, direction=(0.3, 0.5, 0.8), spin=2.0, **others):
    dynamic = UniformMovementRandomBounce(speed, spin, direction, seed=32)
    return Mover(Body(dynamic, position, name=name), shape, **others)


def run(simulation, frames):
    return np.array([simulation.frame(k).poses for k in range(frames)])


def gaps(simulation, poses, triangles):
    """Return the smallest gap of each mover to the triangles over all frames, meters."""
    return [
        min(sphere_gap(*spheres_at(mover.shape, pose), triangles) for pose in poses[:, row])
        for row, mover in enumerate(simulation.movers)
    ]


def test_bouncer_flies_straight_without_spin_until_first_hit():
    simulation = SteppedSimulation([bouncer(direction=(0.0, 0.0, 2.0))], fps=25, obstacles=obstacles(ROOM))
    poses = run(simulation, 60)[:, 0]
    hit = next(k for k in range(60) if simulation.frame(k).contacts)
    reach = CUBE.spheres[:, 2].max() + CUBE.spheres[:, 3].max()
    assert 1.5 * (hit - 1) / 25 <= 2.0 - 0.15 <= 1.5 * hit / 25 + reach
    expected = np.zeros((hit, 3))
    expected[:, 2] = 1.5 * np.arange(hit) / 25
    np.testing.assert_allclose(poses[:hit, :3], expected, atol=1e-12)
    np.testing.assert_array_equal(poses[:hit, 3:], np.tile([1.0, 0, 0, 0], (hit, 1)))
    contact = simulation.frame(hit).contacts[0]
    assert (contact.mover, contact.kind, contact.other) == (0, "obstacle", 0)
    assert np.abs(poses[hit + 2, 3:] - [1.0, 0, 0, 0]).max() > 1e-3, "it spins after a hit"
    # Constant speed and spin between hits.
    quiet = [k for k in range(hit + 1, 59) if not simulation.frame(k + 1).contacts]
    np.testing.assert_allclose(np.linalg.norm(poses[quiet][:, :3] - poses[np.array(quiet) + 1][:, :3], axis=1), 0.06)
    assert not any(simulation.frame(k).blocked.any() for k in range(60))


@pytest.mark.parametrize("speed", [1.5, 20.0, 1000.0])
def test_bouncer_stays_inside_room_at_any_speed(speed):
    simulation = SteppedSimulation([bouncer(speed=speed)], fps=25, obstacles=obstacles(ROOM))
    poses = run(simulation, 150)
    assert gaps(simulation, poses, ROOM)[0] > 0.0
    assert (np.abs(poses[:, 0, :3]) < (1.85, 1.35, 1.85)).all()
    moved = np.linalg.norm(np.diff(poses[:, 0, :3], axis=0), axis=1)
    assert moved.max() <= speed / 25 + 1e-9
    if speed == 1.5:
        assert moved.mean() > 0.9 * speed / 25


def test_bouncers_do_not_pass_thin_plates_or_stick_in_wedges():
    """Two sheets without thickness that meet in a wedge of 12 degrees, in a room."""
    slope = np.tan(np.radians(6.0))
    sheets = [quad((0, y * slope, 0.0), (1.5, y * slope * 1.5, 0), (0, 0, 1.9)) for y in (-1.0, 1.0)]
    parts = [ROOM, *sheets]
    movers = [
        bouncer("a", (1.0, 0.8, 0.0), ball(0.1), direction=(-1, 0, 0.1)),
        bouncer("b", (1.4, 0.0, 0.5), ball(0.05), direction=(-1, 0, 0)),
        bouncer("c", (1.4, 0.0, -0.5), ball(0.05), speed=15.0, direction=(-1, 0.05, 0)),
    ]
    simulation = SteppedSimulation(movers, fps=25, obstacles=obstacles(*parts))
    poses = run(simulation, 400)
    assert min(gaps(simulation, poses, np.concatenate(parts))) > 0.0
    assert np.abs(poses[..., :3]).max() < 2.0
    stuck = np.linalg.norm(np.diff(poses[..., :3], axis=0), axis=2) < 1e-3
    for column in stuck.T:
        longest = max((len(run) for run in "".join("x" if s else " " for s in column).split()), default=0)
        assert longest < 50


def test_fast_spinning_rods_do_not_penetrate():
    """Long rods that spin at up to 40 rad/s hit with their ends."""
    movers = [bouncer("rod", shape=ROD, spin=40.0), bouncer("other", (0.0, 0.9, 0.0), shape=ROD, spin=40.0)]
    simulation = SteppedSimulation(movers, fps=25, obstacles=obstacles(ROOM))
    poses = run(simulation, 200)
    assert min(gaps(simulation, poses, ROOM)) > 0.0
    assert min(mover_gap(simulation, pose) for pose in poses) > 0.0
    assert np.abs(np.diff(poses[:, 0, 3:], axis=0)).max() > 0.1


def mover_gap(simulation, poses):
    """Return the smallest gap between two movers, meters."""
    placed = [spheres_at(mover.shape, pose) for mover, pose in zip(simulation.movers, poses, strict=True)]
    return min(
        (np.linalg.norm(a[:, None] - b, axis=2) - r[:, None] - s).min()
        for row, (a, r) in enumerate(placed)
        for b, s in placed[:row]
    )


def make_crowd():
    movers = [
        bouncer(str(row), (x, y, z), spin=5.0, direction=(x + 0.1, y - 0.2, -z))
        for row, (x, y, z) in enumerate((x, y, z) for x in (-1.0, 0.0, 1.0) for y in (-0.6, 0.6) for z in (-1.0, 1.0))
    ]
    return SteppedSimulation(movers, fps=25, obstacles=obstacles(ROOM))


@pytest.fixture(scope="module")
def crowd():
    simulation = make_crowd()
    return simulation, run(simulation, 200)


def test_crowd_does_not_penetrate(crowd):
    simulation, poses = crowd
    assert min(gaps(simulation, poses[::4], ROOM)) > 0.0
    assert min(mover_gap(simulation, pose) for pose in poses) > 0.0
    met = {contact.kind for k in range(185, 200) for contact in simulation.frame(k).contacts}
    assert met <= {"mover", "obstacle"}
    speed = np.linalg.norm(np.diff(poses[..., :3], axis=0), axis=2) * 25
    assert speed.mean() > 0.9 * 1.5


def test_frames_do_not_depend_on_order_of_requests(crowd, monkeypatch):
    simulation, poses = crowd
    again = SteppedSimulation(simulation.movers, fps=25, obstacles=obstacles(ROOM))
    monkeypatch.setattr(module, "MAX_CHECKPOINTS", 4)
    for k in (130, 3, 131, 129, 0, 199, 64, 65, 63, 16, 17):
        assert again.frame(k).poses.tobytes() == poses[k].tobytes(), f"frame {k}"
    assert len(again.checkpoint_frames) <= 4
    assert simulation.frame(100).contacts == again.frame(100).contacts


class SimulatedFrames:
    """Provider of no walls that records the frames that a simulation computes."""

    def __init__(self, fps: int) -> None:
        self._fps = fps
        self.frames: list[int] = []

    def __call__(self, time: Fraction) -> None:
        frame = math.ceil(time * self._fps)
        if time * self._fps == frame:  # the last substep of the frame
            self.frames.append(frame)

    def clear(self) -> None:
        self.frames.clear()


def test_seeking_simulates_only_from_the_last_checkpoint():
    simulated = SimulatedFrames(fps=25)
    simulation = SteppedSimulation([bouncer()], fps=25, obstacles=obstacles(ROOM), walls=simulated)
    simulation.frame(200)
    for number in (100, 37, 150):
        simulated.clear()
        simulation.frame(number)
        assert simulated.frames == list(range(number - (number - 1) % module.CHECKPOINT, number + 1))


def test_distant_movers_do_not_change_poses():
    """Add a distant room with a faster mover, as a row before or after the first."""
    far = box((4.0, 3.0, 4.0), (20.0, 0.0, 0.0))
    make = obstacles(ROOM, far)
    alone = run(SteppedSimulation([bouncer()], fps=25, obstacles=make), 120)
    other = bouncer("other", (20.0, 0.0, 0.0), speed=9.0, spin=9.0)
    for movers, row in (([bouncer(), other], 0), ([other, bouncer()], 1)):
        together = run(SteppedSimulation(movers, fps=25, obstacles=make), 120)
        assert together[:, row].tobytes() == alone[:, 0].tobytes()


LINE = LinearWaypoints([Waypoint((-1.2, 0, 0)), Waypoint((1.2, 0, 0), (0, 90, 0))], total_time=4.0)
TURN = np.sqrt(0.5) * np.array([[1.0, 0, 1], [0, np.sqrt(2.0), 0], [-1, 0, 1]])
PILLAR = box((0.4, 1.5, 0.4)) @ TURN.T + (0.0, 0.0, 0.06)


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


def test_timings_delay_and_pause_bouncers():
    movers = [bouncer("a"), bouncer("b", (0.0, 0.8, 0.8))]
    waiting = SteppedSimulation(movers, AllTogether(0.5), fps=20, obstacles=obstacles(ROOM))
    poses = run(waiting, 30)
    assert (poses[:11] == poses[0]).all()
    direction = np.array((0.3, 0.5, 0.8)) / np.linalg.norm((0.3, 0.5, 0.8))
    np.testing.assert_allclose(poses[14, 0, :3], 4 * 1.5 / 20 * direction, atol=1e-12)
    turns = SteppedSimulation(movers, DictTimings({"b": 0.5, "a": 0.25}), fps=20, obstacles=obstacles(ROOM))
    poses = run(turns, 40)
    moves = np.abs(np.diff(poses, axis=0)).max(axis=2) > 0.0
    np.testing.assert_array_equal(moves[:, 0], [k % 15 >= 10 for k in range(39)])
    np.testing.assert_array_equal(moves[:, 1], [k % 15 < 10 for k in range(39)])


def test_mover_collides_only_between_first_and_last_frame():
    still = Mover(Body(Still(), (0.0, 0.0, 0.8), name="wall"), CUBE, first_frame=0, last_frame=30)
    mover = bouncer(direction=(0, 0, 1))
    gone = Mover(still.body, CUBE, first_frame=0, last_frame=2)
    free = run(SteppedSimulation([mover, gone], fps=25, obstacles=obstacles(ROOM)), 20)
    np.testing.assert_allclose(free[:, 0, 2], 1.5 * np.arange(20) / 25, atol=1e-12)
    met = run(SteppedSimulation([mover, still], fps=25, obstacles=obstacles(ROOM)), 20)
    assert met[:, 0, 2].max() < 0.8
    late = Mover(Body(mover.body.dynamic, birth=Fraction(10, 25), name="late"), CUBE, first_frame=10)
    poses = run(SteppedSimulation([late], fps=25, obstacles=obstacles(ROOM)), 15)
    direction = np.array([0.0, 0.0, 1.0])
    assert (poses[:11] == poses[0]).all()
    np.testing.assert_allclose(poses[14, 0, :3], 4 * 1.5 / 25 * direction, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [({"fps": 0}, ValueError), ({"fps": float("nan")}, ValueError), ({"fps": "25"}, TypeError)],
)
def test_invalid_fps_or_frame_number_raises(arguments, error):
    with pytest.raises(error, match="fps"):
        SteppedSimulation([bouncer()], **arguments)
    simulation = SteppedSimulation([bouncer()], fps=25)
    with pytest.raises(ValueError, match="number"):
        simulation.frame(-1)
    with pytest.raises(TypeError, match=r"number=2\.5: must be a whole number"):
        simulation.frame(2.5)


@pytest.mark.parametrize(
    ("arguments", "error", "match"),
    [
        ({"speed": -1.0}, ValueError, "speed"),
        ({"angular_speed": "fast"}, TypeError, "angular_speed"),
        ({"start_direction": (0, 0, 0)}, ValueError, "start_direction"),
        ({"seed": 1.5}, TypeError, "seed"),
    ],
)
def test_invalid_bounce_arguments_raise(arguments, error, match):
    with pytest.raises(error, match=match):
        UniformMovementRandomBounce(**arguments)


def test_bounce_defaults():
    dynamic = UniformMovementRandomBounce()
    values = dynamic.speed, dynamic.angular_speed, dynamic.start_direction, dynamic.seed
    assert values == (5.0, 2.0, (0.0, 0.0, 1.0), 42)
    assert dynamic.loop_time == float("inf")


PROGRAM = """
import hashlib, sys
from tiscene.device import runtime
runtime.start(threads=int(sys.argv[1]))
from tests.dynamics.test_stepped_simulation import make_crowd
simulation = make_crowd()
print(hashlib.sha256(b"".join(simulation.frame(k).poses.tobytes() for k in range(30))).hexdigest())
"""


def test_frames_are_identical_in_another_process_with_any_thread_count():
    root = Path(__file__).parents[2]
    found = [
        subprocess.run(
            [sys.executable, "-c", PROGRAM, threads], cwd=root, check=True, capture_output=True, text=True
        ).stdout.split()[-1]
        for threads in ("1", "2")
    ]
    simulation = make_crowd()
    here = hashlib.sha256(b"".join(simulation.frame(k).poses.tobytes() for k in range(30))).hexdigest()
    assert found == [here, here]


def test_new_movers_or_obstacles_compile_no_kernel(crowd):
    def compiled():
        return [len(kernel._primal.compiled_kernels) for kernel in (evaluate, substep)]

    before = compiled()
    run(SteppedSimulation([bouncer(), bouncer("b", (0, 0.8, 0), ROD)], fps=30, obstacles=obstacles(ROOM, PILLAR)), 5)
    assert compiled() == before


def test_teleported_movers_continue_from_their_new_pose():
    turned = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)
    still = Mover(Body(Still(), name="s"), CUBE, moves=(Teleport(5, (1.0, 0.5, 0.0), turned),))
    follower = Mover(Body(LINE, name="f"), cube(0.2), moves=(Teleport(5, (-1.0, 0.9, -0.5), turned),))
    flying = bouncer("b", (0.0, -0.8, 0.0), direction=(0, 0, 1), moves=(Teleport(5, (1.5, -0.8, -1.0), turned),))
    passing = Mover(Body(LINE, name="p"), moves=(Teleport(5, (0.0, 0.0, 0.0), turned),))
    simulation = SteppedSimulation([still, follower, flying, passing], fps=25, obstacles=obstacles(ROOM))
    poses = run(simulation, 80)
    path = np.array([Simulation([Body(LINE, name="f")]).poses(Fraction(k, 25))[0] for k in range(80)])
    for row, mover in enumerate(simulation.movers):
        np.testing.assert_array_equal(poses[5, row], (*mover.moves[0].position, *mover.moves[0].rotation))
    again = SteppedSimulation(simulation.movers, fps=25, obstacles=obstacles(ROOM))
    np.testing.assert_array_equal(again.frame(5).arrivals[:, :3], [(0, 0, 0), path[5, :3], (0, -0.8, 0.3), path[5, :3]])
    assert (poses[5:, 0] == poses[5, 0]).all(), "a static body stays at its new pose"
    back = [(poses[k, 1] == path[k]).all() for k in range(80)]
    assert back[:5] == [True] * 5
    assert not any(back[5:10])
    assert back[79]
    assert np.linalg.norm(np.diff(poses[5:, 1, :3], axis=0), axis=1).max() < 0.15, "it returns at bounded speed"
    np.testing.assert_allclose(poses[10, 2, :3], (1.5, -0.8, -1.0 + 5 * 1.5 / 25), atol=1e-12)
    np.testing.assert_array_equal(poses[6:, 3], path[6:])


def test_amended_movers_equal_a_new_simulation_without_resimulating_earlier_frames():
    moved = Mover(Body(Still(), (0.0, 0.9, 1.2), name="m"), CUBE, moves=(Teleport(70, (0.0, 0.5, 0.5), (1, 0, 0, 0)),))
    first = [bouncer("a"), Mover(moved.body, CUBE)]
    late = Mover(Body(first[0].body.dynamic, (1.0, 0.0, 0.0), birth=Fraction(70, 25), name="c"), CUBE, first_frame=70)
    simulated = SimulatedFrames(fps=25)
    taken = SteppedSimulation(first, fps=25, obstacles=obstacles(ROOM), walls=simulated)
    run(taken, 72)
    fresh = SteppedSimulation([first[0], moved, late], fps=25, obstacles=obstacles(ROOM))
    for movers in ([first[0], moved], [first[0], moved, late]):
        simulated.clear()
        taken.amend(movers, 70)
        taken.frame(71)
        assert simulated.frames == [70, 71], "frames before the edit are not computed again"
        assert max(taken.checkpoint_frames) == 64
    for k in (75, 69, 70, 130, 30):
        assert taken.frame(k).poses.tobytes() == fresh.frame(k).poses.tobytes()
    # An edit at a much earlier frame.
    taken.amend([first[0], replace(moved, moves=(Teleport(20, (0, 0, 0), (1, 0, 0, 0)), *moved.moves)), late], 20)
    fresh = SteppedSimulation(taken.movers, fps=25, obstacles=obstacles(ROOM))
    for k in (19, 21, 75):
        assert taken.frame(k).poses.tobytes() == fresh.frame(k).poses.tobytes()
    # Skipping frames that are known to be free of collisions.
    loop = Mover(Body(LINE, name="f"), CUBE)
    fresh, taken = (
        SteppedSimulation([loop, late], fps=25, obstacles=obstacles(ROOM), walls=walls) for walls in (None, simulated)
    )
    taken.start_at(70)
    simulated.clear()
    taken.frame(71)
    assert simulated.frames == [70, 71]
    assert taken.checkpoint_frames == [69]
    for k in (90, 70, 10):
        assert taken.frame(k).poses.tobytes() == fresh.frame(k).poses.tobytes()


def test_movers_that_come_and_go_have_rows_only_while_they_exist():
    """Give rows to existing movers only: all poses and contacts are those of a simulation of all movers."""

    def passing(number):
        first = 3 * number
        body = Body(bouncer().body.dynamic, (0.0, -0.8, 0.9), name=f"p{number}", birth=Fraction(first, 25))
        return Mover(body, CUBE, first_frame=first, last_frame=first + 4)

    movers = [bouncer("a", speed=3.0), Mover(Body(LINE, name="f"), cube(0.2)), *(passing(n) for n in range(12))]

    def existing(frame):
        return [n for n, each in enumerate(movers) if each.first_frame <= frame <= (each.last_frame or 99) + 1]

    everyone = SteppedSimulation(movers, fps=25, obstacles=obstacles(ROOM))
    some = SteppedSimulation(movers, fps=25, existing=existing, obstacles=obstacles(ROOM))
    sizes, contacts = set(), 0
    for k in (*range(45), 7, 30, 12, 44):
        state, all_states = some.frame(k), everyone.frame(k)
        assert list(state.numbers) == existing(k)
        rows = list(state.numbers)
        assert state.poses.tobytes() == all_states.poses[rows].tobytes(), f"frame {k}"
        assert state.arrivals.tobytes() == all_states.arrivals[rows].tobytes()
        assert state.blocked.tolist() == all_states.blocked[rows].tolist()
        assert state.contacts == all_states.contacts
        sizes.add(len(rows))
        contacts += sum(each.kind == "mover" for each in state.contacts)
    assert max(sizes) <= 5
    assert contacts > 3


def test_assigned_windows_are_those_of_the_whole_group():
    bodies = [("a", LINE), ("b", Still()), ("c", LINE)]
    whole = WaitUntilComplete(0.5).windows(bodies)
    assigned = AssignedWindows(WaitUntilComplete(0.5), bodies)
    assert assigned.windows(bodies) == whole
    assert assigned.windows(bodies[2:]) == whole[2:]


@pytest.mark.parametrize("height", [0.0, 0.01, -0.05])
def test_bouncer_placed_on_or_in_the_floor_comes_free(height):
    """A box that stands on the floor, or penetrates it, flies off."""
    shape = cover(box((0.4, 0.8, 0.4), (0.0, 0.4, 0.0)), max_spheres=96)
    room = box((6.0, 4.0, 6.0), (0.0, 2.0, 0.0))
    simulation = SteppedSimulation([bouncer("c", (1.0, height, 0.0), shape)], fps=25, obstacles=obstacles(room))
    poses = run(simulation, 60)
    assert gaps(simulation, poses[:1], room)[0] < 0.0
    assert gaps(simulation, poses[20:], room)[0] > 0.0
    assert poses[:, 0, 1].min() >= height - 1e-9
    assert np.linalg.norm(np.diff(poses[:, 0, :3], axis=0), axis=1).mean() > 0.8 * 1.5 / 25
