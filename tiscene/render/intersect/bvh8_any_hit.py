# SPDX-License-Identifier: Apache-2.0
"""Occlusion rays in the 8-wide BVH: four rays per thread are interleaved, with branch-free steps (CPU).

Traversal mispredicts about one branch a node, which is half of a ray's time. Here a step has no branch: the mask of the
children that a ray enters is pushed on its stack, and the next child is the lowest bit of the topmost mask, whether new
or old. The latency of one ray's step hides behind the other rays' steps. Leaves and the ends of trees are processed one
ray at a time, after each round of steps.

Compiled in vector mode only.
"""

import taichi as ti

from dynamics.balanced_loops import first_items, iterations, next_item
from tiscene.device.kernel_types import Float4s1, Float8s1, Floats3, Ints1, Ints2, Template, float8
from tiscene.render.intersect.bvh2 import reciprocal
from tiscene.render.intersect.bvh8 import (
    LARGEST,
    MIN_TASKS,
    SLACK,
    STACK,
    entry_column,
    fast_max,
    fast_min,
    intersect_leaf_block,
    into_instance,
    mask_bits,
    shear,
)
from tiscene.render.intersect.ray_queue import Rays
from tiscene.scene.bvh.layout_kernels import END_OF_INSTANCE, END_OF_RAY, GUARD_NODE, MAX_NODES
from tiscene.scene.bvh.rebraid import ROW_MASK

RAYS = 4  # interleaved rays of a thread; three and six are slower
TASK_RAYS = 256  # rays of one task; at its end some of the interleaved rays are idle

# Stack entries, called groups: first row of a node * 32 + mask of the children still to be visited. Each level of a
# tree has at most one. At the bottom, and where an instance is entered, is one of the guard node, whose children are
# end marks. One more entry is written, and not kept, for a node without children to visit.
GROUPS = STACK + 3
RAY_END_GROUP = GUARD_NODE * 256 + 2
INSTANCE_END_GROUP = GUARD_NODE * 256 + 1
NODE_MASK = 8 * (MAX_NODES - 1)  # tells LLVM that the number is positive, which saves an instruction per address

# Floats of each ray: origin and reciprocal direction in the space of the current tree, t_max, results of `shear` in the
# instance, origin, direction and reciprocal direction in world space.
ORIGIN, INVERSE, T_MAX, CYCLIC, SHEARED, WORLD_ORIGIN, WORLD_DIRECTION, WORLD_INVERSE = 0, 3, 6, 7, 10, 13, 16, 19
FLOATS = 24
# Integers of each ray: next child, index of its topmost group, axes of `shear`, row of the ray, instance or -1.
NEXT, TOP, AXES, RAY, INSTANCE = 0, 1, 2, 5, 6
INTS = 8


@ti.func
def store3(array: Template, at: ti.i32, x, y, z):
    """Store three consecutive numbers."""
    array[at] = x
    array[at + 1] = y
    array[at + 2] = z


@ti.func
def next_child(nodes: Template, groups: Template, top: ti.i32):
    """Pop the lowest child of the group at `top`; returns (its reference, index of the topmost group afterwards)."""
    group = groups[top]
    bit = group & (256 - group) & 255
    remaining = group ^ bit
    groups[top] = remaining
    child = ti.bit_cast(nodes[((group >> 5) & NODE_MASK) + 6][ti.math.popcnt(bit - 1)], ti.i32)
    return child, top - ti.select((remaining & 255) == 0, 1, 0)


