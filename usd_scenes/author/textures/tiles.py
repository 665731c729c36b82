# SPDX-License-Identifier: Apache-2.0
"""Glazed tiles, terrazzo, marble, cement, frosted glass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usd_scenes.author.textures.noise import mix, normals_from_height, smoothstep, spectral
from usd_scenes.author.textures.wood import SurfaceTextures

Array = NDArray[np.float64]


def glaze(size: int, seed: int, tile: float, light: object, dark: object) -> SurfaceTextures:
    """Generate hand-poured glaze with clouds of color, pinholes and a wavy face, to cut tiles from."""
    shape = (size, size)
    pools = spectral(shape, seed, 0.09, slope=1.8)
    drift = spectral(shape, seed + 1, 0.5, slope=2.0)
    pits = smoothstep(2.6, 3.4, spectral(shape, seed + 2, 0.004, slope=1.4))
    tone = np.clip(0.5 + 0.20 * pools + 0.24 * drift, 0.0, 1.0)
    color = mix(light, dark, tone) * (1.0 - 0.5 * pits)[..., None]
    height = 1.4e-4 * spectral(shape, seed + 3, 0.035, slope=2.4) - 1.0e-4 * pits
    return SurfaceTextures(color, 0.10 + 0.03 * np.abs(pools) + 0.3 * pits, normals_from_height(height, size / tile))


def terrazzo(size: int, seed: int) -> Array:
    """Generate chips of marble in pale cement: the cells of scattered points, kept apart."""
    rng = np.random.default_rng(seed)
    picture = np.broadcast_to((0.56, 0.54, 0.50), (size, size, 3)) * 1.0
    colors = np.array(
        [(0.30, 0.28, 0.26), (0.44, 0.33, 0.25), (0.66, 0.63, 0.58), (0.22, 0.24, 0.25), (0.50, 0.42, 0.33)]
    )
    y, x = np.mgrid[0:size, 0:size] / size
    ragged = 0.0032 * spectral((size, size), seed, 0.010, slope=1.2)
    for _ in range(620):
        cx, cy = rng.random(2)
        radius = 0.0045 + 0.012 * rng.random() ** 2.2
        turn, squash = rng.uniform(0.0, np.pi), rng.uniform(0.55, 1.0)
        dx, dy = (x - cx + 0.5) % 1.0 - 0.5, (y - cy + 0.5) % 1.0 - 0.5
        u = np.abs(np.cos(turn) * dx + np.sin(turn) * dy)
        v = np.abs(-np.sin(turn) * dx + np.cos(turn) * dy) / squash
        inside = smoothstep(0.0008, -0.0008, np.maximum(np.maximum(u, v), 0.72 * (u + v)) + ragged - radius)
        picture = mix(picture, colors[rng.integers(len(colors))] * rng.uniform(0.8, 1.15), inside)
    return np.asarray(picture * np.exp(0.025 * spectral((size, size), seed + 1, 0.004, slope=0.8))[..., None])


def marble(size: int, seed: int) -> Array:
    """Generate white marble: clouds, and gray veins where warped noise crosses zero."""
    shape = (size, size)
    cloud = spectral(shape, seed, 0.30, slope=1.8)
    warp = 0.55 * spectral(shape, seed + 1, 0.45, slope=2.2) + 0.28 * spectral(shape, seed + 2, 0.16, slope=2.0)
    fine = warp + 0.35 * spectral(shape, seed + 3, 0.10, slope=1.9)
    strength = smoothstep(-0.6, 1.6, spectral(shape, seed + 4, 0.28, slope=2.0))
    vein = np.exp(-((warp / 0.045) ** 2)) * strength + 0.45 * np.exp(-((fine / 0.030) ** 2)) * (1.0 - 0.6 * strength)
    base = mix(
        np.broadcast_to((0.70, 0.69, 0.67), (*shape, 3)), (0.58, 0.575, 0.57), np.clip(0.35 + 0.28 * cloud, 0.0, 1.0)
    )
    return mix(base, (0.27, 0.265, 0.26), np.clip(0.80 * vein, 0.0, 1.0))


def cement(size: int, seed: int) -> Array:
    """Generate pale pigmented cement with clouds and fine grains."""
    shape = (size, size)
    cloud = 0.05 * spectral(shape, seed, 0.18, slope=1.7) + 0.025 * spectral(shape, seed + 1, 0.008, slope=0.9)
    return np.asarray(np.array((0.54, 0.515, 0.465)) * np.exp(cloud)[..., None])


def frosted(width: int, height: int, seed: int) -> Array:
    """Generate a garden seen through reeded glass: smeared foliage and sky in vertical flutes, 0..1."""
    v = 1.0 - (np.arange(height)[:, None] + 0.5) / height
    u = (np.arange(width)[None, :] + 0.5) / width
    blur = spectral((height, width), seed, (0.12, 0.30), slope=2.2)
    level = smoothstep(0.30, 0.85, v + 0.16 * blur)
    color = mix(np.broadcast_to((0.10, 0.15, 0.065), (height, width, 3)), (0.40, 0.46, 0.53), level)
    flutes = np.sin(2.0 * np.pi * 22.0 * u)
    return np.asarray(color * np.exp(0.16 * flutes + 0.05 * blur)[..., None]).clip(0.0, 1.0)
