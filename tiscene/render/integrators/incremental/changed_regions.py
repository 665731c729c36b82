# SPDX-License-Identifier: Apache-2.0
"""Rectangles around the parts of a frame that differ much from its base image: movers, their shadows and reflections.

Where light is denoised at reduced resolution, these regions are denoised at full resolution.
"""

from functools import reduce
from itertools import accumulate, chain, groupby
from operator import itemgetter
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats2, Floats3, Ints2

Region = tuple[slice, slice]  # rows and columns of an image
Place = tuple[int, int]  # row and column of a cell
Extent = tuple[int, int, int, int]  # first row, the one after the last, and the same for columns, px

CELL = 8  # px; changes are detected per square cell
MIN_CHANGE = 0.15  # change of a cell's radiance that counts, as a fraction of its radiance in the base image
# Margin around the cells of a region, and the granularity of its sides, so that few sizes occur; px.
MARGIN, STEP = 8, 16
NARROW_MARGIN = 4  # around pixels that alone are taken from the denoised rectangle, px
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
    """Return rectangles that contain all True pixels of a mask, [h, w], with a margin of NARROW_MARGIN.

    There is one for each group of pixels in adjoining cells, or several, as of `bounding_regions`.
    """
    height, width = mask.shape
    padded = np.pad(mask, ((0, -height % CELL), (0, -width % CELL)))
    cells = padded.reshape(len(padded) // CELL, CELL, -1, CELL).swapaxes(1, 2)
    rows, columns = np.nonzero(cells.any(axis=(2, 3)))
    inside = cells[rows, columns]
    spans = [
        (CELL * first + filled.argmax(axis=1), CELL * (first + 1) - filled[:, ::-1].argmax(axis=1))
        for first, filled in ((rows, np.asarray(inside.any(axis=2))), (columns, np.asarray(inside.any(axis=1))))
    ]
    extents = np.column_stack([*spans[0], *spans[1]]).tolist()
    places = zip(rows.tolist(), columns.tolist(), strict=True)
    return _Rectangles(height, width, NARROW_MARGIN).around(dict(zip(places, extents, strict=True)))


def bounding_regions(cells: NDArray[np.bool_], height: int, width: int) -> list[Region]:
    """Return rectangles that contain all True cells with a margin of MARGIN, sorted by row and column.

    There is one for each 8-connected group, or several where they are smaller together by more than SPLIT_GAIN. If
    together they are no smaller than the image, return one rectangle of the whole image.

    Args:
        cells: bool [rows, columns], squares of CELL pixels.
        height: Image height, px.
        width: Image width, px.
    """
    extents: dict[Place, Extent] = {
        (row, column): (CELL * row, CELL * (row + 1), CELL * column, CELL * (column + 1))
        for row, column in np.argwhere(cells).tolist()
    }
    return _Rectangles(height, width, MARGIN).around(extents)


class _Rectangles:
    """Rectangles in an image around groups of cells.

    Args:
        height: Image height, px.
        width: Image width, px.
        margin: Of a rectangle, px.
    """

    def __init__(self, height: int, width: int, margin: int) -> None:
        self._height, self._width, self._margin = height, width, margin

    def around(self, extents: dict[Place, Extent]) -> list[Region]:
        """Return rectangles around all cells, see `bounding_regions`, from what each has to contain of its cell."""
        remaining = set(extents)
        result: list[Region] = []
        while remaining:
            stack, group = [remaining.pop()], list[Place]()
            while stack:
                row, column = stack.pop()
                group.append((row, column))
                neighbors = {(row + y, column + x) for y in (-1, 0, 1) for x in (-1, 0, 1)} & remaining
                remaining -= neighbors
                stack += neighbors
            result += self._covering(group, extents)
        if sum(map(_area, result)) >= self._height * self._width:
            return [(slice(0, self._height), slice(0, self._width))]
        return sorted(result, key=lambda region: (region[0].start, region[1].start))

    def _covering(self, cells: list[Place], extents: dict[Place, Extent]) -> list[Region]:
        """Return rectangles that contain cells: one, cut in two as long as that makes them smaller."""
        whole = self._rectangle(reduce(_union, (extents[cell] for cell in cells)))
        best: tuple[list[list[Place]], list[list[Place]]] | None = None
        if (least := _area(whole) - SPLIT_GAIN) > 2 * STEP**2:
            for axis in (0, 1):
                lines = [list(line) for _, line in groupby(sorted(cells, key=itemgetter(axis)), key=itemgetter(axis))]
                parts = [reduce(_union, (extents[cell] for cell in line)) for line in lines]
                before = list(accumulate(parts, _union))
                after = list(accumulate(reversed(parts), _union))[::-1]
                for cut in range(1, len(lines)):
                    area = sum(_area(self._rectangle(part)) for part in (before[cut - 1], after[cut]))
                    if area < least:
                        least, best = area, (lines[:cut], lines[cut:])
        if best is None:
            return [whole]
        return [region for half in best for region in self._covering(list(chain.from_iterable(half)), extents)]

    def _rectangle(self, extent: Extent) -> Region:
        """Return the rectangle of an extent with its margin."""
        top, bottom, left, right = extent
        return self._span(top, bottom, self._height), self._span(left, right, self._width)

    def _span(self, begin: int, end: int, size: int) -> slice:
        """Return the pixels along an axis from `begin` to before `end`, with their margin, within 0 .. size."""
        begin, end = begin - self._margin, end + self._margin
        length = min(-(-(end - begin) // STEP) * STEP, size)
        begin = max(0, min((begin + end - length) // 2, size - length))
        return slice(begin, begin + length)


def _union(one: Extent, other: Extent) -> Extent:
    return min(one[0], other[0]), max(one[1], other[1]), min(one[2], other[2]), max(one[3], other[3])


def _area(region: Region) -> int:
    rows, columns = region
    return int((rows.stop - rows.start) * (columns.stop - columns.start))
