"""The view out of the window: a hazy afternoon sky with thin clouds over trees and a lawn, as a latlong picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usd_scenes.author.textures.noise import mix, smoothstep, spectral

Array = NDArray[np.float64]


def directions(width: int, height: int) -> Array:
    """Unit directions [h, w, 3] of a latlong picture in OpenUSD's convention (+z in the centre, +x left of it)."""
    v = (np.arange(height) + 0.5) / height
    u = (np.arange(width) + 0.5) / width
    theta, phi = np.pi * v[:, None], 2.0 * np.pi * u[None, :] - np.pi / 2.0
    return np.stack(
        np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)), axis=-1
    )


def afternoon(width: int, height: int, seed: int, sun: Array) -> Array:
    """Radiance [h, w, 3] without the sun's disc, mean of the sky about 1. sun: unit vector towards it."""
    d = directions(width, height)
    elevation = np.arcsin(d[..., 1])
    toward = np.clip(d @ sun, -1.0, 1.0)
    up = np.clip(d[..., 1], 0.0, 1.0)
    sky = mix(np.broadcast_to((1.12, 1.15, 1.18), d.shape), (0.30, 0.52, 0.95), up**0.55)
    glow = 0.9 * np.exp((toward - 1.0) / 0.10) + 0.45 * np.exp((toward - 1.0) / 0.5)
    sky = sky + glow[..., None] * (1.0, 0.90, 0.74)
    clouds = spectral((height, width), seed, (0.05, 0.07), slope=1.5)
    veil = smoothstep(0.1, 1.7, clouds) * smoothstep(0.03, 0.35, up)
    sky = mix(sky, sky * 0.45 + np.array((1.25, 1.22, 1.18)) * (0.75 + 0.5 * glow[..., None]), 0.7 * veil)
    lawn = mix(np.broadcast_to((0.16, 0.20, 0.085), d.shape), (0.24, 0.25, 0.15), smoothstep(-0.5, -0.02, elevation))
    lawn = lawn * np.exp(0.12 * spectral((height, width), seed + 1, (0.02, 0.05), slope=1.0))[..., None]
    ground = np.where((elevation < 0.0)[..., None], lawn, sky)
    outline = 0.085 + 0.035 * spectral((1, width), seed + 2, (1.0, 0.05), slope=1.2)
    outline = outline + 0.010 * spectral((height, width), seed + 3, (0.012, 0.008), slope=1.0)
    leaves = spectral((height, width), seed + 4, (0.016, 0.009), slope=1.0)
    trees = np.array((0.085, 0.115, 0.05)) * np.exp(0.35 * leaves + 4.0 * (elevation - 0.03))[..., None]
    trees = mix(trees, (0.5, 0.56, 0.60), np.full((height, width), 0.12))
    inside = smoothstep(0.010, -0.010, elevation - outline) * smoothstep(-0.030, -0.018, elevation)
    return np.asarray(mix(ground, trees, inside))
