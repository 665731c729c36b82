# SPDX-License-Identifier: Apache-2.0
"""Suppression of isolated outliers ("fireflies") in the correction of a base image, before denoising.

The correction of a pixel rests on few paths. A rare bright path appears as an isolated bright pixel, a rare bright path
of the base that a mover blocks as a dark one, and the denoiser would keep either as detail of an otherwise clean image.
The part of a correction that its neighborhood does not explain is distributed over a wide B-spline. Energy is preserved
except for outliers too large to be distributed invisibly.
"""

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats2, Floats3, Template, vec3
from tiscene.render.columns import read3
from tiscene.render.film.upsample import read, spline

NEIGHBORHOOD = 2  # radius of the window that a correction is compared with, px
CELL = 16  # px; an outlier is distributed by the quadratic B-spline over cells of this size
# Limit of a correction: a fraction of the uncorrected radiance plus a multiple of the mean correction around it.
RADIANCE_FRACTION, NEIGHBOR_MULTIPLE = 0.25, 3.0
MAX_SPREAD = 0.1  # distributed light per cell, as a fraction of the cell's mean radiance


@ti.func
def is_static(correction: Template, pixel: ti.i32) -> ti.i32:
    """Return 1 if no mover is visible in the pixel: the corrections of albedo and normal are zero."""
    changed = 0.0
    for c in ti.static(range(3, 9)):
        changed += ti.abs(correction[pixel, c])
    return ti.cast(changed == 0.0, ti.i32)


@ti.kernel
def find_outliers(width: ti.i32, height: ti.i32, correction: Floats2, hdr: Floats3, outliers: Floats3):
    """Write to outliers [h, w, 3] the part of each pixel's correction beyond its limit."""
    for pixel in range(width * height):
        x, y = pixel % width, pixel // width
        correction_here = read3(correction, pixel, 0)
        size = ti.abs(correction_here).sum()
        outlier = vec3(0.0)
        if size > 0.0 and is_static(correction, pixel):
            neighbor_sum, neighbors = 0.0, 0.0
            for dy in range(ti.max(-NEIGHBORHOOD, -y), ti.min(NEIGHBORHOOD, height - 1 - y) + 1):
                for dx in range(ti.max(-NEIGHBORHOOD, -x), ti.min(NEIGHBORHOOD, width - 1 - x) + 1):
                    other = pixel + dy * width + dx
                    if other != pixel:
                        neighbors += 1.0
                        for c in ti.static(range(3)):
                            neighbor_sum += ti.abs(correction[other, c])
            uncorrected = ti.max(read(hdr, y, x).sum() - correction_here.sum(), 0.0)
            limit = RADIANCE_FRACTION * uncorrected + NEIGHBOR_MULTIPLE * neighbor_sum / ti.max(neighbors, 1.0)
            if size > limit:
                outlier = correction_here * (1.0 - limit / size)
        for c in ti.static(range(3)):
            outliers[y, x, c] = outlier[c]


@ti.func
def spline_cells(x: ti.i32):
    """Return the middle one of the three cells along an axis whose B-splines cover a pixel, and their weights."""
    position = (x + 0.5) / CELL - 0.5
    middle = ti.round(position, ti.i32)
    return middle, spline(position - middle)


@ti.func
def cell_weight(cell: ti.i32, size: ti.i32) -> ti.f32:
    """Return the sum of a cell's B-spline weights over all pixels along an axis of `size` pixels."""
    last = (size - 1) // CELL
    total = 0.0
    for x in range(ti.max((cell - 2) * CELL, 0), ti.min((cell + 3) * CELL, size)):
        middle, weights = spline_cells(x)
        for k in ti.static(range(3)):
            if ti.math.clamp(middle + k - 1, 0, last) == cell:
                total += weights[k]
    return total


@ti.kernel
def sum_outliers(width: ti.i32, height: ti.i32, outliers: Floats3, hdr: Floats3, cells: Floats3):
    """Sum the outliers of each cell, normalized: a pixel receives its spline weights times the cells' values."""
    for row, column in ti.ndrange(cells.shape[0], cells.shape[1]):
        total, shown, pixels = vec3(0.0), 0.0, 0.0
        for y in range(row * CELL, ti.min((row + 1) * CELL, height)):
            for x in range(column * CELL, ti.min((column + 1) * CELL, width)):
                pixels += 1.0
                for c in ti.static(range(3)):
                    total[c] += outliers[y, x, c]
                    shown += hdr[y, x, c] - outliers[y, x, c]
        total /= cell_weight(row, height) * cell_weight(column, width)
        size, most = ti.abs(total).sum(), MAX_SPREAD * ti.max(shown, 0.0) / pixels
        if size > most:
            total *= most / size
        for c in ti.static(range(3)):
            cells[row, column, c] = total[c]


@ti.kernel
def distribute_outliers(
    width: ti.i32, height: ti.i32, outliers: Floats3, cells: Floats3, hdr: Floats3, filtered: Floats3
):
    """Subtract the outliers from the radiance and add the distributed ones."""
    for pixel in range(width * height):
        x, y = pixel % width, pixel // width
        middle_x, weights_x = spline_cells(x)
        middle_y, weights_y = spline_cells(y)
        value = read(hdr, y, x) - read(outliers, y, x)
        for j, i in ti.static(ti.ndrange(3, 3)):
            row = ti.math.clamp(middle_y + j - 1, 0, cells.shape[0] - 1)
            column = ti.math.clamp(middle_x + i - 1, 0, cells.shape[1] - 1)
            weight = weights_y[j] * weights_x[i]
            value += weight * read(cells, row, column)
        for c in ti.static(range(3)):
            filtered[y, x, c] = value[c]


def filter_outliers(correction: Any, hdr: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return an image with its outliers distributed over their surroundings.

    Args:
        correction: f32 [pixels, CORRECTION_COLUMNS] on the device, see `retrace_kernels.accumulate_corrections`.
        hdr: Radiance of the corrected image, float32 [h, w, 3].

    Returns:
        Radiance without outliers, float32 [h, w, 3].
    """
    height, width = hdr.shape[:2]
    outliers, filtered = np.empty_like(hdr), np.empty_like(hdr)
    cells = np.empty((-(-height // CELL), -(-width // CELL), 3), np.float32)
    find_outliers(width, height, correction, hdr, outliers)
    sum_outliers(width, height, outliers, hdr, cells)
    distribute_outliers(width, height, outliers, cells, hdr, filtered)
    return filtered
