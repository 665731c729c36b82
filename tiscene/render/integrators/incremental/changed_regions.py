# SPDX-License-Identifier: Apache-2.0
"""Rectangles around the parts of a frame that differ much from its base image: movers, their shadows and reflections.

Where light is denoised at reduced resolution, these regions are denoised at full resolution.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats2, Floats3, Ints2

Region = tuple[slice, slice]  # rows and columns of an image

CELL = 8  # px; changes are detected per square cell
MIN_CHANGE = 0.15  # change of a cell's radiance that counts, as a fraction of its radiance in the base image
# Margin around the cells of a region, and the granularity of its sides, so that few sizes occur; px.
MARGIN, STEP = 8, 16


def changed_regions(
    correction: Any,
    denoiser_input: NDArray[np.float32],
    filtered: NDArray[np.float32],
    static_mask: NDArray[np.float32],
) -> list[Region]:
    """Return one rectangle per connected group of cells in which a mover is visible or light changed much.

    Args:
        correction: f32 [pixels, CORRECTION_COLUMNS] on the device, see `retrace_kernels.accumulate_corrections`.
        denoiser_input: Radiance with its outliers, float32 [h, w, 3].
        filtered: Radiance without its outliers, float32 [h, w, 3].
        static_mask: 1 where no mover is visible, else 0, float32 [h, w, 1].
    """
    height, width = static_mask.shape[:2]
    cells = np.empty((-(-height // CELL), -(-width // CELL)), np.int32)
    find_changed(width, height, correction, denoiser_input, filtered, static_mask, cells)
    return bounding_regions(cells > 0, height, width)


@ti.kernel
def find_changed(
    width: ti.i32,
    height: ti.i32,
    correction: Floats2,
    denoiser_input: Floats3,
    filtered: Floats3,
    static_mask: Floats3,
    cells: Ints2,
):
    """Set cells[row, column] to 1 where the cell changed, else to 0."""
    for row, column in ti.ndrange(cells.shape[0], cells.shape[1]):
        mover_pixels, change, base = 0.0, ti.math.vec3(0.0), ti.math.vec3(0.0)
        for y in range(row * CELL, ti.min((row + 1) * CELL, height)):
            for x in range(column * CELL, ti.min((column + 1) * CELL, width)):
                mover_pixels += 1.0 - static_mask[y, x, 0]
                for c in ti.static(range(3)):
                    before = denoiser_input[y, x, c] - correction[y * width + x, c]
                    base[c] += before
                    change[c] += filtered[y, x, c] - before
        is_changed = ti.abs(change).sum() > MIN_CHANGE * ti.abs(base).sum()
        cells[row, column] = ti.cast(mover_pixels > 0.0 or is_changed, ti.i32)


def regions_of(mask: NDArray[np.bool_]) -> list[Region]:
    """Return rectangles that contain all True pixels of a mask, [h, w], see `bounding_regions`."""
    height, width = mask.shape
    padded = np.pad(mask, ((0, -height % CELL), (0, -width % CELL)))
    cells = np.any(padded.reshape(len(padded) // CELL, CELL, -1, CELL), axis=(1, 3))
    return bounding_regions(np.asarray(cells), height, width)


def bounding_regions(cells: NDArray[np.bool_], height: int, width: int) -> list[Region]:
    """Return rectangles that contain all True cells, one per 8-connected group, sorted by row and column.

    If together they are no smaller than the image, return one rectangle of the whole image.

    Args:
        cells: bool [rows, columns], squares of CELL pixels.
        height: Image height, px.
        width: Image width, px.
    """
    remaining = set(map(tuple, np.argwhere(cells).tolist()))
    result = []
    while remaining:
        stack, group = [remaining.pop()], []
        while stack:
            row, column = stack.pop()
            group.append((row, column))
            neighbors = {(row + y, column + x) for y in (-1, 0, 1) for x in (-1, 0, 1)} & remaining
            remaining -= neighbors
            stack += neighbors
        rows, columns = zip(*group, strict=True)
        result.append((_span(rows, height), _span(columns, width)))
    if sum((y.stop - y.start) * (x.stop - x.start) for y, x in result) >= height * width:
        return [(slice(0, height), slice(0, width))]
    return sorted(result, key=lambda region: (region[0].start, region[1].start))


def _span(cells: Sequence[int], size: int) -> slice:
    """Return the pixels along an axis that contain the cells and their margin, within 0 .. size."""
    begin, end = min(cells) * CELL - MARGIN, (max(cells) + 1) * CELL + MARGIN
    length = min(-(-(end - begin) // STEP) * STEP, size)
    begin = max(0, min((begin + end - length) // 2, size - length))
    return slice(begin, begin + length)
