# SPDX-License-Identifier: Apache-2.0
"""What bodies try, and what they do with what they meet: device functions, one call for each body.

(No postponed annotations in this module.) The columns are those of `dynamics.body_layout`.
"""

import taichi as ti

from dynamics.body_access import max_step_angle, read3, read4, rotation_vector_between, write3
from dynamics.body_layout import (
    ACTIVE_TIME,
    ATTEMPTS,
    BOUNCES,
    FREE_TIME,
    KIND,
    MOVE,
    MOVE_BUDGET,
    POSITION,
    REACHES_TARGET,
    ROTATION,
    SPIN,
    STEP,
    TARGET,
    TIME_LEFT,
    TURN,
    TURN_BUDGET,
    VELOCITY,
    WALL_PUSH,
    WALL_PUSHED,
)
from dynamics.bounce_response import advance_bouncing, look_ahead_time
from dynamics.kernel_types import Template
from dynamics.path_following import advance_following


@ti.func
def look_ahead(bodies: Template, integers: Template, body: ti.i32):
    """Set the motion of what flies for as long as is worth looking ahead, s, which is returned.

    What is pulled into walls does not go on as it does: it tries its step alone, and 0 is returned.
    """
    duration = ti.cast(0.0, ti.f64)
    if integers[body, WALL_PUSHED] > 0:
        propose(bodies, integers, body)
    else:
        duration = look_ahead_time(bodies, body, read3(bodies, body, SPIN).norm())
        write3(bodies, body, MOVE, duration * read3(bodies, body, VELOCITY))
        write3(bodies, body, TURN, duration * read3(bodies, body, SPIN))
    return duration


@ti.func
def propose(bodies: Template, integers: Template, body: ti.i32):
    """Set the motion that the body tries next."""
    if integers[body, KIND] == BOUNCES:
        spin = read3(bodies, body, SPIN)
        step = ti.min(bodies[body, TIME_LEFT], look_ahead_time(bodies, body, spin.norm()))
        if bodies[body, FREE_TIME] > 0.0:
            step = ti.min(step, bodies[body, FREE_TIME])
        move = read3(bodies, body, VELOCITY) * step
        if integers[body, WALL_PUSHED] > 0:
            move += read3(bodies, body, WALL_PUSH) * (step / bodies[body, ACTIVE_TIME])
        write3(bodies, body, MOVE, move)
        write3(bodies, body, TURN, spin * step)
        bodies[body, STEP] = step
    else:
        move = read3(bodies, body, TARGET) - read3(bodies, body, POSITION)
        turn = rotation_vector_between(read4(bodies, body, ROTATION), read4(bodies, body, TARGET + 3))
        distance = move.norm()
        angle = turn.norm()
        reaches_target = 1
        if distance > bodies[body, MOVE_BUDGET]:
            move *= bodies[body, MOVE_BUDGET] / distance
            reaches_target = 0
        if angle > bodies[body, TURN_BUDGET]:
            turn *= bodies[body, TURN_BUDGET] / angle
            angle = bodies[body, TURN_BUDGET]
            reaches_target = 0
        if angle > max_step_angle(bodies, body):
            part = max_step_angle(bodies, body) / angle
            move *= part
            turn *= part
            reaches_target = 0
        write3(bodies, body, MOVE, move)
        write3(bodies, body, TURN, turn)
        integers[body, REACHES_TARGET] = reaches_target


@ti.func
def advance(
    bodies: Template,
    integers: Template,
    touches: Template,
    counts: Template,
    body: ti.i32,
    time: ti.f32,
    normal,
    kind: ti.i32,
    row: ti.i32,
):
    """Move a body up to what it meets first, at `time` (0 .. 1) of its motion, and decide what it tries next."""
    when = ti.cast(time, ti.f64)
    if integers[body, KIND] == BOUNCES:
        outward = ti.cast(normal, ti.f64)
        advance_bouncing(
            bodies, integers, touches, counts, body, when, kind, row, outward / ti.max(outward.norm(), 1e-9)
        )
    else:
        advance_following(bodies, integers, touches, counts, body, when, kind, row)
        if bodies[body, TIME_LEFT] > 0.0 and integers[body, ATTEMPTS] == 0:
            propose(bodies, integers, body)
