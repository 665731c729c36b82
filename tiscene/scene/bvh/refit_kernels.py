# SPDX-License-Identifier: Apache-2.0
"""Kernels that move a mesh: new vertices, the triangles that rays meet, and boxes of the same tree around them.

Each box is made of what is below it, from the last node to the first: children have higher numbers (bvh_write.py).
"""

import taichi as ti

from tiscene.device.kernel_types import Float4s1, Float8s1, Floats2, Ints2
from tiscene.scene.bvh.build_kernels import FAR

_MARGIN = 4e-7  # of a box's largest coordinate, as in bvh.py


@ti.kernel
def write_vertices(
    positions: Floats2,
    normals: Floats2,
    has_normals: ti.i32,
    first: ti.i32,
    vertex_position: Floats2,
    vertex_normal: Floats2,
):
    """Put a mesh's vertices into the scene's rows from `first` on."""
    for i in range(positions.shape[0]):
        for c in ti.static(range(3)):
            vertex_position[first + i, c] = positions[i, c]
        if has_normals > 0:
            n = ti.math.vec3(normals[i, 0], normals[i, 1], normals[i, 2])
            length = n.norm()
            if length > 0.0:
                n = n / length
            for c in ti.static(range(3)):
                vertex_normal[first + i, c] = n[c]


@ti.kernel
def refit_leaf_blocks(
    leaf_blocks: Float4s1,
    first: ti.i32,
    count: ti.i32,
    vertex_position: Floats2,
    triangle_vertices: Ints2,
    moved: ti.i32,
):
    """The wide layout's triangles. moved: how far behind its row of `triangle_vertices` each vertex is."""
    for pack in range(count):
        at = 10 * (first + pack)
        for lane in ti.static(range(4)):
            triangle = ti.bit_cast(leaf_blocks[at + 9][lane], ti.i32)
            if triangle >= 0:
                for corner, c in ti.static(ti.ndrange(3, 3)):
                    vertex = triangle_vertices[triangle, corner] + moved
                    leaf_blocks[at + 3 * corner + c][lane] = vertex_position[vertex, c]


@ti.kernel
def refit_wide(nodes: Float8s1, first: ti.i32, count: ti.i32, leaf_blocks: Float4s1):
    ti.loop_config(serialize=True)
    for turn in range(count):
        at = 8 * (first + count - 1 - turn)
        for k in ti.static(range(8)):
            child = ti.bit_cast(nodes[at + 6][k], ti.i32)
            if child != 0:
                low, high = ti.math.vec3(FAR), ti.math.vec3(-FAR)
                if child > 0:
                    for lane, c in ti.static(ti.ndrange(8, 3)):
                        low[c] = ti.min(low[c], nodes[child + c][lane])
                        high[c] = ti.max(high[c], nodes[child + 3 + c][lane])
                else:
                    pack = -1 - child
                    for lane in ti.static(range(4)):
                        if ti.bit_cast(leaf_blocks[pack + 9][lane], ti.i32) >= 0:
                            for corner, c in ti.static(ti.ndrange(3, 3)):
                                value = leaf_blocks[pack + 3 * corner + c][lane]
                                low[c] = ti.min(low[c], value)
                                high[c] = ti.max(high[c], value)
                    margin = ti.max(_MARGIN * ti.max(ti.abs(low), ti.abs(high)).max(), 1e-12)
                    low -= margin
                    high += margin
                for c in ti.static(range(3)):
                    nodes[at + c][k] = low[c]
                    nodes[at + 3 + c][k] = high[c]


@ti.kernel
def refit_triangles(
    rows: Floats2, first: ti.i32, count: ti.i32, vertex_position: Floats2, triangle_vertices: Ints2, moved: ti.i32
):
    """The binary layout's triangles; `moved` as for `refit_leaf_blocks`."""
    for row in range(first, first + count):
        triangle = ti.bit_cast(rows[row, 3], ti.i32)
        for corner, c in ti.static(ti.ndrange(3, 3)):
            rows[row, 4 * corner + c] = vertex_position[triangle_vertices[triangle, corner] + moved, c]


@ti.kernel
def refit_binary(nodes: Floats2, first: ti.i32, count: ti.i32, rows: Floats2):
    ti.loop_config(serialize=True)
    for turn in range(count):
        at = first + count - 1 - turn
        for k in ti.static(range(2)):
            child = ti.bit_cast(nodes[at, 12 + k], ti.i32)
            if child != 0:
                low, high = ti.math.vec3(FAR), ti.math.vec3(-FAR)
                if child > 0:
                    for c in ti.static(range(3)):
                        for other in ti.static(range(2)):
                            if ti.bit_cast(nodes[child, 12 + other], ti.i32) != 0:
                                low[c] = ti.min(low[c], nodes[child, 6 * other + c])
                                high[c] = ti.max(high[c], nodes[child, 6 * other + 3 + c])
                else:
                    code = -1 - child
                    for row in range(code // 4, code // 4 + code % 4 + 1):
                        for corner, c in ti.static(ti.ndrange(3, 3)):
                            low[c] = ti.min(low[c], rows[row, 4 * corner + c])
                            high[c] = ti.max(high[c], rows[row, 4 * corner + c])
                    margin = ti.max(_MARGIN * ti.max(ti.abs(low), ti.abs(high)).max(), 1e-12)
                    low -= margin
                    high += margin
                for c in ti.static(range(3)):
                    nodes[at, 6 * k + c] = low[c]
                    nodes[at, 6 * k + 3 + c] = high[c]
