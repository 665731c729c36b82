# SPDX-License-Identifier: Apache-2.0
"""Which of many rays come near the movers: eight boxes at once. Compiled in vector mode (see intersect/wide.py)."""

import taichi as ti

from tiscene.device.kernel_types import Float8s1, Ints1, Template
from tiscene.render.integrators.path.path_state import chunk_size
from tiscene.render.intersect.bvh8 import slabs
from tiscene.render.intersect.ray_queue import Rays


@ti.func
def add_up(chunks: Template, count: ti.i32):
    """Numbers of chunks to where each chunk begins, and the sum of all behind them. For one thread."""
    total = 0
    for chunk in range(count):
        here = chunks[chunk]
        chunks[chunk] = total
        total += here
    chunks[count] = total


@ti.kernel
def find_near(rays: Rays, count: ti.i32, boxes: Float8s1, near: Ints1, candidates: Ints1, chunks: Ints1) -> ti.i32:
    """Rows whose rays come near one of the boxes, in order, to `candidates`; near[row] says so too. Returns how many.

    boxes: 6 vectors: least x, y, z and greatest x, y, z of eight boxes.
    """
    size = chunk_size(count)
    chunk_count = (count + size - 1) // size
    for chunk in range(chunk_count):
        found = 0
        for row in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            ox, oy, oz = rays[row][0], rays[row][1], rays[row][2]
            ix, iy, iz, fx, fy, fz, near_x, near_y, near_z = slabs(rays[row][4], rays[row][5], rays[row][6])
            enters = ti.max(
                ti.max((boxes[near_x] - ox) * ix, (boxes[near_y] - oy) * iy), ti.max((boxes[near_z] - oz) * iz, 0.0)
            )
            leaves = ti.min(
                ti.min((boxes[3 - near_x] - ox) * fx, (boxes[5 - near_y] - oy) * fy),
                ti.min((boxes[7 - near_z] - oz) * fz, rays[row][7]),
            )
            inside = leaves - enters
            best = inside[0]
            for k in ti.static(range(1, 8)):
                best = ti.max(best, inside[k])
            answer = ti.select(best >= 0.0, 1, 0)
            near[row] = answer
            found += answer
        chunks[chunk] = found
    ti.loop_config(serialize=True)
    for _ in range(1):
        add_up(chunks, chunk_count)
    for chunk in range(chunk_count):
        at = chunks[chunk]
        if chunks[chunk + 1] > at:
            for row in range(chunk * size, ti.min(count, (chunk + 1) * size)):
                if near[row] > 0:
                    candidates[at] = row
                    at += 1
    return chunks[chunk_count]
