# SPDX-License-Identifier: Apache-2.0
"""Importance sampling of a light's texture by a piecewise-constant distribution over a grid."""

import taichi as ti

from tiscene.device.kernel_types import Template, vec2
from tiscene.render.lights.light_sample import integer
from tiscene.scene.lights.light_table import DISTRIBUTION, GRID


@ti.dataclass
class ImagePoint:
    """A sampled point, in cells from the image's top left. density: over the unit square."""

    x: ti.f32
    y: ti.f32
    density: ti.f32


@ti.func
def interval(distribution: Template, start: ti.i32, count: ti.i32, u: ti.f32) -> ti.i32:
    """Return the i with cdf[i] <= u < cdf[i + 1], of `count` intervals whose CDF begins at `start`."""
    low, high = 0, count
    while high - low > 1:
        middle = (low + high) // 2
        if distribution[start + middle] <= u:
            low = middle
        else:
            high = middle
    return low


@ti.func
def within(distribution: Template, at: ti.i32, u: ti.f32) -> ti.f32:
    """Return the position of u between a CDF value and the next, 0..1."""
    low = distribution[at]
    return ti.math.clamp((u - low) / ti.max(distribution[at + 1] - low, 1e-30), 0.0, 1.0)


@ti.func
def density(lights: Template, light: ti.i32, column: ti.i32, row: ti.i32) -> ti.f32:
    """Return the density of `sample` in a cell, over the unit square."""
    distribution = ti.static(lights.distribution)
    start = integer(lights.values, light, DISTRIBUTION)
    columns, rows = integer(lights.values, light, GRID), integer(lights.values, light, GRID + 1)
    i, j = ti.math.clamp(column, 0, columns - 1), ti.math.clamp(row, 0, rows - 1)
    at = start + rows + 1 + j * (columns + 1) + i
    probability = (distribution[start + j + 1] - distribution[start + j]) * (distribution[at + 1] - distribution[at])
    return probability * columns * rows


@ti.func
def sample(lights: Template, light: ti.i32, u: vec2):
    """Sample a point; returns an ImagePoint."""
    distribution = ti.static(lights.distribution)
    start = integer(lights.values, light, DISTRIBUTION)
    columns, rows = integer(lights.values, light, GRID), integer(lights.values, light, GRID + 1)
    j = interval(distribution, start, rows, u.y)
    at = start + rows + 1 + j * (columns + 1)
    i = interval(distribution, at, columns, u.x)
    return ImagePoint(
        x=i + within(distribution, at + i, u.x),
        y=j + within(distribution, start + j, u.y),
        density=density(lights, light, i, j),
    )
