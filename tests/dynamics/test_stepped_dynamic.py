# SPDX-License-Identifier: Apache-2.0
"""Stepped dynamics: trajectories that users write in Python."""

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest

from dynamics import AllTogether, Body, Mover, Simulation, Stepped, SteppedSimulation, Waypoint
from dynamics import stepped_dynamic as module
from dynamics.dynamic import Pose
from dynamics.errors import ArgumentError
from tests.dynamics.solids import box, cube, obstacles


@dataclass(frozen=True)
class Pendulum(Stepped):
    """A pendulum in the xy plane below its start position."""

    length: float = 1.0
    swing: float = 0.5

    def begin(self, start):
        return start.position, self.swing, 0.0

    def advance(self, state, number):
        pivot, angle, rate = state
        rate -= 9.81 / self.length * math.sin(angle) * self.step
        return pivot, angle + rate * self.step, rate

    def pose(self, state):
        (x, y, z), angle, _ = state
        place = (x + self.length * math.sin(angle), y - self.length * math.cos(angle), z)
        return Waypoint(place, (0.0, 0.0, math.degrees(angle)))


@dataclass(frozen=True)
class Walk(Stepped):
    """A random walk with a step every 0.1 s."""

    seed: int = 1
    step = 0.1

    def begin(self, start):
        return np.array(start.position)

    def advance(self, state, number):
        return state + 0.02 * np.random.default_rng((self.seed, number)).normal(size=3)

    def pose(self, state):
        return Waypoint(tuple(state))


def bodies():
    return [Body(Pendulum(), (0.0, 2.0, 0.0), name="p"), Body(Walk(), (3.0, 0.0, 0.0), name="w")]


def test_pendulum_swings_with_its_period():
    simulation = Simulation(bodies()[:1])
    poses = np.array([simulation.poses(Fraction(k, 50))[0] for k in range(500)])
    np.testing.assert_allclose(np.linalg.norm(poses[:, :3] - (0.0, 2.0, 0.0), axis=1), 1.0, atol=1e-3)
    angles = np.arctan2(poses[:, 0], 2.0 - poses[:, 1])
    assert 0.49 < angles.max() < 0.52
    # A small swing takes 2 pi sqrt(l / g) (1 + a^2 / 16) s.
    crossings = np.flatnonzero((angles[:-1] < 0.0) & (angles[1:] >= 0.0))
    assert np.diff(crossings).mean() / 50 == pytest.approx(
        2.0 * math.pi / math.sqrt(9.81) * (1.0 + 0.25 / 16), rel=5e-3
    )
    np.testing.assert_allclose(2.0 * np.arctan2(poses[:, 6], poses[:, 3]), angles, atol=1e-3)


def test_poses_do_not_depend_on_order_of_calls(monkeypatch):
    straight = Simulation(bodies(), AllTogether(0.5))
    expected = [straight.poses(Fraction(k, 25)).tobytes() for k in range(400)]
    monkeypatch.setattr(module, "MAX_CHECKPOINTS", 4)
    again = Simulation(bodies(), AllTogether(0.5))
    for k in (399, 3, 200, 201, 199, 0, 12, 13, 398):
        assert again.poses(Fraction(k, 25)).tobytes() == expected[k], f"frame {k}"
    assert expected[0] == expected[12], "the timing delays the start"


def test_checkpoints_stay_bounded_and_do_not_change_poses(monkeypatch):
    monkeypatch.setattr(module, "MAX_CHECKPOINTS", 4)
    states = module.SteppedStates(Walk(), Pose((3.0, 0.0, 0.0)), "w")
    poses = [states.pose_at(clock) for clock in range(200)]
    assert states.checkpoint_count <= 4
    again = module.SteppedStates(Walk(), Pose((3.0, 0.0, 0.0)), "w")
    for clock in (150, 3, 199, 77):
        np.testing.assert_array_equal(again.pose_at(clock), poses[clock])


def test_seeking_recomputes_from_last_checkpoint():
    steps = []

    @dataclass(frozen=True)
    class Counted(Walk):
        def advance(self, state, number):
            steps.append(number)
            return super().advance(state, number)

    simulation = Simulation([Body(Counted(), name="c")])
    simulation.poses(500.0)
    assert len(steps) == 5001
    steps.clear()
    simulation.poses(321.0)
    assert len(steps) <= module.CHECKPOINT + 1


def test_blocked_body_returns_to_its_path():
    wall = box((0.2, 3.0, 3.0), (-0.55, 0.0, 0.0))
    shape = cube(0.2)
    mover = Mover(Body(Pendulum(swing=0.9), (0.0, 1.0, 0.0), name="p"), shape)
    stepped = SteppedSimulation([mover], fps=25, obstacles=obstacles(wall))
    free = Simulation([mover.body])
    poses = np.array([stepped.frame(k).poses[0] for k in range(100)])
    paths = np.array([free.poses(Fraction(k, 25))[0] for k in range(100)])
    assert paths[:, 0].min() < -0.7
    assert -0.45 < poses[:, 0].min() < -0.3
    same = (poses == paths).all(axis=1)
    assert not same.all()
    blocked = int(np.flatnonzero(~same)[0])
    assert same[blocked:].any(), "back on its path, bit by bit"


def test_wrong_pose_or_step_raises_error_that_names_the_class():
    @dataclass(frozen=True)
    class Wrong(Walk):
        def pose(self, state):
            return state

    with pytest.raises(TypeError, match=r"Wrong of 'x': pose\(\) returned .*: must be a Waypoint"):
        Simulation([Body(Wrong(), name="x")]).poses(0.0)

    @dataclass(frozen=True)
    class Frozen(Walk):
        step = 0.0

    with pytest.raises(ValueError, match="step of Frozen"):
        Simulation([Body(Frozen(), name="x")])


def test_simulation_that_diverges_is_an_error_that_names_the_time():
    """Kernels of collisions ended the process without a message."""

    @dataclass(frozen=True)
    class Spring(Stepped):
        def begin(self, start):
            return 1.0

        def advance(self, state, number):
            return -10.0 * state

        def pose(self, state):
            return Waypoint((state, 0.0, 0.0))

    simulation = Simulation([Body(Spring(), name="s")])
    assert simulation.poses(0.08)[0, 0] == pytest.approx(1e8)
    with pytest.raises(ArgumentError, match=r"Spring of 's': pose\(\) is at .* m after 0\.1 s, more than 1e\+09 m"):
        simulation.poses(0.09)
    with pytest.raises(
        ArgumentError, match=r"Spring of 's': pose\(\) after 0\.39 s: position=.*3\.4e\+38; if the simulation"
    ):
        simulation.poses(0.39)
