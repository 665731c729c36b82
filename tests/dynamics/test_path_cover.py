# SPDX-License-Identifier: Apache-2.0
"""The balls of a path contain all of it, and little more."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from dynamics import (
    Body,
    CatmullWaypoints,
    ClosedForm,
    Composite,
    Keyframes,
    LinearWaypoints,
    LookAt,
    Orbit,
    Simulation,
    Still,
    Waypoint,
)
from dynamics.path_cover import MAX_BALLS, PIECES, cover_path

A, B = Waypoint((-1.0, 1.2, -2.2)), Waypoint((1.0, 1.2, -2.2))
SIDEWAYS = Keyframes((0, 30.0, 30.5, 31.0, 100.0), (A, A, B, A, A), repeat=True)
ORBIT = Orbit((0.3, 0.1, 0.0), 0.37, (1, 2, 0))


def waypoints(count: int, seed: int = 0, size: float = 2.0, turning: bool = True) -> list[Waypoint]:
    random = np.random.default_rng(seed)
    positions, angles = random.normal(scale=size, size=(count, 3)), random.uniform(-180, 180, (count, 3)) * turning
    return [Waypoint(tuple(p), tuple(r)) for p, r in zip(positions.tolist(), angles.tolist(), strict=True)]


PATHS = {
    "at rest": Still(),
    "many waypoints": LinearWaypoints([A, B] * 64, 128.0),
    "splines": CatmullWaypoints(waypoints(5)),
    "many splines": CatmullWaypoints(waypoints(100, 1), 9.7, "arc_length", "euler"),
    "short detour in a long loop": SIDEWAYS,
    "not repeated": Keyframes((2.0, 3.0, 3.5), waypoints(3)),
    "orbit": Orbit((1, 2, 3), 6.0, (3, -1, 2)),
    "orbit about itself": Orbit((0.5, -1.0, 2.0)),
    "aimed": LookAt((0.5, 1.0, 1.0), CatmullWaypoints(waypoints(4))),
    "aimed, with an arm": Composite((LookAt((0, 1, 0), CatmullWaypoints(waypoints(4))), ORBIT)),
    "fast orbit on waypoints": Composite((LinearWaypoints(waypoints(6), 8.0), ORBIT)),
    "fast orbit on waypoints that do not turn": Composite((CatmullWaypoints(waypoints(6, turning=False), 8.0), ORBIT)),
    "fast orbit on Euler angles": Composite((CatmullWaypoints(waypoints(3), 8.0, rotation="euler"), ORBIT)),
    "waypoints on an orbit": Composite((Orbit(period=7.0), CatmullWaypoints(waypoints(4)))),
    "three orbits": Composite((Orbit(period=10.0), Orbit((1, 0, 0), 1.1), ORBIT)),
    "detour on waypoints on an orbit": Composite((Orbit(), LinearWaypoints(waypoints(9)), SIDEWAYS)),
    "parts at rest": Composite((Still(), Still())),
}


def outside(dynamic: ClosedForm) -> float:
    """Return the greatest distance of a path's points from its balls, m."""
    body = Body(dynamic, (0.5, -1.0, 2.0), (30, 40, 50))
    balls = cover_path(body.tracks)
    loop = Fraction(min(dynamic.loop_time, 100.0)).limit_denominator(1000) or Fraction(1)
    times = [loop * Fraction(i, 700) for i in range(701)] + [30 + Fraction(i, 100) for i in range(100)]
    points = Simulation([body]).poses_at(times)[:, 0, :3]
    return float((np.linalg.norm(points[:, None] - balls[:, :3], axis=2) - balls[:, 3]).min(axis=1).max())


@pytest.mark.parametrize("name", PATHS)
def test_every_path_stays_in_its_balls(name):
    assert outside(PATHS[name]) < 1e-9


def test_random_composites_stay_in_their_balls():
    for seed in range(8):
        random = np.random.default_rng(seed)
        parts: list[ClosedForm] = []
        for _ in range(random.integers(1, 4)):
            count, time = int(random.integers(2, 9)), float(random.integers(1, 20))
            points = waypoints(count, seed, random.exponential(), bool(random.integers(2)))
            parts.append(
                (
                    lambda points, time: LinearWaypoints(points, time),
                    lambda points, time: CatmullWaypoints(points, time, "arc_length"),
                    lambda points, time: Keyframes(np.arange(len(points)) * time + 0.5, points, repeat=True),
                    lambda points, time: Orbit(points[0].position, time, points[1].position),
                )[random.integers(4)](points, time)
            )
        assert outside(Composite(parts)) < 1e-9, parts


def test_a_repeated_path_holds_the_jump_to_its_start():
    """A body that collides is swept along it."""
    stations = (A, Waypoint((0, 5, 0)), B)
    for repeat in (False, True):
        balls = cover_path(Body(Keyframes((0, 1, 2), stations, repeat)).tracks)
        distances = np.linalg.norm(balls[:, :3] - (0.0, 1.2, -2.2), axis=1) - balls[:, 3]
        assert bool(distances.min() < 1e-9) is repeat


def test_balls_are_about_as_small_as_pieces_of_the_path():
    line = LinearWaypoints([A, B])
    np.testing.assert_allclose(cover_path(Body(line).tracks)[:-1, 3], 2.0 / PIECES)
    uneven = LinearWaypoints([A, B, Waypoint((1.01, 1.2, -2.2)), Waypoint((1.02, 1.2, -2.2))])
    assert cover_path(Body(uneven).tracks)[:, 3].max() < 2.03 / PIECES
    circle = cover_path(Body(Orbit(), (1, 5, 0)).tracks)
    np.testing.assert_allclose(circle[:, 3], math.pi / PIECES, rtol=1e-3)
    spin = Composite((line, Orbit(period=0.1, axis=(1, 1, 0))))
    np.testing.assert_array_equal(cover_path(Body(spin).tracks), cover_path(Body(line).tracks))
    bob = Composite((line, LinearWaypoints([Waypoint((0, 0, 0)), Waypoint((0, 0.1, 0))])))
    assert cover_path(Body(bob).tracks)[:, 3].max() < 2.2 / PIECES
    assert not cover_path(Body(Still(), (1, 2, 3)).tracks)[:, 3].any()


def test_the_number_of_balls_is_bounded_where_several_tracks_move():
    parts = (Orbit(), *[CatmullWaypoints(waypoints(4, seed, turning=False)) for seed in range(4)])
    assert len(cover_path(Body(Composite(parts), (1, 0, 0)).tracks)) <= MAX_BALLS
