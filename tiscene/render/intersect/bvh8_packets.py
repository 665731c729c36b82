# SPDX-License-Identifier: Apache-2.0
"""Packets of sixteen coherent camera rays in the 8-wide BVH; same hits as `bvh8.closest`, bit for bit (CPU).

Boxes are tested against all directions of a packet at once, by interval arithmetic; triangles against the sixteen
rays, one per lane (Wald et al., "Interactive Rendering with Coherent Ray Tracing", 2001). Rays are traced one by one
where they are not coherent, where their directions have different largest axes in an instance's space, and where the
packet tests too many triangles.

Compiled in vector mode only.
"""

import taichi as ti

from dynamics.balanced_loops import first_items, iterations, next_item
from tiscene.device.kernel_types import Float4s1, Float8s1, Floats3, Ints1, Ints2, Template, float8
from tiscene.render.intersect.bvh8 import (
    INFINITY,
    LARGEST,
    STACK,
    entry_column,
    fast_max,
    fast_min,
    intersect_sheared,
    trace,
)
from tiscene.render.intersect.ray_queue import HitIds, Hits, Rays, write_hit
from tiscene.scene.bvh.rebraid import ROW_MASK

LANES = 16
lanes = ti.types.vector(LANES, ti.f32)
int_lanes = ti.types.vector(LANES, ti.i32)

MAX_SPREAD = 0.01  # of the directions of a packet along each axis, about two pixels; above, single rays are faster
MAX_LEAF_BLOCKS = 16  # tested by a packet; with triangles as small as pixels single rays are faster
MARGIN = 1e-6  # relative enlargement of intervals, more than their rounding error
FAR_SLACK = 1.00001  # factor of far planes


@ti.func
def interval(center: ti.f32, radius: ti.f32):
    """Return the range of reciprocals of a direction's coordinate within `radius` of `center`.

    Returns:
        (minimum, maximum, number to add to the far distance, row of the near planes). Where the coordinate can be 0,
        the axis constrains nothing.
    """
    low = center - radius
    high = center + radius
    minimum, maximum, far_offset, near = 0.0, 0.0, LARGEST, 0
    if low > 1e-18 or high < -1e-18:
        minimum = 1.0 / high
        maximum = 1.0 / low
        far_offset = 0.0
        near = ti.select(high < 0.0, 3, 0)
    return minimum, maximum, far_offset, near


@ti.func
def matrix_row(transforms: Template, time: ti.i32, instance: ti.i32, first: Template):
    """Return the four columns of a matrix from `first` on."""
    return (
        transforms[time, instance, first],
        transforms[time, instance, first + 1],
        transforms[time, instance, first + 2],
        transforms[time, instance, first + 3],
    )


@ti.func
def max_lane(v):
    """Return the maximum of the lanes."""
    a = fast_max(fast_max(v[0], v[1]), fast_max(v[2], v[3]))
    b = fast_max(fast_max(v[4], v[5]), fast_max(v[6], v[7]))
    c = fast_max(fast_max(v[8], v[9]), fast_max(v[10], v[11]))
    d = fast_max(fast_max(v[12], v[13]), fast_max(v[14], v[15]))
    return fast_max(fast_max(a, b), fast_max(c, d))


@ti.func
def intervals(cx: ti.f32, cy: ti.f32, cz: ti.f32, rx: ti.f32, ry: ti.f32, rz: ti.f32):
    """Prepare slab tests of all directions within (rx, ry, rz) of (cx, cy, cz): the results of `interval` per axis."""
    lx, mx, jx, near_x = interval(cx, rx)
    ly, my, jy, near_y = interval(cy, ry)
    lz, mz, jz, near_z = interval(cz, rz)
    return lx, mx, jx, near_x, ly, my, jy, near_y + 1, lz, mz, jz, near_z + 2


