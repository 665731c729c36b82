# SPDX-License-Identifier: Apache-2.0
"""Pixel filters by importance sampling: camera rays are distributed like the filter, and all have equal weight.

A path contributes to one pixel only, so that the noise of neighboring pixels is uncorrelated (Ernst, Stamminger and
Greiner, "Filter Importance Sampling", 2006). Filters are separable. Labels are not filtered: they are those at the
pixel's center.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Template
from tiscene.errors import ArgumentError

_STEPS = 1 << 15  # of the numerical integration, per side


@dataclass(frozen=True)
class PixelFilter:
    """A separable pixel filter.

    Attributes:
        radius: px.
        weight: Function of the offset from the pixel's center along one axis, px, -radius..radius.
        cells: Cells of equal probability, uniform inside, that approximate the filter's tails.
    """

    radius: float
    weight: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    cells: int = 8192

    def table(self) -> NDArray[np.float32]:
        """Return what `sample_offset` and `offset_weight` read, float32 [cells + 3].

        The absolute value of a path's weight (1 for filters without negative lobes), the distance, px, from which
        weights are negative, then the boundaries of the cells, px.
        """
        x = np.linspace(-self.radius, self.radius, 2 * _STEPS + 1)
        weights = self.weight(0.5 * (x[1:] + x[:-1]))
        cdf = np.concatenate([[0.0], np.cumsum(np.abs(weights))])
        cells = np.interp(np.linspace(0.0, cdf[-1], self.cells + 1), cdf, x)
        cells = 0.5 * (cells - cells[::-1])  # exactly symmetric
        negative = np.abs(x[1:][weights < 0.0])
        scale = (cdf[-1] / weights.sum()) ** 2
        return np.array([scale, negative.min(initial=np.inf), *cells], np.float32)


def _mitchell(x: NDArray[np.float64]) -> NDArray[np.float64]:
    x = np.abs(x)
    near = (7.0 * x**3 - 12.0 * x**2 + 16.0 / 3.0) / 6.0
    far = (-7.0 / 3.0 * x**3 + 12.0 * x**2 - 20.0 * x + 32.0 / 3.0) / 6.0
    return np.where(x < 1.0, near, far)


def _blackman_harris(x: NDArray[np.float64]) -> NDArray[np.float64]:
    turns = np.pi * (x / 1.5 + 1.0)
    return 0.35875 - 0.48829 * np.cos(turns) + 0.14128 * np.cos(2.0 * turns) - 0.01168 * np.cos(3.0 * turns)


# Radii and shapes of pbrt; the Blackman-Harris window is Blender's.
PIXEL_FILTERS = {
    "box": PixelFilter(0.5, np.ones_like, cells=1),
    "triangle": PixelFilter(1.0, lambda x: 1.0 - np.abs(x)),
    "gaussian": PixelFilter(1.5, lambda x: np.exp(-2.0 * x**2) - math.exp(-2.0 * 1.5**2)),
    "mitchell": PixelFilter(2.0, _mitchell),
    "blackman-harris": PixelFilter(1.5, _blackman_harris),
}


def pixel_filter(name: str) -> PixelFilter:
    """Return the filter of that name.

    Raises:
        ArgumentError: There is no such filter; the message lists all.
    """
    if not isinstance(name, str) or name not in PIXEL_FILTERS:
        raise ArgumentError(f"pixel_filter={name!r}: must be one of {', '.join(PIXEL_FILTERS)}")
    return PIXEL_FILTERS[name]


@ti.func
def sample_offset(table: Template, u: ti.f32) -> ti.f32:
    """Return a random offset from the pixel's center along one axis, px. u: in [0, 1)."""
    cells = table.shape[0] - 3
    position = u * cells
    cell = ti.min(ti.cast(position, ti.i32), cells - 1)
    return table[2 + cell] + (position - cell) * (table[3 + cell] - table[2 + cell])


@ti.func
def offset_weight(table: Template, x: ti.f32, y: ti.f32) -> ti.f32:
    """Return the weight of a path with that offset: the same for all but for its sign."""
    weight = table[0]
    if (ti.abs(x) > table[1]) != (ti.abs(y) > table[1]):
        weight = -weight
    return weight
