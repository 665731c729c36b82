# SPDX-License-Identifier: Apache-2.0
"""Choice of the motion that a body attempts next, and dispatch of collision responses: Taichi functions.

Common arguments: `bodies` and `integers`, the columns of `dynamics.body_layout`; `touches` and `counts`, the touches of
each sphere group and their number (`dynamics.contact`); `body`, the row of one body.
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
    STEP_TIME,
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
    """Set the attempted motion of a bouncing body to one worth testing against obstacles at once.

    Returns:
        Its duration, s; 0 for a body that is pushed inside the walls, whose next step is tested alone.
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
    """Set the motion that the body attempts next."""
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
        bodies[body, STEP_TIME] = step
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
    """Move a body up to its first contact and choose its next motion.

    Args:
        time: Part (0..1) of the attempted motion until the contact; 1 without one.
        normal: Contact normal, of any length, towards the body.
        kind: What is touched: NOTHING, OBSTACLE, MOVER, WALL, or WAIT.
        row: Row of the instance, mover or wall that is touched.
    """
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
