# SPDX-License-Identifier: Apache-2.0
"""The view out of the window: a hazy afternoon sky with thin clouds over trees and a lawn, as a latlong picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usd_scenes.author.textures.noise import mix, smoothstep, spectral

Array = NDArray[np.float64]


def directions(width: int, height: int) -> Array:
    """Return unit directions [h, w, 3] of a latlong image in OpenUSD's convention (+z in the center, +x left of it)."""
    v = (np.arange(height) + 0.5) / height
    u = (np.arange(width) + 0.5) / width
    theta, phi = np.pi * v[:, None], 2.0 * np.pi * u[None, :] - np.pi / 2.0
    return np.stack(
        np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)), axis=-1
    )


def afternoon(width: int, height: int, seed: int, sun: Array) -> Array:
    """Generate radiance [h, w, 3] without the sun's disc, of mean about 1; `sun` is the unit vector towards it."""
    d = directions(width, height)
    elevation = np.arcsin(d[..., 1])
    toward = np.clip(d @ sun, -1.0, 1.0)
    up = np.clip(d[..., 1], 0.0, 1.0)
    sky = mix(np.broadcast_to((1.12, 1.15, 1.18), d.shape), (0.30, 0.52, 0.95), up**0.55)
    halo = 0.9 * np.exp((toward - 1.0) / 0.10) + 0.45 * np.exp((toward - 1.0) / 0.5)
    sky = sky + halo[..., None] * (1.0, 0.90, 0.74)
    clouds = spectral((height, width), seed, (0.05, 0.07), slope=1.5)
    veil = smoothstep(0.1, 1.7, clouds) * smoothstep(0.03, 0.35, up)
    sky = mix(sky, sky * 0.45 + np.array((1.25, 1.22, 1.18)) * (0.75 + 0.5 * halo[..., None]), 0.7 * veil)
    lawn = mix(np.broadcast_to((0.075, 0.11, 0.032), d.shape), (0.12, 0.14, 0.065), smoothstep(-0.5, -0.02, elevation))
    lawn = lawn * np.exp(0.15 * spectral((height, width), seed + 1, (0.02, 0.05), slope=1.0))[..., None]
    view = np.where((elevation < 0.0)[..., None], lawn, sky)
    view = _trees(view, elevation, seed + 10, 0.235, 0.045, (0.080, 0.105, 0.060), haze=0.20)
    view = _trees(view, elevation, seed + 20, 0.135, 0.055, (0.044, 0.068, 0.021), haze=0.05)
    view = _trees(view, elevation, seed + 30, 0.015, 0.028, (0.032, 0.055, 0.016), haze=0.0)
    return _trees(view, elevation, seed + 40, -0.26, 0.11, (0.036, 0.060, 0.020), haze=0.0, foot=-0.33)


def dusk(width: int, height: int, seed: int, sun: Array) -> Array:
    """Generate radiance [h, w, 3] as the sun sets at `sun`: an orange horizon under blue, with tree silhouettes."""
    d = directions(width, height)
    elevation = np.arcsin(d[..., 1])
    toward = np.clip(d @ sun, -1.0, 1.0)
    up = np.clip(d[..., 1], 0.0, 1.0)
    near = (0.5 + 0.5 * toward)[..., None] ** 2
    horizon = np.array((0.62, 0.50, 0.52)) * (1.0 - near) + np.array((1.75, 0.92, 0.42)) * near
    sky = horizon + (np.array((0.13, 0.21, 0.46)) - horizon) * (1.0 - np.exp(-up / 0.22))[..., None]
    sky = sky + (1.6 * np.exp((toward - 1.0) / 0.03))[..., None] * (1.0, 0.62, 0.28)
    clouds = spectral((height, width), seed, (0.03, 0.09), slope=1.5)
    veil = smoothstep(0.2, 1.8, clouds) * smoothstep(0.02, 0.2, up) * smoothstep(0.8, 0.3, up)
    sky = mix(sky, np.array((0.95, 0.50, 0.36)) * (0.35 + 0.9 * near), 0.6 * veil)
    distance = smoothstep(-0.5, -0.02, elevation)
    lawn = mix(np.broadcast_to((0.010, 0.013, 0.008), d.shape), (0.026, 0.027, 0.024), distance)
    lawn = lawn * np.exp(0.25 * spectral((height, width), seed + 1, (0.02, 0.05), slope=1.0))[..., None]
    view = np.where((elevation < 0.0)[..., None], lawn, sky)
    view = _trees(view, elevation, seed + 10, 0.16, 0.040, (0.055, 0.055, 0.055), haze=0.25)
    view = _trees(view, elevation, seed + 20, 0.085, 0.045, (0.018, 0.022, 0.014), haze=0.0)
    view = _trees(view, elevation, seed + 30, 0.012, 0.020, (0.013, 0.017, 0.010), haze=0.0)
    return _trees(view, elevation, seed + 40, -0.26, 0.11, (0.010, 0.014, 0.008), haze=0.0, foot=-0.33)


def _trees(
    view: Array,
    elevation: Array,
    seed: int,
    top: float,
    relief: float,
    leaf: object,
    haze: float,
    foot: float = -0.042,
) -> Array:
    """Add a hazy row of trees or shrubs in front of `view`, from elevation `foot` to about `top`, rad."""
    height, width = elevation.shape
    crowns = spectral((1, width), seed, (1.0, 0.045), slope=1.3)
    ragged = spectral((height, width), seed + 1, (0.020, 0.011), slope=1.1)
    outline = top + relief * crowns + 0.014 * ragged
    clumps = spectral((height, width), seed + 2, (0.030, 0.016), slope=1.3)
    leaves = spectral((height, width), seed + 3, (0.007, 0.0035), slope=0.9)
    light = np.exp(0.45 * clumps + 0.28 * leaves + 3.0 * (elevation - top))
    color = mix(np.asarray(leaf) * light[..., None], (0.34, 0.38, 0.40), np.full((height, width), haze))
    inside = smoothstep(0.006, -0.006, elevation - outline) * smoothstep(
        -0.013, 0.012, elevation - foot + 0.01 * ragged
    )
    return mix(view, color, inside)
