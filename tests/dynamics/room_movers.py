# SPDX-License-Identifier: Apache-2.0
"""Movers in a room, and their gaps to it, for tests of SteppedSimulation."""

import math
from fractions import Fraction

import numpy as np

from dynamics import (
    Body,
    LinearWaypoints,
    Waypoint,
)
from dynamics.colliding_bodies import Mover
from dynamics.random_bounce import UniformMovementRandomBounce
from dynamics.sphere_proxy import cover
from dynamics.stepped_simulation import SteppedSimulation
from tests.dynamics.solids import box, cube, obstacles, spheres_at
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


LINE = LinearWaypoints([Waypoint((-1.2, 0, 0)), Waypoint((1.2, 0, 0), (0, 90, 0))], total_time=4.0)
TURN = np.sqrt(0.5) * np.array([[1.0, 0, 1], [0, np.sqrt(2.0), 0], [-1, 0, 1]])
PILLAR = box((0.4, 1.5, 0.4)) @ TURN.T + (0.0, 0.0, 0.06)
