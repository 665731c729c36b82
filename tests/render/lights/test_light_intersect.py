# SPDX-License-Identifier: Apache-2.0
"""Rays against lights: the BVH of lights finds the same hits as a test of every light."""

import numpy as np
import pytest
import taichi as ti

from tiscene.device.kernel_types import Float8s1, Floats1, Floats2, Ints2
from tiscene.device.vector_mode import vector_mode
from tiscene.render.lights import dispatch
from tiscene.render.lights.intersect import is_blocked_by_light, nearest_intersected
from tiscene.render.lights.light_sample import LightTables
from tiscene.scene.description import CylinderLight, DiskLight, Light, RectLight, SphereLight
from tiscene.scene.lights.light_bvh import BLOCK_ROWS, BOX_MIN, REFERENCE, build
from tiscene.scene.lights.light_table import LightTable
from tiscene.scene.lights.light_tree import LANES
from tiscene.scene.textures.atlas import TextureAtlas

WHITE = (1.0, 1.0, 1.0)


@ti.kernel
def intersect_all(
    values: Floats2, nodes: Float8s1, distribution: Floats1, rays: Floats2, rows: Ints2, distances: Floats2
):
    """Intersect rays (origin, direction, t_max) with all lights: even columns by the BVH, odd ones by brute force.

    rows: nearest light, and whether any other light is hit. distances: of the nearest.
    """
    lights = ti.static(LightTables(values, nodes, distribution))
    for ray in range(rays.shape[0]):
        origin = ti.math.vec3(rays[ray, 0], rays[ray, 1], rays[ray, 2])
        direction = ti.math.vec3(rays[ray, 3], rays[ray, 4], rays[ray, 5])
        rows[ray, 0], distances[ray, 0] = nearest_intersected(lights, -1, 0, origin, direction, rays[ray, 6])
        first, nearest, others = -1, rays[ray, 6], 0
        for row in range(values.shape[0]):
            distance = dispatch.intersect(lights, row, origin, direction)
            if distance < nearest:
                first, nearest = row, distance
            others += ti.cast(distance < rays[ray, 6], ti.i32)
        rows[ray, 1], distances[ray, 1] = first, nearest
        rows[ray, 2] = is_blocked_by_light(lights, first, origin, direction, rays[ray, 6])
        rows[ray, 3] = ti.cast(others > 1, ti.i32)


def some_lights(count: int) -> list[Light]:
    random = np.random.default_rng(count)
    result: list[Light] = []
    for k in range(count):
        matrix = np.eye(4)
        matrix[:3, :3] = np.linalg.qr(random.normal(size=(3, 3)))[0] if k % 8 > 3 else np.eye(3)
        matrix[:3, 3] = random.uniform(-3.0, 3.0, 3)
        size = random.uniform(0.05, 0.6)
        kinds = (
            RectLight(f"{k}", f"/{k}", matrix, WHITE, size, 2.0 * size),
            DiskLight(f"{k}", f"/{k}", matrix, WHITE, size),
            SphereLight(f"{k}", f"/{k}", matrix, WHITE, size),
            CylinderLight(f"{k}", f"/{k}", matrix, WHITE, 0.3 * size, 2.0 * size),
        )
        result.append(kinds[k % 4])
    return result


@pytest.mark.parametrize("count", [1, 2, 8, 9, 64, 65, 200, 300])
def test_nearest_light_equals_brute_force(count: int) -> None:
    random = np.random.default_rng(7)
    table = LightTable()
    table.place([(0, light) for light in some_lights(count)], [0])
    arrays = table.arrays(TextureAtlas())
    rays = np.empty((4000, 7), np.float32)
    rays[:, :3] = random.uniform(-4.0, 4.0, (4000, 3))
    aims = np.array([light.world_from_light[:3, 3] for light in table.lights])[random.integers(0, count, 4000)]
    directions = aims + random.uniform(-0.2, 0.2, (4000, 3)) - rays[:, :3]
    directions[:100, 1:] = 0.0  # along an axis
    rays[:, 3:6] = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    rays[:, 6] = random.uniform(3.0, 12.0, 4000)
    rows, distances = np.empty((4000, 4), np.int32), np.empty((4000, 2), np.float32)
    with vector_mode():  # like the shading kernels
        intersect_all(*arrays, rays, rows, distances)
    is_hit = rows[:, 1] >= 0
    assert is_hit.sum() > 100
    np.testing.assert_array_equal(rows[:, 0], rows[:, 1])
    np.testing.assert_array_equal(distances[:, 0], distances[:, 1])
    np.testing.assert_array_equal(rows[:, 2], rows[:, 3])
    if count > 8:
        assert 0 < rows[:, 3].sum() < is_hit.sum()


def test_no_lights_build_an_empty_bvh() -> None:
    assert build(np.zeros((0, 3)), np.zeros((0, 3)), 0).shape == (0, LANES)


@pytest.mark.parametrize("count", [1, 8, 9, 200, 2000])
def test_boxes_of_nodes_contain_each_light_once(count: int) -> None:
    random = np.random.default_rng(count)
    lower = random.uniform(-5.0, 5.0, (count, 3))
    upper = lower + random.uniform(0.0, 1.0, (count, 3))
    first = 3
    table = np.concatenate([np.zeros((first, LANES), np.float32), build(lower, upper, first)])

    def below(node: int) -> list[int]:
        """Return the lights below a node, and check that its children's boxes contain them."""
        result = []
        for block in range(int(table[node + 7, 0])):
            rows = table[node + BLOCK_ROWS * block :][:BLOCK_ROWS]
            for lane in range(LANES):
                if rows[BOX_MIN, lane] < 1e30:
                    child = int(rows[REFERENCE, lane])
                    lights = below(child) if child >= 0 else [-1 - child]
                    assert (rows[BOX_MIN:3, lane] <= lower[lights].min(axis=0) + 1e-6).all()
                    assert (rows[3:REFERENCE, lane] >= upper[lights].max(axis=0) - 1e-6).all()
                    result += lights
        return result

    assert sorted(below(first)) == list(range(count))
