# SPDX-License-Identifier: Apache-2.0
"""Which light is sampled: the one that gives most at the point, and none is left out."""

import numpy as np
import pytest
import taichi as ti
from scipy import stats

from tests.reference.chi_square import MIN_P_VALUE
from tiscene.device.kernel_types import Float8s1
from tiscene.render.lights.importance import weigh_entries
from tiscene.render.lights.light_sample import LightTables
from tiscene.render.lights.light_sampler import choose_light, light_probabilities
from tiscene.scene.description import DistantLight, DomeLight, Portal, RectLight, SphereLight
from tiscene.scene.lights.light_kinds import DISTANT, DOME, PORTAL, RECT, SPHERE
from tiscene.scene.lights.light_table import KIND, LightTable
from tiscene.scene.lights.light_tree import (
    CHILD,
    H_BVH_ROW,
    H_DOME_END,
    H_ENTRY_NODES,
    LANES,
    MAX_ENTRIES,
    MAX_FINITE_ENTRIES,
    NODE_COLUMNS,
    PARENT,
    ROW,
    STRENGTH,
    UNIFORM_FRACTION,
    child_rows,
    light_slots,
)
from tiscene.scene.textures.atlas import TextureAtlas

VALUES = ti.types.ndarray(dtype=ti.f32, ndim=2)
NUMBERS = ti.types.ndarray(dtype=ti.f32, ndim=1)


@ti.kernel
def choices(
    values: VALUES,
    nodes: Float8s1,
    distribution: NUMBERS,
    x: ti.f32,
    y: ti.f32,
    z: ti.f32,
    normal: ti.math.vec3,
    chances: NUMBERS,
    counts: NUMBERS,
    mismatch: NUMBERS,
    numbers: NUMBERS,
    left: NUMBERS,
    chosen_with: NUMBERS,
):
    lights = ti.static(LightTables(values, nodes, distribution))
    point = ti.math.vec3(x, y, z)
    ti.loop_config(serialize=True)
    for _ in range(1):
        weights, faced = ti.Vector.zero(ti.f32, MAX_ENTRIES), ti.Vector.zero(ti.f32, MAX_ENTRIES)
        count, scale, faced_scale = weigh_entries(lights, point, normal, weights, faced, True)
        for k in range(numbers.shape[0]):
            row, _place, both, left[k] = choose_light(
                lights, weights, faced, count, scale, faced_scale, point, normal, numbers[k]
            )
            counts[row] += 1.0
            chosen_with[row] = both.x
            again = light_probabilities(lights, weights, weights, count, scale, scale, row, point).y
            mismatch[0] = ti.max(mismatch[0], ti.abs(both.y - again))
        for row in range(chances.shape[0]):
            chances[row] = light_probabilities(lights, weights, weights, count, scale, scale, row, point).y


def chosen(lights, point, numbers, normal=(0.0, 0.0, 0.0)):
    """Kinds of the table's rows, the chance of each at a point, and how often it is chosen by numbers in 0..1; by a
    surface of a normal the chances are those that were found by choosing, 0 where it was never chosen."""
    table = LightTable()
    table.append(lights, 0)
    arrays = table.arrays(TextureAtlas())
    kinds = arrays.values.to_numpy()[:, KIND].astype(int)
    chances, counts, mismatch = (np.zeros(size, np.float32) for size in (len(kinds), len(kinds), 1))
    left = np.empty(len(numbers), np.float32)
    found = np.zeros(len(kinds), np.float32)
    normal = ti.math.vec3(*normal)
    choices(*arrays, *point, normal, chances, counts, mismatch, numbers.astype(np.float32), left, found)
    assert 0.0 <= left.min() <= left.max() < 1.0
    assert np.histogram(left, 16, (0.0, 1.0))[0] == pytest.approx(len(numbers) / 16, rel=0.06)
    assert chances.sum() == pytest.approx(1.0, abs=1e-5)
    assert mismatch[0] < 1e-6
    if normal.norm() > 0.0:
        return kinds, found, counts
    np.testing.assert_allclose(found[counts > 0], chances[counts > 0], rtol=1e-4)
    return kinds, chances, counts


