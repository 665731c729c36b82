# SPDX-License-Identifier: Apache-2.0
"""Tileable noise: white noise filtered in the frequency domain, periodic by construction; blending, normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def spectral(
    shape: tuple[int, int], seed: int, scale: float | tuple[float, float], slope: float = 1.5, floor: float = 0.0
) -> Array:
    """Generate noise of unit variance; `scale` is the size of features as a fraction of the tile, or (rows, columns).

    slope: how fast detail finer than `scale` fades; floor: the least frequency kept, relative to 1 / scale.
    """
    rows, columns = shape
    scale_rows, scale_columns = scale if isinstance(scale, tuple) else (scale, scale)
    fy = np.fft.fftfreq(rows, 1.0 / rows)[:, None] * scale_rows
    fx = np.fft.fftfreq(columns, 1.0 / columns)[None, :] * scale_columns
    frequency = np.hypot(fy, fx)
    gain = (1.0 + frequency**2) ** (-slope)
    gain[frequency < floor] = 0.0
    gain[0, 0] = 0.0
    white = np.random.default_rng(seed).standard_normal(shape)
    noise = np.fft.ifft2(np.fft.fft2(white) * gain).real
    return np.asarray(noise / noise.std())


def smoothstep(low: float, high: float, x: Array) -> Array:
    """Return the cubic Hermite step from 0 at `low` to 1 at `high`."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def mix(a: object, b: object, t: Array) -> Array:
    """Blend colors a and b [3], or fields, by t [h, w]."""
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    weight = t[..., None] if first.shape[-1:] == (3,) or second.shape[-1:] == (3,) else t
    return np.asarray(first + (second - first) * weight)


def normals_from_height(height: Array, pixels_per_meter: float) -> Array:
    """Return tangent-space normals [h, w, 3] of a tileable height field, m: +x along u, +y along v (up the image)."""
    slope_u = (np.roll(height, -1, axis=1) - np.roll(height, 1, axis=1)) * (0.5 * pixels_per_meter)
    slope_v = (np.roll(height, 1, axis=0) - np.roll(height, -1, axis=0)) * (0.5 * pixels_per_meter)
    normals = np.stack([-slope_u, -slope_v, np.ones_like(height)], axis=-1)
    return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))
