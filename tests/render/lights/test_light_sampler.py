# SPDX-License-Identifier: Apache-2.0
"""Choosing a light: in proportion to estimated contributions, and never with probability 0."""

import numpy as np
import pytest
import taichi as ti
from scipy import stats

from tests.reference.chi_square import MIN_P_VALUE
from tiscene.device.kernel_types import Float8s1, Floats1, Floats2
from tiscene.render.lights.importance import EntryWeights, weigh_entries
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


@ti.kernel
def choices(
    values: Floats2,
    nodes: Float8s1,
    distribution: Floats1,
    x: ti.f32,
    y: ti.f32,
    z: ti.f32,
    normal: ti.math.vec3,
    probabilities: Floats1,
    counts: Floats1,
    mismatch: Floats1,
    numbers: Floats1,
    left: Floats1,
    chosen_with: Floats1,
):
    lights = ti.static(LightTables(values, nodes, distribution))
    point = ti.math.vec3(x, y, z)
    ti.loop_config(serialize=True)
    for _ in range(1):
        weights, faced = ti.Vector.zero(ti.f32, MAX_ENTRIES), ti.Vector.zero(ti.f32, MAX_ENTRIES)
        count, scale, faced_scale = weigh_entries(lights, point, normal, weights, faced, True)
        entries = ti.static(EntryWeights(weights, faced, count, scale, faced_scale))
        facing = ti.static(EntryWeights(weights, weights, count, scale, scale))
        for k in range(numbers.shape[0]):
            row, _place, both, left[k] = choose_light(lights, entries, point, normal, numbers[k])
            counts[row] += 1.0
            chosen_with[row] = both.x
            again = light_probabilities(lights, facing, row, point).y
            mismatch[0] = ti.max(mismatch[0], ti.abs(both.y - again))
        for row in range(probabilities.shape[0]):
            probabilities[row] = light_probabilities(lights, facing, row, point).y


def chosen(lights, point, numbers, normal=(0.0, 0.0, 0.0)):
    """Return kinds of the table's rows, the probability of each at a point, and how often numbers in 0..1 choose it.

    With a normal, the probabilities are those returned by choosing; 0 for lights that were never chosen.
    """
    table = LightTable()
    table.place([(0, light) for light in lights], [0])
    arrays = table.arrays(TextureAtlas())
    kinds = arrays.values.to_numpy()[:, KIND].astype(int)
    probabilities, counts, mismatch = (np.zeros(size, np.float32) for size in (len(kinds), len(kinds), 1))
    left = np.empty(len(numbers), np.float32)
    found = np.zeros(len(kinds), np.float32)
    normal = ti.math.vec3(*normal)
    choices(*arrays, *point, normal, probabilities, counts, mismatch, numbers.astype(np.float32), left, found)
    assert 0.0 <= left.min() <= left.max() < 1.0
    assert np.histogram(left, 16, (0.0, 1.0))[0] == pytest.approx(len(numbers) / 16, rel=0.06)
    assert probabilities.sum() == pytest.approx(1.0, abs=1e-5)
    assert mismatch[0] < 1e-6
    if normal.norm() > 0.0:
        return kinds, found, counts
    np.testing.assert_allclose(found[counts > 0], probabilities[counts > 0], rtol=1e-4)
    return kinds, probabilities, counts


def probabilities_at(lights, point):
    """Return kinds of the table's rows, and the probability of each at a point; checks that choosing agrees."""
    samples = 100_000
    kinds, probabilities, counts = chosen(lights, point, (np.arange(samples) + 0.5) / samples)
    # One number serves all steps of the choice; its remainder after many steps is practically random.
    assert counts / samples == pytest.approx(probabilities, abs=2e-4 if len(kinds) <= MAX_FINITE_ENTRIES else 2e-3)
    return kinds, probabilities


