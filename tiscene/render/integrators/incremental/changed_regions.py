# SPDX-License-Identifier: Apache-2.0
"""Where much has changed: rectangles around what moves, and around light and shadow that it brings elsewhere."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats2, Floats3, Ints2

Region = tuple[slice, slice]  # rows and columns

CELL = 8  # px; what has changed is told by such squares
OF_LIGHT = 0.15  # the change of light of a cell that counts, as a part of what was there
MARGIN, STEP = 8, 16  # px around the cells of a patch; its sides are multiples of the latter, so that few sizes occur


def changed_regions(
    change: Any, drawn: NDArray[np.float32], even: NDArray[np.float32], unmoved: NDArray[np.float32]
) -> list[Region]:
    """One for each group of cells in which something moves or light has changed much.

    change: f32 [pixels, n], as `combine` has it; drawn, even: radiance with that and without its spikes [h, w, 3].
    """
    height, width = unmoved.shape[:2]
    cells = np.empty((-(-height // CELL), -(-width // CELL)), np.int32)
    find_changed(width, height, change, drawn, even, unmoved, cells)
    return bounding_regions(cells > 0, height, width)


@ti.kernel
def find_changed(
    width: ti.i32, height: ti.i32, change: Floats2, drawn: Floats3, even: Floats3, unmoved: Floats3, cells: Ints2
):
    """1 for those cells, 0 for the others."""
    for row, column in ti.ndrange(cells.shape[0], cells.shape[1]):
        moved, shift, below = 0.0, ti.math.vec3(0.0), ti.math.vec3(0.0)
        for y in range(row * CELL, ti.min((row + 1) * CELL, height)):
            for x in range(column * CELL, ti.min((column + 1) * CELL, width)):
                moved += 1.0 - unmoved[y, x, 0]
                for c in ti.static(range(3)):
                    before = drawn[y, x, c] - change[y * width + x, c]
                    below[c] += before
                    shift[c] += even[y, x, c] - before
        much = ti.abs(shift).sum() > OF_LIGHT * ti.abs(below).sum()
        cells[row, column] = ti.cast(moved > 0.0 or much, ti.i32)


def bounding_regions(cells: NDArray[np.bool_], height: int, width: int) -> list[Region]:
    """Rectangles of a picture that hold all of those cells, one for each group of neighbors; one of the whole picture,
    if they are no smaller together."""
    left = set(map(tuple, np.argwhere(cells).tolist()))
    result = []
    while left:
        waiting, group = [left.pop()], []
        while waiting:
            row, column = waiting.pop()
            group.append((row, column))
            near = {(row + y, column + x) for y in (-1, 0, 1) for x in (-1, 0, 1)} & left
            left -= near
            waiting += near
        rows, columns = zip(*group, strict=True)
        result.append((_span(rows, height), _span(columns, width)))
    if sum((y.stop - y.start) * (x.stop - x.start) for y, x in result) >= height * width:
        return [(slice(0, height), slice(0, width))]
    return sorted(result, key=lambda patch: (patch[0].start, patch[1].start))


def _span(cells: Sequence[int], size: int) -> slice:
    """Pixels along one axis that hold the cells and what is around them."""
    begin, end = min(cells) * CELL - MARGIN, (max(cells) + 1) * CELL + MARGIN
    length = min(-(-(end - begin) // STEP) * STEP, size)
    begin = max(0, min((begin + end - length) // 2, size - length))
    return slice(begin, begin + length)
