# SPDX-License-Identifier: Apache-2.0
"""Wood: growth rings cut lengthwise, pores, and strips of differing boards for a floor. Grain runs along u."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usd_scenes.author.textures.noise import mix, normals_from_height, smoothstep, spectral

Array = NDArray[np.float64]
STRIPS = 12


@dataclass(frozen=True)
class SurfaceTextures:
    """Textures of a surface.

    Attributes:
        color: [h, w, 3], linear.
        roughness: [h, w].
        normal: [h, w, 3], unit length.
    """

    color: Array
    roughness: Array
    normal: Array


def board(rows: int, columns: int, seed: int, length: float, light: object, dark: object) -> SurfaceTextures:
    """Generate a board, `length` m along the grain and in proportion across it, between two albedos."""
    shape = (rows, columns)
    width = length * rows / columns
    drift = spectral(shape, seed, (0.06 / width, 1.1 / length), slope=2.5)
    wander = spectral(shape, seed + 1, (0.02 / width, 0.5 / length), slope=2.0)
    across = np.linspace(0.0, 1.0, rows, endpoint=False)[:, None] * round(width / 0.012)
    rings = (across + 1.3 * drift + 0.18 * wander) % 1.0
    late_wood = smoothstep(0.15, 0.85, rings) * smoothstep(1.0, 0.93, rings)
    streaks = spectral(shape, seed + 2, (0.0015 / width, 0.16 / length), slope=1.2)
    pores = smoothstep(1.5, 2.3, spectral(shape, seed + 3, (0.0008 / width, 0.018 / length), slope=1.6))
    tone = np.clip(0.42 * late_wood + 0.16 + 0.09 * streaks + 0.07 * drift, 0.0, 1.0)
    color = mix(light, dark, tone) * (1.0 - 0.35 * pores * (0.3 + 0.7 * late_wood))[..., None]
    height = -3.0e-5 * late_wood - 1.2e-4 * pores + 1.0e-5 * streaks
    roughness = 0.40 + 0.07 * late_wood + 0.22 * pores + 0.02 * streaks
    return SurfaceTextures(color, roughness, normals_from_height(height, columns / length))


def boards(size: int, seed: int, length: float, light: object, dark: object) -> SurfaceTextures:
    """Generate STRIPS different boards one above the other, of differing hue, tone and figure."""
    rng = np.random.default_rng(seed)
    edges = np.round(np.linspace(0, size, STRIPS + 1)).astype(int)
    colors, roughnesses, normals = [], [], []
    for strip in range(STRIPS):
        rows = int(edges[strip + 1] - edges[strip])
        gain = float(np.exp(rng.normal(0.0, 0.17)))
        warmth = np.array([1.0 + rng.normal(0.0, 0.03), 1.0, 1.0 - rng.normal(0.0, 0.05)])
        surface = board(rows, size, seed + 100 * (strip + 1), length, light, dark)
        colors.append(surface.color * gain * warmth)
        roughnesses.append(surface.roughness + rng.normal(0.0, 0.025))
        normals.append(surface.normal)
    return SurfaceTextures(np.concatenate(colors), np.concatenate(roughnesses), np.concatenate(normals))
