# SPDX-License-Identifier: Apache-2.0
"""Free space before a camera: projection, lines of sight, distances, reachability."""

from __future__ import annotations

import numpy as np
import pytest

from tests.randomization.rooms import cube
from tests.usd.helpers import write
from tiscene.randomization.free_space import FreeSpace
from tiscene.scene.camera import Camera
from tiscene.scene.description import SceneDescription
from tiscene.usd.read.stage_reader import read_stage

CAMERA = Camera((0, 0, 5), vertical_fov=np.pi / 2)
# A box of 2 m about the origin, and a plate behind it, 18 m wide.
SCENE = cube("Box", (0, 0, 0), (1, 1, 1)) + cube("Plate", (0, 0, -20), (9, 9, 0.1))


def is_free(space: FreeSpace, points: np.ndarray, radius: float) -> np.ndarray:
    """Return at which of the points [n, 3] a ball touches no surface and is reachable from the camera."""
    return (space.distances(points, 2.0 * radius) > radius) & space.is_reachable(points)


def free_space(folder, stage: str) -> FreeSpace:
    return FreeSpace(read_stage(write(folder, stage)), CAMERA, 1.5)


@pytest.fixture(scope="module")
def space(tmp_path_factory: pytest.TempPathFactory) -> FreeSpace:
    return free_space(tmp_path_factory.mktemp("scene"), SCENE)


def test_project_inverts_points(space):
    rng = np.random.default_rng(1)
    x, y, depth = rng.random(50), rng.random(50), rng.uniform(0.2, 30, 50)
    np.testing.assert_allclose(space.project(space.points(x, y, depth)), (x, y, depth), atol=1e-12)
    corner = space.points(np.array([0.0]), np.array([0.0]), np.array([2.0]))
    np.testing.assert_allclose(corner, [(-3, 2, 3)], atol=1e-12)  # left and top, 2 m ahead


def test_in_view_and_hidden(space):
    points = np.array([(0, 0, 3), (0, 0, -3), (3, 0, 0), (9, 0, 0), (0, 0, 6), (0, 4.9, 0), (0, 5.1, 0)])
    assert space.in_view(points).tolist() == [True, True, True, False, False, True, False]
    assert space.hidden(points).tolist() == [False, True, False, False, False, False, False]


def test_hidden_is_exact_at_silhouettes(space):
    """The box's front face, 4 m ahead, hides a point at z = -3 within 1 m * 8 / 4 of the axis."""
    points = np.array([(x, y, -3.0) for x in (1.999, 2.001) for y in (-1.999, -2.001)])
    assert space.hidden(points).tolist() == [True, False, False, False]


def test_distances_count_surfaces_and_near_plane(space):
    points = np.array([(0, 0, 2.5), (3, 0, 0), (0, 0, -10), (0, 0, 4.5), (0, 0, 5.4)])
    expected = [1.5, 2, 4, 0.5 - CAMERA.near, 0.4 - CAMERA.near]
    np.testing.assert_allclose(space.distances(points, 4.0), expected, atol=1e-5)


def test_is_free_requires_radius_and_reachability(space):
    points = np.array([(0, 0, 2.5), (0, 0, 1.4), (0, 0, 0), (0, 0, -1.4), (0, 0, -3), (1.4, 0, 0), (3, 0, 0)])
    # The center of the box is 1 m away from every surface, but enclosed.
    assert is_free(space, points, 0.5).tolist() == [True, False, False, False, True, False, True]
    assert is_free(space, points, 1.7).tolist() == [False, False, False, False, True, False, True]
    in_plate_behind_and_beside = np.array([(0, 0, -19.9), (0, 0, -30), (50, 0, 0)])
    assert not is_free(space, in_plate_behind_and_beside, 0.5).any()


def test_free_balls_intersect_no_box(space):
    rng = np.random.default_rng(2)
    points = rng.uniform((-8, -8, -19), (8, 8, 4), (2000, 3))
    for radius in (0.1, 1.0):
        free = points[is_free(space, points, radius)]
        assert 0.5 < len(free) / len(points) < 1
        nearest = np.clip(free, -1, 1)
        assert np.linalg.norm(free - nearest, axis=1).min() > radius


def test_invisible_collider_blocks_and_does_not_hide(tmp_path):
    pane = cube("Pane", (5, 0, -8), (3, 3, 0.1), "PhysicsCollisionAPI", "guide")
    space = free_space(tmp_path, SCENE + pane)
    points = np.array([(5, 0, -7.0), (5, 0, -8.0), (5, 0, -8.5), (5, 0, -12.0)])
    assert is_free(space, points, 0.5).tolist() == [True, False, False, True]  # the last: around the pane
    assert not space.hidden(points).any()


def test_space_behind_closed_collider_is_not_reachable(tmp_path):
    cell = cube("Cell", (5, 0, -10), (2, 2, 2), "PhysicsCollisionAPI", "guide")
    space = free_space(tmp_path, SCENE + cell)
    points = np.array([(5, 0, -10.0), (5, 0, -7.0)])
    assert is_free(space, points, 0.5).tolist() == [False, True]
    assert not space.hidden(points).any()


def test_empty_scene_is_free_everywhere():
    space = FreeSpace(SceneDescription("empty"), Camera(), 1.0)
    assert is_free(space, np.array([(0, 0, -100), (0, 0, 100)]), 3.0).all()
