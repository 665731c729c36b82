"""Which light is sampled: the one that gives most at the point, and none is left out."""

import numpy as np
import pytest
import taichi as ti

from tiscene.render.lights.choice import EVEN_PART, chance_of, choose
from tiscene.render.lights.light_sample import Lights
from tiscene.scene.description import DistantLight, DomeLight, Portal, RectLight, SphereLight
from tiscene.scene.light_table import (
    DISTANT,
    DOME,
    FEW,
    G_COUNT,
    G_FIRST,
    G_STRENGTH,
    GROUP,
    GROUP_COLUMNS,
    GROUP_COUNT,
    KIND,
    RECT,
    SPHERE,
    STRENGTH,
    LightTable,
)
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
    samples = 10_000 if total <= FEW else 200_000
    choices(values, distribution, total, solid, *point, chances, counts, mismatch, samples)
    assert chances.sum() == pytest.approx(1.0, abs=1e-5)
    # One number serves for every step of the choice: what is left of it after many is as good as random.
    assert counts == pytest.approx(chances, abs=2e-4 if total <= FEW else 2e-3)
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


def many_lamps(count):
    random = np.random.default_rng(2)
    return [lamp(*random.uniform(-5.0, 5.0, 3), (float(random.uniform(0.1, 2.0)),) * 3) for _ in range(count)]


@pytest.mark.parametrize("count", [FEW + 1, 60, 200])
def test_of_many_lamps_the_near_and_bright_ones(count):
    lamps = [*many_lamps(count), DistantLight("sun", "/sun", np.eye(4), (0.01, 0.01, 0.01), 0.01)]
    point = np.array([1.0, 2.0, -3.0])
    _, chances = chances_at(lamps, tuple(point))
    assert (chances >= EVEN_PART / len(lamps) * 0.999).all()
    gives = [each.radiance[0] / ((each.world_from_light[:3, 3] - point) ** 2).sum() for each in lamps[:-1]]
    ideal = np.array([*gives, 0.01 / (np.pi * 0.1**2)])
    ideal /= ideal.sum()
    # The mean square of what a light gives over its chance; 1 for chances by what each gives.
    evenly = (ideal**2 * len(lamps)).sum()
    assert (ideal**2 / chances).sum() < min(2.2, 0.5 * evenly)


def test_groups_hold_every_light_once():
    table = LightTable()
    table.append([*many_lamps(50), DomeLight("sky", "/sky", np.eye(4), (1.0, 1.0, 1.0))], 0)
    values, distribution, total, _ = table.arrays(TextureAtlas(), radius=5.0)
    values, distribution = values.to_numpy(), distribution.to_numpy()
    groups = distribution[: int(values[0, GROUP_COUNT]) * GROUP_COLUMNS].reshape(-1, GROUP_COLUMNS)
    assert 6 <= len(groups) <= 17
    rows = [distribution[int(g[G_FIRST]) : int(g[G_FIRST] + g[G_COUNT])].astype(int) for g in groups]
    assert sorted(np.concatenate(rows)) == list(range(total))
    for number, members in enumerate(rows):
        assert (values[members, GROUP] == number).all()
    assert groups[:, G_STRENGTH].sum() == pytest.approx(values[:total, STRENGTH].sum(), rel=1e-5)
