# SPDX-License-Identifier: Apache-2.0
"""Textures of single templates: phone screen, plush, cardboard, terry cloth, embossed paper, leaf."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usd_scenes.author.textures.noise import mix, normals_from_height, smoothstep, spectral
from usd_scenes.author.textures.wood import SurfaceTextures

Array = NDArray[np.float64]


def phone_screen(width: int, height: int, seed: int) -> Array:
    """Generate a home screen: soft colors, the time, four columns of icons and a dock."""
    y, x = np.mgrid[0:height, 0:width]
    u, v = (x + 0.5) / width, 1.0 - (y + 0.5) / height
    drift = 0.16 * spectral((height, width), seed, 0.35, slope=3.0)
    picture = mix(
        np.broadcast_to((0.60, 0.16, 0.24), (height, width, 3)), (0.05, 0.10, 0.42), smoothstep(0.1, 0.95, v + drift)
    )
    picture = mix(picture, (0.85, 0.46, 0.16), 0.85 * smoothstep(0.30, 0.0, np.hypot(u - 0.75 + drift, v - 0.25)))
    aspect = height / width
    rng = np.random.default_rng(seed)
    for row, level in enumerate((0.58, 0.46, 0.34, 0.22, 0.08)):
        if row == 4:
            dock = np.maximum(np.abs(u - 0.5) - 0.40, (np.abs(v - 0.08) - 0.035) * aspect)
            picture = mix(picture, (0.75, 0.75, 0.78), 0.35 * smoothstep(0.06, 0.05, dock))
        for column in range(4):
            du, dv = u - (0.17 + 0.22 * column), (v - level) * aspect
            square = (np.abs(du / 0.075) ** 5 + np.abs(dv / 0.075) ** 5) ** 0.2
            hue = rng.uniform(0.0, 1.0)
            tone = 0.5 + 0.45 * np.cos(2.0 * np.pi * (hue + np.array([0.0, 0.33, 0.67])))
            picture = mix(picture, tone**1.5, smoothstep(1.03, 0.97, square))
            mark = np.abs(np.hypot(du, dv) / 0.075 - rng.uniform(0.3, 0.5))
            picture = mix(picture, (0.9, 0.9, 0.9), 0.9 * smoothstep(0.14, 0.10, mark))
    time = np.zeros((height, width), dtype=bool)
    for index, digit in enumerate((1, 0, 0, 9)):
        left = 0.24 + 0.13 * index + (0.03 if index > 1 else 0.0)
        time |= _digit(digit, (u - left) / 0.085, (v - 0.74) * aspect / 0.17)
    for level in (0.772, 0.808):
        time |= np.maximum(np.abs(u - 0.498), np.abs(v - level) * aspect) < 0.011
    return np.asarray(mix(picture, (0.92, 0.92, 0.92), time * 1.0))


SEGMENTS = {
    0: "abcdef",
    1: "bc",
    2: "abged",
    3: "abgcd",
    4: "fgbc",
    5: "afgcd",
    6: "afgedc",
    7: "abc",
    8: "abcdefg",
    9: "abcdfg",
}


def _digit(digit: int, x: Array, y: Array) -> NDArray[np.bool_]:
    """Return where a seven-segment digit is lit, in the unit square."""
    lines = {
        "a": (0.0, 1.0, 1.0, 1.0), "b": (1.0, 0.5, 1.0, 1.0), "c": (1.0, 0.0, 1.0, 0.5), "d": (0.0, 0.0, 1.0, 0.0),
        "e": (0.0, 0.0, 0.0, 0.5), "f": (0.0, 0.5, 0.0, 1.0), "g": (0.0, 0.5, 1.0, 0.5),
    }  # fmt: skip
    found = np.zeros(x.shape, dtype=bool)
    for name in SEGMENTS[digit]:
        x0, y0, x1, y1 = lines[name]
        found |= (x > x0 - 0.08) & (x < x1 + 0.08) & (y > y0 - 0.06) & (y < y1 + 0.06)
    return found


def plush(size: int, seed: int, tile: float, color: object) -> SurfaceTextures:
    """Generate plush of short pile, brushed one way in one place and another in the next."""
    shape = (size, size)
    clumps = spectral(shape, seed, 0.035, slope=1.8)
    hair = spectral(shape, seed + 1, (0.006, 0.016), slope=1.4) + spectral(shape, seed + 2, (0.016, 0.006), slope=1.4)
    gain = np.exp(0.08 * clumps + 0.11 * hair)
    height = 1.6e-4 * clumps + 1.3e-4 * hair
    return SurfaceTextures(
        np.asarray(color, dtype=np.float64) * gain[..., None],
        np.full(shape, 0.95),
        normals_from_height(height, size / tile),
    )


def cardboard(size: int, seed: int) -> Array:
    """Generate kraft paper over flutes that just show, with darker fibres."""
    shape = (size, size)
    fibres = spectral(shape, seed, (0.004, 0.03), slope=1.0)
    clouds = spectral(shape, seed + 1, 0.2, slope=1.6)
    flutes = np.sin(2.0 * np.pi * np.arange(size) / size * 60.0)[None]
    specks = smoothstep(2.2, 3.0, spectral(shape, seed + 2, 0.006, slope=1.2))
    gain = np.exp(0.05 * fibres + 0.03 * clouds + 0.022 * flutes) * (1.0 - 0.35 * specks)
    return np.asarray((0.40, 0.25, 0.125) * gain[..., None])


def terry(size: int, seed: int, tile: float) -> Array:
    """Generate normals of towelling: rows of loops, slightly misaligned."""
    shape = (size, size)
    at = (np.arange(size) + 0.5) / size * 48.0
    x = at[None, :] + 0.22 * spectral(shape, seed, 0.03, slope=1.6)
    y = at[:, None] + 0.22 * spectral(shape, seed + 1, 0.03, slope=1.6)
    loops = np.abs(np.sin(np.pi * x)) * np.abs(np.sin(np.pi * (y + 0.5 * np.floor(x))))
    height = 6.0e-4 * loops + 1.5e-4 * spectral(shape, seed + 2, 0.01, slope=1.2)
    return normals_from_height(height, size / tile)


def quilted(size: int, tile: float) -> Array:
    """Generate normals of embossed tissue: a lattice of dots with a diamond of lines between."""
    at = (np.arange(size) + 0.5) / size * 4.0
    x, y = at[None, :], at[:, None]
    p, q = x + y, x - y
    lines = np.minimum(np.abs(p - np.round(p)), np.abs(q - np.round(q)))
    height = -1.6e-4 * smoothstep(0.10, 0.0, lines)
    return normals_from_height(height, size / tile)


def snake_leaf(width: int, height: int, seed: int) -> Array:
    """Generate a sword of dark green with gray-green bands across and yellow edges; u across it, v along."""
    y, x = np.mgrid[0:height, 0:width]
    u, v = (x + 0.5) / width * 2.0 - 1.0, 1.0 - (y + 0.5) / height
    wobble = spectral((height, width), seed, (0.01, 0.25), slope=1.6)
    bands = np.sin(2.0 * np.pi * 11.0 * v + 1.1 * wobble + 0.8 * np.cos(3.0 * u))
    picture = mix(
        np.broadcast_to((0.030, 0.085, 0.030), (height, width, 3)), (0.13, 0.21, 0.10), smoothstep(-0.2, 0.9, bands)
    )
    edge = np.abs(u) + 0.025 * spectral((height, width), seed + 1, (0.05, 0.4), slope=1.6)
    return np.asarray(mix(picture, (0.46, 0.44, 0.10), smoothstep(0.72, 0.78, edge)))


def crust(size: int, seed: int) -> Array:
    """Generate the crust of a loaf: toasted brown, paler where it burst, dusted with flour."""
    shape = (size, size)
    bake = smoothstep(-1.6, 1.6, spectral(shape, seed, 0.16, slope=1.9))
    flour = smoothstep(
        0.7, 2.2, spectral(shape, seed + 1, 0.05, slope=1.2) + 0.5 * spectral(shape, seed + 2, 0.012, slope=0.8)
    )
    color = mix(np.broadcast_to((0.48, 0.26, 0.095), (*shape, 3)), (0.24, 0.092, 0.028), bake)
    return mix(
        color * np.exp(0.10 * spectral(shape, seed + 3, 0.012, slope=0.9))[..., None], (0.70, 0.63, 0.52), 0.45 * flour
    )
