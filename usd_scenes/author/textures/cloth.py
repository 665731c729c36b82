# SPDX-License-Identifier: Apache-2.0
"""Woven and knotted cloth, leather, and the rug."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usd_scenes.author.textures.noise import mix, normals_from_height, smoothstep, spectral
from usd_scenes.author.textures.wood import SurfaceTextures

Array = NDArray[np.float64]


def weave(size: int, seed: int, tile: float, threads: int, color: object, contrast: float = 0.2) -> SurfaceTextures:
    """Generate plain weave with slubs: `threads` each way over a tile of `tile` m; threads must be even."""
    shape = (size, size)
    at = (np.arange(size) + 0.5) / size * threads
    warp_wobble = 0.16 * spectral(shape, seed, (0.4, 0.04), slope=1.5)
    weft_wobble = 0.16 * spectral(shape, seed + 1, (0.04, 0.4), slope=1.5)
    x, y = at[None, :] + warp_wobble, at[:, None] + weft_wobble
    over = np.sin(np.pi * x) * np.sin(np.pi * y) * np.cos(np.pi * (np.floor(x) + np.floor(y)))
    warp = np.abs(np.sin(np.pi * x)) * (1.0 + 0.5 * over)
    weft = np.abs(np.sin(np.pi * y)) * (1.0 - 0.5 * over)
    height = np.maximum(warp, weft)
    thread_warp = np.random.default_rng(seed + 2).normal(0.0, 1.0, threads)[np.floor(x).astype(int) % threads]
    thread_weft = np.random.default_rng(seed + 3).normal(0.0, 1.0, threads)[np.floor(y).astype(int) % threads]
    tone = np.where(warp > weft, thread_warp, thread_weft)
    fuzz = spectral(shape, seed + 4, 0.01, slope=0.8)
    gain = (1.0 - contrast * (1.3 - height).clip(0.0)) * np.exp(0.05 * tone + 0.04 * fuzz)
    relief = 0.2 * tile / threads * height
    return SurfaceTextures(
        np.asarray(color, dtype=np.float64) * gain[..., None],
        np.full(shape, 0.9),
        normals_from_height(relief, size / tile),
    )


def ticking(size: int, ground: object, stripe: object) -> Array:
    """Generate colors [1, size, 3] of warp threads for `weave`: pairs of fine stripes, two to a tile."""
    at = (np.arange(size) + 0.5) / size * 2.0 % 1.0
    lines = np.maximum(np.abs(at - 0.46) < 0.011, np.abs(at - 0.54) < 0.011)
    return mix(np.broadcast_to(np.asarray(ground), (1, size, 3)), stripe, lines[None] * 0.85)


def berber(width: int, height: int, seed: int) -> SurfaceTextures:
    """Generate a shaggy wool rug, 2.3 x 1.6 m, whole: a hand-drawn lattice of dark lines on undyed wool."""
    shape = (height, width)
    y, x = np.mgrid[0:height, 0:width]
    wobble = 0.012 * spectral(shape, seed, 0.10, slope=1.8) + 0.004 * spectral(shape, seed + 1, 0.012, slope=1.0)
    u = (x + 0.5) / width * 2.3 / 0.46 + wobble / 0.46
    v = (y + 0.5) / height * 1.6 / 0.64 + np.roll(wobble, 31, axis=1) / 0.64
    lines = np.minimum(np.abs((u + v) % 1.0 - 0.5), np.abs((u - v) % 1.0 - 0.5))
    color = mix(
        np.broadcast_to((0.60, 0.555, 0.475), (*shape, 3)), (0.085, 0.075, 0.068), smoothstep(0.034, 0.022, lines)
    )
    tufts = spectral(shape, seed + 2, 0.0055, slope=1.1)
    clouds = spectral(shape, seed + 3, 0.22, slope=1.6)
    color = color * np.exp(0.10 * tufts + 0.05 * clouds)[..., None]
    return SurfaceTextures(color, np.full(shape, 0.95), normals_from_height(1.5e-3 * tufts, width / 2.3))


def leather(size: int, seed: int, tile: float, color: object) -> SurfaceTextures:
    """Generate aniline leather: a net of fine creases, cloudy dye, worn highs."""
    shape = (size, size)
    cells = np.abs(spectral(shape, seed, 0.022, slope=3.0))
    creases = smoothstep(0.35, 0.0, cells)
    fine = spectral(shape, seed + 1, 0.006, slope=1.5)
    clouds = spectral(shape, seed + 2, 0.35, slope=1.6)
    gain = np.exp(0.055 * clouds + 0.02 * fine) * (1.0 - 0.22 * creases)
    height = 1.2e-4 * (-creases) + 8.0e-6 * fine
    return SurfaceTextures(
        np.asarray(color, dtype=np.float64) * gain[..., None],
        0.42 + 0.14 * creases + 0.025 * clouds,
        normals_from_height(height, size / tile),
    )


def rug(width: int, height: int, seed: int) -> SurfaceTextures:
    """Generate a hand-knotted wool rug, whole: a lattice of diamonds on ivory and a border, its dye uneven (abrash)."""
    y, x = np.mgrid[0:height, 0:width]
    wobble = 0.0025 * spectral((height, width), seed, 0.01, slope=1.0)
    meters_x = (x + 0.5) / width * 3.2 + wobble
    meters_y = (y + 0.5) / height * 2.3 + np.roll(wobble, 7, axis=1)
    ivory, slate, rust, ochre = (0.56, 0.50, 0.40), (0.075, 0.105, 0.135), (0.30, 0.085, 0.045), (0.42, 0.25, 0.085)
    edge = np.minimum(np.minimum(meters_x, 3.2 - meters_x), np.minimum(meters_y, 2.3 - meters_y))
    u = (meters_x - 1.6) / 0.40
    v = (meters_y - 1.15) / 0.40
    diamond = np.abs((u + v) % 1.0 - 0.5) * 2.0, np.abs((u - v) % 1.0 - 0.5) * 2.0
    lines = np.maximum(diamond[0], diamond[1])
    core = np.minimum(1.0 - diamond[0], 1.0 - diamond[1])
    color = mix(np.broadcast_to(ivory, (height, width, 3)), slate, smoothstep(0.90, 0.92, lines))
    color = mix(color, rust, smoothstep(0.74, 0.76, core))
    color = mix(color, ochre, smoothstep(0.90, 0.92, core))
    inner = smoothstep(0.262, 0.258, edge)
    band = mix(np.broadcast_to(slate, (height, width, 3)), ivory, _band(edge, 0.225, 0.240))
    along = np.where(np.minimum(meters_x, 3.2 - meters_x) < np.minimum(meters_y, 2.3 - meters_y), meters_y, meters_x)
    teeth = np.abs((along / 0.115) % 1.0 - 0.5) * 2.0
    zigzag = _band(edge - 0.055 * teeth, 0.085, 0.120)
    band = mix(band, rust, zigzag)
    band = mix(band, ochre, _band(edge, 0.040, 0.052))
    color = mix(color, band, inner)
    abrash = spectral((height, width), seed + 1, (0.05, 0.9), slope=1.4)
    pile = spectral((height, width), seed + 2, 0.004, slope=0.7)
    color = color * np.exp(0.07 * abrash + 0.06 * pile)[..., None]
    return SurfaceTextures(color, np.full((height, width), 0.95), normals_from_height(6.0e-4 * pile, width / 3.2))


def _band(x: Array, low: float, high: float) -> Array:
    return smoothstep(low - 0.002, low + 0.002, x) * smoothstep(high + 0.002, high - 0.002, x)
