# SPDX-License-Identifier: Apache-2.0
"""Closest hits in an 8-wide BVH: one ray against eight boxes, or four triangles, with SIMD vectors (CPU).

Boxes: slab test (plane - origin) / direction, with far planes enlarged by more than the rounding error, so that no hit
is lost (Ize, "Robust BVH Ray Traversal", 2013). Triangles: watertight test (Woop, Benthin and Wald 2013); triangles
with a common edge compute the same edge function, so that no ray passes between them.

Compiled in vector mode only (`tiscene.device.vector_mode`).
"""

import taichi as ti

from dynamics.balanced_loops import first_items, iterations, next_item
from tiscene.device.kernel_types import Float4s1, Float8s1, Floats3, Ints1, Ints2, Template, float4, float8, int8
from tiscene.render.intersect.bvh2 import reciprocal
from tiscene.render.intersect.ray_queue import HitIds, Hits, Rays, write_hit
from tiscene.scene.bvh.rebraid import INFO_PARTS, ROW_BITS, ROW_MASK

TASK_RAYS = 32  # rays of one task, which share a stack: Taichi clears it where it is declared
MIN_TASKS = 1 << 8  # of a loop over many rays
STACK = 112  # a BLAS and a TLAS need at most 56 entries each (tiscene.scene.bvh.workspace)
SLACK = 1.000002  # factor of far planes and t_max
INFINITY = ti.math.inf
LARGEST = 3e38


@ti.func
def fast_max(a, b):
    """Return the maximum in one instruction; `ti.max` takes two more for its handling of NaN."""
    return ti.select(a > b, a, b)


@ti.func
def fast_min(a, b):
    """Return the minimum in one instruction."""
    return ti.select(a < b, a, b)


@ti.func
def mask_bits(condition) -> ti.i32:
    """Return an 8-bit mask of the lanes in which a comparison holds; lane 0 is the lowest bit."""
    bits = ti.select(condition, int8([1, 2, 4, 8, 16, 32, 64, 128]), int8(0))
    return bits[0] + bits[1] + bits[2] + bits[3] + bits[4] + bits[5] + bits[6] + bits[7]


@ti.func
def entry_column(entered: ti.i32) -> ti.i32:
    """Return the column of `instances` with the BLAS node at which the reference in a TLAS leaf enters."""
    part = entered >> ROW_BITS
    return ti.select(part > 0, INFO_PARTS - 1 + part, 0)


@ti.func
def intersect_sheared(ax, ay, az, bx, by, bz, cx, cy, cz, shz, miss):
    """Intersect triangles with rays, lane by lane.

    For a triangle without area along the ray the determinant is 0 and t undefined: a miss.

    Args:
        ax ... cz: Corners, of which x and y are sheared so that the ray is the z axis.
        shz: 1 / z of the direction.
        miss: +inf in each lane, the distance of a miss.

    Returns:
        (distances, barycentrics b1, b2).
    """
    u = cx * by - cy * bx
    v = ax * cy - ay * cx
    w = bx * ay - by * ax
    determinant = u + v + w
    scale = 1.0 / determinant
    # Interpolated from the vertices' distances, so that rounding keeps z between them. The distance to the plane is no
    # more exact for large triangles, and slower; `surface_interaction.offset_origin` allows for the error.
    z = (u * az + v * bz + w * cz) * scale
    t = ti.select(fast_max(determinant, 0.0 - determinant) > 0.0, z * shz, miss)
    valid_t = ti.select(fast_min(fast_min(u, v), w) >= 0.0, t, miss)
    valid_t = ti.select(fast_max(fast_max(u, v), w) <= 0.0, t, valid_t)
    return ti.select(valid_t > 0.0, valid_t, miss), v * scale, w * scale


@ti.func
def intersect_leaf_block(
    leaf_blocks: Template, at: ti.i32, ox, oy, oz, kx: ti.i32, ky: ti.i32, kz: ti.i32, shx, shy, shz
):
    """Intersect the four triangles of a leaf block.

    Vertices are sheared so that the ray is the z axis.

    Args:
        leaf_blocks: Rows of four lanes: nine of vertex coordinates, one of triangle numbers.
        at: First row of the block.
        ox ... shz: The ray, as `shear` returns it.

    Returns:
        (distances, +inf for a miss; barycentrics b1; b2), four lanes each.
    """
    ax = leaf_blocks[at + kx] - ox
    ay = leaf_blocks[at + ky] - oy
    az = leaf_blocks[at + kz] - oz
    bz = leaf_blocks[at + 3 + kz] - oz
    cz = leaf_blocks[at + 6 + kz] - oz
    ex = ax - shx * az
    ey = ay - shy * az
    fx = leaf_blocks[at + 3 + kx] - ox - shx * bz
    fy = leaf_blocks[at + 3 + ky] - oy - shy * bz
    gx = leaf_blocks[at + 6 + kx] - ox - shx * cz
    gy = leaf_blocks[at + 6 + ky] - oy - shy * cz
    return intersect_sheared(ex, ey, az, fx, fy, bz, gx, gy, cz, shz, float4(INFINITY))