@ti.func
def shear_packet(
    ox: ti.f32, oy: ti.f32, oz: ti.f32, dx, dy, dz, cx: ti.f32, cy: ti.f32, cz: ti.f32, rx: ti.f32, ry: ti.f32,
    rz: ti.f32,
):  # fmt: skip
    """Prepare triangle tests of a packet, as `bvh8.shear` does of a ray.

    Args:
        ox, oy, oz: Origin.
        dx, dy, dz: Directions, one per lane.
        cx, cy, cz: Their center.
        rx, ry, rz: Their radius around it.

    Returns:
        What `bvh8.shear` returns, and whether the largest axis of all directions is the same.
    """
    px, py, pz, kx, ky, kz = ox, oy, oz, 0, 1, 2
    shx, shy, scale = dx, dy, lanes(0.0)
    is_coherent = True
    ax, ay, az = ti.abs(cx), ti.abs(cy), ti.abs(cz)
    if ax - rx > fast_max(ay + ry, az + rz):
        px, py, pz, kx, ky, kz = oy, oz, ox, 1, 2, 0
        scale = 1.0 / dx
        shx, shy = dy * scale, dz * scale
    elif ay - ry > fast_max(ax + rx, az + rz):
        px, py, pz, kx, ky, kz = oz, ox, oy, 2, 0, 1
        scale = 1.0 / dy
        shx, shy = dz * scale, dx * scale
    elif az - rz > fast_max(ax + rx, ay + ry):
        scale = 1.0 / dz
        shx, shy = dx * scale, dy * scale
    else:
        is_coherent = False
    return px, py, pz, kx, ky, kz, shx, shy, scale, is_coherent


