# SPDX-License-Identifier: Apache-2.0
"""Any hit in the wide layout: several rays of a thread take turns. Compiled in vector mode only.

Where one ray goes next a processor must guess at each node, and half of a ray's time goes into wrong guesses. Here a
step has no branch: the children of a node that a ray enters become the bits of a number, a group, on top of the ray's
stack, and the next child is the lowest bit of the topmost group, be it new or old. While one ray waits for that the
others take their steps. What is no node, a leaf or an end, is seen to ray by ray, after a step of each.
"""

import taichi as ti

from tiscene.device.kernel_types import Float4s1, Float8s1, Floats3, Ints1, Ints2, Template, float8
from tiscene.render.intersect.bvh8 import (
    LARGEST,
    MANY,
    SLACK,
    STACK,
    bits_of,
    entry_column,
    intersect_leaf_block,
    into_instance,
    larger,
    reciprocal,
    shear,
    smaller,
)
from tiscene.render.intersect.ray_queue import Rays
from tiscene.scene.bvh.layout_kernels import END_OF_INSTANCE, END_OF_RAY, GUARD_NODE, MOST_NODES
from tiscene.scene.bvh.rebraid import ROW_MASK

RAYS = 4  # of a thread under way: with three or six less is gained
BLOCK = 256  # rays of one thread in a row: at the end of a block some have no turn

# Groups: a node's first row * 32 + a bit for each child that is still to be visited. A tree's levels have one each at
# most; at the bottom, and where an instance is entered, one of the guard node, whose children are ends. One more is
# written and not kept where a node has no children.
GROUPS = STACK + 3
LAST = GUARD_NODE * 256 + 2
LEAVE = GUARD_NODE * 256 + 1
NODE_MASK = 8 * (MOST_NODES - 1)  # a number known to be positive is part of an address as it is

# Of each ray, floats: origin and reciprocal direction in the space of the tree it is in, t_max, what `shear` says of it
# in the instance; in the world its origin, direction and reciprocal direction.
ORIGIN, INVERSE, T_MAX, CYCLIC, SHEARED, WORLD_ORIGIN, WORLD_DIRECTION, WORLD_INVERSE = 0, 3, 6, 7, 10, 13, 16, 19
FLOATS = 24
# Integers: the next child, where its topmost group is, axes as `shear` says, its row, the instance; -1 for none.
NEXT, TOP, AXES, RAY, INSTANCE = 0, 1, 2, 5, 6
INTS = 8


@ti.func
def put(array: Template, at: ti.i32, x, y, z):
    array[at] = x
    array[at + 1] = y
    array[at + 2] = z


@ti.func
def next_child(nodes: Template, groups: Template, top: ti.i32):
    """Take the lowest child out of the group at `top`: its reference, and where the topmost group is then."""
    group = groups[top]
    bit = group & (256 - group) & 255
    others = group ^ bit
    groups[top] = others
    child = ti.bit_cast(nodes[((group >> 5) & NODE_MASK) + 6][ti.math.popcnt(bit - 1)], ti.i32)
    return child, top - ti.select((others & 255) == 0, 1, 0)


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
    size = ti.math.clamp(count // MANY, 1, BLOCK)
    for block in range((count + size - 1) // size):
        groups = ti.Vector([0] * (RAYS * GROUPS))
        floats = ti.Vector([1.0] * (RAYS * FLOATS))
        ints = ti.Vector([0] * (RAYS * INTS))  # each begins at the empty node, and then ends
        for r in ti.static(range(RAYS)):
            groups[r * GROUPS] = LAST
            ints[r * INTS + TOP] = r * GROUPS
            ints[r * INTS + RAY] = -1
            ints[r * INTS + INSTANCE] = -1
        i = block * size
        last = ti.min(count, i + size)
        under_way = RAYS
        while under_way > 0:
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
                near = larger(
                    larger(smaller(low_x, high_x), smaller(low_y, high_y)),
                    larger(smaller(low_z, high_z), float8(0.0)),
                )
                far = smaller(
                    smaller(larger(low_x, high_x), larger(low_y, high_y)),
                    smaller(larger(low_z, high_z), smaller(nodes[node + 7], float8(floats[f + T_MAX]))),
                )
                children = bits_of(near <= far * SLACK)
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
                    ends = child == END_OF_RAY
                    going_on = False
                    if child == END_OF_INSTANCE:
                        for c in ti.static(range(3)):
                            floats[f + ORIGIN + c] = floats[f + WORLD_ORIGIN + c]
                            floats[f + INVERSE + c] = floats[f + WORLD_INVERSE + c]
                        ints[n + INSTANCE] = -1
                        going_on = True
                    elif not ends:
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
                            put(floats, f + ORIGIN, ox, oy, oz)
                            put(floats, f + INVERSE, reciprocal(dx), reciprocal(dy), reciprocal(dz))
                            put(floats, f + CYCLIC, px, py, pz)
                            put(floats, f + SHEARED, shx, shy, shz)
                            put(ints, n + AXES, kx, ky, kz)
                            ints[n + INSTANCE] = instance
                            ints[n + TOP] += 1
                            groups[ints[n + TOP]] = LEAVE
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
                            ends = smaller(smaller(t[0], t[1]), smaller(t[2], t[3])) < floats[f + T_MAX]
                            going_on = not ends
                    if going_on:
                        child, ints[n + TOP] = next_child(nodes, groups, ints[n + TOP])
                    if ends:
                        if ints[n + RAY] >= 0:
                            result[ints[n + RAY]] = ti.select(child == END_OF_RAY, 0, 1)
                        groups[r * GROUPS] = LAST
                        ints[n + TOP] = r * GROUPS
                        ints[n + INSTANCE] = -1
                        if i < last:
                            ray = queue[i]
                            i += 1
                            ints[n + RAY] = ray
                            floats[f + T_MAX] = ti.min(rays[ray][7], LARGEST)  # below infinity, which is a miss
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
                            under_way -= ti.select(ints[n + RAY] == -2, 0, 1)
                            ints[n + RAY] = -2
                ints[n + NEXT] = child
