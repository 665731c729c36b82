# SPDX-License-Identifier: Apache-2.0
"""Closest hits and occlusion in a binary BVH, all scalar: two boxes, one triangle at a time (GPU).

The tests are those of `bvh8`, operation for operation. GPU compilers fuse a product and a sum into one operation with
one rounding. In an edge function, a difference of two products, only one of them would be rounded: the two triangles
at an edge would compute different values, and rays could pass between them. Products are therefore rounded by
`rounded_product`, which cannot be fused.
"""

import taichi as ti

from tiscene.device.kernel_types import Floats2, Floats3, Ints1, Ints2, Template, vec3
from tiscene.render.intersect.ray_queue import HitIds, Hits, Rays, ray_direction, ray_origin, write_hit

STACK = 72  # a BLAS needs at most 48 entries, a TLAS 24 (tiscene.scene.bvh.workspace)
UNUSED = 7  # a column of triangles that is always 0 (tiscene.scene.bvh.layout_kernels)
SLACK = 1.000002
INFINITY = ti.math.inf
LARGEST = 3e38


@ti.func
def reciprocal(d: Template):
    """Return 1 / d by component, finite for 0, so that 0 * infinity does not occur."""
    return 1.0 / ti.select(ti.abs(d) < 1e-18, ti.select(d < 0.0, -1e-18, 1e-18), d)


@ti.func
def intersect_box(nodes: Template, node: ti.i32, at: Template, origin, inverse, best: ti.f32) -> ti.f32:
    """Return the distance at which a ray enters the box at column `at` of a node, +inf for a miss."""
    low = (vec3(nodes[node, at], nodes[node, at + 1], nodes[node, at + 2]) - origin) * inverse
    high = (vec3(nodes[node, at + 3], nodes[node, at + 4], nodes[node, at + 5]) - origin) * inverse
    near = ti.max(ti.min(low, high).max(), 0.0)
    far = ti.min(ti.max(low, high).min(), best)
    return ti.select(near <= far * SLACK, near, INFINITY)


@ti.func
def rounded_product(a: ti.f32, b: ti.f32, zero: ti.i32) -> ti.f32:
    """Return a * b, rounded on its own, whatever the compiler may fuse.

    Args:
        zero: The number 0, read from memory, so that the compiler cannot see that the bits stay the same.
    """
    return ti.bit_cast(ti.bit_cast(a * b, ti.i32) | zero, ti.f32)


@ti.func
def edge_function(px: ti.f32, py: ti.f32, qx: ti.f32, qy: ti.f32, zero: ti.i32) -> ti.f32:
    """Return on which side of the line from q to p the origin is; with p and q swapped, exactly the negative."""
    return rounded_product(px, qy, zero) - rounded_product(py, qx, zero)


@ti.func
def intersect_triangle(rows: Template, at: ti.i32, o, k, sheared):
    """Return (distance, +inf for a miss; barycentrics b1, b2); the operations of `bvh8.intersect_leaf_block`."""
    zero = ti.bit_cast(rows[at, UNUSED], ti.i32)
    ax = rows[at, k[0]] - o.x
    ay = rows[at, k[1]] - o.y
    az = rows[at, k[2]] - o.z
    bz = rows[at, 4 + k[2]] - o.z
    cz = rows[at, 8 + k[2]] - o.z
    ex = ax - rounded_product(sheared.x, az, zero)
    ey = ay - rounded_product(sheared.y, az, zero)
    fx = rows[at, 4 + k[0]] - o.x - rounded_product(sheared.x, bz, zero)
    fy = rows[at, 4 + k[1]] - o.y - rounded_product(sheared.y, bz, zero)
    gx = rows[at, 8 + k[0]] - o.x - rounded_product(sheared.x, cz, zero)
    gy = rows[at, 8 + k[1]] - o.y - rounded_product(sheared.y, cz, zero)
    u = edge_function(gx, gy, fx, fy, zero)
    v = edge_function(ex, ey, gx, gy, zero)
    w = edge_function(fx, fy, ex, ey, zero)
    determinant = u + v + w
    scale = 1.0 / determinant
    z = (u * az + v * bz + w * cz) * scale
    valid_t = INFINITY
    if determinant != 0.0 and (ti.min(u, v, w) >= 0.0 or ti.max(u, v, w) <= 0.0):
        valid_t = z * sheared.z
    return ti.select(valid_t > 0.0, valid_t, INFINITY), v * scale, w * scale


@ti.func
def shear(o, d):
    """Return (origin with its axes in cyclic order and the direction's largest last, these axes, shear); see `bvh8`."""
    k = ti.Vector([0, 1, 2])
    if ti.abs(d.x) > ti.max(ti.abs(d.y), ti.abs(d.z)):
        k = ti.Vector([1, 2, 0])
    elif ti.abs(d.y) > ti.abs(d.z):
        k = ti.Vector([2, 0, 1])
    scale = reciprocal(vec3(d[k[0]], d[k[1]], d[k[2]])).z
    return vec3(o[k[0]], o[k[1]], o[k[2]]), k, vec3(d[k[0]] * scale, d[k[1]] * scale, scale)