@ti.kernel
def closest(
    nodes: Float8s1,
    leaf_blocks: Float4s1,
    transforms: Floats3,
    instances: Ints2,
    time: ti.i32,
    root: ti.i32,
    rays: Rays,
    queue: Ints1,
    count: ti.i32,
    hits: Hits,
    hit_ids: HitIds,
):
    """Find the closest hits of rays; parameters as `trace.closest`."""
    # Per axis, c and r: center and radius of the packet's directions; l, m, j: results of `interval`.
    packets = (count + LANES - 1) // LANES
    taken = 0
    for iteration in range(iterations(packets)):
        next_packet, end_packet = first_items(taken, iteration, packets, 1)
        while next_packet < end_packet:
            packet = next_packet
            next_packet, end_packet = next_item(taken, packet, end_packet, packets, 1)
            references = ti.Vector([0] * STACK)
            distances = ti.Vector([0.0] * STACK)
            first = packet * LANES
            last = ti.min(count, first + LANES)
            low = rays[queue[first]]
            high = low
            for i in range(first + 1, last):
                low = fast_min(low, rays[queue[i]])
                high = fast_max(high, rays[queue[i]])
            extent = high - low
            is_packet = last - first == LANES and extent[0] == 0.0 and extent[1] == 0.0 and extent[2] == 0.0
            is_packet = is_packet and fast_max(fast_max(extent[4], extent[5]), extent[6]) < MAX_SPREAD
            if is_packet:
                rows = int_lanes([queue[first + k] for k in range(LANES)])
                dx = lanes([rays[rows[k]][4] for k in range(LANES)])
                dy = lanes([rays[rows[k]][5] for k in range(LANES)])
                dz = lanes([rays[rows[k]][6] for k in range(LANES)])
                best = fast_min(lanes([rays[rows[k]][7] for k in range(LANES)]), lanes(LARGEST))
                bound = max_lane(best) * FAR_SLACK
                b1 = lanes(0.0)
                b2 = lanes(0.0)
                hit_instance = int_lanes(-1)
                hit_triangle = int_lanes(-1)
                wox, woy, woz = low[0], low[1], low[2]
                cx, cy, cz = 0.5 * (low[4] + high[4]), 0.5 * (low[5] + high[5]), 0.5 * (low[6] + high[6])
                rx = 0.5 * extent[4] + MARGIN * ti.abs(cx)
                ry = 0.5 * extent[5] + MARGIN * ti.abs(cy)
                rz = 0.5 * extent[6] + MARGIN * ti.abs(cz)
                wlx, wmx, wjx, wnear_x, wly, wmy, wjy, wnear_y, wlz, wmz, wjz, wnear_z = intervals(
                    cx, cy, cz, rx, ry, rz
                )
                ox, oy, oz = wox, woy, woz
                lx, mx, jx, near_x = wlx, wmx, wjx, wnear_x
                ly, my, jy, near_y = wly, wmy, wjy, wnear_y
                lz, mz, jz, near_z = wlz, wmz, wjz, wnear_z
                px, py, pz, kx, ky, kz = ox, oy, oz, 0, 1, 2  # set on entering an instance
                shx, shy, shz = dx, dy, dz
                stack_size = 0
                tested_blocks = 0
                blas_base = -1
                instance = -1
                current = root
                searching = True
                while searching:
                    pop = False
                    while current >= 0 and not pop:
                        node = current
                        a = nodes[node + near_x] - ox
                        b = nodes[node + near_y] - oy
                        c = nodes[node + near_z] - oz
                        near = fast_max(
                            fast_max(fast_min(a * lx, a * mx), fast_min(b * ly, b * my)),
                            fast_max(fast_min(c * lz, c * mz), float8(0.0)),
                        )
                        a = nodes[node + 3 - near_x] - ox
                        b = nodes[node + 5 - near_y] - oy
                        c = nodes[node + 7 - near_z] - oz
                        far = fast_min(
                            fast_min(
                                fast_max(a * lx, a * mx) * FAR_SLACK + jx, fast_max(b * ly, b * my) * FAR_SLACK + jy
                            ),
                            fast_min(fast_max(c * lz, c * mz) * FAR_SLACK + jz, float8(bound)),
                        )
                        entry = ti.select(near <= far, near, float8(INFINITY))
                        nearest = INFINITY
                        found = False
                        for k in ti.static(range(8)):
                            distance = entry[k]
                            if distance < INFINITY:
                                child = ti.bit_cast(nodes[node + 6][k], ti.i32)
                                if found:
                                    closer = distance < nearest
                                    references[stack_size] = ti.select(closer, current, child)
                                    current = ti.select(closer, child, current)
                                    distances[stack_size] = ti.select(closer, nearest, distance)
                                    nearest = ti.select(closer, distance, nearest)
                                    stack_size += 1
                                else:
                                    current = child
                                    nearest = distance
                                    found = True
                        pop = not found
                    if not pop:
                        if blas_base < 0:
                            entered = -1 - current
                            instance = entered & ROW_MASK
                            m0, m1, m2, m3 = matrix_row(transforms, time, instance, 0)
                            m4, m5, m6, m7 = matrix_row(transforms, time, instance, 4)
                            m8, m9, m10, m11 = matrix_row(transforms, time, instance, 8)
                            ox = m0 * wox + m1 * woy + m2 * woz + m3
                            oy = m4 * wox + m5 * woy + m6 * woz + m7
                            oz = m8 * wox + m9 * woy + m10 * woz + m11
                            x0, x1, x2 = m0 * cx, m1 * cy, m2 * cz
                            y0, y1, y2 = m4 * cx, m5 * cy, m6 * cz
                            z0, z1, z2 = m8 * cx, m9 * cy, m10 * cz
                            ex, ey, ez = x0 + x1 + x2, y0 + y1 + y2, z0 + z1 + z2
                            sx = ti.abs(m0) * rx + ti.abs(m1) * ry + ti.abs(m2) * rz
                            sy = ti.abs(m4) * rx + ti.abs(m5) * ry + ti.abs(m6) * rz
                            sz = ti.abs(m8) * rx + ti.abs(m9) * ry + ti.abs(m10) * rz
                            sx += MARGIN * (ti.abs(x0) + ti.abs(x1) + ti.abs(x2))
                            sy += MARGIN * (ti.abs(y0) + ti.abs(y1) + ti.abs(y2))
                            sz += MARGIN * (ti.abs(z0) + ti.abs(z1) + ti.abs(z2))
                            lx, mx, jx, near_x, ly, my, jy, near_y, lz, mz, jz, near_z = intervals(
                                ex, ey, ez, sx, sy, sz
                            )
                            qx = m0 * dx + m1 * dy + m2 * dz
                            qy = m4 * dx + m5 * dy + m6 * dz
                            qz = m8 * dx + m9 * dy + m10 * dz
                            px, py, pz, kx, ky, kz, shx, shy, shz, is_coherent = shear_packet(
                                ox, oy, oz, qx, qy, qz, ex, ey, ez, sx, sy, sz
                            )
                            if not is_coherent:
                                is_packet = False
                                searching = False
                            blas_base = stack_size
                            current = instances[instance, entry_column(entered)]
                        else:
                            at = -1 - current
                            ax = leaf_blocks[at + kx] - px
                            ay = leaf_blocks[at + ky] - py
                            az = leaf_blocks[at + kz] - pz
                            bx = leaf_blocks[at + 3 + kx] - px
                            by = leaf_blocks[at + 3 + ky] - py
                            bz = leaf_blocks[at + 3 + kz] - pz
                            vx = leaf_blocks[at + 6 + kx] - px
                            vy = leaf_blocks[at + 6 + ky] - py
                            vz = leaf_blocks[at + 6 + kz] - pz
                            for k in range(4):
                                triangle = ti.bit_cast(leaf_blocks[at + 9][k], ti.i32)
                                if triangle >= 0:
                                    t, u, v = intersect_sheared(
                                        ax[k] - shx * az[k], ay[k] - shy * az[k], az[k],
                                        bx[k] - shx * bz[k], by[k] - shy * bz[k], bz[k],
                                        vx[k] - shx * vz[k], vy[k] - shy * vz[k], vz[k],
                                        shz, lanes(INFINITY),
                                    )  # fmt: skip
                                    lower = ti.select(hit_triangle > triangle, int_lanes(1), int_lanes(0))
                                    lower = ti.select(hit_instance == instance, lower, int_lanes(0))
                                    lower = ti.select(hit_instance > instance, int_lanes(1), lower)
                                    wins = ti.select(t == best, lower, int_lanes(0))
                                    wins = ti.select(t < best, int_lanes(1), wins)
                                    best = ti.select(wins > 0, t, best)
                                    b1 = ti.select(wins > 0, u, b1)
                                    b2 = ti.select(wins > 0, v, b2)
                                    hit_instance = ti.select(wins > 0, int_lanes(instance), hit_instance)
                                    hit_triangle = ti.select(wins > 0, int_lanes(triangle), hit_triangle)
                            bound = max_lane(best) * FAR_SLACK
                            pop = True
                            tested_blocks += 1
                            if tested_blocks > MAX_LEAF_BLOCKS:
                                is_packet = False
                                searching = False
                    while pop and searching:
                        if stack_size == blas_base:
                            blas_base = -1
                            ox, oy, oz = wox, woy, woz
                            lx, mx, jx, near_x = wlx, wmx, wjx, wnear_x
                            ly, my, jy, near_y = wly, wmy, wjy, wnear_y
                            lz, mz, jz, near_z = wlz, wmz, wjz, wnear_z
                        if stack_size == 0:
                            searching = False
                        else:
                            stack_size -= 1
                            if distances[stack_size] <= bound:
                                current = references[stack_size]
                                pop = False
                if is_packet:
                    for k in ti.static(range(LANES)):
                        write_hit(hits, hit_ids, rows[k], best[k], b1[k], b2[k], hit_instance[k], hit_triangle[k])
            if not is_packet:
                for i in range(first, last):
                    ray = queue[i]
                    t, u, v, instance, triangle = trace(
                        nodes, leaf_blocks, transforms, instances, time, root, rays, ray, references, distances
                    )
                    write_hit(hits, hit_ids, ray, t, u, v, instance, triangle)
