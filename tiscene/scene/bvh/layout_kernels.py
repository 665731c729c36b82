# SPDX-License-Identifier: Apache-2.0
"""Kernels that turn a binary tree of boxes (bvh_build.py) into the nodes and triangles that rays meet."""

import taichi as ti

from tiscene.device.kernel_types import Float4s1, Float8s1, Floats2, Ints1, Ints2, Template
from tiscene.scene.bvh.build_kernels import FAR, box_of, half_area

NAME, LEAF_BLOCK, ROWS = 0, 1, 2  # what a leaf refers to: its only primitive, one pack of all, a row for each

# Of the wide layout: an empty node whose first two references are what is at the end of an instance and of a ray
# (render/intersect/any_hit.py).
GUARD_NODE = 1
MOST_NODES = 1 << 23  # so that a node's first row and a bit for each child are one i32
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
    width: ti.i32,
    leaf_kind: ti.i32,
    by_count: ti.i32,
):
    """Merge the binary nodes of trees into nodes of up to `width` children, numbered depth first, tree after tree.

    roots: the slot of each tree's root, in the first column. found: for each tree how many nodes and leaf blocks
    there are so far, it included, and the most entries that a traversal of it can have on its stack.

    children[node]: slots, -1 for none. The child with the largest area (by_count: the most primitives) is opened first.
    In node_link column 2 of an inner slot becomes its wide node, column 1 of a leaf what `leaf_kind` says.
    """
    ti.loop_config(serialize=True)
    for tree in range(found.shape[0]):
        nodes = 0
        leaf_blocks = 0
        if tree > 0:
            nodes = found[tree - 1, 0]
            leaf_blocks = found[tree - 1, 1]
        deepest = 0
        stack[0, 0] = roots[tree, 0]
        stack[0, 1] = 0
        waiting = 1
        while waiting > 0:
            waiting -= 1
            slot = stack[waiting, 0]
            below = stack[waiting, 1]
            opened = ti.Vector([-1] * 8)
            opened[0] = slot
            count = 1
            candidate = 0
            while candidate >= 0 and count < width:
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
            below += count - 1
            deepest = ti.max(deepest, below)
            for k in range(8):
                s = opened[k]
                children[nodes, k] = s
                if s >= 0:
                    if node_link[s, 0] >= 0:
                        stack[waiting, 0] = s
                        stack[waiting, 1] = below
                        waiting += 1
                    elif leaf_kind == NAME:
                        node_link[s, 1] = order[node_link[s, 2]]
                    elif leaf_kind == LEAF_BLOCK:
                        node_link[s, 1] = leaf_blocks
                        leaf_blocks += 1
                    else:
                        node_link[s, 1] = node_link[s, 2]
            nodes += 1
        found[tree, 0] = nodes
        found[tree, 1] = leaf_blocks
        found[tree, 2] = deepest


@ti.kernel
def write_wide_nodes(
    node_box: Floats2,
    node_link: Ints2,
    children: Ints2,
    count: ti.i32,
    nodes: Float8s1,
    first_node: ti.i32,
    first_leaf: ti.i32,
    leaf_rows: ti.i32,
):
    """Eight rows a node, a lane for each child: least x, y, z, greatest x, y, z, references (bits of int32), infinity.

    Where there is no child the box is inverted, the reference 0, the last row -1.
    A reference is the first row of an inner node, or -1 - row of a leaf: `leaf_rows` rows each from `first_leaf` on.
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
    """Make the first two references of the empty GUARD_NODE what they are."""
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
    """Ten rows a pack of up to four triangles: their vertices, global triangle (bits of int32), ascending."""
    for node, k in ti.ndrange(count, 8):
        slot = children[node, k]
        if slot >= 0:
            if node_link[slot, 0] < 0:
                at = 10 * (first_block + node_link[slot, 1])
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
    for i in range(begin + 1, end):
        j = i
        while j > begin and order[j - 1] > order[j]:
            order[j - 1], order[j] = order[j], order[j - 1]
            j -= 1


@ti.kernel
def write_binary_nodes(
    node_box: Floats2,
    node_link: Ints2,
    children: Ints2,
    count: ti.i32,
    nodes: Floats2,
    first_node: ti.i32,
    first_leaf: ti.i32,
):
    """Sixteen numbers a node: the boxes of two children (least x, y, z, greatest x, y, z), their references, nothing.

    A reference is an inner node, or -1 - (4 * first row + rows - 1) of a leaf.
    """
    for node, k in ti.ndrange(count, 2):
        at = first_node + node
        for c in ti.static(range(3)):
            nodes[at, 6 * k + c] = ti.math.inf  # a box that no ray reaches, whichever way it goes
            nodes[at, 6 * k + 3 + c] = ti.math.inf
        nodes[at, 12 + k] = 0.0
        nodes[at, 14 + k] = 0.0
        slot = children[node, k]
        if slot >= 0:
            for c in ti.static(range(6)):
                nodes[at, 6 * k + c] = node_box[slot, c]
            reference = first_node + node_link[slot, 2]
            if node_link[slot, 0] < 0:
                reference = -4 * (first_leaf + node_link[slot, 1]) - node_link[slot, 3]
            nodes[at, 12 + k] = ti.bit_cast(reference, ti.f32)


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
    """Twelve numbers a triangle, in the order of the leaves: vertex 0, its global number (bits), vertices 1 and 2."""
    for i in range(count):
        local = order[i]
        at = first_row + i
        rows[at, 3] = ti.bit_cast(first_triangle + local, ti.f32)
        rows[at, 7] = 0.0
        rows[at, 11] = 0.0
        for corner, c in ti.static(ti.ndrange(3, 3)):
            rows[at, 4 * corner + c] = positions[triangles[local, corner], c]
