# SPDX-License-Identifier: Apache-2.0
"""Kernels that refit the tree of a deforming mesh: new vertices, the triangles in its leaves, and the boxes above them.

The tree keeps its topology. Nodes of the layout "bvh8" are refitted from last to first, since children have higher
numbers than parents (`layout_kernels`); those of the layout "bvh2", for GPUs, level by level.
"""

import taichi as ti

from tiscene.device.kernel_types import Float4s1, Float8s1, Floats2, Ints1, Ints2
from tiscene.scene.bvh.build_kernels import FAR, MARGIN
from tiscene.scene.bvh.layout_kernels import BLOCK_ROWS


@ti.kernel
def write_vertices(
    positions: Floats2,
    normals: Floats2,
    has_normals: ti.i32,
    first: ti.i32,
    vertex_position: Floats2,
    vertex_normal: Floats2,
):
    """Write a mesh's vertices to the scene's rows from `first` on. Normals are normalized."""
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
    offset: ti.i32,
):
    """Write the triangles of leaf blocks again. `offset` is added to each row of `triangle_vertices`."""
    for block in range(count):
        at = BLOCK_ROWS * (first + block)
        for lane in ti.static(range(4)):
            triangle = ti.bit_cast(leaf_blocks[at + 9][lane], ti.i32)
            if triangle >= 0:
                for corner, c in ti.static(ti.ndrange(3, 3)):
                    vertex = triangle_vertices[triangle, corner] + offset
                    leaf_blocks[at + 3 * corner + c][lane] = vertex_position[vertex, c]


@ti.kernel
def refit_bvh8(nodes: Float8s1, first: ti.i32, count: ti.i32, leaf_blocks: Float4s1):
    """Fit the boxes of consecutive nodes, from the last to the first."""
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
                    block = -1 - child
                    for lane in ti.static(range(4)):
                        if ti.bit_cast(leaf_blocks[block + 9][lane], ti.i32) >= 0:
                            for corner, c in ti.static(ti.ndrange(3, 3)):
                                value = leaf_blocks[block + 3 * corner + c][lane]
                                low[c] = ti.min(low[c], value)
                                high[c] = ti.max(high[c], value)
                    margin = ti.max(MARGIN * ti.max(ti.abs(low), ti.abs(high)).max(), 1e-12)
                    low -= margin
                    high += margin
                for c in ti.static(range(3)):
                    nodes[at + c][k] = low[c]
                    nodes[at + 3 + c][k] = high[c]


@ti.kernel
def refit_triangles(
    rows: Floats2, first: ti.i32, count: ti.i32, vertex_position: Floats2, triangle_vertices: Ints2, offset: ti.i32
):
    """Write the triangles of the layout "bvh2" again; `offset` as for `refit_leaf_blocks`."""
    for row in range(first, first + count):
        triangle = ti.bit_cast(rows[row, 3], ti.i32)
        for corner, c in ti.static(ti.ndrange(3, 3)):
            rows[row, 4 * corner + c] = vertex_position[triangle_vertices[triangle, corner] + offset, c]


@ti.kernel
def refit_bvh2(nodes: Floats2, order: Ints1, first: ti.i32, count: ti.i32, rows: Floats2):
    """Fit the boxes of the nodes order[first .. first + count), none of which is below another one."""
    for turn in range(count):
        at = order[first + turn]
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
                    margin = ti.max(MARGIN * ti.max(ti.abs(low), ti.abs(high)).max(), 1e-12)
                    low -= margin
                    high += margin
                for c in ti.static(range(3)):
                    nodes[at, 6 * k + c] = low[c]
                    nodes[at, 6 * k + 3 + c] = high[c]
