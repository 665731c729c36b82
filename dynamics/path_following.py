# SPDX-License-Identifier: Apache-2.0
"""What a body does that follows a path, where something is in its way: device functions.

(No postponed annotations in this module.) The columns are those of `dynamics.body_layout`.
"""

import taichi as ti

from dynamics.body_access import apply_motion, max_step_angle, read3, record_contact, write3
from dynamics.body_layout import (
    ATTEMPTS,
    BLOCKED,
    FIRST_GROUP,
    GROUP_COUNT,
    MAX_DISPLACEMENT,
    MOVE,
    MOVE_BUDGET,
    ON_PATH,
    POSITION,
    RADIUS,
    REACHES_TARGET,
    STEP,
    TARGET,
    TIME_LEFT,
    TURN,
    TURN_BUDGET,
    WALL_PUSH,
)
from dynamics.contact import ARM, GAP, MAX_TOUCHES, NORMAL, TOUCH_KIND, WALL
from dynamics.kernel_types import Template

SLIDE_PASSES = 10  # over all touches, to make a motion slide along them
MAX_PUSH = 1e-3  # m: that a follower is pushed out of what it is too near to, at once


@ti.func
def slide(
    bodies: Template,
    integers: Template,
    touches: Template,
    counts: Template,
    body: ti.i32,
    turning: ti.f64,
):
    """Bend the motion that is tried so that it leads along what is near, not into it. turning: 1, or 0 for no turn."""
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
                    push = bodies[body, WALL_PUSH]
                min_motion = ti.min(-ti.cast(touches[at, GAP], ti.f64), push)
                lever = arm.cross(normal)
                missing = min_motion - normal.dot(move) - lever.dot(turn)
                if missing > 0.0:
                    share = missing / (1.0 + turning * lever.dot(lever) / (radius * radius))
                    move += share * normal
                    turn += (turning * share / (radius * radius)) * lever
    length = move.norm() + radius * turn.norm()
    remaining = ti.max(bodies[body, MAX_DISPLACEMENT] - bodies[body, STEP], 0.0)
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
    tries = integers[body, ATTEMPTS]
    exact = tries == 0 and time >= 1.0 and integers[body, REACHES_TARGET] > 0
    part = time
    done = tries > 0
    if tries == 0 and time < 1.0:
        part = 0.0  # first it bends its way
    elif tries == 1 and time <= 1e-3:
        done = False
        part = 0.0
    moved = read3(bodies, body, MOVE).norm() * part
    turned = read3(bodies, body, TURN).norm() * part
    if part > 0.0:
        apply_motion(bodies, body, part)
    integers[body, ON_PATH] = 0
    if exact:
        # The pose of the path itself, to the bit.
        for i in ti.static(range(7)):
            bodies[body, POSITION + i] = bodies[body, TARGET + i]
        integers[body, ON_PATH] = 1
        done = True
    elif tries == 0 and time >= 1.0:
        bodies[body, MOVE_BUDGET] -= moved
        bodies[body, TURN_BUDGET] -= turned
        bodies[body, STEP] += moved + turned * bodies[body, RADIUS]
        done = moved + turned < 1e-9
    else:
        integers[body, BLOCKED] = 1
        record_contact(integers, body, kind, row)
        if not done:
            # The first time with its turn, then without.
            slide(bodies, integers, touches, counts, body, ti.cast(1 - tries, ti.f64))
        integers[body, ATTEMPTS] = tries + 1
    if done:
        bodies[body, TIME_LEFT] = 0.0
