# SPDX-License-Identifier: Apache-2.0
"""Sampling distributions of light textures: piecewise constant, in proportion to luminance, as tables of the CDF.

What is computed of a texture is kept as long as the texture exists.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynamics.weak_cache import weakly_cached
from tiscene.scene.color import LUMINANCE
from tiscene.scene.description import Texture
from tiscene.scene.textures.atlas import linear_pixels

_LARGEST_GRID = (512, 1024)
# Size of the filtered copy of an environment map that is read for wide lobes. The width is a power of two.
SMALL_WIDTH, SMALL_HEIGHT = 256, 128
# Pixels brighter than this factor times the mean are the sun, which BSDF sampling alone practically never finds.
_SUN_THRESHOLD = 16.0
# Minimum fraction of an area light's samples that are by solid angle or area instead of by its texture.
_MIN_GEOMETRIC_FRACTION = 0.1


@weakly_cached
def dome_distribution(texture: Texture) -> tuple[NDArray[np.float32], tuple[int, int]]:
    """Return the distribution of a latlong image, in proportion to luminance times solid angle.

    Returns:
        (cdf, (columns, rows)). cdf: float32, rows + 1 values over the rows from the image's top, then columns + 1
        values of each row.
    """
    weight = _pixel_means(_luminance(texture), wrap=True)
    edges = np.cos(np.linspace(0.0, math.pi, len(weight) + 1))
    return _distribution(weight * (edges[:-1] - edges[1:])[:, None])


@weakly_cached
def area_distribution(texture: Texture) -> tuple[NDArray[np.float32], tuple[int, int]]:
    """Return the distribution of the texture of an area light, in proportion to luminance; as `dome_distribution`."""
    return _distribution(_pixel_means(_luminance(texture), wrap=False))


@weakly_cached
def image_fraction(texture: Texture) -> float:
    """Return the fraction of an area light's samples to draw from its texture: 0 for a constant one, up to 0.9."""
    luminance = _luminance(texture)
    mean = float(luminance.mean())
    return 0.0 if mean <= 0.0 else min(1.0 - mean * mean / float((luminance**2).mean()), 1.0 - _MIN_GEOMETRIC_FRACTION)


@weakly_cached
def sun_fraction(texture: Texture) -> float:
    """Return the fraction, 0..0.75, of a latlong image's light that comes from its brightest pixels, the sun."""
    luminance = _luminance(texture)
    edges = np.cos(np.linspace(0.0, math.pi, len(luminance) + 1))
    light = np.maximum(luminance, 0.0) * ((edges[:-1] - edges[1:]) / (2.0 * luminance.shape[1]))[:, None]
    mean = float(light.sum())
    return 0.0 if mean <= 0.0 else min(float(light[luminance > _SUN_THRESHOLD * mean].sum()) / mean, 0.75)


@weakly_cached
def small_image(texture: Texture) -> NDArray[np.float32] | None:
    """Return the image filtered by solid angle to float32 [SMALL_HEIGHT, SMALL_WIDTH, 3]; None if it is smaller."""
    pixels = linear_pixels(texture)[..., :3].astype(np.float64)
    if pixels.shape[0] < SMALL_HEIGHT or pixels.shape[1] < SMALL_WIDTH:
        return None
    weight = np.sin(math.pi * (np.arange(len(pixels)) + 0.5) / len(pixels))[:, None]
    total = _block_means(weight, SMALL_HEIGHT)
    channels = [
        _block_means((_block_means(pixels[..., channel] * weight, SMALL_HEIGHT) / total).T, SMALL_WIDTH).T
        for channel in range(3)
    ]
    return np.stack(channels, axis=-1).astype(np.float32)


@weakly_cached
def mean_luminance(texture: Texture) -> float:
    """Return the mean luminance of all pixels."""
    return float(_luminance(texture).mean())


def _luminance(texture: Texture) -> NDArray[np.float64]:
    return np.asarray(linear_pixels(texture)[..., :3].astype(np.float64) @ LUMINANCE)


def _pixel_means(luminance: NDArray[np.float64], wrap: bool) -> NDArray[np.float64]:
    """Return the mean of the bilinear interpolation over each pixel's square. wrap: the left and right edges meet."""
    padded = np.pad(luminance, ((0, 0), (1, 1)), mode="wrap" if wrap else "edge")
    luminance = 0.75 * luminance + 0.125 * (padded[:, :-2] + padded[:, 2:])
    padded = np.pad(luminance, ((1, 1), (0, 0)), mode="edge")
    return 0.75 * luminance + 0.125 * (padded[:-2] + padded[2:])


def _distribution(weight: NDArray[np.float64]) -> tuple[NDArray[np.float32], tuple[int, int]]:
    """Return the CDF tables of weights [rows, columns], which are averaged to _LARGEST_GRID if they are more."""
    rows, columns = (min(size, limit) for size, limit in zip(weight.shape, _LARGEST_GRID, strict=True))
    weight = np.maximum(_block_means(_block_means(weight, rows).T, columns).T, 0.0)
    weight += 1e-12 if weight.sum() <= 0.0 else 0.0
    marginal = _cumulative(weight.sum(axis=1)[None])
    conditional = _cumulative(weight + 1e-30)
    return np.concatenate([marginal.ravel(), conditional.ravel()]).astype(np.float32), (columns, rows)


def _block_means(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return means over `count` equal intervals of axis 0; `count` need not divide its length."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    edges = np.linspace(0.0, len(values), count + 1)
    low = np.minimum(edges.astype(int), len(values) - 1)
    part = (edges - low)[:, None]
    at_edges = sums[low] * (1.0 - part) + sums[low + 1] * part
    return np.asarray(np.diff(at_edges, axis=0) * (count / len(values)))


def _cumulative(weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return CDFs [rows, n + 1] from weights [rows, n]."""
    sums = np.cumsum(weight, axis=1)
    return np.concatenate([np.zeros((len(weight), 1)), sums / sums[:, -1:]], axis=1)