@ti.kernel
def occluded(
    nodes: Float8s1,
    leaf_blocks: Float4s1,
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
    size = ti.math.clamp(count // MIN_TASKS, 1, TASK_RAYS)
    tasks = (count + size - 1) // size
    taken = 0
    for iteration in range(iterations(tasks)):
        next_task, end_task = first_items(taken, iteration, tasks, 1)
        while next_task < end_task:
            task = next_task
            next_task, end_task = next_item(taken, task, end_task, tasks, 1)
            groups = ti.Vector([0] * (RAYS * GROUPS))
            floats = ti.Vector([1.0] * (RAYS * FLOATS))
            ints = ti.Vector([0] * (RAYS * INTS))  # each ray starts at the empty node, then ends
            for r in ti.static(range(RAYS)):
                groups[r * GROUPS] = RAY_END_GROUP
                ints[r * INTS + TOP] = r * GROUPS
                ints[r * INTS + RAY] = -1
                ints[r * INTS + INSTANCE] = -1
            i = task * size
            end = ti.min(count, i + size)
            active_rays = RAYS
            while active_rays > 0:
                for r in ti.static(range(RAYS)):
                    f = ti.static(r * FLOATS)
                    n = ti.static(r * INTS)
                    node = ints[n + NEXT] & NODE_MASK
                    top = ints[n + TOP]
                    low_x = (nodes[node] - floats[f + ORIGIN]) * floats[f + INVERSE]
                    high_x = (nodes[node + 3] - floats[f + ORIGIN]) * floats[f + INVERSE]
                    low_y = (nodes[node + 1] - floats[f + ORIGIN + 1]) * floats[f + INVERSE + 1]
                    high_y = (nodes[node + 4] - floats[f + ORIGIN + 1]) * floats[f + INVERSE + 1]
                    low_z = (nodes[node + 2] - floats[f + ORIGIN + 2]) * floats[f + INVERSE + 2]
                    high_z = (nodes[node + 5] - floats[f + ORIGIN + 2]) * floats[f + INVERSE + 2]
                    near = fast_max(
                        fast_max(fast_min(low_x, high_x), fast_min(low_y, high_y)),
                        fast_max(fast_min(low_z, high_z), float8(0.0)),
                    )
                    far = fast_min(
                        fast_min(fast_max(low_x, high_x), fast_max(low_y, high_y)),
                        fast_min(fast_max(low_z, high_z), fast_min(nodes[node + 7], float8(floats[f + T_MAX]))),
                    )
                    children = mask_bits(near <= far * SLACK)
                    groups[top + 1] = node * 32 + children
                    top += ti.select(children > 0, 1, 0)
                    child, top = next_child(nodes, groups, top)
                    ints[n + NEXT] = child
                    ints[n + TOP] = top
                for r in range(RAYS):
                    f = r * FLOATS
                    n = r * INTS
                    child = ints[n + NEXT]
                    while child < 0:
                        is_done = child == END_OF_RAY
                        continues = False
                        if child == END_OF_INSTANCE:
                            for c in ti.static(range(3)):
                                floats[f + ORIGIN + c] = floats[f + WORLD_ORIGIN + c]
                                floats[f + INVERSE + c] = floats[f + WORLD_INVERSE + c]
                            ints[n + INSTANCE] = -1
                            continues = True
                        elif not is_done:
                            if ints[n + INSTANCE] < 0:
                                entered = -1 - child
                                instance = entered & ROW_MASK
                                ox, oy, oz, dx, dy, dz = into_instance(
                                    transforms,
                                    time,
                                    instance,
                                    floats[f + WORLD_ORIGIN],
                                    floats[f + WORLD_ORIGIN + 1],
                                    floats[f + WORLD_ORIGIN + 2],
                                    floats[f + WORLD_DIRECTION],
                                    floats[f + WORLD_DIRECTION + 1],
                                    floats[f + WORLD_DIRECTION + 2],
                                )
                                px, py, pz, kx, ky, kz, shx, shy, shz = shear(ox, oy, oz, dx, dy, dz)
                                store3(floats, f + ORIGIN, ox, oy, oz)
                                store3(floats, f + INVERSE, reciprocal(dx), reciprocal(dy), reciprocal(dz))
                                store3(floats, f + CYCLIC, px, py, pz)
                                store3(floats, f + SHEARED, shx, shy, shz)
                                store3(ints, n + AXES, kx, ky, kz)
                                ints[n + INSTANCE] = instance
                                ints[n + TOP] += 1
                                groups[ints[n + TOP]] = INSTANCE_END_GROUP
                                child = instances[instance, entry_column(entered)]
                            else:
                                t, _b1, _b2 = intersect_leaf_block(
                                    leaf_blocks,
                                    -1 - child,
                                    floats[f + CYCLIC],
                                    floats[f + CYCLIC + 1],
                                    floats[f + CYCLIC + 2],
                                    ints[n + AXES],
                                    ints[n + AXES + 1],
                                    ints[n + AXES + 2],
                                    floats[f + SHEARED],
                                    floats[f + SHEARED + 1],
                                    floats[f + SHEARED + 2],
                                )
                                is_done = fast_min(fast_min(t[0], t[1]), fast_min(t[2], t[3])) < floats[f + T_MAX]
                                continues = not is_done
                        if continues:
                            child, ints[n + TOP] = next_child(nodes, groups, ints[n + TOP])
                        if is_done:
                            if ints[n + RAY] >= 0:
                                result[ints[n + RAY]] = ti.select(child == END_OF_RAY, 0, 1)
                            groups[r * GROUPS] = RAY_END_GROUP
                            ints[n + TOP] = r * GROUPS
                            ints[n + INSTANCE] = -1
                            if i < end:
                                ray = queue[i]
                                i += 1
                                ints[n + RAY] = ray
                                floats[f + T_MAX] = ti.min(rays[ray][7], LARGEST)  # finite: +inf is a miss
                                for c in ti.static(range(3)):
                                    origin = rays[ray][c]
                                    direction = rays[ray][4 + c]
                                    inverse_c = reciprocal(direction)
                                    floats[f + ORIGIN + c] = origin
                                    floats[f + INVERSE + c] = inverse_c
                                    floats[f + WORLD_ORIGIN + c] = origin
                                    floats[f + WORLD_DIRECTION + c] = direction
                                    floats[f + WORLD_INVERSE + c] = inverse_c
                                child = root
                                if targeted > 0:
                                    child = -1 - targets[ray]
                            else:
                                child = 0
                                active_rays -= ti.select(ints[n + RAY] == -2, 0, 1)
                                ints[n + RAY] = -2
                    ints[n + NEXT] = child
