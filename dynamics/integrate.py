# SPDX-License-Identifier: Apache-2.0
"""What bodies try, and what they do with what they meet: device functions, one call for each body.

(No postponed annotations in this module.) The columns are those of `dynamics.body_layout`.
"""

import taichi as ti

from dynamics.body_access import longest_turn, row3, row4, set3, turn_between
from dynamics.body_layout import (
    ACTIVE,
    AHEAD,
    ALLOWED,
    ALLOWED_TURN,
    BOUNCES,
    FULL,
    KIND,
    MOVE,
    POSITION,
    PULL,
    PULLED,
    REST,
    ROTATION,
    SPIN,
    STEP,
    TARGET,
    TRIES,
    TURN,
    VELOCITY,
)
from dynamics.bounce_response import advance_bouncing, leg_time
from dynamics.kernel_types import Template
from dynamics.path_following import advance_following


@ti.func
def look_ahead(bodies: Template, integers: Template, body: ti.i32):
    """Set the motion of what flies for as long as is worth looking ahead, s, which is returned.

    What is pulled into walls does not go on as it does: it tries its step alone, and 0 is returned.
    """
    leg = ti.cast(0.0, ti.f64)
    if integers[body, PULLED] > 0:
        propose(bodies, integers, body)
    else:
        leg = leg_time(bodies, body, row3(bodies, body, SPIN).norm())
        set3(bodies, body, MOVE, leg * row3(bodies, body, VELOCITY))
        set3(bodies, body, TURN, leg * row3(bodies, body, SPIN))
    return leg


@ti.func
def propose(bodies: Template, integers: Template, body: ti.i32):
    """Set the motion that the body tries next."""
    if integers[body, KIND] == BOUNCES:
        spin = row3(bodies, body, SPIN)
        step = ti.min(bodies[body, REST], leg_time(bodies, body, spin.norm()))
        if bodies[body, AHEAD] > 0.0:
            step = ti.min(step, bodies[body, AHEAD])
        move = row3(bodies, body, VELOCITY) * step
        if integers[body, PULLED] > 0:
            move += row3(bodies, body, PULL) * (step / bodies[body, ACTIVE])
        set3(bodies, body, MOVE, move)
        set3(bodies, body, TURN, spin * step)
        bodies[body, STEP] = step
    else:
        move = row3(bodies, body, TARGET) - row3(bodies, body, POSITION)
        turn = turn_between(row4(bodies, body, ROTATION), row4(bodies, body, TARGET + 3))
        far = move.norm()
        angle = turn.norm()
        full = 1
        if far > bodies[body, ALLOWED]:
            move *= bodies[body, ALLOWED] / far
            full = 0
        if angle > bodies[body, ALLOWED_TURN]:
            turn *= bodies[body, ALLOWED_TURN] / angle
            angle = bodies[body, ALLOWED_TURN]
            full = 0
        if angle > longest_turn(bodies, body):
            part = longest_turn(bodies, body) / angle
            move *= part
            turn *= part
            full = 0
        set3(bodies, body, MOVE, move)
        set3(bodies, body, TURN, turn)
        integers[body, FULL] = full


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
        if bodies[body, REST] > 0.0 and integers[body, TRIES] == 0:
            propose(bodies, integers, body)
