# SPDX-License-Identifier: Apache-2.0
"""Surfaces that cross, and points inside closed surfaces."""

import numpy as np
import pytest

from dynamics.rotation import matrix_from_quaternion
from dynamics.surface_overlap import shrunk, surfaces_cross, winding_number
from tests.dynamics.solids import box, quad

UNIT = box((1.0, 1.0, 1.0))
FLOOR = quad((0.0, 0.0, 0.0), (0.0, 0.0, 5.0), (5.0, 0.0, 0.0))


def sphere(radius: float, center=(0.0, 0.0, 0.0), rings: int = 24) -> np.ndarray:
    """Return the triangles of a sphere, counter-clockwise seen from outside."""
    polar, around = np.linspace(0.0, np.pi, rings + 1), np.linspace(0.0, 2.0 * np.pi, 2 * rings + 1)
    grid = np.array([[(np.sin(p) * np.cos(q), np.cos(p), -np.sin(p) * np.sin(q)) for q in around] for p in polar])
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    triangles = np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)
    return radius * triangles + center


@pytest.mark.parametrize(
    ("b", "cross"),
    [
        (box((1.0, 1.0, 1.0), (0.9, 0.8, 0.7)), True),
        (box((1.0, 1.0, 1.0), (1.0001, 0.0, 0.0)), False),
        (box((0.2, 0.2, 0.2)), False),  # inside
        (box((0.01, 3.0, 0.01), (0.2, 0.0, 0.1)), True),  # a pin through two faces
        (FLOOR, True),
        (FLOOR - (0.0, 0.51, 0.0), False),
        (sphere(0.6), True),
        (sphere(0.49), False),
    ],
)
def test_boxes_cross_other_surfaces(b, cross):
    assert surfaces_cross(UNIT, b) is cross
    assert surfaces_cross(b, UNIT) is cross


@pytest.mark.parametrize("below", [FLOOR - (0.0, 0.5, 0.0), box((1.0, 1.0, 1.0), (0.0, -1.0, 0.0))])
def test_shrunk_box_does_not_cross_what_it_stands_on(below):
    assert not surfaces_cross(shrunk(UNIT, 0.005, 0.2), below)
    assert surfaces_cross(shrunk(UNIT, 0.005, 0.2) - (0.0, 0.006, 0.0), below)


def test_fine_spheres_cross_as_their_distance_says():
    a = sphere(0.5, rings=48)
    rng = np.random.default_rng(1)
    for direction in rng.normal(size=(12, 3)):
        direction /= np.linalg.norm(direction)
        for distance, cross in ((0.93, True), (1.01, False), (0.3, True)):
            assert surfaces_cross(a, sphere(0.5, distance * direction)) is cross, (direction, distance)


@pytest.mark.slow
def test_crossing_equals_brute_force_for_random_triangles():
    rng = np.random.default_rng(2)
    found = set()
    for number in range(60):
        a, b = (rng.normal(size=(count, 3, 3)) * 0.2 + rng.normal(size=(count, 1, 3)) for count in (70, 40))
        b += (0.03 * number, 0.0, 0.0)
        brute = any(surfaces_cross(one[None], other[None]) for one in a for other in b)
        assert surfaces_cross(a, b) is brute
        found.add(brute)
    assert found == {True, False}


def test_no_triangles_cross_nothing():
    none = np.zeros((0, 3, 3))
    assert not surfaces_cross(none, UNIT)
    assert not surfaces_cross(UNIT, none)


def test_winding_number_is_one_inside_and_zero_outside():
    turned = UNIT @ matrix_from_quaternion(np.array([0.8, 0.6, 0.0, 0.0])).T
    for triangles in (UNIT, turned, sphere(0.5)):
        assert winding_number(np.array([0.1, 0.2, 0.1]), triangles) == pytest.approx(1.0)
        assert winding_number(np.array([0.1, 0.2, 0.1]), triangles[:, ::-1]) == pytest.approx(-1.0)
        assert winding_number(np.array([1.1, 0.2, 0.1]), triangles) == pytest.approx(0.0, abs=1e-9)
    shell = np.concatenate([sphere(0.5), sphere(0.4)[:, ::-1]])
    assert winding_number(np.zeros(3), shell) == pytest.approx(0.0, abs=1e-9), "in the cavity"
    assert winding_number(np.array([0.45, 0.0, 0.0]), shell) == pytest.approx(1.0)


def test_shrinking_moves_each_side_of_the_box_by_the_margin():
    corners = shrunk(box((1.0, 0.02, 2.0), (3.0, 0.0, 0.0)), 0.005, 0.2).reshape(-1, 3)
    np.testing.assert_allclose(corners.min(axis=0), (2.505, -0.006, -0.995))
    np.testing.assert_allclose(corners.max(axis=0), (3.495, 0.006, 0.995))
    flat = quad((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    assert (shrunk(flat, 0.005, 0.2)[..., 1] == 1.0).all()