def chances_at(lights, point):
    """Kinds of the table's rows, and the chance of each at a point; checks that choosing agrees with them."""
    samples = 100_000
    kinds, chances, counts = chosen(lights, point, (np.arange(samples) + 0.5) / samples)
    # One number serves for every step of the choice: what is left of it after many is as good as random.
    assert counts / samples == pytest.approx(chances, abs=2e-4 if len(kinds) <= MAX_FINITE_ENTRIES else 2e-3)
    return kinds, chances


def at(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def lamp(x, y, z, radiance=(1.0, 1.0, 1.0)):
    return SphereLight("lamp", "/lamp", at(x, y, z), radiance, 0.1)


def test_the_nearer_of_two_lamps_by_the_square_of_the_distance():
    kinds, chances = chances_at([lamp(1.0, 0.0, 0.0), lamp(-3.0, 0.0, 0.0)], (0.0, 0.0, 0.0))
    assert list(kinds) == [SPHERE, SPHERE]
    expected = (1.0 - UNIFORM_FRACTION) * 9.0 / 10.0 + UNIFORM_FRACTION / 2.0
    assert chances[0] == pytest.approx(expected, rel=2e-3)


def test_a_panel_gives_nothing_behind_it():
    panel = RectLight("panel", "/panel", at(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 1.0, 1.0)  # shines towards -z
    kinds, before = chances_at([panel, lamp(0.0, 0.0, -2.0)], (0.0, 0.0, -1.0))
    _, behind = chances_at([panel, lamp(0.0, 0.0, -2.0)], (0.0, 0.0, 1.0))
    assert kinds[0] == RECT
    assert before[0] > 0.8
    assert behind[0] == 0.0


def test_a_sun_counts_where_it_shines_through_a_portal():
    portal = Portal(at(0.0, 0.0, 0.0), 1.0, 1.0)  # light comes in along -z
    sky = DomeLight("sky", "/sky", np.eye(4), (1.0, 1.0, 1.0), None, (portal,))
    sun = DistantLight("sun", "/sun", np.eye(4), (50.0, 50.0, 50.0), 0.01)
    kinds, lit = chances_at([sky, sun], (0.2, 0.0, -2.0))
    assert list(kinds) == [DISTANT, DOME, PORTAL]
    assert lit[0] > 0.9
    assert lit[1] == 0.0  # the sky is looked for where it comes in
    _, unlit = chances_at([sky, sun], (2.0, 0.0, -2.0))
    assert unlit[0] == pytest.approx(UNIFORM_FRACTION / 2.0, rel=0.02)
    _, outside = chances_at([sky, sun], (2.0, 0.0, 2.0))
    assert outside[0] == pytest.approx(0.95 * 50.0 / (50.0 + np.pi) + 0.05, rel=1e-3)
    assert outside[1] == pytest.approx(0.95 * np.pi / (50.0 + np.pi), rel=1e-3)


def test_of_many_portals_the_near_ones():
    portals = tuple(Portal(at(x, 0.0, 0.0), 1.0, 1.0) for x in np.linspace(-20.0, 20.0, 21))
    kinds, chances = chances_at([DomeLight("sky", "/sky", np.eye(4), (1.0, 1.0, 1.0), None, portals)], (0.0, 0.0, -2.0))
    assert list(kinds) == [DOME] + [PORTAL] * 21
    assert chances[1 + 10] == chances.max()
    assert chances[1 + 9 : 1 + 12].sum() > 0.5


def many_lamps(count):
    random = np.random.default_rng(2)
    return [lamp(*random.uniform(-5.0, 5.0, 3), (float(random.uniform(0.1, 2.0)),) * 3) for _ in range(count)]


@pytest.mark.parametrize("count", [MAX_FINITE_ENTRIES, MAX_FINITE_ENTRIES + 1, 60, 200])
def test_of_many_lamps_the_near_and_bright_ones(count):
    lamps = [*many_lamps(count), DistantLight("sun", "/sun", np.eye(4), (0.01, 0.01, 0.01), 0.01)]
    point = np.array([1.0, 2.0, -3.0])
    _, chances = chances_at(lamps, tuple(point))
    assert (chances > 0.0).all()
    gives = [each.radiance[0] / ((each.world_from_light[:3, 3] - point) ** 2).sum() for each in lamps[:-1]]
    ideal = np.array([*gives, 0.01 / (np.pi * 0.1**2)])
    ideal /= ideal.sum()
    # The mean square of what a light gives over its chance; 1 for chances by what each gives.
    evenly = (ideal**2 * len(lamps)).sum()
    assert (ideal**2 / chances).sum() < min(1.5, 0.5 * evenly)


def test_a_surface_that_faces_away_from_a_lamp_chooses_others():
    lamps = [lamp(0.0, 0.0, 1.0), lamp(0.0, 0.0, -1.0), lamp(0.8, 0.0, 0.6)]
    _, chances, counts = chosen(lamps, (0.0, 0.0, 0.0), (np.arange(20000) + 0.5) / 20000, (0.0, 0.0, 1.0))
    assert counts / 20000 == pytest.approx(chances, abs=2e-4)
    assert chances[1] < 0.08
    # The cosines, of which that of a small lamp is a little larger.
    assert (chances[2] - UNIFORM_FRACTION / 3) / (chances[0] - UNIFORM_FRACTION / 3) == pytest.approx(0.6, rel=0.05)


@pytest.mark.parametrize("count", [MAX_FINITE_ENTRIES, 60, 200])
def test_of_many_lamps_those_that_a_surface_faces(count):
    """What is left is how one cosine stands for all of a group: far less than where no cosine is looked at."""
    lamps, point, normal = many_lamps(count), np.array([-5.2, 2.0, -3.0]), np.array([0.6, -0.8, 0.0])
    _, chances, counts = chosen(lamps, tuple(point), np.random.default_rng(1).random(400_000), tuple(normal))
    _, blind, _ = chosen(lamps, tuple(point), np.random.default_rng(1).random(400_000))
    offsets = np.array([each.world_from_light[:3, 3] for each in lamps]) - point
    distances = np.linalg.norm(offsets, axis=1)
    gives = np.array([each.radiance[0] for each in lamps]) * np.maximum(offsets @ normal, 0.0) / distances**3
    gives /= gives.sum()
    shines = gives > 1e-3
    assert (counts[shines] > 0).all()
    excess, before = ((gives[shines] ** 2 / each[shines]).sum() - 1.0 for each in (chances, blind))
    assert excess < 0.4 * before


@pytest.mark.parametrize("normal", [(0.0, 0.0, 0.0), (0.6, 0.0, -0.8)])
@pytest.mark.parametrize("count", [3, 60, 700])
def test_choices_follow_their_chances(count, normal):
    """Chi-square."""
    samples = 200_000
    lights = [*many_lamps(count), DomeLight("sky", "/sky", np.eye(4), (0.01, 0.01, 0.01))]
    _, chances, counts = chosen(lights, (1.0, 2.0, -3.0), np.random.default_rng(5).random(samples, np.float32), normal)
    expected = chances / chances.sum(dtype=np.float64) * samples
    often = expected >= 5.0
    assert often.sum() > 0.3 * count
    observed = np.append(counts[often], counts[~often].sum() + 1e-9)
    expected = np.append(expected[often], expected[~often].sum() + 1e-9)
    assert stats.chisquare(observed, expected).pvalue > MIN_P_VALUE


def test_groups_hold_every_light_once():
    table = LightTable()
    table.append([*many_lamps(50), DomeLight("sky", "/sky", np.eye(4), (1.0, 1.0, 1.0))], 0)
    arrays = table.arrays(TextureAtlas())
    table_rows = arrays.nodes.to_numpy()
    nodes = table_rows[: int(table_rows[H_BVH_ROW // LANES, H_BVH_ROW % LANES])].reshape(-1, NODE_COLUMNS)
    assert nodes[0, H_DOME_END] == LANES + 1
    assert nodes[0, H_ENTRY_NODES] == 2
    rows, _ = light_slots(nodes[1:])
    assert sorted(rows) == list(range(51))
    for node in range(1, len(nodes)):
        for lane, member in enumerate(child_rows(nodes[node])):
            child = int(member[CHILD])
            assert (member[ROW] < 0.0) == (child > 0)
            if child > 0:
                assert nodes[child, PARENT] == LANES * node + lane
                assert child_rows(nodes[child])[:, STRENGTH].sum() == pytest.approx(member[STRENGTH], rel=1e-5)
