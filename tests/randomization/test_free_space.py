# SPDX-License-Identifier: Apache-2.0
"""Room in front of a camera: what is in view, hidden, free."""

from __future__ import annotations

import numpy as np
import pytest

from tests.usd.helpers import write
from tiscene.randomization.free_space import FreeSpace
from tiscene.scene.camera import Camera
from tiscene.scene.description import SceneDescription
from tiscene.usd.read.stage_reader import read_stage

# A box of 2 m about the origin, and a far small one that makes the bounds wide.
SCENE = """
def Cube "Box"
{
}
def Cube "Far"
{
    double3 xformOp:translate = (0, 0, -20)
    double3 xformOp:scale = (9, 9, 0.1)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
}
"""


@pytest.fixture(scope="module")
def space(tmp_path_factory: pytest.TempPathFactory) -> FreeSpace:
    camera = Camera((0, 0, 5), vertical_fov=np.pi / 2)
    return FreeSpace(read_stage(write(tmp_path_factory.mktemp("scene"), SCENE)), camera, 1.5)


def test_points_and_their_projections_are_inverse(space):
    rng = np.random.default_rng(1)
    x, y, depth = rng.random(50), rng.random(50), rng.uniform(0.2, 30, 50)
    np.testing.assert_allclose(space.project(space.points(x, y, depth)), (x, y, depth), atol=1e-12)
    corner = space.points(np.array([0.0]), np.array([0.0]), np.array([2.0]))
    np.testing.assert_allclose(corner, [(-3, 2, 3)], atol=1e-12)  # left and top, 2 m ahead


def test_in_view_and_hidden(space):
    points = np.array([(0, 0, 3), (0, 0, -3), (3, 0, 0), (9, 0, 0), (0, 0, 6), (0, 4.9, 0), (0, 5.1, 0)])
    assert space.in_view(points).tolist() == [True, True, True, False, False, True, False]
    assert space.hidden(points).tolist() == [False, True, False, False, False, False, False]


def test_a_ball_is_free_where_it_touches_nothing(space):
    points = np.array([(0, 0, 2.5), (0, 0, 1.4), (0, 0, 0), (0, 0, -1.4), (0, 0, -3), (1.4, 0, 0), (3, 0, 0)])
    assert space.is_free(points, 0.5).tolist() == [True, False, False, False, True, False, True]
    # A ball that reaches beyond the picture may meet what is not seen, unless it is within the scene and clear of all.
    assert space.is_free(points, 1.3).tolist() == [False, False, False, False, True, False, False]
    assert not space.is_free(
        np.array([(0, 0, -19.9), (0, 0, -30), (50, 0, 0)]), 0.5
    ).any()  # outside the scene's bounds


def test_what_nobody_sees_is_in_the_way_but_hides_nothing(tmp_path):
    pane = """
def Cube "Pane" (prepend apiSchemas = ["PhysicsCollisionAPI"])
{
    uniform token purpose = "guide"
    double3 xformOp:translate = (0, 0, -8)
    double3 xformOp:scale = (9, 9, 0.1)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
}
"""
    camera = Camera((0, 0, 5), vertical_fov=np.pi / 2)
    space = FreeSpace(read_stage(write(tmp_path, SCENE + pane)), camera, 1.5)
    points = np.array([(5, 0, -7.0), (5, 0, -8.0), (5, 0, -8.5)])
    assert space.is_free(points, 0.5).tolist() == [True, False, False]
    assert not space.hidden(points).any()


def test_free_balls_hold_no_vertex_and_no_surface(space):
    rng = np.random.default_rng(2)
    points = rng.uniform((-8, -8, -19), (8, 8, 4), (2000, 3))
    for radius in (0.1, 1.0):
        free = points[space.is_free(points, radius)]
        assert 0.5 < len(free) / len(points) < 1
        nearest = np.clip(free, -1, 1)
        assert np.linalg.norm(free - nearest, axis=1).min() > radius


def test_nothing_at_all_is_all_room():
    space = FreeSpace(SceneDescription("empty"), Camera(), 1.0)
    assert space.empty
    assert space.is_free(np.array([(0, 0, -100), (0, 0, 100)]), 3.0).all()
