"""Which light is sampled: the one that gives most at the point, and none is left out."""

import numpy as np
import pytest
import taichi as ti

from tiscene.render.lights.choice import EVEN_PART, FEW, chance_of, choose
from tiscene.render.lights.light_sample import Lights
from tiscene.scene.description import DistantLight, DomeLight, Portal, RectLight, SphereLight
from tiscene.scene.light_table import DISTANT, DOME, KIND, RECT, SPHERE, LightTable
from tiscene.scene.texture_atlas import TextureAtlas

VALUES = ti.types.ndarray(dtype=ti.f32, ndim=2)
NUMBERS = ti.types.ndarray(dtype=ti.f32, ndim=1)


@ti.kernel
def choices(
    values: VALUES,
    distribution: NUMBERS,
    total: ti.i32,
    solid: ti.i32,
    x: ti.f32,
    y: ti.f32,
    z: ti.f32,
    chances: NUMBERS,
    counts: NUMBERS,
    mismatch: NUMBERS,
    samples: ti.i32,
):
    lights = ti.static(Lights(values, distribution, total, solid))
    point = ti.math.vec3(x, y, z)
    ti.loop_config(serialize=True)
    for k in range(samples):
        row, chance = choose(lights, point, (k + 0.5) / samples)
        counts[row] += 1.0 / samples
        mismatch[0] = ti.max(mismatch[0], ti.abs(chance - chance_of(lights, row, point)))
    for row in range(total):
        chances[row] = chance_of(lights, row, point)


def chances_at(lights, point):
    """Kinds of the table's rows, and the chance of each at a point; checks that choosing agrees with them."""
    table = LightTable()
    table.append(lights, 0)
    values, distribution, total, solid = table.arrays(TextureAtlas(), radius=5.0)
    chances, counts, mismatch = (np.zeros(size, np.float32) for size in (total, total, 1))
    choices(values, distribution, total, solid, *point, chances, counts, mismatch, 10_000)
    assert chances.sum() == pytest.approx(1.0, abs=1e-5)
    assert counts == pytest.approx(chances, abs=2e-4)
    assert mismatch[0] < 1e-6
    return values.to_numpy()[:total, KIND].astype(int), chances


def at(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def lamp(x, y, z, radiance=(1.0, 1.0, 1.0)):
    return SphereLight("lamp", "/lamp", at(x, y, z), radiance, 0.1)


def test_the_nearer_of_two_lamps_by_the_square_of_the_distance():
    kinds, chances = chances_at([lamp(1.0, 0.0, 0.0), lamp(-3.0, 0.0, 0.0)], (0.0, 0.0, 0.0))
    assert list(kinds) == [SPHERE, SPHERE]
    expected = (1.0 - EVEN_PART) * 9.0 / 10.0 + EVEN_PART / 2.0
    assert chances[0] == pytest.approx(expected, rel=2e-3)


def test_a_panel_gives_nothing_behind_it():
    panel = RectLight("panel", "/panel", at(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 1.0, 1.0)  # shines towards -z
    kinds, before = chances_at([panel, lamp(0.0, 0.0, -2.0)], (0.0, 0.0, -1.0))
    _, behind = chances_at([panel, lamp(0.0, 0.0, -2.0)], (0.0, 0.0, 1.0))
    assert kinds[0] == RECT
    assert before[0] > 0.8
    assert behind[0] == pytest.approx(EVEN_PART / 2.0)


def test_a_sun_counts_where_it_shines_through_a_portal():
    portal = Portal(at(0.0, 0.0, 0.0), 1.0, 1.0)  # light comes in along -z
    sky = DomeLight("sky", "/sky", np.eye(4), (1.0, 1.0, 1.0), None, (portal,))
    sun = DistantLight("sun", "/sun", np.eye(4), (50.0, 50.0, 50.0), 0.01)
    kinds, lit = chances_at([sky, sun], (0.2, 0.0, -2.0))
    assert list(kinds) == [DISTANT, DOME]
    assert lit[0] > 0.9
    _, unlit = chances_at([sky, sun], (2.0, 0.0, -2.0))
    assert unlit[0] == pytest.approx(EVEN_PART / 2.0)
    _, outside = chances_at([sky, sun], (2.0, 0.0, 2.0))
    assert outside[0] == pytest.approx(0.9 * 50.0 / (50.0 + np.pi) + 0.05, rel=1e-3)


def test_many_lamps_are_chosen_by_power():
    lamps = [lamp(x, 0.0, 0.0, (1.0 + x,) * 3) for x in range(FEW + 1)]
    _, chances = chances_at(lamps, (0.0, 0.5, 0.0))
    assert (np.diff(chances) > 0.0).all()
