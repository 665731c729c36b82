# SPDX-License-Identifier: Apache-2.0
"""SteppedSimulation: no penetration, no tunneling, and exactly repeatable frames."""

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dynamics import (
    AllTogether,
    DictTimings,
)
from dynamics import stepped_simulation as module
from dynamics.random_bounce import UniformMovementRandomBounce
from dynamics.sphere_proxy import cover
from dynamics.step_kernel import substep
from dynamics.stepped_simulation import SteppedSimulation
from dynamics.trajectory_kernel import evaluate
from tests.dynamics.room_movers import (
    CUBE,
    PILLAR,
    ROD,
    ROOM,
    SimulatedFrames,
    bouncer,
    gaps,
    make_crowd,
    mover_gap,
    run,
)
from tests.dynamics.solids import ball, box, obstacles, quad


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
    monkeypatch.setattr(module, "MAX_CHECKPOINTS", 4)
    again = SteppedSimulation(simulation.movers, fps=25, obstacles=obstacles(ROOM))
    for k in (130, 3, 131, 129, 0, 199, 64, 65, 63, 16, 17):
        assert again.frame(k).poses.tobytes() == poses[k].tobytes(), f"frame {k}"
    assert len(again._checkpoints) <= 4
    assert simulation.frame(100).contacts == again.frame(100).contacts


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
from tests.dynamics.room_movers import make_crowd
simulation = make_crowd()
print(hashlib.sha256(b"".join(simulation.frame(k).poses.tobytes() for k in range(30))).hexdigest())
"""


@pytest.mark.parametrize("threads", ["1", pytest.param("3", marks=pytest.mark.slow)])
def test_frames_are_identical_in_another_process_with_any_thread_count(threads):
    root = Path(__file__).parents[2]
    found = subprocess.run(
        [sys.executable, "-c", PROGRAM, threads], cwd=root, check=True, capture_output=True, text=True
    ).stdout.split()[-1]
    simulation = make_crowd()
    here = hashlib.sha256(b"".join(simulation.frame(k).poses.tobytes() for k in range(30))).hexdigest()
    assert found == here


def test_new_movers_or_obstacles_compile_no_kernel(crowd):
    def compiled():
        return [len(kernel._primal.compiled_kernels) for kernel in (evaluate, substep)]

    before = compiled()
    run(SteppedSimulation([bouncer(), bouncer("b", (0, 0.8, 0), ROD)], fps=30, obstacles=obstacles(ROOM, PILLAR)), 5)
    run(SteppedSimulation([bouncer()], fps=30), 5)  # without obstacles
    assert compiled() == before


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
