# SPDX-License-Identifier: Apache-2.0
"""Rectangles around the parts of a frame that differ much from its base image: movers, their shadows and reflections.

Where light is denoised at reduced resolution, these regions are denoised at full resolution.
"""

from itertools import accumulate, chain, groupby
from operator import itemgetter
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats2, Floats3, Ints2

Region = tuple[slice, slice]  # rows and columns of an image
Extent = tuple[int, int, int, int]  # first and last row, first and last column of cells

CELL = 8  # px; changes are detected per square cell
MIN_CHANGE = 0.15  # change of a cell's radiance that counts, as a fraction of its radiance in the base image
# Margin around the cells of a region, and the granularity of its sides, so that few sizes occur; px.
MARGIN, STEP = 8, 16
SPLIT_GAIN = 512  # px, by which two rectangles have to be smaller than one


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
    """Return rectangles that contain all True cells, sorted by row and column.

    There is one for each 8-connected group, or several where they are smaller together by more than SPLIT_GAIN. If
    together they are no smaller than the image, return one rectangle of the whole image.

    Args:
        cells: bool [rows, columns], squares of CELL pixels.
        height: Image height, px.
        width: Image width, px.
    """
    remaining = set(map(tuple, np.argwhere(cells).tolist()))
    result: list[Region] = []
    while remaining:
        stack, group = [remaining.pop()], list[tuple[int, ...]]()
        while stack:
            row, column = stack.pop()
            group.append((row, column))
            neighbors = {(row + y, column + x) for y in (-1, 0, 1) for x in (-1, 0, 1)} & remaining
            remaining -= neighbors
            stack += neighbors
        result += _covering(group, height, width)
    if sum(map(_area, result)) >= height * width:
        return [(slice(0, height), slice(0, width))]
    return sorted(result, key=lambda region: (region[0].start, region[1].start))


def _covering(cells: list[tuple[int, ...]], height: int, width: int) -> list[Region]:
    """Return rectangles that contain cells, (row, column) each: one, cut in two as long as that makes them smaller."""
    whole, best = _rectangle(*_extent(cells), height, width), None
    if (least := _area(whole) - SPLIT_GAIN) > 2 * (CELL + 2 * MARGIN) ** 2:
        for axis in (0, 1):
            lines = [list(line) for _, line in groupby(sorted(cells, key=itemgetter(axis)), key=itemgetter(axis))]
            extents = [_extent(line) for line in lines]
            before = list(accumulate(extents, _union))
            after = list(accumulate(reversed(extents), _union))[::-1]
            for cut in range(1, len(lines)):
                parts = before[cut - 1], after[cut]
                area = sum(_area(_rectangle(*part, height, width)) for part in parts)
                if area < least:
                    least, best = area, (lines[:cut], lines[cut:])
    if best is None:
        return [whole]
    return [region for half in best for region in _covering(list(chain.from_iterable(half)), height, width)]


def _extent(cells: list[tuple[int, ...]]) -> Extent:
    rows, columns = zip(*cells, strict=True)
    return min(rows), max(rows), min(columns), max(columns)


def _union(one: Extent, other: Extent) -> Extent:
    return min(one[0], other[0]), max(one[1], other[1]), min(one[2], other[2]), max(one[3], other[3])


def _rectangle(top: int, bottom: int, left: int, right: int, height: int, width: int) -> Region:
    """Return the rectangle of some rows and columns of cells with their margin."""
    return _span(top, bottom, height), _span(left, right, width)


def _area(region: Region) -> int:
    rows, columns = region
    return int((rows.stop - rows.start) * (columns.stop - columns.start))


def _span(first: int, last: int, size: int) -> slice:
    """Return the pixels along an axis that contain the cells first .. last and their margin, within 0 .. size."""
    begin, end = first * CELL - MARGIN, (last + 1) * CELL + MARGIN
    length = min(-(-(end - begin) // STEP) * STEP, size)
    begin = max(0, min((begin + end - length) // 2, size - length))
    return slice(begin, begin + length)
