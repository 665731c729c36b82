# SPDX-License-Identifier: Apache-2.0
"""Pearson's chi-square test of samples against a density, in two coordinates of unit Jacobian."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]


def chi_square(
    points: Array,
    density: Callable[[Array], Array],
    low: tuple[float, float],
    high: tuple[float, float],
    cells: tuple[int, int] = (12, 24),
    quadrature: int = 16,
) -> float:
    """Return the p-value of samples: the probability that samples of `density` deviate as much as these or more.

    Cells that expect fewer than 5 samples are pooled.

    Args:
        points: [n, 2], the samples.
        density: Density of points [m, 2] in the box from `low` to `high`, per unit of area; zero outside. Its integral
            may be below 1 where a sampler may fail: failed samples are left out of `points`, and their count is tested.
        low: Lower corner of the box.
        high: Upper corner of the box.
        cells: Number of cells along each axis.
        quadrature: Density evaluations per cell along each axis.
    """
    edges = [np.linspace(low[axis], high[axis], cells[axis] + 1) for axis in range(2)]
    observed = np.histogram2d(points[:, 0], points[:, 1], bins=edges)[0].ravel()
    fine = [
        low[axis] + (np.arange(cells[axis] * quadrature) + 0.5) * (high[axis] - low[axis]) / (cells[axis] * quadrature)
        for axis in range(2)
    ]
    grid = np.stack(np.meshgrid(*fine, indexing="ij"), axis=-1).reshape(-1, 2)
    values = density(grid).reshape(cells[0], quadrature, cells[1], quadrature)
    area = np.prod(np.subtract(high, low)) / (cells[0] * cells[1])
    expected = values.mean(axis=(1, 3)).ravel() * area * len(points)
    return _p_value(np.append(observed, len(points) - observed.sum()), np.append(expected, 0.0), len(points))


def _p_value(observed: Array, expected: Array, count: int) -> float:
    expected[-1] = max(count - expected.sum(), 0.0)
    order = np.argsort(expected)
    observed, expected = observed[order], expected[order]
    pooled = int(np.searchsorted(np.cumsum(expected), 5.0)) + 1
    if expected[:pooled].sum() < 1.0 and observed[:pooled].sum() > 20:
        return 0.0  # samples where the density is zero
    observed = np.concatenate([[observed[:pooled].sum()], observed[pooled:]])
    expected = np.concatenate([[max(expected[:pooled].sum(), 1e-9)], expected[pooled:]])
    statistic = float(np.sum((observed - expected) ** 2 / np.maximum(expected, 1.0)))
    return float(stats.chi2.sf(statistic, len(observed) - 1))


def sphere_coordinates(directions: Array) -> Array:
    """Return (cosine with z, azimuth in 0..2 pi) of directions [n, 3]: unit Jacobian with respect to solid angle."""
    azimuth = np.arctan2(directions[:, 1], directions[:, 0]) % (2.0 * np.pi)
    return np.stack([np.clip(directions[:, 2], -1.0, 1.0), azimuth], axis=-1)


def directions_of(coordinates: Array) -> Array:
    """Return the directions of `sphere_coordinates`."""
    cosine, azimuth = coordinates.T
    radius = np.sqrt(np.clip(1.0 - cosine**2, 0.0, 1.0))
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), cosine], axis=-1)


SPHERE_LOW, SPHERE_HIGH = (-1.0, 0.0), (1.0, 2.0 * np.pi)
# A correct sampler falls below in fewer than one of ten thousand tests.
MIN_P_VALUE = 1e-4
