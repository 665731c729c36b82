# SPDX-License-Identifier: Apache-2.0
"""Distances and times of contact against plain numpy, for stretched, rotated and sheared instances."""

import numpy as np
import pytest
import taichi as ti

from dynamics.contact import MAX_TOUCHES, SKIN, TOUCH_COLUMNS
from dynamics.sphere_query import CONTACT, NEAREST, WITHIN, query_sphere
from dynamics.tree_access import Tree, vec3
from tests.dynamics.solids import obstacles
from tests.reference.distance import point_triangle
from tiscene.device.kernel_types import Floats2, Ints1


@ti.kernel
def run_queries(
    spheres: Floats2,
    chords: Floats2,
    limit: ti.f32,
    found: Floats2,
    touches: Floats2,
    is_bvh8: ti.template(),
    nodes: Tree,
    leaf_blocks: Tree,
    instances: Floats2,
    roots: Ints1,
    root: ti.i32,
):
    for i in range(spheres.shape[0]):
        center = vec3(spheres[i, 0], spheres[i, 1], spheres[i, 2])
        chord = vec3(chords[i, 0], chords[i, 1], chords[i, 2])
        arm = vec3(0.0)
        for query in ti.static((NEAREST, WITHIN, CONTACT)):
            until = 1.0
            radius = spheres[i, 3]
            if ti.static(query == NEAREST):
                until = limit
            number, normal, row, _count = query_sphere(
                is_bvh8,
                nodes,
                leaf_blocks,
                instances,
                roots,
                root,
                center,
                chord,
                radius,
                until,
                0.0,
                0.0,
                arm,
                arm,
                touches,
                i * MAX_TOUCHES,
                0,
                query,
            )
            found[i, query] = number
            if ti.static(query == CONTACT):
                found[i, 3] = normal.dot(chord)
                found[i, 4] = row


@pytest.fixture(scope="module", params=["bvh8", pytest.param("bvh2", marks=pytest.mark.slow)])
def scene(request):
    """Return clouds of triangles, some of them slivers, in instances that stretch, rotate, mirror and shear."""
    random = np.random.default_rng(3)
    parts, matrices, world = [], [], []
    for kind in range(6):
        corners = random.uniform(-1.0, 1.0, (60, 1, 3)) + random.uniform(-0.2, 0.2, (60, 3, 3))
        corners[:10, 2] = 0.5 * (corners[:10, 0] + corners[:10, 1]) + 1e-4
        matrix = np.eye(4)
        turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
        matrix[:3, :3] = turn @ np.diag(random.uniform(0.3, 2.0, 3))
        if kind >= 4:
            matrix[:3, :3] = matrix[:3, :3] @ np.array([[1.0, 0.4, 0.0], [0.0, 1.0, -0.3], [0.2, 0.0, 1.0]])
        matrix[:3, 3] = random.uniform(-1.5, 1.5, 3)
        parts.append(corners)
        matrices.append(matrix)
        world.append(corners.astype(np.float32) @ matrix[:3, :3].T + matrix[:3, 3])
    return (
        obstacles(*parts, matrices=matrices, layout=request.param)(),
        np.concatenate(world),
        np.repeat(np.arange(6), 60),
    )


def queried(tree, spheres, chords, limit):
    """Return per sphere: distance, bound of the time, time of contact, speed along the normal there, instance."""
    found = np.zeros((len(spheres), 5), np.float32)
    touches = np.zeros((len(spheres) * MAX_TOUCHES, TOUCH_COLUMNS), np.float32)
    run_queries(spheres.astype(np.float32), chords.astype(np.float32), limit, found, touches, *tree.arguments())
    return found


def test_nearest_returns_distance_to_nearest_triangle(scene):
    tree, world, _ = scene
    spheres = np.zeros((400, 4))
    spheres[:, :3] = np.random.default_rng(4).uniform(-3.0, 3.0, (400, 3))
    truth = point_triangle(spheres[:, :3], world).min(axis=1)
    np.testing.assert_allclose(queried(tree, spheres, np.zeros((400, 3)), 1e4)[:, 0], truth, atol=2e-6)
    # The limit bounds the distance.
    np.testing.assert_allclose(queried(tree, spheres, np.zeros((400, 3)), 0.3)[:, 0], np.minimum(truth, 0.3), atol=2e-6)


def test_contact_stops_one_skin_before_nearest_triangle(scene):
    """At the time of contact the gap is one skin; before, it is larger."""
    tree, world, owner = scene
    random = np.random.default_rng(5)
    spheres, chords = np.zeros((300, 4)), random.normal(size=(300, 3)) * random.uniform(0.01, 3.0, (300, 1))
    spheres[:, :3] = random.uniform(-2.0, 2.0, (300, 3))
    spheres[:, 3] = random.uniform(0.001, 0.1, 300)
    spheres, chords = spheres.astype(np.float32).astype(float), chords.astype(np.float32).astype(float)
    free = point_triangle(spheres[:, :3], world).min(axis=1) > spheres[:, 3] + 2.0 * SKIN
    spheres, chords = spheres[free], chords[free]
    found = queried(tree, spheres, chords, 1.0)
    hit = found[:, 2] < 1.0
    assert 0.2 < hit.mean() < 0.95
    for part in np.linspace(0.0, 1.0, 60):
        here = spheres[:, :3] + (part * found[:, 2:3]) * chords
        assert (point_triangle(here, world).min(axis=1) - spheres[:, 3]).min() > SKIN - 1e-5
    distance = point_triangle(spheres[:, :3] + found[:, 2:3] * chords, world)
    np.testing.assert_allclose(distance.min(axis=1)[hit] - spheres[hit, 3], SKIN, atol=2e-5)
    assert (found[hit, 3] < 0.0).all(), "a contact's normal points against the motion"
    assert (owner[distance.argmin(axis=1)][hit] == found[hit, 4]).mean() > 0.99
    assert (found[~hit, 4] == -1).all()
    # At the bound of the time no triangle is within the radius yet.
    before = spheres[:, :3] + 0.999 * found[:, 1:2] * chords
    assert (point_triangle(before, world).min(axis=1) > spheres[:, 3] - 1e-5).all()


def test_contact_finds_thin_plate_on_long_motion():
    """A motion of a kilometer does not tunnel through a plate without thickness."""
    plate = np.array([[[0.0, -1, -1], [0, 1, -1], [0, 0, 1]]])
    tree = obstacles(plate)()
    spheres, chords = np.array([[-500.0, 0.0, 0.0, 0.01]]), np.array([[1000.0, 0.0, 0.0]])
    found = queried(tree, spheres, chords, 1.0)
    np.testing.assert_allclose(found[0, 2] * 1000.0, 500.0 - 0.01 - SKIN, atol=1e-3)


@pytest.mark.parametrize("is_bvh8", [True, False])
def test_empty_obstacles_return_limits(is_bvh8):
    from dynamics.obstacles import Obstacles

    found = queried(Obstacles.empty(is_bvh8), np.array([[0.0, 0, 0, 1]]), np.array([[1.0, 0, 0]]), 5.0)
    assert found[0].tolist() == [5.0, 1.0, 1.0, 0.0, -1.0]
