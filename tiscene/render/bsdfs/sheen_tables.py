# SPDX-License-Identifier: Apache-2.0
"""Albedo table of the sheen lobe, for energy conservation; computed once per process by the midpoint rule."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

# Below, the fit of the masking function in the paper reflects more than all light at grazing angles.
SMALLEST_ROUGHNESS = 0.07
# Layout: [roughness][cosine], roughness uniform from SMALLEST_ROUGHNESS to 1, cosines denser at grazing angles.
SHEEN_ROUGHNESSES, SHEEN_COSINES = 16, 32
SHEEN_SIZE = SHEEN_ROUGHNESSES * SHEEN_COSINES
# Coefficients of the masking function for r = 0 and r = 1 (Estevez and Kulla 2017, table 1).
SOFT = (25.3245, 3.32435, 0.16801, -1.27393, -4.85967)
HARD = (21.5473, 3.82987, 0.19823, -1.97760, -4.32054)

Array = NDArray[np.float64]


@cache
def sheen_table() -> Array:
    """Return the albedo of white sheen for each roughness and outgoing cosine, flat."""
    count = 256
    place = (np.arange(count) + 0.5) / count
    z, turn = np.meshgrid(place, place * np.pi)
    wi = np.stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z], axis=-1)
    cosines = np.maximum(np.linspace(0.0, 1.0, SHEEN_COSINES) ** 2, 1e-4)
    table = np.empty((SHEEN_ROUGHNESSES, SHEEN_COSINES))
    for column, cosine in enumerate(cosines):
        m = wi + np.array([np.sqrt(1.0 - cosine * cosine), 0.0, cosine])
        m /= np.linalg.norm(m, axis=-1, keepdims=True)
        sine = np.sqrt(np.clip(1.0 - m[..., 2] ** 2, 0.0, 1.0))
        for row, r in enumerate(np.linspace(SMALLEST_ROUGHNESS, 1.0, SHEEN_ROUGHNESSES)):
            density = (2.0 + 1.0 / r) * sine ** (1.0 / r) / (2.0 * np.pi)
            visible = 1.0 / (1.0 + _masking(np.asarray(cosine), r) + _masking(z, r))
            table[row, column] = 2.0 * np.pi * (density * visible).mean() / (4.0 * cosine)
    flat = np.minimum(table, 1.0).ravel()
    flat.setflags(write=False)
    return flat


def _masking(cosine: Array, r: float) -> Array:
    """Return Estevez and Kulla's Lambda."""
    weight = (1.0 - r) ** 2
    a, b, c, d, e = (weight * soft + (1.0 - weight) * hard for soft, hard in zip(SOFT, HARD, strict=True))

    def exponent(x: Array) -> Array:
        return np.asarray(a / (1.0 + b * x**c) + d * x + e)

    half = exponent(np.asarray(0.5))
    steep = 2.0 * half - exponent(np.maximum(1.0 - cosine, 0.0))
    return np.exp(np.where(cosine < 0.5, exponent(cosine), steep))
