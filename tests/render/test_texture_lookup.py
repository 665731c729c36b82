# SPDX-License-Identifier: Apache-2.0
"""Texture lookups: values, wrap modes, encodings, orientation of v; mipmaps, and stochastic lookups."""

import numpy as np
import pytest
import taichi as ti

from tiscene.device.kernel_types import Floats1, Floats2, Ints1, Ints2
from tiscene.render.texture_lookup import Textures, lookup, lookup_stochastic, mip_level
from tiscene.scene.description import Texture
from tiscene.scene.textures.atlas import COARSER, HEIGHT, LEVELS, WIDTH, TextureAtlas, linear_pixels
from tiscene.scene.textures.mipmaps import coarser_copies

WRAPS = ("repeat", "clamp", "mirror", "black")


@ti.kernel
def lookup_all(info: Ints2, words: Ints1, floats: Floats1, row: ti.i32, uv: Floats2, values: Floats2):
    textures = ti.static(Textures(info, words, floats))
    for i in range(uv.shape[0]):
        value = lookup(textures, row, ti.math.vec2(uv[i, 0], uv[i, 1]))
        for c in ti.static(range(4)):
            values[i, c] = value[c]


def values_of(texture: Texture, uv: np.ndarray) -> np.ndarray:
    atlas = TextureAtlas()
    atlas.append([Texture("other", np.zeros((3, 5, 4), texture.pixels.dtype)), texture])
    values = np.empty((len(uv), 4), np.float32)
    lookup_all(*atlas.arrays(), 1, np.ascontiguousarray(uv, np.float32), values)
    return values


def reference(texture: Texture, uv: np.ndarray) -> np.ndarray:
    pixels = linear_pixels(texture).astype(np.float64)
    height, width = pixels.shape[:2]

    def wrapped(index: np.ndarray, size: int, wrap: str) -> np.ndarray:
        if wrap == "repeat":
            return index % size
        if wrap == "mirror":
            return np.minimum(index % (2 * size), 2 * size - 1 - index % (2 * size))
        inside = np.clip(index, 0, size - 1)
        return np.where((wrap == "black") & (index != inside), -1, inside)

    x, y = uv[:, 0] * width - 0.5, (1.0 - uv[:, 1]) * height - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    result = np.zeros((len(uv), 4))
    for dx in (0, 1):
        for dy in (0, 1):
            column, row = wrapped(left + dx, width, texture.wrap_s), wrapped(top + dy, height, texture.wrap_t)
            weight = np.abs(1 - dx - (x - left)) * np.abs(1 - dy - (y - top))
            value = np.where(((column >= 0) & (row >= 0))[:, None], pixels[row, column], 0.0)
            result += weight[:, None] * value
    return result


@pytest.mark.parametrize("wrap_t", WRAPS)
@pytest.mark.parametrize("wrap_s", WRAPS)
@pytest.mark.parametrize("kind", ["srgb", "raw", "float"])
def test_lookups_agree_with_plain_numpy(kind: str, wrap_s: str, wrap_t: str) -> None:
    generator = np.random.default_rng(1)
    pixels = generator.integers(0, 256, (5, 7, 4)).astype(np.uint8)
    if kind == "float":
        texture = Texture("t", pixels.astype(np.float32) * 3.0, encoding="raw", wrap_s=wrap_s, wrap_t=wrap_t)
    else:
        texture = Texture("t", pixels, encoding=kind, wrap_s=wrap_s, wrap_t=wrap_t)
    uv = generator.uniform(-2.9, 3.9, (2000, 2)).astype(np.float32).astype(np.float64)
    scale = 765.0 if kind == "float" else 1.0
    assert values_of(texture, uv) / scale == pytest.approx(reference(texture, uv) / scale, abs=5e-5)


def test_v_1_is_the_top_row() -> None:
    pixels = np.zeros((2, 1, 4), np.float32)
    pixels[0] = 1.0
    texture = Texture("t", pixels, encoding="raw", wrap_t="clamp")
    assert values_of(texture, np.array([[0.5, 0.99], [0.5, 0.01]]))[:, 0].tolist() == [1.0, 0.0]


def test_repeat_is_exact_far_outside() -> None:
    pixels = np.linspace(0, 1, 16, dtype=np.float32).reshape(1, 4, 4)
    texture = Texture("t", pixels, encoding="raw")
    near, far = values_of(texture, np.array([[0.375, 0.5], [10000.375, -4000.5]]))
    assert near == pytest.approx(far, abs=2e-3)


