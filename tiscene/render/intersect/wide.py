"""Traversal of the wide layout: a ray against eight boxes, or four triangles, at once. Compiled in vector mode only.

Boxes are tested by slabs as (plane - origin) / direction, whose relative error is bounded, and the far side is moved
out by more than that error: what a box holds is never lost to rounding (Ize 2013). Triangles are tested as Moeller and
Trumbore (1997) do.
"""

import taichi as ti

vec8 = ti.types.vector(8, ti.f32)
vec4 = ti.types.vector(4, ti.f32)
Wide = ti.types.ndarray(vec8, 1)
Packs = ti.types.ndarray(vec4, 1)
Rays = ti.types.ndarray(ti.f32, 2)
Matrices = ti.types.ndarray(ti.f32, 3)
Ids = ti.types.ndarray(ti.i32, 2)
Queue = ti.types.ndarray(ti.i32, 1)

STACK = 120  # a BLAS and a TLAS need 56 each at most (scene/bvh.py), and a node is pushed before it is counted
SLACK = 1.000002
INFINITY = ti.math.inf
LARGEST = 3e38


@ti.func
def reciprocal(d: ti.f32) -> ti.f32:
    """1 / d, finite also for d = 0, so that 0 * infinity does not arise."""
    return 1.0 / ti.select(ti.abs(d) < 1e-18, ti.select(d < 0.0, -1e-18, 1e-18), d)


@ti.func
def hit_pack(packs: ti.template(), at: ti.i32, ox, oy, oz, dx, dy, dz):
    """Distances (infinity for a miss) and barycentrics b1, b2 of the four triangles of a pack.

    A triangle without area and a ray in the plane of one make the determinant 0 and t infinite or undefined: a miss.
    """
    e1x = packs[at + 3]
    e1y = packs[at + 4]
    e1z = packs[at + 5]
    e2x = packs[at + 6]
    e2y = packs[at + 7]
    e2z = packs[at + 8]
    px = dy * e2z - dz * e2y
    py = dz * e2x - dx * e2z
    pz = dx * e2y - dy * e2x
    scale = 1.0 / (e1x * px + e1y * py + e1z * pz)
    sx = ox - packs[at]
    sy = oy - packs[at + 1]
    sz = oz - packs[at + 2]
    b1 = (sx * px + sy * py + sz * pz) * scale
    qx = sy * e1z - sz * e1y
    qy = sz * e1x - sx * e1z
    qz = sx * e1y - sy * e1x
    b2 = (dx * qx + dy * qy + dz * qz) * scale
    t = (e2x * qx + e2y * qy + e2z * qz) * scale
    inside = ti.min(ti.min(b1, b2), 1.0 - b1 - b2)
    t = ti.select(inside >= 0.0, t, vec4(INFINITY))
    return ti.select(t > 0.0, t, vec4(INFINITY)), b1, b2


