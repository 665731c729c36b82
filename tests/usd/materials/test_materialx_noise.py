# SPDX-License-Identifier: Apache-2.0
"""MaterialX's noises and patterns: against scalar versions, and in a network."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.usd.materials.test_materialx import color_from, document, given, linked, material_of, node, warned_material
from tiscene.usd.materials.materialx_noise import evaluate_noise, lattice_hash

MASK = 0xFFFFFFFF


def scalar_hash(*places: int) -> int:
    """Return Jenkins' hash of two to four integers, in Python's own integers."""
    start = (0xDEADBEEF + 4 * len(places) + 13) & MASK
    a, b, c = ((start + each) & MASK for each in (*places, 0)[:3])

    def turned(value: int, bits: int) -> int:
        return (value << bits | value >> (32 - bits)) & MASK

    if len(places) == 4:
        for first, second, third in ((4, 6, 8), (16, 19, 4)):
            a = ((a - c) & MASK) ^ turned(c, first)
            c = (c + b) & MASK
            b = ((b - a) & MASK) ^ turned(a, second)
            a = (a + c) & MASK
            c = ((c - b) & MASK) ^ turned(b, third)
            b = (b + a) & MASK
        a = (a + places[3]) & MASK
    c = ((c ^ b) - turned(b, 14)) & MASK
    a = ((a ^ c) - turned(c, 11)) & MASK
    b = ((b ^ a) - turned(a, 25)) & MASK
    c = ((c ^ b) - turned(b, 16)) & MASK
    a = ((a ^ c) - turned(c, 4)) & MASK
    b = ((b ^ a) - turned(a, 14)) & MASK
    return ((c ^ b) - turned(b, 24)) & MASK


def scalar_noise(x: float, y: float) -> float:
    """Return gradient noise of one channel."""
    i, j = math.floor(x), math.floor(y)
    fx, fy = x - i, y - j

    def corner(dx: int, dy: int) -> float:
        h = scalar_hash(i + dx, j + dy) & 7
        ox, oy = fx - dx, fy - dy
        u, v = (ox, 2.0 * oy) if h < 4 else (oy, 2.0 * ox)
        return (-u if h & 1 else u) + (-v if h & 2 else v)

    def fade(t: float) -> float:
        return t * t * t * (t * (t * 6.0 - 15.0) + 10.0)

    low = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * fade(fx)
    high = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * fade(fx)
    return 0.6616 * (low + (high - low) * fade(fy))


def scalar_noise_of_three(x: float, y: float, z: float) -> float:
    """Return gradient noise of three dimensions, of one channel: a sum over corners of products of weights."""
    cell = [math.floor(each) for each in (x, y, z)]
    total = 0.0
    for corner in range(8):
        step = [corner >> k & 1 for k in range(3)]
        h = scalar_hash(*(i + s for i, s in zip(cell, step, strict=True))) & 15
        ox, oy, oz = (each - i - s for each, i, s in zip((x, y, z), cell, step, strict=True))
        u = ox if h < 8 else oy
        v = oy if h < 4 else ox if h in (12, 14) else oz
        weight = 1.0
        for each, i, s in zip((x, y, z), cell, step, strict=True):
            t = each - i
            fade = t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
            weight *= fade if s else 1.0 - fade
        total += weight * ((-u if h & 1 else u) + (-v if h & 2 else v))
    return 0.9820 * total


def scalar_worley(at: tuple[float, ...]) -> list[float]:
    """Return the distances to the points of the cells around a place of two or three dimensions, ascending."""
    found = []
    for index in range(3 ** len(at)):
        cell = [math.floor(each) + index // 3**k % 3 - 1 for k, each in enumerate(at)]
        hashes = [scalar_hash(*cell, k) for k in range(len(at))]
        found.append(math.dist(at, [i + h / MASK for i, h in zip(cell, hashes, strict=True)]))
    return sorted(found)


def test_noises_of_three_dimensions_match_scalar_versions() -> None:
    at = np.random.default_rng(5).uniform(-5.0, 5.0, (40, 3))
    expected = [scalar_noise_of_three(*each) for each in at]
    np.testing.assert_allclose(evaluate_noise("noise3d", at, 1, ())[:, 0], expected, atol=1e-9)
    octaves = [scalar_noise_of_three(*each) + 0.25 * scalar_noise_of_three(*(3 * each)) for each in at]
    np.testing.assert_allclose(evaluate_noise("fractal3d", at, 1, (2, 3.0, 0.25))[:, 0], octaves, atol=1e-9)
    cells = [scalar_hash(*(math.floor(each) for each in place)) / MASK for place in at]
    np.testing.assert_allclose(evaluate_noise("cellnoise3d", at, 1, ())[:, 0], cells)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_worley_noise_matches_scalar_version(dimensions) -> None:
    """The solid style has one value for all places that are nearest to the same point."""
    at = np.random.default_rng(6).uniform(-5.0, 5.0, (40, dimensions))
    expected = [scalar_worley(tuple(each))[:3] for each in at]
    np.testing.assert_allclose(evaluate_noise(f"worleynoise{dimensions}d", at, 3, (1.0, 0.0)), expected, atol=1e-9)
    middles = np.floor(at) + 0.5
    solid = evaluate_noise(f"worleynoise{dimensions}d", at, 1, (0.0, 1.0))
    np.testing.assert_array_equal(solid, evaluate_noise(f"cellnoise{dimensions}d", middles, 1, ()))


POINT = """<texcoord name="st" type="vector2"/>
  <convert name="wide" type="vector3"><input name="in" type="vector2" nodename="st"/></convert>
  <multiply name="eight" type="vector3"><input name="in1" type="vector3" nodename="wide"/>
    <input name="in2" type="vector3" value="8, 8, 8"/></multiply>
  <add name="at" type="vector3"><input name="in1" type="vector3" nodename="eight"/>
    <input name="in2" type="vector3" value="0, 0.5, 0.3"/></add>"""
PLACE = '<input name="position" type="vector3" nodename="at"/>'


@pytest.mark.parametrize(
    ("category", "more", "function"),
    [
        ("noise3d", given("amplitude", "0.25") + given("pivot", "0.5"),
         lambda p: 0.5 + 0.25 * scalar_noise_of_three(*p)),
        ("worleynoise3d", "", lambda p: scalar_worley(p)[0]),
        ("unifiednoise3d", "", lambda p: 0.5 + 0.5 * scalar_noise_of_three(*p)),
        ("unifiednoise3d", given("type", "2", "integer") + given("outmin", "0.5"),
         lambda p: 0.5 + 0.5 * scalar_worley(p)[0]),
    ],
)  # fmt: skip
def test_noise_of_three_dimensions_of_texture_coordinates_is_computed(tmp_path, category, more, function):
    """At (8 u, 8 v + 0.5, 0.3)."""
    _, pixels = color_from(tmp_path, POINT + node(category, "float", more, PLACE), "float")
    for row, column in ((3, 5), (200, 100), (511, 300)):
        u, v = (column + 0.5) / 512, 1.0 - (row + 0.5) / 512
        assert pixels[row, column, 0] == pytest.approx(function((8 * u, 8 * v + 0.5, 0.3)), abs=5e-3)


@pytest.mark.parametrize("nodes", ["", '<position name="at" type="vector3"/>'])
def test_noise_of_the_place_in_space_is_its_mean(tmp_path, nodes):
    place = PLACE if nodes else ""
    text = nodes + node("fractal3d", "float", place)
    text = document(linked("metalness", "N", "float"), nodes=text)
    material = warned_material(tmp_path, text, "'fractal3d' is not computed; its mean is used")
    assert material.metallic == 0.0


def test_jitter_turns_unified_noise(tmp_path):
    """By 90000 degrees for each unit: of 0.999, -90 degrees, clockwise. (u, v) turns to (-v, u)."""
    jittered = given("jitter", "0.999") + given("freq", "8, 8", "vector2")
    _, pixels = color_from(tmp_path, node("unifiednoise2d", "float", jittered), "float")
    for row, column in ((3, 5), (200, 100)):
        u, v = 8.0 * (column + 0.5) / 512, 8.0 * (1.0 - (row + 0.5) / 512)
        assert pixels[row, column, 0] == pytest.approx(0.5 + 0.5 * scalar_noise(-v, u), abs=5e-3)


def test_hash_matches_scalar_version() -> None:
    places = np.array([[0, 0], [1, 2], [-3, 7], [1000, -1000]])
    found = lattice_hash(places[:, 0], places[:, 1])
    assert found.tolist() == [scalar_hash(x, y) for x, y in places.tolist()]


def test_noises_match_scalar_version() -> None:
    at = np.random.default_rng(1).uniform(-5.0, 5.0, (40, 2))
    expected = [scalar_noise(x, y) for x, y in at]
    np.testing.assert_allclose(evaluate_noise("noise2d", at, 1, ())[:, 0], expected, atol=1e-9)
    octaves = [scalar_noise(x, y) + 0.25 * scalar_noise(3 * x, 3 * y) for x, y in at]
    np.testing.assert_allclose(evaluate_noise("fractal2d", at, 1, (2, 3.0, 0.25))[:, 0], octaves, atol=1e-9)
    cells = [scalar_hash(math.floor(x), math.floor(y)) / MASK for x, y in at]
    np.testing.assert_allclose(evaluate_noise("cellnoise2d", at, 1, ())[:, 0], cells)


def test_channels_of_colors_differ_and_first_is_that_of_one_channel() -> None:
    at = np.random.default_rng(2).uniform(0.0, 9.0, (40, 2))
    color = evaluate_noise("noise2d", at, 3, ())
    np.testing.assert_array_equal(color[:, :1], evaluate_noise("noise2d", at, 1, ()))
    assert np.abs(color[:, 1] - color[:, 0]).max() > 0.1


@pytest.mark.parametrize(("category", "octaves", "pivot"), [("noise2d", 1, 0.5), ("fractal2d", 3, 0.0)])
def test_noise_of_a_network_is_computed_per_texel(tmp_path, category, octaves, pivot):
    """Coordinates are multiplied by 8; row 0 of the picture is at v = 1. fractal2d has no pivot."""
    inputs = '<input name="in1" type="vector2" nodename="st"/>', given("in2", "8, 8", "vector2")
    scaled = '<texcoord name="st" type="vector2"/>' + node("multiply", "vector2", *inputs, name="eight")
    place = '<input name="texcoord" type="vector2" nodename="eight"/>'
    text = scaled + node(category, "float", given("amplitude", "0.25"), given("pivot", "0.5"), place)
    _, pixels = color_from(tmp_path, text, "float")
    size = pixels.shape[0]
    for row, column in ((3, 5), (200, 100), (511, 300)):
        u, v = 8.0 * (column + 0.5) / size, 8.0 * (1.0 - (row + 0.5) / size)
        noise = sum(0.5**k * scalar_noise(u * 2**k, v * 2**k) for k in range(octaves))
        assert pixels[row, column, 0] == pytest.approx(0.25 * noise + pivot, abs=5e-3)


@pytest.mark.parametrize(
    ("nodes", "function"),
    [
        (node("checkerboard", "color3", given("uvtiling", "2, 3", "vector2"), given("color1", "1, 0, 0", "color3"),
              given("color2", "0, 1, 0", "color3")),
         lambda u, v: np.where((np.floor(2 * u) + np.floor(3 * v)) % 2 == 1, [1, 0, 0], [0, 1, 0])),
        (node("ramp4", "color3", given("valuetl", "1, 0, 0", "color3"), given("valuetr", "0, 1, 0", "color3"),
              given("valuebr", "0, 0, 1", "color3")),
         lambda u, v: np.concatenate([(1 - u) * v, u * v, u * (1 - v)], axis=-1)),
        (node("circle", "float", given("center", "0.5, 0.25", "vector2"), given("radius", "0.2")),
         lambda u, v: np.repeat((u - 0.5) ** 2 + (v - 0.25) ** 2 <= 0.04, 3, axis=-1)),
    ],
)  # fmt: skip
def test_patterns_follow_the_graphs_of_the_library(tmp_path, nodes, function):
    """Cell (0, 0) of a checkerboard has color2."""
    _, pixels = color_from(tmp_path, nodes)
    at = (np.arange(512) + 0.5) / 512
    u, v = np.meshgrid(at, at[::-1])
    np.testing.assert_allclose(pixels, function(u[..., None], v[..., None]), atol=0.005)


COLOR = given("in", "0.5, 0.25, 0.1, 0.4", "color4")


@pytest.mark.parametrize(
    ("nodes", "expected"),
    [
        (node("hsvadjust", "color4", COLOR, given("amount", "0, 1, 0.5", "vector3")), (0.25, 0.125, 0.05, 0.4)),
        (node("saturate", "color4", COLOR, given("amount", "0"), given("lumacoeffs", "0, 1, 0", "color3")),
         (0.25, 0.25, 0.25, 0.4)),
        (node("over", "color4", given("fg", "0.5, 0, 0, 0.5", "color4"), given("bg", "0, 0.8, 0, 0.6", "color4")),
         (0.5, 0.4, 0.0, 0.8)),
        (node("matte", "color4", given("fg", "0.5, 0, 0, 0.5", "color4"), given("bg", "0, 0.8, 0, 0.6", "color4")),
         (0.25, 0.4, 0.0, 0.8)),
        (node("mask", "color4", given("fg", "0.5, 0, 0, 0.5", "color4"), given("bg", "0, 0.8, 0, 0.6", "color4")),
         (0.0, 0.4, 0.0, 0.3)),
    ],
)  # fmt: skip
def test_operations_on_colors_with_alpha(tmp_path, nodes, expected):
    """hsvadjust of such a color lost its material."""
    nodes += node("extract", "float", linked("in", "N", "color4"), given("index", "3", "integer"), name="alpha")
    surface = linked("base_color", "N", "color4") + given("base", "1") + linked("metalness", "alpha", "float")
    material = material_of(tmp_path, document(surface, nodes=nodes))
    np.testing.assert_allclose((*material.diffuse_color, material.metallic), expected, atol=1e-6)


@pytest.mark.parametrize(("definition", "expected"), [("and", 0.0), ("or", 1.0), ("xor", 1.0)])
def test_logic_is_found_by_the_names_of_its_definitions(tmp_path, definition, expected):
    nodes = node("test", "boolean", given("in1", "true", "boolean"), given("in2", "false", "boolean"))
    nodes = nodes.replace("<test", f'<test nodedef="ND_logical_{definition}"')
    assert material_of(tmp_path, document(linked("metalness", "N", "boolean"), nodes=nodes)).metallic == expected


@pytest.mark.parametrize(("category", "shift"), [
    ("noise2d", (19, 73)), ("noise3d", (19, 73, 29)), ("fractal2d", (19, 193)), ("fractal3d", (19, 193, 17)),
])  # fmt: skip
def test_second_of_two_and_last_of_four_components_are_noises_elsewhere(category, shift):
    """As in the reference shaders; the second of gradient noise is that of three."""
    at, octaves = np.random.default_rng(5).uniform(-3.0, 3.0, (20, len(shift))), (2.0, 2.0, 0.5)
    one, two, three, four = (evaluate_noise(category, at, channels, octaves) for channels in (1, 2, 3, 4))
    moved = evaluate_noise(category, at + np.array(shift), 1, octaves)
    second = three[:, 1:2] if category.startswith("noise") else moved
    np.testing.assert_array_equal(two, np.concatenate([one, second], axis=1))
    np.testing.assert_array_equal(four, np.concatenate([three, moved], axis=1))


@pytest.mark.parametrize(("kind", "components"), [("vector2", "xy"), ("color4", "ra")])
def test_noise_of_two_or_four_components_is_computed_in_a_network(tmp_path, kind, components):
    """It counted as its mean."""
    parts = node(f"separate{kind[-1]}", "multioutput", linked("in", "noise", kind), name="parts")
    links = (linked(f"in{row + 1}", "parts", "float", f'output="out{each}"') for row, each in enumerate(components))
    nodes = node("noise2d", kind, given("pivot", "0.5"), name="noise") + parts + node("combine3", "color3", *links)
    _, pixels = color_from(tmp_path, nodes)
    assert pixels[..., :2].std(axis=(0, 1)).min() > 0.05
