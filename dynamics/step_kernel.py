# SPDX-License-Identifier: Apache-2.0
"""Kernel of a stepped simulation: one substep of all bodies.

Each body is written by one thread, from positions that were frozen at the start of the substep. Neither the number of
threads nor bodies far away change any bit of it. Columns are those of `dynamics.body_layout`, tables those of
`dynamics.sweep_obstacles`.
"""

import taichi as ti

from dynamics.balanced_loops import first_items, iterations_of_long_items, next_item
from dynamics.body_access import (
    quaternion_from_rotation_vector,
    read3,
    read4,
    rotation_vector_between,
    vec3d,
    write3,
    write4,
)
from dynamics.body_layout import (
    ACTIVE_TIME,
    ANGULAR_SPEED,
    ATTEMPTS,
    BOUNCES,
    COLLIDES,
    FIRST_GROUP,
    FREE_TIME,
    GROUP_COUNT,
    KIND,
    LIMITED,
    LOST_TIME,
    MAX_DISPLACEMENT,
    MAX_WALL_PUSH,
    MOVE_BUDGET,
    PATH_LENGTH,
    POSITION,
    RADIUS,
    ROTATION,
    SPEED,
    SPIN,
    TARGET,
    TIME_LEFT,
    TURN_BUDGET,
    VELOCITY,
    WALL_PUSH,
    WALL_PUSHED,
)
from dynamics.contact import FAR, NOTHING, OBSTACLE, SKIN, TOLERANCE, WAIT, WALL
from dynamics.integrate import advance, look_ahead, propose
from dynamics.kernel_types import Doubles1, Doubles2, Floats1, Floats2, Ints1, Ints2, Template
from dynamics.sweep_movers import sweep_movers
from dynamics.sweep_obstacles import ROUNDING_MARGIN, read3_f32, rotate_to_world, sweep_obstacles
from dynamics.sweep_walls import WALLS, sweep_walls
from dynamics.trajectory_kernel import multiply, unit
from dynamics.tree_access import Tree, vec3, vector_at

# A follower returns to its path at CATCH_UP_FACTOR times the path's speed plus CATCH_UP_SPEED; turns likewise.
CATCH_UP_FACTOR = 2.0
CATCH_UP_SPEED, CATCH_UP_TURN = 1.0, 3.0  # m/s, rad/s
WALL_PUSH_SPEED = 3.0  # m/s at which walls push in bodies that are outside
PUSH_ROUNDS = 8  # of projections onto all walls
MAX_TOTAL_PUSH = 2e-3  # m: largest push of a follower out of penetrations in a substep
MAX_ATTEMPTS = 24  # of motions in one substep


@ti.func
def follow_freely(bodies: Template, body: ti.i32):
    """Set the pose of a body without collisions to that of its path."""
    for i in ti.static(range(7)):
        bodies[body, POSITION + i] = bodies[body, TARGET + i]


@ti.func
def fly_freely(bodies: Template, body: ti.i32):
    """Move a bouncing body without collisions straight on for its active time."""
    time = bodies[body, ACTIVE_TIME]
    write3(bodies, body, POSITION, read3(bodies, body, POSITION) + time * read3(bodies, body, VELOCITY))
    rotation = multiply(
        quaternion_from_rotation_vector(time * read3(bodies, body, SPIN)), read4(bodies, body, ROTATION)
    )
    write4(bodies, body, ROTATION, unit(rotation, rotation))


@ti.func
def depth_outside(
    bodies: Template, integers: Template, groups: Template, spheres: Template, normal, body: ti.i32, height
):
    """Return how far a body reaches outside of a wall, m; `height` is that of its origin inside of it."""
    depth = -FAR
    first = integers[body, FIRST_GROUP]
    for group in range(first, first + integers[body, GROUP_COUNT]):
        for sphere in range(groups[group, 1], groups[group, 1] + groups[group, 2]):
            arm = rotate_to_world(bodies, body, vector_at(spheres, sphere, 0))
            depth = ti.max(depth, spheres[sphere, 3] - height - normal.dot(arm))
    return depth


