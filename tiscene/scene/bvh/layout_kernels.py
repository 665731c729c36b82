# SPDX-License-Identifier: Apache-2.0
"""Kernels that turn a binary tree of boxes (`build_kernels`) into the nodes and leaf blocks that rays traverse."""

import taichi as ti

from tiscene.device.kernel_types import Float4s1, Float8s1, Floats2, Ints1, Ints2, Template
from tiscene.scene.bvh.build_kernels import FAR, box_of, half_area

BLOCK_ROWS = 10  # of a leaf block, see `write_leaf_blocks`

# Of the layout "bvh8": an empty node whose first two references mark the end of an instance and of a ray
# (`render.intersect.bvh8_any_hit`).
GUARD_NODE = 1
MAX_NODES = 1 << 23  # so that a node's first row and a bit for each child fit one i32
END_OF_INSTANCE, END_OF_RAY = -(1 << 31), 1 - (1 << 31)


@ti.kernel
def collapse(
    order: Ints1,
    node_box: Floats2,
    node_link: Ints2,
    children: Ints2,
    stack: Ints2,
    roots: Ints2,
    found: Ints2,
    of_instances: ti.i32,
    by_count: ti.i32,
):
    """Merge the binary nodes of trees into nodes of up to 8 children, numbered depth first, tree after tree.

    The child with the largest area is opened first.

    Args:
        order: Primitives in the order of the leaves.
        node_box: Boxes of the binary nodes, by slot.
        node_link: Links of the binary nodes, by slot (`build_kernels.grow`). Column 2 of an inner slot becomes its
            merged node, column 1 of a leaf its instance or leaf block.
        children: Receives the slots of each node's children, -1 for none.
        stack: Scratch.
        roots: Column 0 holds the slot of each tree's root.
        found: Receives, for each tree, the numbers of nodes and leaf blocks up to it, and the most entries that its
            traversal can have on the stack.
        of_instances: 1: a leaf is one instance; 0: a leaf block with all of its triangles.
        by_count: 1: the child with the most primitives is opened first.
    """
    ti.loop_config(serialize=True)
    for tree in range(found.shape[0]):
        nodes = 0
        leaf_blocks = 0
        if tree > 0:
            nodes = found[tree - 1, 0]
            leaf_blocks = found[tree - 1, 1]
        max_stack = 0
        stack[0, 0] = roots[tree, 0]
        stack[0, 1] = 0
        pending = 1
        while pending > 0:
            pending -= 1
            slot = stack[pending, 0]
            stacked = stack[pending, 1]
            opened = ti.Vector([-1] * 8)
            opened[0] = slot
            count = 1
            candidate = 0
            while candidate >= 0 and count < 8:
                candidate = -1
                largest = -1.0
                for k in range(count):
                    s = opened[k]
                    if node_link[s, 0] >= 0:
                        low, high = box_of(node_box, s)
                        measure = half_area(low, high)
                        if by_count > 0:
                            measure = ti.cast(node_link[s, 3], ti.f32)
                        if measure > largest:
                            largest = measure
                            candidate = k
                if candidate >= 0:
                    s = opened[candidate]
                    opened[candidate] = node_link[s, 0]
                    opened[count] = node_link[s, 1]
                    count += 1
            if node_link[slot, 0] >= 0:
                node_link[slot, 2] = nodes
            stacked += count - 1
            max_stack = ti.max(max_stack, stacked)
            for k in range(8):
                s = opened[k]
                children[nodes, k] = s
                if s >= 0:
                    if node_link[s, 0] >= 0:
                        stack[pending, 0] = s
                        stack[pending, 1] = stacked
                        pending += 1
                    elif of_instances > 0:
                        node_link[s, 1] = order[node_link[s, 2]]
                    else:
                        node_link[s, 1] = leaf_blocks
                        leaf_blocks += 1
            nodes += 1
        found[tree, 0] = nodes
        found[tree, 1] = leaf_blocks
        found[tree, 2] = max_stack


