# SPDX-License-Identifier: Apache-2.0
"""Motion of bodies that follow a path past obstacles: Taichi functions.

A follower moves straight to its pose on the path. Where that is blocked it slides along its touches.

Common arguments: `bodies` and `integers`, the columns of `dynamics.body_layout`; `touches` and `counts`, the touches of
each sphere group and their number (`dynamics.contact`); `body`, the row of one body.
"""

import taichi as ti

from dynamics.body_access import apply_motion, max_step_angle, read3, record_contact, write3
from dynamics.body_layout import (
    ATTEMPTS,
    BLOCKED,
    FIRST_GROUP,
    GROUP_COUNT,
    MAX_DISPLACEMENT,
    MAX_WALL_PUSH,
    MOVE,
    MOVE_BUDGET,
    PATH_LENGTH,
    POSITION,
    RADIUS,
    REACHES_TARGET,
    TARGET,
    TIME_LEFT,
    TURN,
    TURN_BUDGET,
)
from dynamics.contact import ARM, GAP, MAX_TOUCHES, NORMAL, TOUCH_KIND, WALL
from dynamics.kernel_types import Template

SLIDE_PASSES = 10  # over all touches
MAX_PUSH = 1e-3  # m: largest push out of a penetration in one motion


@ti.func
def slide(
    bodies: Template,
    integers: Template,
    touches: Template,
    counts: Template,
    body: ti.i32,
    turning: ti.f64,
):
    """Change the attempted motion so that it leads along all touches instead of into them.

    Projected Gauss-Seidel: each pass corrects the motion for one touch after another.

    Args:
        turning: 1 to keep the turn, 0 for a pure translation.
    """
    move = read3(bodies, body, MOVE)
    turn = turning * read3(bodies, body, TURN)
    radius = ti.max(bodies[body, RADIUS], 1e-6)
    first = integers[body, FIRST_GROUP]
    for _ in range(SLIDE_PASSES):
        for group in range(first, first + integers[body, GROUP_COUNT]):
            for slot in range(counts[group]):
                at = group * MAX_TOUCHES + slot
                normal = ti.cast(read3(touches, at, NORMAL), ti.f64)
                arm = ti.cast(read3(touches, at, ARM), ti.f64)
                push = ti.cast(MAX_PUSH, ti.f64)
                if ti.cast(touches[at, TOUCH_KIND], ti.i32) == WALL:
                    push = bodies[body, MAX_WALL_PUSH]
                min_motion = ti.min(-ti.cast(touches[at, GAP], ti.f64), push)
                lever = arm.cross(normal)
                missing = min_motion - normal.dot(move) - lever.dot(turn)
                if missing > 0.0:
                    share = missing / (1.0 + turning * lever.dot(lever) / (radius * radius))
                    move += share * normal
                    turn += (turning * share / (radius * radius)) * lever
    length = move.norm() + radius * turn.norm()
    remaining = ti.max(bodies[body, MAX_DISPLACEMENT] - bodies[body, PATH_LENGTH], 0.0)
    if length > remaining:
        move *= remaining / length
        turn *= remaining / length
    angle = turn.norm()
    if angle > max_step_angle(bodies, body):
        turn *= max_step_angle(bodies, body) / angle
    write3(bodies, body, MOVE, move)
    write3(bodies, body, TURN, turn)


@ti.func
def advance_following(
    bodies: Template,
    integers: Template,
    touches: Template,
    counts: Template,
    body: ti.i32,
    time,
    kind: ti.i32,
    row: ti.i32,
):
    """Move a follower up to its first contact; after a contact make it slide, first with its turn, then without.

    Args:
        time: Part (0..1) of the attempted motion until the contact; 1 without one.
        kind: What is touched: NOTHING, OBSTACLE, MOVER, WALL, or WAIT.
        row: Row of the instance, mover or wall that is touched.
    """
    attempts = integers[body, ATTEMPTS]
    arrives = attempts == 0 and time >= 1.0 and integers[body, REACHES_TARGET] > 0
    part = time
    done = attempts > 0
    if attempts == 0 and time < 1.0:
        part = 0.0  # slide first
    elif attempts == 1 and time <= 1e-3:
        done = False
        part = 0.0
    moved = read3(bodies, body, MOVE).norm() * part
    turned = read3(bodies, body, TURN).norm() * part
    if part > 0.0:
        apply_motion(bodies, body, part)
    if arrives:
        # Copy the path's pose, which the sum of motions equals up to rounding only.
        for i in ti.static(range(7)):
            bodies[body, POSITION + i] = bodies[body, TARGET + i]
        done = True
    elif attempts == 0 and time >= 1.0:
        bodies[body, MOVE_BUDGET] -= moved
        bodies[body, TURN_BUDGET] -= turned
        bodies[body, PATH_LENGTH] += moved + turned * bodies[body, RADIUS]
        done = moved + turned < 1e-9
    else:
        integers[body, BLOCKED] = 1
        record_contact(integers, body, kind, row)
        if not done:
            slide(bodies, integers, touches, counts, body, ti.cast(1 - attempts, ti.f64))
        integers[body, ATTEMPTS] = attempts + 1
    if done:
        bodies[body, TIME_LEFT] = 0.0