@ti.func
def slabs(dx: ti.f32, dy: ti.f32, dz: ti.f32):
    """Prepare slab tests: return reciprocals of a direction for near planes and far planes, and rows of near planes."""
    ix = reciprocal(dx)
    iy = reciprocal(dy)
    iz = reciprocal(dz)
    near_x = ti.select(ix < 0.0, 3, 0)
    near_y = ti.select(iy < 0.0, 4, 1)
    near_z = ti.select(iz < 0.0, 5, 2)
    return ix, iy, iz, ix * SLACK, iy * SLACK, iz * SLACK, near_x, near_y, near_z


@ti.func
def shear(ox: ti.f32, oy: ti.f32, oz: ti.f32, dx: ti.f32, dy: ti.f32, dz: ti.f32):
    """Prepare triangle tests of a ray.

    Returns:
        (the origin with its axes in cyclic order and the direction's largest last; these three axes; the shear: x and y
        of the direction over its z, and 1 / z).
    """
    px, py, pz, qx, qy, qz = ox, oy, oz, dx, dy, dz
    kx, ky, kz = 0, 1, 2
    if ti.abs(dx) > ti.max(ti.abs(dy), ti.abs(dz)):
        px, py, pz, qx, qy, qz = oy, oz, ox, dy, dz, dx
        kx, ky, kz = 1, 2, 0
    elif ti.abs(dy) > ti.abs(dz):
        px, py, pz, qx, qy, qz = oz, ox, oy, dz, dx, dy
        kx, ky, kz = 2, 0, 1
    scale = reciprocal(qz)
    return px, py, pz, kx, ky, kz, qx * scale, qy * scale, scale


@ti.func
def into_instance(transforms: Template, time: ti.i32, row: ti.i32, ox, oy, oz, dx, dy, dz):
    """Transform origin and direction to the object space of an instance; distances t remain the same."""
    m0 = transforms[time, row, 0]
    m1 = transforms[time, row, 1]
    m2 = transforms[time, row, 2]
    m3 = transforms[time, row, 3]
    m4 = transforms[time, row, 4]
    m5 = transforms[time, row, 5]
    m6 = transforms[time, row, 6]
    m7 = transforms[time, row, 7]
    m8 = transforms[time, row, 8]
    m9 = transforms[time, row, 9]
    m10 = transforms[time, row, 10]
    m11 = transforms[time, row, 11]
    return (
        m0 * ox + m1 * oy + m2 * oz + m3,
        m4 * ox + m5 * oy + m6 * oz + m7,
        m8 * ox + m9 * oy + m10 * oz + m11,
        m0 * dx + m1 * dy + m2 * dz,
        m4 * dx + m5 * dy + m6 * dz,
        m8 * dx + m9 * dy + m10 * dz,
    )


@ti.func
def trace(
    nodes: Template,
    leaf_blocks: Template,
    transforms: Template,
    instances: Template,
    time: ti.i32,
    root: ti.i32,
    rays: Template,
    ray: ti.i32,
    references: Template,
    distances: Template,
):
    """Find the closest hit of one ray of an array, see `trace_ray`.

    Args:
        rays: Rays.
        ray: Row of the ray.
    """
    return trace_ray(
        nodes, leaf_blocks, transforms, instances, time, root, rays[ray][0], rays[ray][1], rays[ray][2],
        rays[ray][4], rays[ray][5], rays[ray][6], rays[ray][7], references, distances,
    )  # fmt: skip


