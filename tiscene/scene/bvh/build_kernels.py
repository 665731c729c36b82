# SPDX-License-Identifier: Apache-2.0
"""Kernels that grow a binary tree of boxes by the binned surface-area heuristic (SAH; Wald 2007).

A build runs `grow` once for the top of the tree and once for the subtrees in parallel; then `layout_kernels` turn the
tree into nodes. A binary node over n primitives owns 2n - 1 slots, beginning with its own, and its left child is in the
slot after it. Subtrees are thereby numbered independently, and the tree is the same for any number of threads.
"""

import taichi as ti

from dynamics.balanced_loops import first_items, iterations_of_long_items, next_item
from tiscene.device.kernel_types import Floats2, Ints1, Ints2, Template

BINS = 16
STACK = 72  # a tree is at most as deep as `sah_depth` of `grow`, 40 at most, plus log2(primitives)
FAR = 1e30  # an empty box is [FAR, -FAR]
MARGIN = 4e-7  # by which boxes are enlarged against rounding errors, of their largest coordinate


@ti.func
def half_area(low: Template, high: Template) -> ti.f32:
    """Return half the surface area of a box."""
    size = high - low
    return size.x * size.y + size.y * size.z + size.z * size.x


@ti.func
def box_of(boxes: Template, row: ti.i32):
    """Return the lowest and highest corner of a box."""
    low = ti.Vector([boxes[row, 0], boxes[row, 1], boxes[row, 2]])
    high = ti.Vector([boxes[row, 3], boxes[row, 4], boxes[row, 5]])
    return low, high


@ti.func
def bin_of(boxes: Template, row: ti.i32, axis: ti.i32, low: ti.f32, scale: ti.f32) -> ti.i32:
    """Return the bin of a box's center, which is doubled as `low` is."""
    return ti.min(BINS - 1, ti.max(0, ti.cast((boxes[row, axis] + boxes[row, 3 + axis] - low) * scale, ti.i32)))