@ti.func
def set_wall_push(
    bodies: Template,
    integers: Template,
    groups: Template,
    spheres: Template,
    planes: Template,
    body: ti.i32,
    length: ti.f64,
):
    """Set the displacement, `length` m at most, that brings a body outside the walls back inside."""
    displacement = vec3d(0.0)
    origin = read3_f32(bodies, body, POSITION)
    reach = ti.cast(bodies[body, RADIUS], ti.f32)
    for wall in range(WALLS):
        normal = vector_at(planes, wall, 0)
        height = normal.dot(origin) + planes[wall, 3] - SKIN
        if height < reach:
            depth = ti.max(depth_outside(bodies, integers, groups, spheres, normal, body, height), 0.0)
            displacement += ti.cast(depth * normal, ti.f64)
    # The way inside of one wall may lead outside of others: project onto each of them in turn.
    rounds = ti.select(displacement.norm() > 0.0, PUSH_ROUNDS, 0)
    for _ in range(rounds):
        for wall in range(WALLS):
            normal = vector_at(planes, wall, 0)
            height = normal.dot(origin + ti.cast(displacement, ti.f32)) + planes[wall, 3] - SKIN
            if height < reach:
                depth = depth_outside(bodies, integers, groups, spheres, normal, body, height)
                if depth > TOLERANCE:
                    displacement += ti.cast(depth * normal, ti.f64)
    far = displacement.norm()
    if far > length:
        displacement *= length / far
    write3(bodies, body, WALL_PUSH, displacement)
    integers[body, WALL_PUSHED] = 0
    if far > 0.0 and length > 0.0:
        integers[body, WALL_PUSHED] = 1


@ti.func
def begin_bouncing(
    bodies: Template,
    integers: Template,
    groups: Template,
    spheres: Template,
    planes: Template,
    body: ti.i32,
):
    """Set the time, the wall push and the largest displacement of a bouncing body for this substep."""
    time = bodies[body, ACTIVE_TIME]
    bodies[body, TIME_LEFT] = time
    bound = (bodies[body, SPEED] + bodies[body, ANGULAR_SPEED] * bodies[body, RADIUS]) * time
    integers[body, WALL_PUSHED] = 0
    if integers[body, LIMITED] > 0:
        length = WALL_PUSH_SPEED * time
        set_wall_push(bodies, integers, groups, spheres, planes, body, length)
        if integers[body, WALL_PUSHED] > 0:
            bound += read3(bodies, body, WALL_PUSH).norm()
    bodies[body, MAX_DISPLACEMENT] = bound


@ti.func
def begin_following(bodies: Template, integers: Template, targets: Template, body: ti.i32, length):
    """Set the target, the budgets and the largest displacement of a follower for a substep of `length` s."""
    path = vec3d(0.0)
    same = True
    for i in ti.static(range(3)):
        path[i] = targets[body, i] - bodies[body, TARGET + i]
    path_turn = rotation_vector_between(read4(bodies, body, TARGET + 3), read4(targets, body, 3))
    for i in ti.static(range(7)):
        bodies[body, TARGET + i] = targets[body, i]
        if bodies[body, POSITION + i] != targets[body, i]:
            same = False
    bodies[body, MOVE_BUDGET] = CATCH_UP_FACTOR * path.norm() + CATCH_UP_SPEED * length
    bodies[body, TURN_BUDGET] = CATCH_UP_FACTOR * path_turn.norm() + CATCH_UP_TURN * length
    bodies[body, PATH_LENGTH] = 0.0
    bodies[body, TIME_LEFT] = 0.0
    bodies[body, MAX_DISPLACEMENT] = 0.0
    push = ti.cast(MAX_TOTAL_PUSH, ti.f64)
    bodies[body, MAX_WALL_PUSH] = 0.0
    if integers[body, LIMITED] > 0:
        bodies[body, MAX_WALL_PUSH] = WALL_PUSH_SPEED * length
        push += bodies[body, MAX_WALL_PUSH]
    if not same or integers[body, LIMITED] > 0:
        bodies[body, TIME_LEFT] = 1.0
        # Upper bound for all motions of the substep together.
        far = (read3(bodies, body, TARGET) - read3(bodies, body, POSITION)).norm()
        angle = rotation_vector_between(read4(bodies, body, ROTATION), read4(bodies, body, TARGET + 3)).norm()
        bodies[body, MAX_DISPLACEMENT] = (
            ti.min(far, bodies[body, MOVE_BUDGET])
            + ti.min(angle, bodies[body, TURN_BUDGET]) * bodies[body, RADIUS]
            + push
        )


