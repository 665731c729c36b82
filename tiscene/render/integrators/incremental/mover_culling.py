# SPDX-License-Identifier: Apache-2.0
"""Culling of rays against the bounds of the movers, eight boxes at once.

Most rays of paths come near no mover. Of cached ones only the remaining candidates are tested, and paths that are
cached for one frame alone need not be traced on. Compiled in vector mode, see `tiscene.device.vector_mode`.
"""

import taichi as ti

from tiscene.device.kernel_types import Float8s1, Ints1, Template
from tiscene.device.prefix_sums import exclusive_scan
from tiscene.render.integrators.path.path_state import DEPTH_MASK, LIGHT_PENDING, LIVE, chunk_size
from tiscene.render.intersect.bvh8 import slabs
from tiscene.render.intersect.ray_queue import Rays


@ti.func
def is_near(rays: Template, row: ti.i32, boxes: Template) -> ti.i32:
    """Return 1 if a ray intersects one of eight boxes, else 0; `boxes` as of `cull_rays`."""
    ox, oy, oz = rays[row][0], rays[row][1], rays[row][2]
    ix, iy, iz, fx, fy, fz, near_x, near_y, near_z = slabs(rays[row][4], rays[row][5], rays[row][6])
    enters = ti.max(
        ti.max((boxes[near_x] - ox) * ix, (boxes[near_y] - oy) * iy), ti.max((boxes[near_z] - oz) * iz, 0.0)
    )
    leaves = ti.min(
        ti.min((boxes[3 - near_x] - ox) * fx, (boxes[5 - near_y] - oy) * fy),
        ti.min((boxes[7 - near_z] - oz) * fz, rays[row][7]),
    )
    overlap = leaves - enters
    best = overlap[0]
    for k in ti.static(range(1, 8)):
        best = ti.max(best, overlap[k])
    return ti.select(best >= 0.0, 1, 0)


@ti.kernel
def cull_rays(
    rays: Rays,
    count: ti.i32,
    boxes: Float8s1,
    near: Ints1,
    candidates: Ints1,
    chunks: Ints1,
    in_blocks: Template,
) -> ti.i32:
    """Find the rays that intersect one of eight boxes.

    Args:
        rays: The rays; count: their number.
        boxes: 6 vectors of 8: minimum x, y, z and maximum x, y, z of the boxes.
        near: Output, i32 [rows], 1 for rays that intersect a box, else 0.
        candidates: Output, i32 [rows], the rows of those rays in increasing order.
        chunks: Scratch, i32 [chunks_for(count)].
        in_blocks: Compile-time: see `exclusive_scan`.

    Returns:
        The number of candidates.
    """
    size = chunk_size(count)
    chunk_count = (count + size - 1) // size
    for chunk in range(chunk_count):
        found = 0
        for row in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            near[row] = is_near(rays, row, boxes)
            found += near[row]
        chunks[chunk] = found
    exclusive_scan(chunks, chunk_count, in_blocks)
    for chunk in range(chunk_count):
        at = chunks[chunk]
        if chunks[chunk + 1] > at:
            for row in range(chunk * size, ti.min(count, (chunk + 1) * size)):
                if near[row] > 0:
                    candidates[at] = row
                    at += 1
    return chunks[chunk_count]


@ti.kernel
def drop_far(queue: Ints1, count: ti.i32, rays: Rays, shadow_rays: Rays, boxes: Float8s1, status: Ints1):
    """End the paths that have left a surface along a ray that intersects none of eight boxes; drop such shadow rays.

    Args:
        queue: Rows of the paths; count: their number.
        rays, shadow_rays, status: Of the PathState.
        boxes: As of `cull_rays`.
    """
    for k in range(count):
        i = queue[k]
        if (status[i] & LIVE) != 0 and (status[i] & DEPTH_MASK) > 0:
            if is_near(rays, i, boxes) == 0:
                status[i] &= ~LIVE
        if (status[i] & LIGHT_PENDING) != 0:
            if is_near(shadow_rays, i, boxes) == 0:
                status[i] &= ~LIGHT_PENDING
