# SPDX-License-Identifier: Apache-2.0
"""How the images of lights are sampled: in proportion to their luminance, by cumulative probabilities."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import Texture
from tiscene.scene.textures.atlas import linear_pixels

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
_LARGEST_GRID = (512, 1024)
# Of the copy of an image for paths that scatter widely. The width is a power of two.
SMALL_WIDTH, SMALL_HEIGHT = 256, 128
# What is so many times brighter than the image's mean is its sun, which no sampling of directions alone would find.
_SUN = 16.0
# Of a lamp's samples at least this part regards where it is near, not where it is bright.
_LEAST_EVEN_PART = 0.1


def dome_distribution(texture: Texture) -> tuple[NDArray[np.float32], tuple[int, int]]:
    """What a latlong image is sampled by, in proportion to luminance times solid angle: (values, (columns, rows)).

    values: rows + 1 cumulative probabilities over the rows (from the image's top), then columns + 1 for every row.
    """
    weight = _pixel_means(_luminance(texture), wrap=True)
    edges = np.cos(np.linspace(0.0, math.pi, len(weight) + 1))
    return _distribution(weight * (edges[:-1] - edges[1:])[:, None])


def lamp_distribution(texture: Texture) -> tuple[NDArray[np.float32], tuple[int, int]]:
    """The same of the image on a lamp, in proportion to luminance times area."""
    return _distribution(_pixel_means(_luminance(texture), wrap=False))


def image_part(texture: Texture) -> float:
    """How many of a lamp's samples should be drawn from its image: none where it is even, most where it has spots."""
    luminance = _luminance(texture)
    mean = float(luminance.mean())
    return 0.0 if mean <= 0.0 else min(1.0 - mean * mean / float((luminance**2).mean()), 1.0 - _LEAST_EVEN_PART)


def sun_part(texture: Texture) -> float:
    """The part, 0..0.75, of a latlong image's light that comes from its sun."""
    luminance = _luminance(texture)
    edges = np.cos(np.linspace(0.0, math.pi, len(luminance) + 1))
    light = np.maximum(luminance, 0.0) * ((edges[:-1] - edges[1:]) / (2.0 * luminance.shape[1]))[:, None]
    mean = float(light.sum())
    return 0.0 if mean <= 0.0 else min(float(light[luminance > _SUN * mean].sum()) / mean, 0.75)


def small_copy(texture: Texture) -> NDArray[np.float32] | None:
    """A latlong image of SMALL_HEIGHT x SMALL_WIDTH pixels, rgb, of means over solid angles; None of a smaller one."""
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


def mean_luminance(texture: Texture) -> float:
    """Of all pixels."""
    return float(_luminance(texture).mean())


def _luminance(texture: Texture) -> NDArray[np.float64]:
    return np.asarray(linear_pixels(texture)[..., :3].astype(np.float64) @ LUMINANCE)


def _pixel_means(luminance: NDArray[np.float64], wrap: bool) -> NDArray[np.float64]:
    """Lookups interpolate between pixel centers: each pixel's mean over its own square. wrap: from left to right."""
    padded = np.pad(luminance, ((0, 0), (1, 1)), mode="wrap" if wrap else "edge")
    luminance = 0.75 * luminance + 0.125 * (padded[:, :-2] + padded[:, 2:])
    padded = np.pad(luminance, ((1, 1), (0, 0)), mode="edge")
    return 0.75 * luminance + 0.125 * (padded[:-2] + padded[2:])


def _distribution(weight: NDArray[np.float64]) -> tuple[NDArray[np.float32], tuple[int, int]]:
    """Cumulative probabilities in proportion to the weights, which are summed to a coarser grid if they are many."""
    rows, columns = (min(size, limit) for size, limit in zip(weight.shape, _LARGEST_GRID, strict=True))
    weight = np.maximum(_block_means(_block_means(weight, rows).T, columns).T, 0.0)
    weight += 1e-12 if weight.sum() <= 0.0 else 0.0
    marginal = _cumulative(weight.sum(axis=1)[None])
    conditional = _cumulative(weight + 1e-30)
    return np.concatenate([marginal.ravel(), conditional.ravel()]).astype(np.float32), (columns, rows)


def _block_means(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Means over `count` equal parts of axis 0, which need not divide it."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    edges = np.linspace(0.0, len(values), count + 1)
    low = np.minimum(edges.astype(int), len(values) - 1)
    part = (edges - low)[:, None]
    at_edges = sums[low] * (1.0 - part) + sums[low + 1] * part
    return np.asarray(np.diff(at_edges, axis=0) * (count / len(values)))


def _cumulative(weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows of n weights to rows of n + 1 cumulative probabilities."""
    sums = np.cumsum(weight, axis=1)
    return np.concatenate([np.zeros((len(weight), 1)), sums / sums[:, -1:]], axis=1)