@ti.func
def freeze(
    bodies: Template,
    integers: Template,
    groups: Template,
    spheres: Template,
    bounding: Template,
    frozen: Template,
    frozen_groups: Template,
    frozen_bodies: Template,
    body: ti.i32,
):
    """Store where the spheres, groups and origin of a body are, for the tests of other bodies against it."""
    origin = read3_f32(bodies, body, POSITION)
    for i in ti.static(range(3)):
        frozen_bodies[body, i] = origin[i]
    first = integers[body, FIRST_GROUP]
    for group in range(first, first + integers[body, GROUP_COUNT]):
        middle = origin + rotate_to_world(bodies, body, vector_at(bounding, group, 0))
        for i in ti.static(range(3)):
            frozen_groups[group, i] = middle[i]
        for sphere in range(groups[group, 1], groups[group, 1] + groups[group, 2]):
            center = origin + rotate_to_world(bodies, body, vector_at(spheres, sphere, 0))
            for i in ti.static(range(3)):
                frozen[sphere, i] = center[i]


@ti.kernel
def substep(
    bodies: Doubles2,
    integers: Ints2,
    groups: Ints2,
    spheres: Floats2,
    bounding: Floats2,
    frozen: Floats2,
    frozen_groups: Floats2,
    frozen_bodies: Floats2,
    neighbors: Ints2,
    planes: Floats2,
    targets: Doubles2,
    active: Doubles1,
    length: ti.f64,
    touches: Floats2,
    times: Floats1,
    counts: Ints1,
    is_bvh8: Template,
    nodes: Tree,
    triangles: Tree,
    instances: Floats2,
    roots: Ints1,
    root: ti.i32,
):
    """Advance all bodies by one substep.

    Args:
        bodies: Float columns, updated.
        integers: Integer columns, updated.
        groups: Sphere groups; with `spheres` and `bounding` see `dynamics.sweep_obstacles`.
        frozen: Scratch; with `frozen_groups`, `frozen_bodies` and `neighbors` see `dynamics.sweep_movers`.
        planes: f32 [WALLS, 4], walls at the end of the substep.
        targets: f64 [n, 7], poses on the paths at the end of the substep.
        active: f64 [n], s of the substep during which each body's clock runs.
        length: Duration of the substep, s.
        touches: Scratch; touches of every group. `times` and `counts`: scratch, one per group.
        is_bvh8: Layout of the trees; this and the rest are `Obstacles.arguments()`.
    """
    # Store all positions, and choose how far each body may move.
    for body in range(targets.shape[0]):
        bodies[body, ACTIVE_TIME] = active[body]
        integers[body, ATTEMPTS] = 0
        if integers[body, COLLIDES] == 0:
            for i in ti.static(range(7)):
                bodies[body, TARGET + i] = targets[body, i]
            if integers[body, KIND] == BOUNCES:
                if active[body] > 0.0:
                    fly_freely(bodies, body)
            else:
                follow_freely(bodies, body)
            bodies[body, TIME_LEFT] = 0.0
            bodies[body, MAX_DISPLACEMENT] = 0.0
        else:
            freeze(bodies, integers, groups, spheres, bounding, frozen, frozen_groups, frozen_bodies, body)
            if integers[body, KIND] == BOUNCES:
                begin_bouncing(bodies, integers, groups, spheres, planes, body)
            else:
                begin_following(bodies, integers, targets, body, length)
    # Find pairs that might touch in this substep.
    for body in range(targets.shape[0]):
        count = 0
        if bodies[body, TIME_LEFT] > 0.0:
            here = read3(bodies, body, POSITION)
            for other in range(targets.shape[0]):
                if other != body and integers[other, COLLIDES] > 0:
                    between = (read3(bodies, other, POSITION) - here).norm()
                    size = bodies[body, RADIUS] + bodies[other, RADIUS]
                    if (
                        between
                        < size
                        + bodies[body, MAX_DISPLACEMENT]
                        + bodies[other, MAX_DISPLACEMENT]
                        + 8.0 * SKIN
                        + 2.0 * ROUNDING_MARGIN
                    ):
                        count += 1
                        neighbors[body, count] = other
        neighbors[body, 0] = count
    # Let each body attempt one motion after another, until its time is used up.
    taken = 0
    ti.loop_config(block_dim=1)  # on GPUs, where threads of a block would wait for the longest item of all
    for iteration in range(iterations_of_long_items(targets.shape[0])):
        body, end = first_items(taken, iteration, targets.shape[0], 1)
        while body < end:
            tries = 0
            if bodies[body, TIME_LEFT] > 0.0 and integers[body, KIND] != BOUNCES:
                propose(bodies, integers, body)
            while bodies[body, TIME_LEFT] > 0.0 and tries < MAX_ATTEMPTS:
                tries += 1
                first = integers[body, FIRST_GROUP]
                for group in range(first, first + integers[body, GROUP_COUNT]):
                    counts[group] = 0
                time = ti.cast(1.0, ti.f32)
                normal = vec3(0.0)
                kind = NOTHING
                row = -1
                ahead_time = ti.cast(0.0, ti.f64)
                queries_obstacles = True
                if integers[body, KIND] == BOUNCES:
                    queries_obstacles = bodies[body, FREE_TIME] <= 0.0
                    if queries_obstacles:
                        ahead_time = look_ahead(bodies, integers, body)
                if queries_obstacles:
                    time, normal, row = sweep_obstacles(
                        bodies, integers, groups, spheres, bounding, touches, times, counts,
                        is_bvh8, nodes, triangles, instances, roots, root, body,
                    )  # fmt: skip
                    if time < 1.0:
                        kind = OBSTACLE
                if ahead_time > 0.0:
                    bodies[body, FREE_TIME] = time * ahead_time
                    if time > 0.0:
                        time = 1.0
                        kind = NOTHING
                    propose(bodies, integers, body)
                elif not queries_obstacles:
                    propose(bodies, integers, body)
                wall_time, wall_normal, wall = sweep_walls(
                    bodies, integers, groups, spheres, planes, touches, counts, body, time
                )
                if wall >= 0:
                    time, normal, kind, row = wall_time, wall_normal, WALL, wall
                mover_time, mover_normal, mover_kind, mover = sweep_movers(
                    bodies, integers, groups, spheres, bounding, frozen, frozen_groups, frozen_bodies,
                    neighbors, touches, times, counts, body, time,
                )  # fmt: skip
                if mover_kind != NOTHING:
                    time, normal, kind, row = mover_time, mover_normal, mover_kind, mover
                if not queries_obstacles and time <= 0.0 and kind != WAIT:
                    bodies[body, FREE_TIME] = 0.0  # a bounce depends on all touches: query the obstacles too
                else:
                    advance(bodies, integers, touches, counts, body, time, normal, kind, row)
            if bodies[body, TIME_LEFT] > 0.0:
                # Out of attempts: the remaining time is lost.
                if integers[body, KIND] == BOUNCES:
                    bodies[body, LOST_TIME] += bodies[body, TIME_LEFT]
                bodies[body, TIME_LEFT] = 0.0
            body, end = next_item(taken, body, end, targets.shape[0], 1)