@ti.func
def trace_ray(
    nodes: Template,
    leaf_blocks: Template,
    transforms: Template,
    instances: Template,
    time: ti.i32,
    root: ti.i32,
    wox: ti.f32,
    woy: ti.f32,
    woz: ti.f32,
    wdx: ti.f32,
    wdy: ti.f32,
    wdz: ti.f32,
    t_max: ti.f32,
    references: Template,
    distances: Template,
):
    """Find the closest hit of one ray.

    Args:
        nodes: Nodes of all trees.
        leaf_blocks: Triangles of all trees.
        transforms: [time, instance, 12], instance_from_world.
        instances: BLAS entries of the instances.
        time: Of `transforms`.
        root: First node of the TLAS.
        wox, woy, woz: Origin of the ray.
        wdx, wdy, wdz: Its direction.
        t_max: Where it ends.
        references: Local vector of STACK integers, the traversal stack; need not be initialized.
        distances: Local vector of STACK floats, likewise.

    Returns:
        (distance, b1, b2, instance row or -1 for a miss, triangle). Ties go to the lower (instance, triangle).
    """
    best = ti.min(t_max, LARGEST)  # finite: +inf is a miss
    bound = best * SLACK
    b1 = 0.0
    b2 = 0.0
    hit_instance = -1
    hit_triangle = -1
    ox = wox
    oy = woy
    oz = woz
    dx = wdx
    dy = wdy
    dz = wdz
    ix, iy, iz, fx, fy, fz, near_x, near_y, near_z = slabs(dx, dy, dz)
    px, py, pz, kx, ky, kz, shx, shy, shz = ox, oy, oz, 0, 1, 2, dx, dy, dz  # set on entering an instance
    stack_size = 0
    blas_base = -1  # stack entries below it are of the TLAS; -1 while in the TLAS
    instance = -1
    current = root
    searching = True
    while searching:
        pop = False
        while current >= 0 and not pop:
            node = current
            near = fast_max(
                fast_max((nodes[node + near_x] - ox) * ix, (nodes[node + near_y] - oy) * iy),
                fast_max((nodes[node + near_z] - oz) * iz, float8(0.0)),
            )
            far = fast_min(
                fast_min((nodes[node + 3 - near_x] - ox) * fx, (nodes[node + 5 - near_y] - oy) * fy),
                fast_min((nodes[node + 7 - near_z] - oz) * fz, float8(bound)),
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
                        farther = ti.select(closer, current, child)
                        current = ti.select(closer, child, current)
                        distances[stack_size] = ti.select(closer, nearest, distance)
                        nearest = ti.select(closer, distance, nearest)
                        references[stack_size] = (
                            farther  # stored last: any other order makes camera rays 7 % slower with LLVM
                        )
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
                ox, oy, oz, dx, dy, dz = into_instance(transforms, time, instance, wox, woy, woz, wdx, wdy, wdz)
                ix, iy, iz, fx, fy, fz, near_x, near_y, near_z = slabs(dx, dy, dz)
                px, py, pz, kx, ky, kz, shx, shy, shz = shear(ox, oy, oz, dx, dy, dz)
                blas_base = stack_size
                current = instances[instance, entry_column(entered)]
            else:
                at = -1 - current
                t, u, v = intersect_leaf_block(leaf_blocks, at, px, py, pz, kx, ky, kz, shx, shy, shz)
                t_min = fast_min(fast_min(t[0], t[1]), fast_min(t[2], t[3]))
                if t_min <= best:
                    number, u_hit, v_hit = leaf_blocks[at + 9][3], u[3], v[3]
                    for k in ti.static((2, 1, 0)):  # of equal distances, the first lane wins
                        number = ti.select(t[k] == t_min, leaf_blocks[at + 9][k], number)
                        u_hit = ti.select(t[k] == t_min, u[k], u_hit)
                        v_hit = ti.select(t[k] == t_min, v[k], v_hit)
                    triangle = ti.bit_cast(number, ti.i32)
                    wins = t_min < best
                    if not wins:
                        wins = instance < hit_instance
                        if instance == hit_instance:
                            wins = triangle < hit_triangle
                    if wins:
                        best = t_min
                        bound = best * SLACK
                        b1 = u_hit
                        b2 = v_hit
                        hit_instance = instance
                        hit_triangle = triangle
                pop = True
        while pop and searching:
            if stack_size == blas_base:
                blas_base = -1
                ox = wox
                oy = woy
                oz = woz
                dx = wdx
                dy = wdy
                dz = wdz
                ix, iy, iz, fx, fy, fz, near_x, near_y, near_z = slabs(dx, dy, dz)
            if stack_size == 0:
                searching = False
            else:
                stack_size -= 1
                if distances[stack_size] <= bound:
                    current = references[stack_size]
                    pop = False
    return best, b1, b2, hit_instance, hit_triangle


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
    roots: Ints1,
    rays_per_frame: ti.i32,
    hits: Hits,
    hit_ids: HitIds,
):
    """Find the closest hits of rays; parameters as `trace.closest`. roots: of each frame, if rays_per_frame > 0."""
    size = ti.math.clamp(count // MIN_TASKS, 1, TASK_RAYS)
    tasks = (count + size - 1) // size
    taken = 0
    for iteration in range(iterations(tasks)):
        next_task, end_task = first_items(taken, iteration, tasks, 1)
        while next_task < end_task:
            task = next_task
            next_task, end_task = next_item(taken, task, end_task, tasks, 1)
            references = ti.Vector([0] * STACK)
            distances = ti.Vector([0.0] * STACK)
            for i in range(task * size, ti.min(count, (task + 1) * size)):
                ray = queue[i]
                start = root
                if rays_per_frame > 0:
                    start = roots[ray // rays_per_frame]
                t, b1, b2, instance, triangle = trace(
                    nodes, leaf_blocks, transforms, instances, time, start, rays, ray, references, distances
                )
                write_hit(hits, hit_ids, ray, t, b1, b2, instance, triangle)