@ti.kernel
def write_bvh8_nodes(
    node_box: Floats2,
    node_link: Ints2,
    children: Ints2,
    count: ti.i32,
    nodes: Float8s1,
    first_node: ti.i32,
    first_leaf: ti.i32,
    leaf_rows: ti.i32,
):
    """Write nodes of the layout "bvh8": eight rows each, with a lane for each child.

    Rows 0 to 2 are the lowest x, y and z, rows 3 to 5 the highest, row 6 references (bits of int32), row 7 infinity.
    Without a child, the box is inverted, the reference 0 and row 7 is -1. A reference is the first row of an inner
    node, or -1 - first row of a leaf; leaves have `leaf_rows` rows each, from leaf `first_leaf` on.
    """
    for node in range(count):
        at = 8 * (first_node + node)
        for k in range(8):
            for c in range(3):
                nodes[at + c][k] = FAR
                nodes[at + 3 + c][k] = -FAR
            nodes[at + 6][k] = 0.0
            nodes[at + 7][k] = -1.0
            slot = children[node, k]
            if slot >= 0:
                nodes[at + 7][k] = ti.math.inf
                for c in range(6):
                    nodes[at + c][k] = node_box[slot, c]
                reference = 8 * (first_node + node_link[slot, 2])
                if node_link[slot, 0] < 0:
                    reference = -1 - (first_leaf + node_link[slot, 1]) * leaf_rows
                nodes[at + 6][k] = ti.bit_cast(reference, ti.f32)


@ti.kernel
def write_guard(nodes: Float8s1):
    """Write the first two references of the empty GUARD_NODE."""
    nodes[8 * GUARD_NODE + 6][0] = ti.bit_cast(END_OF_INSTANCE, ti.f32)
    nodes[8 * GUARD_NODE + 6][1] = ti.bit_cast(END_OF_RAY, ti.f32)


@ti.kernel
def write_leaf_blocks(
    positions: Floats2,
    triangles: Ints2,
    order: Ints1,
    node_link: Ints2,
    children: Ints2,
    count: ti.i32,
    leaf_blocks: Float4s1,
    first_block: ti.i32,
    first_triangle: ti.i32,
):
    """Write leaf blocks: ten rows with a lane for each of up to four triangles, in ascending order.

    Rows 0 to 8 are the coordinates of three vertices, row 9 the scene's triangle (bits of int32), -1 for none.
    """
    for node, k in ti.ndrange(count, 8):
        slot = children[node, k]
        if slot >= 0:
            if node_link[slot, 0] < 0:
                at = BLOCK_ROWS * (first_block + node_link[slot, 1])
                begin = node_link[slot, 2]
                size = node_link[slot, 3]
                sort(order, begin, begin + size)
                for lane in range(4):
                    for row in range(9):
                        leaf_blocks[at + row][lane] = 0.0
                    triangle = -1
                    if lane < size:
                        local = order[begin + lane]
                        triangle = first_triangle + local
                        for corner, c in ti.ndrange(3, 3):
                            leaf_blocks[at + 3 * corner + c][lane] = positions[triangles[local, corner], c]
                    leaf_blocks[at + 9][lane] = ti.bit_cast(triangle, ti.f32)


@ti.func
def sort(order: Template, begin: ti.i32, end: ti.i32):
    """Sort a range in ascending order, by insertion."""
    for i in range(begin + 1, end):
        j = i
        while j > begin and order[j - 1] > order[j]:
            order[j - 1], order[j] = order[j], order[j - 1]
            j -= 1


@ti.kernel
def write_triangles(
    positions: Floats2,
    triangles: Ints2,
    order: Ints1,
    count: ti.i32,
    rows: Floats2,
    first_row: ti.i32,
    first_triangle: ti.i32,
):
    """Write triangles of the layout "bvh2", in the order of the leaves: 12 numbers each.

    Vertex 0, the scene's triangle (bits of int32), vertex 1, unused, vertex 2, unused.
    """
    for i in range(count):
        local = order[i]
        at = first_row + i
        rows[at, 3] = ti.bit_cast(first_triangle + local, ti.f32)
        rows[at, 7] = 0.0
        rows[at, 11] = 0.0
        for corner, c in ti.static(ti.ndrange(3, 3)):
            rows[at, 4 * corner + c] = positions[triangles[local, corner], c]


@ti.kernel
def write_rows(numbers: Ints1, values: Ints2, nodes: Floats2):
    """Write nodes of the layout "bvh2": values[i], 16 bit patterns, to row numbers[i]."""
    for i, column in ti.ndrange(numbers.shape[0], 16):
        nodes[numbers[i], column] = ti.bit_cast(values[i, column], ti.f32)
