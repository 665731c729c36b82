# SPDX-License-Identifier: Apache-2.0
"""Which light a ray meets: the same as by looking at every one."""

import numpy as np
import pytest
import taichi as ti

from tiscene.device.kernel_types import Float8s1
from tiscene.device.vector_mode import vector_mode
from tiscene.render.lights import dispatch
from tiscene.render.lights.intersect import is_blocked_by_light, nearest_intersected
from tiscene.render.lights.light_sample import LightTables
from tiscene.scene.description import CylinderLight, DiskLight, Light, RectLight, SphereLight
from tiscene.scene.lights.light_bvh import BLOCK_ROWS, BOX_MIN, REFERENCE, build
from tiscene.scene.lights.light_table import LightTable
from tiscene.scene.lights.light_tree import LANES
from tiscene.scene.textures.atlas import TextureAtlas

FLOATS_1D = ti.types.ndarray(dtype=ti.f32, ndim=1)
FLOATS_2D = ti.types.ndarray(dtype=ti.f32, ndim=2)
INTS = ti.types.ndarray(dtype=ti.i32, ndim=2)
WHITE = (1.0, 1.0, 1.0)


@ti.kernel
def meet(
    values: FLOATS_2D, nodes: Float8s1, distribution: FLOATS_1D, rays: FLOATS_2D, rows: INTS, distances: FLOATS_2D
):
    """Of rays of an origin, a direction and a reach: the light that is met and its distance, then whether another light
    is in the way; by the tree, and by looking at every light."""
    lights = ti.static(LightTables(values, nodes, distribution))
    for ray in range(rays.shape[0]):
        origin = ti.math.vec3(rays[ray, 0], rays[ray, 1], rays[ray, 2])
        direction = ti.math.vec3(rays[ray, 3], rays[ray, 4], rays[ray, 5])
        rows[ray, 0], distances[ray, 0] = nearest_intersected(lights, -1, origin, direction, rays[ray, 6])
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
def test_the_light_that_looking_at_every_one_finds(count: int) -> None:
    random = np.random.default_rng(7)
    table = LightTable()
    table.append(some_lights(count), 0)
    arrays = table.arrays(TextureAtlas())
    rays = np.empty((4000, 7), np.float32)
    rays[:, :3] = random.uniform(-4.0, 4.0, (4000, 3))
    aims = np.array([light.world_from_light[:3, 3] for light in table.lights])[random.integers(0, count, 4000)]
    directions = aims + random.uniform(-0.2, 0.2, (4000, 3)) - rays[:, :3]
    directions[:100, 1:] = 0.0  # along an axis
    rays[:, 3:6] = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    rays[:, 6] = random.uniform(3.0, 12.0, 4000)
    rows, distances = np.empty((4000, 4), np.int32), np.empty((4000, 2), np.float32)
    with vector_mode():  # as the kernels that shade
        meet(*arrays, rays, rows, distances)
    met = rows[:, 1] >= 0
    assert met.sum() > 100
    np.testing.assert_array_equal(rows[:, 0], rows[:, 1])
    np.testing.assert_array_equal(distances[:, 0], distances[:, 1])
    np.testing.assert_array_equal(rows[:, 2], rows[:, 3])
    if count > 8:
        assert 0 < rows[:, 3].sum() < met.sum()


def test_no_light_is_met_where_there_is_none() -> None:
    assert build(np.zeros((0, 3)), np.zeros((0, 3)), 0).shape == (0, LANES)


@pytest.mark.parametrize("count", [1, 8, 9, 200, 2000])
def test_every_box_is_in_those_of_its_groups_once(count: int) -> None:
    random = np.random.default_rng(count)
    least = random.uniform(-5.0, 5.0, (count, 3))
    largest = least + random.uniform(0.0, 1.0, (count, 3))
    first = 3
    table = np.concatenate([np.zeros((first, LANES), np.float32), build(least, largest, first)])

    def below(node: int) -> list[int]:
        """The lights below a node, whose members' boxes hold what is below them."""
        result = []
        for eight in range(int(table[node + 7, 0])):
            rows = table[node + BLOCK_ROWS * eight :][:BLOCK_ROWS]
            for lane in range(LANES):
                if rows[BOX_MIN, lane] < 1e30:
                    child = int(rows[REFERENCE, lane])
                    lights = below(child) if child >= 0 else [-1 - child]
                    assert (rows[BOX_MIN:3, lane] <= least[lights].min(axis=0) + 1e-6).all()
                    assert (rows[3:REFERENCE, lane] >= largest[lights].max(axis=0) - 1e-6).all()
                    result += lights
        return result

    assert sorted(below(first)) == list(range(count))