@ti.func
def trace(
    nodes: ti.template(),
    packs: ti.template(),
    transforms: ti.template(),
    instances: ti.template(),
    time: ti.i32,
    root: ti.i32,
    only: ti.i32,
    rays: ti.template(),
    ray: ti.i32,
    any_hit: ti.template(),
):
    """The first thing that a ray hits: distance, b1, b2, instance row (-1 for none), triangle.

    only: the row of the one instance to test, -1 for all. any_hit (static): stop at the first hit found.
    """
    wox = rays[ray, 0]
    woy = rays[ray, 1]
    woz = rays[ray, 2]
    wdx = rays[ray, 4]
    wdy = rays[ray, 5]
    wdz = rays[ray, 6]
    best = ti.min(rays[ray, 7], LARGEST)  # below infinity, which is a miss
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
    ix = reciprocal(dx)
    iy = reciprocal(dy)
    iz = reciprocal(dz)
    near_x = ti.select(ix < 0.0, 3, 0)
    near_y = ti.select(iy < 0.0, 4, 1)
    near_z = ti.select(iz < 0.0, 5, 2)
    references = ti.Vector([0] * STACK)
    distances = ti.Vector([0.0] * STACK)
    waiting = 0
    floor = -1  # waiting entries below it belong to the TLAS; -1 while in the TLAS
    instance = -1
    current = root
    if only >= 0:
        current = -1 - only
    searching = True
    while searching:
        pop = False
        if current >= 0:
            near = ti.max(
                ti.max((nodes[current + near_x] - ox) * ix, (nodes[current + near_y] - oy) * iy),
                ti.max((nodes[current + near_z] - oz) * iz, 0.0),
            )
            far = ti.min(
                ti.min((nodes[current + 3 - near_x] - ox) * ix, (nodes[current + 5 - near_y] - oy) * iy),
                ti.min((nodes[current + 7 - near_z] - oz) * iz, best),
            )
            entry = ti.select(near <= far * SLACK, near, vec8(INFINITY))
            children = nodes[current + 6]
            nearest = INFINITY
            found = False
            for k in ti.static(range(8)):
                distance = entry[k]
                if distance < INFINITY:
                    child = ti.bit_cast(children[k], ti.i32)
                    if found:
                        other = child
                        other_distance = distance
                        if distance < nearest:
                            other = current
                            other_distance = nearest
                            current = child
                            nearest = distance
                        references[waiting] = other
                        distances[waiting] = other_distance
                        waiting += 1
                    else:
                        current = child
                        nearest = distance
                        found = True
            pop = not found
        elif floor < 0:
            instance = -1 - current
            ox = affine(transforms, time, instance, 0, wox, woy, woz, 1.0)
            oy = affine(transforms, time, instance, 4, wox, woy, woz, 1.0)
            oz = affine(transforms, time, instance, 8, wox, woy, woz, 1.0)
            dx = affine(transforms, time, instance, 0, wdx, wdy, wdz, 0.0)
            dy = affine(transforms, time, instance, 4, wdx, wdy, wdz, 0.0)
            dz = affine(transforms, time, instance, 8, wdx, wdy, wdz, 0.0)
            ix = reciprocal(dx)
            iy = reciprocal(dy)
            iz = reciprocal(dz)
            near_x = ti.select(ix < 0.0, 3, 0)
            near_y = ti.select(iy < 0.0, 4, 1)
            near_z = ti.select(iz < 0.0, 5, 2)
            floor = waiting
            current = instances[instance, 0]
        else:
            at = -1 - current
            t, u, v = hit_pack(packs, at, ox, oy, oz, dx, dy, dz)
            least = ti.min(ti.min(t[0], t[1]), ti.min(t[2], t[3]))
            if ti.static(any_hit):
                if least < best:
                    hit_instance = instance
                    searching = False
            else:
                if least <= best:
                    triangles = packs[at + 9]
                    triangle = -1
                    u_hit = 0.0
                    v_hit = 0.0
                    for k in ti.static((3, 2, 1, 0)):
                        if t[k] == least:
                            triangle = ti.bit_cast(triangles[k], ti.i32)
                            u_hit = u[k]
                            v_hit = v[k]
                    first = least < best
                    if not first:
                        first = instance < hit_instance
                        if instance == hit_instance:
                            first = triangle < hit_triangle
                    if first:
                        best = least
                        b1 = u_hit
                        b2 = v_hit
                        hit_instance = instance
                        hit_triangle = triangle
            pop = True
        while pop and searching:
            if waiting == floor:
                floor = -1
                ox = wox
                oy = woy
                oz = woz
                dx = wdx
                dy = wdy
                dz = wdz
                ix = reciprocal(dx)
                iy = reciprocal(dy)
                iz = reciprocal(dz)
                near_x = ti.select(ix < 0.0, 3, 0)
                near_y = ti.select(iy < 0.0, 4, 1)
                near_z = ti.select(iz < 0.0, 5, 2)
            if waiting == 0:
                searching = False
            else:
                waiting -= 1
                if distances[waiting] <= best * SLACK:
                    current = references[waiting]
                    pop = False
    return best, b1, b2, hit_instance, hit_triangle


@ti.func
def affine(transforms: ti.template(), time: ti.i32, row: ti.i32, at: ti.i32, x, y, z, w) -> ti.f32:
    """One coordinate of a transformed point (w = 1) or direction (w = 0)."""
    sum_ = transforms[time, row, at] * x + transforms[time, row, at + 1] * y + transforms[time, row, at + 2] * z
    return sum_ + transforms[time, row, at + 3] * w


@ti.kernel
def closest(
    nodes: Wide,
    packs: Packs,
    transforms: Matrices,
    instances: Ids,
    time: ti.i32,
    root: ti.i32,
    rays: Rays,
    queue: Queue,
    count: ti.i32,
    hits: Rays,
    hit_ids: Ids,
):
    ti.loop_config(block_dim=256)
    for i in range(count):
        ray = queue[i]
        t, b1, b2, instance, triangle = trace(nodes, packs, transforms, instances, time, root, -1, rays, ray, False)
        if instance < 0:
            t = INFINITY
        hits[ray, 0] = t
        hits[ray, 1] = b1
        hits[ray, 2] = b2
        hits[ray, 3] = 0.0
        hit_ids[ray, 0] = instance
        hit_ids[ray, 1] = triangle


@ti.kernel
def occluded(
    nodes: Wide,
    packs: Packs,
    transforms: Matrices,
    instances: Ids,
    time: ti.i32,
    root: ti.i32,
    rays: Rays,
    queue: Queue,
    count: ti.i32,
    targets: Queue,
    targeted: ti.i32,
    result: Queue,
):
    ti.loop_config(block_dim=256)
    for i in range(count):
        ray = queue[i]
        only = -1
        if targeted > 0:
            only = targets[ray]
        _t, _b1, _b2, instance, _triangle = trace(
            nodes, packs, transforms, instances, time, root, only, rays, ray, True
        )
        result[ray] = ti.select(instance >= 0, 1, 0)