@ti.func
def affine(transforms: Template, time: ti.i32, row: ti.i32, v, w: ti.f32):
    """Transform a point (w = 1) or direction (w = 0) to the object space of an instance."""
    result = vec3(0.0)
    for i in ti.static(range(3)):
        at = ti.static(4 * i)
        x = transforms[time, row, at] * v.x + transforms[time, row, at + 1] * v.y + transforms[time, row, at + 2] * v.z
        result[i] = x + transforms[time, row, at + 3] * w
    return result


@ti.func
def trace(
    nodes: Template,
    leaf_blocks: Template,
    transforms: Template,
    instances: Template,
    time: ti.i32,
    root: ti.i32,
    only: ti.i32,
    rays: Template,
    ray: ti.i32,
    any_hit: Template,
):
    """Find the closest hit of one ray, or any; see `bvh8.trace`.

    only: row of the one instance to test; -1 for all. any_hit: static; stop at the first hit found.

    Returns:
        (distance, b1, b2, instance row or -1 for a miss, triangle).
    """
    world_origin = ray_origin(rays, ray)
    world_direction = ray_direction(rays, ray)
    best = ti.min(rays[ray][7], LARGEST)  # finite: +inf is a miss
    b1 = 0.0
    b2 = 0.0
    hit_instance = -1
    hit_triangle = -1
    origin = world_origin
    direction = world_direction
    inverse = reciprocal(direction)
    cyclic, axes, sheared = origin, ti.Vector([0, 1, 2]), direction  # set on entering an instance
    references = ti.Vector([0] * STACK)
    distances = ti.Vector([0.0] * STACK)
    stack_size = 0
    blas_base = -1  # stack entries below it are of the TLAS; -1 while in the TLAS
    instance = -1
    current = root
    if only >= 0:
        current = -1 - 4 * only
    searching = True
    while searching:
        pop = False
        while current >= 0 and not pop:
            left = intersect_box(nodes, current, 0, origin, inverse, best)
            right = intersect_box(nodes, current, 6, origin, inverse, best)
            near = ti.bit_cast(nodes[current, 12], ti.i32)
            far = ti.bit_cast(nodes[current, 13], ti.i32)
            if right < left:
                near, far = far, near
                left, right = right, left
            if right < INFINITY:
                references[stack_size] = far
                distances[stack_size] = right
                stack_size += 1
            current = near
            pop = left == INFINITY
        if not pop:
            if blas_base < 0:
                instance = (-1 - current) // 4
                origin = affine(transforms, time, instance, world_origin, 1.0)
                direction = affine(transforms, time, instance, world_direction, 0.0)
                inverse = reciprocal(direction)
                cyclic, axes, sheared = shear(origin, direction)
                blas_base = stack_size
                current = instances[instance, 0]
            else:
                code = -1 - current
                for row in range(code // 4, code // 4 + code % 4 + 1):
                    t, u, v = intersect_triangle(leaf_blocks, row, cyclic, axes, sheared)
                    if t <= best:
                        triangle = ti.bit_cast(leaf_blocks[row, 3], ti.i32)
                        wins = t < best
                        if not wins:
                            wins = instance < hit_instance
                            if instance == hit_instance:
                                wins = triangle < hit_triangle
                        if wins:
                            best = t
                            b1 = u
                            b2 = v
                            hit_instance = instance
                            hit_triangle = triangle
                if ti.static(any_hit):
                    searching = hit_instance < 0
                pop = True
        while pop and searching:
            if stack_size == blas_base:
                blas_base = -1
                origin = world_origin
                direction = world_direction
                inverse = reciprocal(direction)
            if stack_size == 0:
                searching = False
            else:
                stack_size -= 1
                current = references[stack_size]
                pop = distances[stack_size] > best * SLACK
    return best, b1, b2, hit_instance, hit_triangle


@ti.kernel
def closest(
    nodes: Floats2,
    leaf_blocks: Floats2,
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
    ti.loop_config(block_dim=256)
    for i in range(count):
        ray = queue[i]
        start = root
        if rays_per_frame > 0:
            start = roots[ray // rays_per_frame]
        t, b1, b2, instance, triangle = trace(
            nodes, leaf_blocks, transforms, instances, time, start, -1, rays, ray, False
        )
        write_hit(hits, hit_ids, ray, t, b1, b2, instance, triangle)


@ti.kernel
def occluded(
    nodes: Floats2,
    leaf_blocks: Floats2,
    transforms: Floats3,
    instances: Ints2,
    time: ti.i32,
    root: ti.i32,
    rays: Rays,
    queue: Ints1,
    count: ti.i32,
    targets: Ints1,
    targeted: ti.i32,
    result: Ints1,
):
    """Test rays for occlusion; parameters as `trace.occluded` and `occluded_by_instance`; targeted: use `targets`."""
    ti.loop_config(block_dim=256)
    for i in range(count):
        ray = queue[i]
        only, start = -1, root
        if targeted > 0:
            only = targets[ray]
            if only < 0:
                start = -1 - only
        _t, _b1, _b2, instance, _triangle = trace(
            nodes, leaf_blocks, transforms, instances, time, start, only, rays, ray, True
        )
        result[ray] = ti.select(instance >= 0, 1, 0)