def at(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def lamp(x, y, z, radiance=(1.0, 1.0, 1.0)):
    return SphereLight("lamp", "/lamp", at(x, y, z), radiance, 0.1)


def test_two_lamps_are_chosen_by_inverse_squared_distance():
    kinds, probabilities = probabilities_at([lamp(1.0, 0.0, 0.0), lamp(-3.0, 0.0, 0.0)], (0.0, 0.0, 0.0))
    assert list(kinds) == [SPHERE, SPHERE]
    expected = (1.0 - UNIFORM_FRACTION) * 9.0 / 10.0 + UNIFORM_FRACTION / 2.0
    assert probabilities[0] == pytest.approx(expected, rel=2e-3)


def test_rect_is_not_chosen_behind_it():
    panel = RectLight("panel", "/panel", at(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 1.0, 1.0)  # emits towards -z
    kinds, before = probabilities_at([panel, lamp(0.0, 0.0, -2.0)], (0.0, 0.0, -1.0))
    _, behind = probabilities_at([panel, lamp(0.0, 0.0, -2.0)], (0.0, 0.0, 1.0))
    assert kinds[0] == RECT
    assert before[0] > 0.8
    assert behind[0] == 0.0


def test_sun_is_chosen_where_it_shines_through_a_portal():
    portal = Portal(at(0.0, 0.0, 0.0), 1.0, 1.0)  # light enters along -z
    sky = DomeLight("sky", "/sky", np.eye(4), (1.0, 1.0, 1.0), None, (portal,))
    sun = DistantLight("sun", "/sun", np.eye(4), (50.0, 50.0, 50.0), 0.01)
    kinds, lit = probabilities_at([sky, sun], (0.2, 0.0, -2.0))
    assert list(kinds) == [DISTANT, DOME, PORTAL]
    assert lit[0] > 0.9
    assert lit[1] == 0.0  # the sky is sampled through its portal
    _, unlit = probabilities_at([sky, sun], (2.0, 0.0, -2.0))
    assert unlit[0] == pytest.approx(UNIFORM_FRACTION / 2.0, rel=0.02)
    _, outside = probabilities_at([sky, sun], (2.0, 0.0, 2.0))
    assert outside[0] == pytest.approx(0.95 * 50.0 / (50.0 + np.pi) + 0.05, rel=1e-3)
    assert outside[1] == pytest.approx(0.95 * np.pi / (50.0 + np.pi), rel=1e-3)


def test_near_portals_are_chosen_more_often():
    portals = tuple(Portal(at(x, 0.0, 0.0), 1.0, 1.0) for x in np.linspace(-20.0, 20.0, 21))
    kinds, probabilities = probabilities_at(
        [DomeLight("sky", "/sky", np.eye(4), (1.0, 1.0, 1.0), None, portals)], (0.0, 0.0, -2.0)
    )
    assert list(kinds) == [DOME] + [PORTAL] * 21
    assert probabilities[1 + 10] == probabilities.max()
    assert probabilities[1 + 9 : 1 + 12].sum() > 0.5


def many_lamps(count):
    random = np.random.default_rng(2)
    return [lamp(*random.uniform(-5.0, 5.0, 3), (float(random.uniform(0.1, 2.0)),) * 3) for _ in range(count)]


@pytest.mark.parametrize("count", [MAX_FINITE_ENTRIES, MAX_FINITE_ENTRIES + 1, 60, 200])
def test_near_and_bright_lamps_are_chosen_more_often(count):
    lamps = [*many_lamps(count), DistantLight("sun", "/sun", np.eye(4), (0.01, 0.01, 0.01), 0.01)]
    point = np.array([1.0, 2.0, -3.0])
    _, probabilities = probabilities_at(lamps, tuple(point))
    assert (probabilities > 0.0).all()
    contribution = [each.radiance[0] / ((each.world_from_light[:3, 3] - point) ** 2).sum() for each in lamps[:-1]]
    ideal = np.array([*contribution, 0.01 / (np.pi * 0.1**2)])
    ideal /= ideal.sum()
    # Second moment of contribution over probability; 1 if they are proportional.
    uniform = (ideal**2 * len(lamps)).sum()
    assert (ideal**2 / probabilities).sum() < min(1.5, 0.5 * uniform)


def test_lamps_behind_a_surface_are_rarely_chosen():
    lamps = [lamp(0.0, 0.0, 1.0), lamp(0.0, 0.0, -1.0), lamp(0.8, 0.0, 0.6)]
    _, probabilities, counts = chosen(lamps, (0.0, 0.0, 0.0), (np.arange(20000) + 0.5) / 20000, (0.0, 0.0, 1.0))
    assert counts / 20000 == pytest.approx(probabilities, abs=2e-4)
    assert probabilities[1] < 0.08
    # The ratio of cosines; a lamp of finite size has a slightly larger one.
    assert (probabilities[2] - UNIFORM_FRACTION / 3) / (probabilities[0] - UNIFORM_FRACTION / 3) == pytest.approx(
        0.6, rel=0.05
    )


@pytest.mark.parametrize("count", [MAX_FINITE_ENTRIES, 60, 200])
def test_lamps_in_front_of_a_surface_are_chosen_more_often(count):
    """One cosine stands for all lights of a group; the remaining variance is far less than without cosines."""
    lamps, point, normal = many_lamps(count), np.array([-5.2, 2.0, -3.0]), np.array([0.6, -0.8, 0.0])
    _, probabilities, counts = chosen(lamps, tuple(point), np.random.default_rng(1).random(400_000), tuple(normal))
    _, blind, _ = chosen(lamps, tuple(point), np.random.default_rng(1).random(400_000))
    offsets = np.array([each.world_from_light[:3, 3] for each in lamps]) - point
    distances = np.linalg.norm(offsets, axis=1)
    contribution = np.array([each.radiance[0] for each in lamps]) * np.maximum(offsets @ normal, 0.0) / distances**3
    contribution /= contribution.sum()
    contributes = contribution > 1e-3
    assert (counts[contributes] > 0).all()
    excess, before = (
        (contribution[contributes] ** 2 / each[contributes]).sum() - 1.0 for each in (probabilities, blind)
    )
    assert excess < 0.4 * before


@pytest.mark.parametrize("normal", [(0.0, 0.0, 0.0), (0.6, 0.0, -0.8)])
@pytest.mark.parametrize("count", [3, 60, 700])
def test_choices_follow_their_probabilities(count, normal):
    """By a chi-square test."""
    samples = 200_000
    lights = [*many_lamps(count), DomeLight("sky", "/sky", np.eye(4), (0.01, 0.01, 0.01))]
    _, probabilities, counts = chosen(
        lights, (1.0, 2.0, -3.0), np.random.default_rng(5).random(samples, np.float32), normal
    )
    expected = probabilities / probabilities.sum(dtype=np.float64) * samples
    often = expected >= 5.0
    assert often.sum() > 0.3 * count
    observed = np.append(counts[often], counts[~often].sum() + 1e-9)
    expected = np.append(expected[often], expected[~often].sum() + 1e-9)
    assert stats.chisquare(observed, expected).pvalue > MIN_P_VALUE


def test_groups_contain_each_light_once():
    table = LightTable()
    lights = *many_lamps(50), DomeLight("sky", "/sky", np.eye(4), (1.0, 1.0, 1.0))
    table.place([(0, light) for light in lights], [0])
    arrays = table.arrays(TextureAtlas())
    table_rows = arrays.nodes.to_numpy()
    nodes = table_rows[: int(table_rows[H_BVH_ROW // LANES, H_BVH_ROW % LANES])].reshape(-1, NODE_COLUMNS)
    assert nodes[0, H_DOME_END] == LANES + 1
    assert nodes[0, H_ENTRY_NODES] == 2
    rows, _ = light_slots(nodes[1:])
    assert sorted(rows) == list(range(51))
    for node in range(1, len(nodes)):
        for lane, attributes in enumerate(child_rows(nodes[node])):
            child = int(attributes[CHILD])
            assert (attributes[ROW] < 0.0) == (child > 0)
            if child > 0:
                assert nodes[child, PARENT] == LANES * node + lane
                assert child_rows(nodes[child])[:, STRENGTH].sum() == pytest.approx(attributes[STRENGTH], rel=1e-5)
