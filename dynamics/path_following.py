# SPDX-License-Identifier: Apache-2.0
"""What a body does that follows a path, where something is in its way: device functions.

(No postponed annotations in this module.) The columns are those of `dynamics.body_layout`.
"""

import taichi as ti

from dynamics.body_access import go, longest_turn, note, row3, set3
from dynamics.body_layout import (
    ALLOWED,
    ALLOWED_TURN,
    BLOCKED,
    BOUND,
    FIRST_GROUP,
    FULL,
    GROUPS,
    MOVE,
    ON_PATH,
    POSITION,
    PULL,
    RADIUS,
    REST,
    STEP,
    TARGET,
    TRIES,
    TURN,
)
from dynamics.contact import ARM, GAP, NORMAL, TOUCH_KIND, TOUCHES, WALL
from dynamics.kernel_types import Template

PASSES = 10  # over all touches, to make a motion slide along them
MOST_PUSH = 1e-3  # m: that a follower is pushed out of what it is too near to, at once


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
    move = row3(bodies, body, MOVE)
    turn = turning * row3(bodies, body, TURN)
    radius = ti.max(bodies[body, RADIUS], 1e-6)
    first = integers[body, FIRST_GROUP]
    for _ in range(PASSES):
        for group in range(first, first + integers[body, GROUPS]):
            for slot in range(counts[group]):
                at = group * TOUCHES + slot
                normal = ti.cast(row3(touches, at, NORMAL), ti.f64)
                arm = ti.cast(row3(touches, at, ARM), ti.f64)
                push = ti.cast(MOST_PUSH, ti.f64)
                if ti.cast(touches[at, TOUCH_KIND], ti.i32) == WALL:
                    push = bodies[body, PULL]
                least = ti.min(-ti.cast(touches[at, GAP], ti.f64), push)
                lever = arm.cross(normal)
                short = least - normal.dot(move) - lever.dot(turn)
                if short > 0.0:
                    share = short / (1.0 + turning * lever.dot(lever) / (radius * radius))
                    move += share * normal
                    turn += (turning * share / (radius * radius)) * lever
    length = move.norm() + radius * turn.norm()
    left = ti.max(bodies[body, BOUND] - bodies[body, STEP], 0.0)
    if length > left:
        move *= left / length
        turn *= left / length
    angle = turn.norm()
    if angle > longest_turn(bodies, body):
        turn *= longest_turn(bodies, body) / angle
    set3(bodies, body, MOVE, move)
    set3(bodies, body, TURN, turn)


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
    tries = integers[body, TRIES]
    exact = tries == 0 and time >= 1.0 and integers[body, FULL] > 0
    goes = time
    done = tries > 0
    if tries == 0 and time < 1.0:
        goes = 0.0  # first it bends its way
    elif tries == 1 and time <= 1e-3:
        done = False
        goes = 0.0
    moved = row3(bodies, body, MOVE).norm() * goes
    turned = row3(bodies, body, TURN).norm() * goes
    if goes > 0.0:
        go(bodies, body, goes)
    integers[body, ON_PATH] = 0
    if exact:
        # The pose of the path itself, to the bit.
        for i in ti.static(range(7)):
            bodies[body, POSITION + i] = bodies[body, TARGET + i]
        integers[body, ON_PATH] = 1
        done = True
    elif tries == 0 and time >= 1.0:
        bodies[body, ALLOWED] -= moved
        bodies[body, ALLOWED_TURN] -= turned
        bodies[body, STEP] += moved + turned * bodies[body, RADIUS]
        done = moved + turned < 1e-9
    else:
        integers[body, BLOCKED] = 1
        note(integers, body, kind, row)
        if not done:
            # The first time with its turn, then without.
            slide(bodies, integers, touches, counts, body, ti.cast(1 - tries, ti.f64))
        integers[body, TRIES] = tries + 1
    if done:
        bodies[body, REST] = 0.0
