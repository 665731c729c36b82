# SPDX-License-Identifier: Apache-2.0
"""Kernels that split large ranges of primitives by all threads together, a level of the tree at a time.

`build_kernels.grow` gives each subtree to one thread, which on a GPU takes seconds for the top of a large tree. The
splits are the same. The bin of a primitive is computed once: a GPU's compiler may round it differently in two kernels,
and a side would then have another number of primitives than were counted.
"""

import taichi as ti

from tiscene.device.kernel_types import Floats2, Floats3, Ints1, Ints2, Template
from tiscene.device.prefix_sums import exclusive_scan
from tiscene.scene.bvh.build_kernels import BINS, FAR, best_plane, bin_of

# Columns of bounds: lowest and highest corner, and those of the doubled centers.
LOW, HIGH, CENTER_LOW, CENTER_HIGH, BOUNDS = 0, 3, 6, 9, 12
AXIS, LAST_BIN, MIDDLE, SPLITS = 0, 1, 2, 3  # columns of splits
LOG_BINS = BINS.bit_length() - 1


@ti.kernel
def bound_ranges(boxes: Floats2, owner: Ints1, ranges: ti.i32, bounds: Floats2):
    """Compute the boxes of ranges.

    Args:
        boxes: Boxes of the primitives.
        owner: Range of each primitive, -1 for none.
        ranges: Number of ranges.
        bounds: Receives a row for each range.
    """
    for r, c in ti.ndrange(ranges, BOUNDS):
        bounds[r, c] = ti.select((c // 3) % 2 == 0, FAR, -FAR)
    for i in range(owner.shape[0]):
        r = owner[i]
        if r >= 0:
            for c in ti.static(range(3)):
                lower(bounds, r, LOW + c, boxes[i, c])
                raise_(bounds, r, HIGH + c, boxes[i, 3 + c])
                lower(bounds, r, CENTER_LOW + c, boxes[i, c] + boxes[i, 3 + c])
                raise_(bounds, r, CENTER_HIGH + c, boxes[i, c] + boxes[i, 3 + c])


@ti.kernel
def bin_ranges(
    boxes: Floats2, owner: Ints1, ranges: ti.i32, bounds: Floats2, bin_numbers: Ints1, counts: Ints2, bins: Floats3
):
    """Count the primitives of each bin, and compute its box.

    Args:
        boxes: Boxes of the primitives.
        owner: Range of each primitive, -1 for none.
        ranges: Number of ranges.
        bounds: A row for each range.
        bin_numbers: Receives the bins of each primitive, LOG_BINS bits for each axis.
        counts: Receives the number of primitives, [ranges, 3 * BINS].
        bins: Receives the boxes, [ranges, 3 * BINS, 6].
    """
    for r, b in ti.ndrange(ranges, 3 * BINS):
        counts[r, b] = 0
        for c in ti.static(range(3)):
            bins[r, b, c] = FAR
            bins[r, b, 3 + c] = -FAR
    for i in range(owner.shape[0]):
        r = owner[i]
        if r >= 0:
            numbers = 0
            for axis in ti.static(range(3)):
                low = bounds[r, CENTER_LOW + axis]
                size = bounds[r, CENTER_HIGH + axis] - low
                if size > 1e-30:
                    number = bin_of(boxes, i, axis, low, BINS * 0.99999 / size)
                    numbers |= number << (axis * LOG_BINS)
                    b = axis * BINS + number
                    ti.atomic_add(counts[r, b], 1)
                    for c in ti.static(range(3)):
                        if boxes[i, c] < bins[r, b, c]:
                            ti.atomic_min(bins[r, b, c], boxes[i, c])
                        if boxes[i, 3 + c] > bins[r, b, 3 + c]:
                            ti.atomic_max(bins[r, b, 3 + c], boxes[i, 3 + c])
            bin_numbers[i] = numbers


@ti.kernel
def choose_splits(
    ranges: Ints2,
    count: ti.i32,
    bounds: Floats2,
    counts: Ints2,
    bins: Floats3,
    splits: Ints2,
    node_box: Floats2,
    node_link: Ints2,
    sah_depth: ti.i32,
    block: ti.i32,
):
    """Choose where ranges are split, and write their binary nodes as `build_kernels.grow` does.

    Args:
        ranges: Rows of (slot, begin, end, depth).
        count: Number of ranges.
        bounds: A row for each range.
        counts: Of `bin_ranges`.
        bins: Of `bin_ranges`.
        splits: Receives axis (-1: in the middle), last bin of the left side, and the first primitive of the right.
        node_box: Receives the box of each slot.
        node_link: Receives left slot, right slot, first primitive and number of primitives.
        sah_depth: Below this depth, ranges are halved instead of split by SAH.
        block: Number of primitives that are tested at once.
    """
    for r in range(count):
        slot = ranges[r, 0]
        begin = ranges[r, 1]
        end = ranges[r, 2]
        best = ti.math.inf
        best_axis = -1
        last = 0
        middle = (begin + end) // 2
        if ranges[r, 3] < sah_depth:
            for axis in range(3):
                if bounds[r, CENTER_HIGH + axis] - bounds[r, CENTER_LOW + axis] > 1e-30:
                    number = ti.Vector([0] * BINS)
                    lows = ti.Matrix([[0.0] * 3] * BINS)
                    highs = ti.Matrix([[0.0] * 3] * BINS)
                    for b in range(BINS):
                        number[b] = counts[r, axis * BINS + b]
                        for c in ti.static(range(3)):
                            lows[b, c] = bins[r, axis * BINS + b, c]
                            highs[b, c] = bins[r, axis * BINS + b, 3 + c]
                    cost, last_bin = best_plane(number, lows, highs, end - begin, block)
                    if cost < best:
                        best = cost
                        best_axis = axis
                        last = last_bin
        if best_axis >= 0:
            middle = begin
            for b in range(last + 1):
                middle += counts[r, best_axis * BINS + b]
        splits[r, AXIS] = best_axis
        splits[r, LAST_BIN] = last
        splits[r, MIDDLE] = middle
        for c in ti.static(range(6)):
            node_box[slot, c] = bounds[r, c]
        node_link[slot, 0] = slot + 1
        node_link[slot, 1] = slot + 2 * (middle - begin)
        node_link[slot, 2] = begin
        node_link[slot, 3] = end - begin


@ti.kernel
def part_ranges(
    boxes: Floats2,
    order: Ints1,
    owner: Ints1,
    ranges: Ints2,
    bin_numbers: Ints1,
    splits: Ints2,
    before: Ints1,
    boxes_out: Floats2,
    order_out: Ints1,
    in_blocks: Template,
):
    """Copy the primitives so that those of the left sides come first, otherwise in the order in which they were.

    Args:
        boxes: Boxes of the primitives.
        order: Primitives.
        owner: Range of each primitive, -1 for none.
        ranges: Rows of (slot, begin, end, depth).
        bin_numbers: Of `bin_ranges`.
        splits: Of `choose_splits`.
        before: Scratch, [n + 1 + SCAN_BLOCKS].
        boxes_out: Receives the boxes.
        order_out: Receives the primitives.
        in_blocks: See `prefix_sums.exclusive_scan`.
    """
    for i in range(owner.shape[0]):
        is_left = 0
        r = owner[i]
        if r >= 0:
            axis = splits[r, AXIS]
            if axis < 0:
                is_left = ti.cast(i < splits[r, MIDDLE], ti.i32)
            else:
                number = (bin_numbers[i] >> (axis * LOG_BINS)) & (BINS - 1)
                is_left = ti.cast(number <= splits[r, LAST_BIN], ti.i32)
        before[i] = is_left
    exclusive_scan(before, owner.shape[0], in_blocks)
    for i in range(owner.shape[0]):
        to = i
        r = owner[i]
        if r >= 0:
            begin = ranges[r, 1]
            left = before[i] - before[begin]
            to = splits[r, MIDDLE] + i - begin - left
            if before[i + 1] > before[i]:
                to = begin + left
        order_out[to] = order[i]
        for c in ti.static(range(6)):
            boxes_out[to, c] = boxes[i, c]


@ti.func
def lower(values: Template, row: ti.i32, column: ti.i32, value: ti.f32):
    """Set a number to another one if that is smaller; most threads need no atomic operation."""
    if value < values[row, column]:
        ti.atomic_min(values[row, column], value)


@ti.func
def raise_(values: Template, row: ti.i32, column: ti.i32, value: ti.f32):
    """Set a number to another one if that is larger."""
    if value > values[row, column]:
        ti.atomic_max(values[row, column], value)
