# SPDX-License-Identifier: Apache-2.0
"""Pixel filters, sampled by importance: paths are sent where the filter weighs, and then all count the same.

So a path belongs to one pixel, and neighbors do not share their noise (Ernst, Stamminger and Greiner, "Filter
Importance Sampling", 2006). Filters are products of one function for each axis. Labels know no filter: they are those
of the pixel's center.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Template
from tiscene.errors import ArgumentError

_STEPS = 1 << 15  # of the integral that cells are made by


@dataclass(frozen=True)
class PixelFilter:
    """radius: px. weight: of a place up to the radius away from the pixel's center along an axis, px.

    cells: of equal probability; within each it is even, so many are wanted where the weight falls off gently.
    """

    radius: float
    weight: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    cells: int = 8192

    def table(self) -> NDArray[np.float32]:
        """What `sample_offset` reads: by how much the paths of a picture are to be multiplied for negative weights not
        to darken it, from which distance weights are negative, then where each cell begins and the last one ends."""
        x = np.linspace(-self.radius, self.radius, 2 * _STEPS + 1)
        weights = self.weight(0.5 * (x[1:] + x[:-1]))
        reached = np.concatenate([[0.0], np.cumsum(np.abs(weights))])
        cells = np.interp(np.linspace(0.0, reached[-1], self.cells + 1), reached, x)
        cells = 0.5 * (cells - cells[::-1])  # symmetric to the bit
        negative = np.abs(x[1:][weights < 0.0])
        scale = (reached[-1] / weights.sum()) ** 2
        return np.array([scale, negative.min(initial=np.inf), *cells], np.float32)


def _mitchell(x: NDArray[np.float64]) -> NDArray[np.float64]:
    x = np.abs(x)
    near = (7.0 * x**3 - 12.0 * x**2 + 16.0 / 3.0) / 6.0
    far = (-7.0 / 3.0 * x**3 + 12.0 * x**2 - 20.0 * x + 32.0 / 3.0) / 6.0
    return np.where(x < 1.0, near, far)


def _blackman_harris(x: NDArray[np.float64]) -> NDArray[np.float64]:
    turns = np.pi * (x / 1.5 + 1.0)
    return 0.35875 - 0.48829 * np.cos(turns) + 0.14128 * np.cos(2.0 * turns) - 0.01168 * np.cos(3.0 * turns)


# Radii and shapes as in PBRT, but for Blackman and Harris's window, which is Blender's.
PIXEL_FILTERS = {
    "box": PixelFilter(0.5, np.ones_like, cells=1),
    "triangle": PixelFilter(1.0, lambda x: 1.0 - np.abs(x)),
    "gaussian": PixelFilter(1.5, lambda x: np.exp(-2.0 * x**2) - math.exp(-2.0 * 1.5**2)),
    "mitchell": PixelFilter(2.0, _mitchell),
    "blackman-harris": PixelFilter(1.5, _blackman_harris),
}


def pixel_filter(name: str) -> PixelFilter:
    """The filter of that name. Raises ArgumentError, listing them."""
    if not isinstance(name, str) or name not in PIXEL_FILTERS:
        raise ArgumentError(f"pixel_filter={name!r}: must be one of {', '.join(PIXEL_FILTERS)}")
    return PIXEL_FILTERS[name]


@ti.func
def sample_offset(table: Template, u: ti.f32) -> ti.f32:
    """How far from the pixel's center along an axis, px, for a number in [0, 1)."""
    cells = table.shape[0] - 3
    place = u * cells
    cell = ti.min(ti.cast(place, ti.i32), cells - 1)
    return table[2 + cell] + (place - cell) * (table[3 + cell] - table[2 + cell])


@ti.func
def offset_weight(table: Template, x: ti.f32, y: ti.f32) -> ti.f32:
    """By how much a path that was sent there is to be multiplied: the same for all, but for its sign."""
    weight = table[0]
    if (ti.abs(x) > table[1]) != (ti.abs(y) > table[1]):
        weight = -weight
    return weight