@ti.func
def blocks(count: ti.i32, block: ti.i32) -> ti.f32:
    """Return the cost of testing primitives: the number of blocks of them."""
    return ti.cast((count + block - 1) // block, ti.f32)


@ti.func
def best_plane(count: Template, lows: Template, highs: Template, primitives: ti.i32, block: ti.i32):
    """Return the cost, and the last bin of the left side, of the best plane between the BINS bins of an axis.

    Args:
        count: Number of primitives of each bin.
        lows: Lowest corners of the bins, [BINS, 3].
        highs: Highest corners.
        primitives: Number of primitives of all bins.
        block: Number of primitives that are tested at once.
    """
    best = ti.math.inf
    best_bin = 0
    right = ti.Vector([0.0] * BINS)
    box_low = ti.Vector([FAR, FAR, FAR])
    box_high = -box_low
    total = 0
    for step in range(BINS - 1):
        b = BINS - 1 - step
        total += count[b]
        for c in ti.static(range(3)):
            box_low[c] = ti.min(box_low[c], lows[b, c])
            box_high[c] = ti.max(box_high[c], highs[b, c])
        right[b] = 0.0
        if total > 0:
            right[b] = half_area(box_low, box_high) * blocks(total, block)
    box_low = ti.Vector([FAR, FAR, FAR])
    box_high = -box_low
    total = 0
    for b in range(BINS - 1):
        total += count[b]
        for c in ti.static(range(3)):
            box_low[c] = ti.min(box_low[c], lows[b, c])
            box_high[c] = ti.max(box_high[c], highs[b, c])
        if total > 0 and total < primitives:
            cost = half_area(box_low, box_high) * blocks(total, block) + right[b + 1]
            if cost < best:
                best = cost
                best_bin = b
    return best, best_bin


@ti.func
def choose_split(boxes: Template, begin: ti.i32, end: ti.i32, low: Template, size: Template, block: ti.i32):
    """Return axis, last bin of the left side and cost of the best of 3 * (BINS - 1) split planes; axis -1 for none."""
    best = ti.math.inf
    best_axis = -1
    best_bin = 0
    count = ti.Vector([0] * BINS)
    lows = ti.Matrix([[FAR] * 3] * BINS)
    highs = ti.Matrix([[-FAR] * 3] * BINS)
    for axis in range(3):
        if size[axis] > 1e-30:
            scale = BINS * 0.99999 / size[axis]
            for b in range(BINS):
                count[b] = 0
                for c in ti.static(range(3)):
                    lows[b, c] = FAR
                    highs[b, c] = -FAR
            for i in range(begin, end):
                b = bin_of(boxes, i, axis, low[axis], scale)
                count[b] += 1
                for c in ti.static(range(3)):
                    lows[b, c] = ti.min(lows[b, c], boxes[i, c])
                    highs[b, c] = ti.max(highs[b, c], boxes[i, 3 + c])
            cost, last = best_plane(count, lows, highs, end - begin, block)
            if cost < best:
                best = cost
                best_axis = axis
                best_bin = last
    return best_axis, best_bin, best


@ti.func
def partition(boxes: Template, order: Template, begin: ti.i32, end: ti.i32, axis, last, low: ti.f32, scale):
    """Move the primitives of bins 0 to `last` to the front; return where the others begin."""
    i = begin
    j = end - 1
    while i <= j:
        if bin_of(boxes, i, axis, low, scale) <= last:
            i += 1
        else:
            for c in ti.static(range(6)):
                boxes[i, c], boxes[j, c] = boxes[j, c], boxes[i, c]
            order[i], order[j] = order[j], order[i]
            j -= 1
    return i


@ti.func
def split(
    boxes: Template,
    order: Template,
    node_box: Template,
    slot: ti.i32,
    begin: ti.i32,
    end: ti.i32,
    depth: ti.i32,
    sah_depth: ti.i32,
    leaf_size: ti.i32,
    block: ti.i32,
    node_cost: ti.f32,
) -> ti.i32:
    """Set a node's box, partition its primitives into two sides, and return where the second begins; -1 for a leaf."""
    low = ti.Vector([FAR, FAR, FAR])
    high = -low
    center_low = low
    center_high = -low
    for i in range(begin, end):
        for c in ti.static(range(3)):
            a = boxes[i, c]
            b = boxes[i, 3 + c]
            low[c] = ti.min(low[c], a)
            high[c] = ti.max(high[c], b)
            center_low[c] = ti.min(center_low[c], a + b)
            center_high[c] = ti.max(center_high[c], a + b)
    for c in ti.static(range(3)):
        node_box[slot, c] = low[c]
        node_box[slot, 3 + c] = high[c]
    middle = -1
    count = end - begin
    if count > 1:
        size = center_high - center_low
        axis = -1
        last = 0
        cost = 0.0
        if depth < sah_depth and count > 2:
            axis, last, cost = choose_split(boxes, begin, end, center_low, size, block)
        area = half_area(low, high)
        worthwhile = axis >= 0 and cost + node_cost * area < area * blocks(count, block)
        if worthwhile or count > leaf_size:
            middle = (begin + end) // 2
            if axis >= 0:
                scale = BINS * 0.99999 / size[axis]
                middle = partition(boxes, order, begin, end, axis, last, center_low[axis], scale)
    return middle


@ti.kernel
def grow(
    boxes: Floats2,
    order: Ints1,
    node_box: Floats2,
    node_link: Ints2,
    tasks: Ints2,
    first: ti.i32,
    count: ti.i32,
    stop: ti.i32,
    sah_depth: ti.i32,
    leaf_size: ti.i32,
    block: ti.i32,
    node_cost: ti.f32,
) -> ti.i32:
    """Grow the binary trees below `tasks[first .. first + count)`.

    Args:
        boxes: Boxes of the primitives, [n, 6]; sorted along with `order`.
        order: Primitives, [n].
        node_box: Receives the box of each slot.
        node_link: Receives left slot (-1 for a leaf), right slot, first primitive and number of primitives.
        tasks: Rows of (slot, begin, end, depth).
        first: First task.
        count: Number of tasks.
        stop: Ranges of at most this number of primitives are not split but appended as tasks. 0, unless count is 1.
        sah_depth: Below this depth, ranges are halved instead of split by SAH.
        leaf_size: Upper limit of primitives in a leaf.
        block: Number of primitives that are tested at once.
        node_cost: Cost of visiting a node, in units of testing one block.

    Returns:
        The number of appended tasks.
    """
    found, taken = 0, 0
    ti.loop_config(block_dim=1)  # on GPUs, where threads of a block would wait for the longest item of all
    for iteration in range(iterations_of_long_items(count)):
        item, last_item = first_items(taken, iteration, count, 1)
        while item < last_item:
            task = first + item
            stack = ti.Matrix([[0] * 4] * STACK)
            for c in ti.static(range(4)):
                stack[0, c] = tasks[task, c]
            depth_of_stack = 1
            while depth_of_stack > 0:
                top = depth_of_stack - 1
                slot = stack[top, 0]
                begin = stack[top, 1]
                end = stack[top, 2]
                depth = stack[top, 3]
                depth_of_stack -= 1
                if end - begin <= stop:
                    for c in ti.static(range(4)):
                        tasks[first + count + found, c] = stack[top, c]
                    found += 1
                else:
                    middle = split(
                        boxes, order, node_box, slot, begin, end, depth, sah_depth, leaf_size, block, node_cost
                    )
                    node_link[slot, 0] = -1
                    node_link[slot, 1] = -1
                    node_link[slot, 2] = begin
                    node_link[slot, 3] = end - begin
                    if middle >= 0:
                        left = slot + 1
                        right = slot + 2 * (middle - begin)
                        node_link[slot, 0] = left
                        node_link[slot, 1] = right
                        for side, s, b, e in ti.static(((0, right, middle, end), (1, left, begin, middle))):
                            stack[top + side, 0] = s
                            stack[top + side, 1] = b
                            stack[top + side, 2] = e
                            stack[top + side, 3] = depth + 1
                        depth_of_stack += 2
            item, last_item = next_item(taken, item, last_item, count, 1)
    return found
