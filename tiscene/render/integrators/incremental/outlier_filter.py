# SPDX-License-Identifier: Apache-2.0
"""Lone spikes of a difference, filter_outliers out for the denoiser, which takes a speck in a clean picture for a detail.

A bright path that few frames have is a speck where it comes, and a dark one where the base has it and the frame not.
What is more than its surroundings explain is spread so far that it is not seen. No light is lost, but of a spike that
would be seen even so.
"""

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats2, Floats3, Template, vec3

SURROUNDINGS = 2  # pixels each way that a change is compared with
CELL = 16  # pixels; a spike is spread by the quadratic B-spline of the cells of that size about it
# A change may be so much of the radiance below it, and so many times the mean change around it.
OF_RADIANCE, OF_SURROUNDINGS = 0.25, 3.0
MOST = 0.1  # of a cell's mean radiance: what is spread over it at most


@ti.func
def same_surface(change: Template, pixel: ti.i32) -> ti.i32:
    """Whether no mover has come into the pixel itself: albedo and normal have not changed."""
    changed = 0.0
    for c in ti.static(range(3, 9)):
        changed += ti.abs(change[pixel, c])
    return ti.cast(changed == 0.0, ti.i32)


@ti.kernel
def find_spikes(width: ti.i32, height: ti.i32, change: Floats2, hdr: Floats3, spikes: Floats3):
    """To spikes [h, w, 3]: what of each pixel is too much."""
    for pixel in range(width * height):
        x, y = pixel % width, pixel // width
        own = vec3(change[pixel, 0], change[pixel, 1], change[pixel, 2])
        size = ti.abs(own).sum()
        spike = vec3(0.0)
        if size > 0.0 and same_surface(change, pixel):
            around, neighbors = 0.0, 0.0
            for dy in range(ti.max(-SURROUNDINGS, -y), ti.min(SURROUNDINGS, height - 1 - y) + 1):
                for dx in range(ti.max(-SURROUNDINGS, -x), ti.min(SURROUNDINGS, width - 1 - x) + 1):
                    other = pixel + dy * width + dx
                    if other != pixel:
                        neighbors += 1.0
                        for c in ti.static(range(3)):
                            around += ti.abs(change[other, c])
            below = ti.max(vec3(hdr[y, x, 0], hdr[y, x, 1], hdr[y, x, 2]).sum() - own.sum(), 0.0)
            limit = OF_RADIANCE * below + OF_SURROUNDINGS * around / ti.max(neighbors, 1.0)
            if size > limit:
                spike = own * (1.0 - limit / size)
        for c in ti.static(range(3)):
            spikes[y, x, c] = spike[c]


@ti.func
def cells_about(x: ti.i32):
    """The middle one of the three cells, along one axis, that a pixel gets light from, and their weights."""
    place = (x + 0.5) / CELL - 0.5
    middle = ti.round(place, ti.i32)
    offset = place - middle
    return middle, vec3(0.5 * (0.5 - offset) ** 2, 0.75 - offset * offset, 0.5 * (0.5 + offset) ** 2)


@ti.func
def given(cell: ti.i32, size: ti.i32) -> ti.f32:
    """The sum of the weights with which all pixels along an axis get light from a cell."""
    last = (size - 1) // CELL
    total = 0.0
    for x in range(ti.max((cell - 2) * CELL, 0), ti.min((cell + 3) * CELL, size)):
        middle, weights = cells_about(x)
        for k in ti.static(range(3)):
            if ti.math.clamp(middle + k - 1, 0, last) == cell:
                total += weights[k]
    return total


@ti.kernel
def pool_spikes(width: ti.i32, height: ti.i32, spikes: Floats3, hdr: Floats3, cells: Floats3):
    """The spikes of each cell together, as what a pixel gets of them for a weight of 1."""
    for row, column in ti.ndrange(cells.shape[0], cells.shape[1]):
        total, shown, pixels = vec3(0.0), 0.0, 0.0
        for y in range(row * CELL, ti.min((row + 1) * CELL, height)):
            for x in range(column * CELL, ti.min((column + 1) * CELL, width)):
                pixels += 1.0
                for c in ti.static(range(3)):
                    total[c] += spikes[y, x, c]
                    shown += hdr[y, x, c] - spikes[y, x, c]
        total /= given(row, height) * given(column, width)
        size, most = ti.abs(total).sum(), MOST * ti.max(shown, 0.0) / pixels
        if size > most:
            total *= most / size
        for c in ti.static(range(3)):
            cells[row, column, c] = total[c]


@ti.kernel
def spread_spikes(width: ti.i32, height: ti.i32, spikes: Floats3, cells: Floats3, hdr: Floats3, even: Floats3):
    """The radiance with its spikes spread."""
    for pixel in range(width * height):
        x, y = pixel % width, pixel // width
        middle_x, weights_x = cells_about(x)
        middle_y, weights_y = cells_about(y)
        value = vec3(hdr[y, x, 0] - spikes[y, x, 0], hdr[y, x, 1] - spikes[y, x, 1], hdr[y, x, 2] - spikes[y, x, 2])
        for j, i in ti.static(ti.ndrange(3, 3)):
            row = ti.math.clamp(middle_y + j - 1, 0, cells.shape[0] - 1)
            column = ti.math.clamp(middle_x + i - 1, 0, cells.shape[1] - 1)
            weight = weights_y[j] * weights_x[i]
            value += weight * vec3(cells[row, column, 0], cells[row, column, 1], cells[row, column, 2])
        for c in ti.static(range(3)):
            even[y, x, c] = value[c]


def filter_outliers(change: Any, hdr: NDArray[np.float32]) -> NDArray[np.float32]:
    """Radiance [h, w, 3] without its spikes. change: f32 [pixels, n], as of `collect`."""
    height, width = hdr.shape[:2]
    spikes, even = np.empty_like(hdr), np.empty_like(hdr)
    cells = np.empty((-(-height // CELL), -(-width // CELL), 3), np.float32)
    find_spikes(width, height, change, hdr, spikes)
    pool_spikes(width, height, spikes, hdr, cells)
    spread_spikes(width, height, spikes, cells, hdr, even)
    return even
