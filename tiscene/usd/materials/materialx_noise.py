# SPDX-License-Identifier: Apache-2.0
"""MaterialX's two-dimensional noises as functions of texture coordinates.

The definitions are those of MaterialX's reference shaders: gradient noise (Perlin 2002) and cell noise on a lattice,
hashed by Jenkins' `final` of lookup3, and sums of octaves. Noises of three dimensions depend on the place in space, so
that no texture holds them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
NOISES_2D = ("noise2d", "fractal2d", "cellnoise2d")
_PERLIN_SCALE = 0.6616  # brings gradient noise of two dimensions to about -1..1


def lattice_hash(x: Array, y: Array) -> Array:
    """Return the hash, uint32, of lattice points with integer coordinates."""
    start = np.uint32((0xDEADBEEF + 8 + 13) & 0xFFFFFFFF)
    a, b = (start + each.astype(np.int64).astype(np.uint32) for each in (x, y))
    values = {"a": a, "b": b, "c": np.full(a.shape, start, np.uint32)}
    order = (("c", "b"), ("a", "c"), ("b", "a"), ("c", "b"), ("a", "c"), ("b", "a"), ("c", "b"))
    for (target, source), turn in zip(order, (14, 11, 25, 16, 4, 14, 24), strict=True):
        values[target] = (values[target] ^ values[source]) - _rotated(values[source], turn)
    return values["c"]


def gradient_noise(at: Array, channels: int) -> Array:
    """Return gradient noise [..., channels] at coordinates [..., 2]; channels 1 or 3, which differ."""
    cell = np.floor(at)
    rest = (at - cell).astype(np.float64)
    fade = rest * rest * rest * (rest * (rest * 6.0 - 15.0) + 10.0)
    corners = []
    for y in (0, 1):
        for x in (0, 1):
            bits = lattice_hash(cell[..., 0] + x, cell[..., 1] + y)
            parts = [bits] if channels == 1 else [bits >> np.uint32(8 * k) & np.uint32(0xFF) for k in range(3)]
            offset = rest - np.array([x, y])
            corners.append(np.stack([_gradient(part, offset[..., 0], offset[..., 1]) for part in parts], axis=-1))
    u, v = fade[..., :1], fade[..., 1:]
    low, high = corners[0] + (corners[1] - corners[0]) * u, corners[2] + (corners[3] - corners[2]) * u
    return np.asarray(_PERLIN_SCALE * (low + (high - low) * v))


def cell_noise(at: Array) -> Array:
    """Return one value of 0..1 [..., 1] for each cell of the lattice, at coordinates [..., 2]."""
    cell = np.floor(at)
    return np.asarray(lattice_hash(cell[..., 0], cell[..., 1]).astype(np.float64) / 0xFFFFFFFF)[..., None]


def fractal_noise(at: Array, octaves: int, lacunarity: float, diminish: float, channels: int) -> Array:
    """Return a sum of octaves of gradient noise; each is `lacunarity` times as fine and `diminish` times as strong."""
    total, strength, place = np.zeros((*at.shape[:-1], channels)), 1.0, np.asarray(at, np.float64)
    for _ in range(octaves):
        total += strength * gradient_noise(place, channels)
        strength *= diminish
        place = place * lacunarity
    return total


def _rotated(values: Array, bits: int) -> Array:
    return np.asarray(values << np.uint32(bits) | values >> np.uint32(32 - bits))


def _gradient(bits: Array, x: Array, y: Array) -> Array:
    """Return the dot product of an offset with one of eight gradients."""
    chosen = bits & np.uint32(7)
    flat = chosen < 4
    u, v = np.where(flat, x, y), 2.0 * np.where(flat, y, x)
    return np.where(chosen & np.uint32(1), -u, u) + np.where(chosen & np.uint32(2), -v, v)


def evaluate_noise(category: str, at: Array, channels: int, numbers: Sequence[float]) -> Array:
    """Return a noise node's values before amplitude and pivot.

    Args:
        category: one of NOISES_2D.
        at: coordinates [..., 2].
        channels: 1 or 3.
        numbers: octaves, lacunarity and diminish of fractal noise.
    """
    if category == "cellnoise2d":
        return cell_noise(at)
    if category == "noise2d":
        return gradient_noise(at, channels)
    return fractal_noise(at, int(np.clip(numbers[0], 1, 16)), numbers[1], numbers[2], channels)
