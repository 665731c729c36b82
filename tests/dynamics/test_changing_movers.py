# SPDX-License-Identifier: Apache-2.0
"""Movers that are spawned, removed and put elsewhere while a simulation runs."""

from dataclasses import replace
from fractions import Fraction

import numpy as np

from dynamics import (
    Body,
    Simulation,
    Still,
    WaitUntilComplete,
)
from dynamics.colliding_bodies import Mover, Teleport
from dynamics.stepped_simulation import SteppedSimulation
from dynamics.timings import AssignedWindows
from tests.dynamics.room_movers import CUBE, LINE, ROOM, SimulatedFrames, bouncer, run
from tests.dynamics.solids import cube, obstacles


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
        assert max(taken._checkpoints) == 64
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
    assert list(taken._checkpoints) == [69]
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
