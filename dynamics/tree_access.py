# SPDX-License-Identifier: Apache-2.0
"""Read access to the two-level bounding volume hierarchy of obstacles: Taichi functions.

Nodes and triangles come in the two layouts of the ray tracer, bvh2 and bvh8 (see `dynamics.obstacles`). `is_bvh8` is a
compile-time constant.
"""

import taichi as ti

from dynamics.kernel_types import Template

vec2 = ti.types.vector(2, ti.f32)
vec3 = ti.types.vector(3, ti.f32)
Tree = ti.types.ndarray()  # nodes and triangles: element types depend on the layout

STACK = 112  # traversal depth that the builders of the trees guarantee


@ti.func
def vector_at(table: Template, row: ti.i32, column: ti.i32):
    """Return three consecutive columns of a float32 table."""
    return vec3(table[row, column], table[row, column + 1], table[row, column + 2])


@ti.func
def transformed(instances: Template, row: ti.i32, column: ti.i32, v, w: ti.f32):
    """Transform a point (w = 1) or a direction (w = 0) by the 3x4 matrix in `column` of an instance."""
    result = vec3(0.0)
    for i in ti.static(range(3)):
        at = column + ti.static(4 * i)
        result[i] = (
            instances[row, at] * v[0]
            + instances[row, at + 1] * v[1]
            + instances[row, at + 2] * v[2]
            + instances[row, at + 3] * w
        )
    return result


@ti.func
def child_bounds(nodes: Template, node: ti.i32, side: ti.i32, is_bvh8: Template):
    """Return one bound of the boxes of all children: 0 to 2 for the lower x, y, z, 3 to 5 for the upper."""
    if ti.static(is_bvh8):
        return nodes[node + side]
    else:
        return vec2(nodes[node, side], nodes[node, 6 + side])


@ti.func
def child_reference(nodes: Template, node: ti.i32, k: Template, is_bvh8: Template) -> ti.i32:
    """Return the reference of child `k`: a node, or a negative number for a leaf."""
    if ti.static(is_bvh8):
        return ti.bit_cast(nodes[node + 6][k], ti.i32)
    else:
        return ti.bit_cast(nodes[node, 12 + k], ti.i32)


@ti.func
def leaf_instance(leaf: ti.i32, is_bvh8: Template) -> ti.i32:
    """Return the instance that a leaf of the upper tree refers to."""
    if ti.static(is_bvh8):
        return -1 - leaf
    else:
        return (-1 - leaf) // 4


@ti.func
def leaf_triangles(triangles: Template, leaf: ti.i32, is_bvh8: Template):
    """Return the row of a leaf's first triangle, and the number of its triangles."""
    first = -1 - leaf
    count = 0
    if ti.static(is_bvh8):
        names = triangles[first + 9]
        for lane in ti.static(range(4)):
            if ti.bit_cast(names[lane], ti.i32) >= 0:
                count = lane + 1
    else:
        count = first % 4 + 1
        first = first // 4
    return first, count


@ti.func
def load_triangle(triangles: Template, first: ti.i32, which: ti.i32, is_bvh8: Template):
    """Return a corner of a triangle and the two edges from it, in the mesh's space."""
    corner, edge_1, edge_2 = vec3(0.0), vec3(0.0), vec3(0.0)
    if ti.static(is_bvh8):
        for c in ti.static(range(3)):
            corner[c] = triangles[first + c][which]
            edge_1[c] = triangles[first + 3 + c][which] - corner[c]
            edge_2[c] = triangles[first + 6 + c][which] - corner[c]
    else:
        corner = vector_at(triangles, first + which, 0)
        edge_1 = vector_at(triangles, first + which, 4) - corner
        edge_2 = vector_at(triangles, first + which, 8) - corner
    return corner, edge_1, edge_2