@ti.kernel
def lookup_all_stochastic(
    info: Ints2, words: Ints1, floats: Floats1, row: ti.i32, area: ti.f32, uv: Floats2, u: Floats2, values: Floats2
):
    textures = ti.static(Textures(info, words, floats))
    for i in range(uv.shape[0]):
        numbers = ti.math.vec3(u[i, 0], u[i, 1], u[i, 2])
        value = lookup_stochastic(textures, row, ti.math.vec2(uv[i, 0], uv[i, 1]), area, numbers)
        for c in ti.static(range(4)):
            values[i, c] = value[c]


def stochastic_values(atlas: TextureAtlas, row: int, uv: np.ndarray, area: float, seed: int = 1) -> np.ndarray:
    values = np.empty((len(uv), 4), np.float32)
    u = np.random.default_rng(seed).random((len(uv), 3), np.float32)
    lookup_all_stochastic(*atlas.arrays(), row, area, np.ascontiguousarray(uv, np.float32), u, values)
    return values


@pytest.mark.parametrize("kind", ["srgb", "raw", "float"])
def test_mean_of_stochastic_lookups_is_the_interpolated_value(kind: str) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (5, 7, 4)).astype(np.uint8)
    values = pixels.astype(np.float32) / 255.0 if kind == "float" else pixels
    texture = Texture("t", values, encoding="raw" if kind == "float" else kind, wrap_s="mirror")
    atlas = TextureAtlas()
    atlas.append([texture])
    for place in ((0.31, 0.62), (0.02, 0.99), (-1.3, 2.2)):
        uv = np.tile([place], (40_000, 1))
        mean = stochastic_values(atlas, 0, uv, 0.0).mean(axis=0)
        assert mean == pytest.approx(reference(texture, uv[:1])[0], abs=0.01)


def painted(size: tuple[int, int], encoding: str) -> Texture:
    """Return a texture of a gradient and noise."""
    height, width = size
    smooth = np.linspace(0, 200, height)[:, None, None] + np.linspace(0, 50, width)[None, :, None]
    noise = np.random.default_rng(5).integers(-5, 5, (height, width, 4))
    return Texture("t", np.clip(smooth + noise, 0, 255).astype(np.uint8), encoding=encoding)


@pytest.mark.parametrize("encoding", ["srgb", "raw"])
@pytest.mark.parametrize("size", [(256, 128), (200, 90), (3, 5)])
def test_large_footprints_read_coarse_mipmaps(size: tuple[int, int], encoding: str) -> None:
    texture = painted(size, encoding)
    atlas = TextureAtlas()
    atlas.append([texture, Texture("other", np.zeros((70, 5, 4), np.uint8))])
    u, v = np.meshgrid((np.arange(320) + 0.5) / 320, (np.arange(320) + 0.5) / 320)
    uv = np.stack([u.ravel() + 3.0, v.ravel()], axis=-1)
    exact = linear_pixels(texture)[((1.0 - v) * size[0]).astype(int).ravel(), (u * size[1]).astype(int).ravel()]
    for area in (0.0, 3.0, 40.0, 1e9):
        values = stochastic_values(atlas, 0, uv, area)
        assert values.mean(axis=0) == pytest.approx(linear_pixels(texture).mean(axis=(0, 1)), rel=8e-3)
        inside = (np.abs(v - 0.5) < 0.45).ravel() & (np.abs(u - 0.5) < 0.45).ravel()
        if min(size) > 5:
            assert np.abs(values - exact)[inside].max() < 0.1  # neighbors differ by the noise and a pixel's step


def test_mipmap_sizes_halve_and_small_images_have_none() -> None:
    large = Texture("large", np.full((1024, 66, 4), (10, 200, 90, 255), np.uint8))
    copies = coarser_copies(large)
    assert [copy.pixels.shape[:2] for copy in copies] == [(512, 33), (256, 17), (128, 9), (64, 5)]
    assert all((copy.pixels == (10, 200, 90, 255)).all() for copy in copies)
    floats = Texture("floats", np.zeros((100, 100, 4), np.float32))
    assert coarser_copies(copies[-1]) == coarser_copies(floats) == ()
    atlas = TextureAtlas()
    atlas.append([floats, large, copies[-2]])
    info = atlas.arrays().info.to_numpy()
    assert info[:3, LEVELS].tolist() == [0, 4, 1]
    assert info[1:3, COARSER].tolist() == [3, 7]
    assert info[3:, [WIDTH, HEIGHT]].tolist() == [[33, 512], [17, 256], [9, 128], [5, 64], [5, 64]]


@ti.kernel
def levels_of(areas: Floats1, levels: Floats1):
    for i in range(areas.shape[0]):
        levels[i] = mip_level(areas[i])


def test_mip_level_is_half_the_binary_logarithm_of_area() -> None:
    areas = np.geomspace(0.01, 1e6, 500).astype(np.float32)
    levels = np.empty_like(areas)
    levels_of(areas, levels)
    assert levels == pytest.approx(0.5 * np.log2(areas), abs=0.05)
