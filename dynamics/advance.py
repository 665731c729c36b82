"""What bodies try, and what they do with what they meet: device functions, one call for each body.

(No postponed annotations in this module.) The columns are those of `dynamics.columns`.
"""

import taichi as ti

from dynamics.bouncing import advance_bouncing
from dynamics.columns import (
    ACTIVE,
    ALLOWED,
    ALLOWED_TURN,
    BOUNCES,
    FIRST_GROUP,
    FULL,
    GROUPS,
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
from dynamics.following import advance_following
from dynamics.rows import longest_turn, row3, row4, set3, turn_between
from dynamics.sweep import RESULT_KIND, RESULT_NORMAL, RESULT_ROW, TIME


@ti.func
def propose(bodies: ti.template(), integers: ti.template(), body: ti.i32):
    """Set the motion that the body tries next."""
    if integers[body, KIND] == BOUNCES:
        step = bodies[body, REST]
        spin = row3(bodies, body, SPIN)
        rate = spin.norm()
        if rate * step > longest_turn(bodies, body):
            step = longest_turn(bodies, body) / rate
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
    bodies: ti.template(),
    integers: ti.template(),
    touches: ti.template(),
    result: ti.template(),
    result_rows: ti.template(),
    body: ti.i32,
):
    """Move a body up to what its groups have found first, and decide what it tries next."""
    first = integers[body, FIRST_GROUP]
    soonest = first
    for group in range(first, first + integers[body, GROUPS]):
        if result[group, TIME] < result[soonest, TIME]:
            soonest = group
    time = ti.cast(result[soonest, TIME], ti.f64)
    kind = result_rows[soonest, RESULT_KIND]
    row = result_rows[soonest, RESULT_ROW]
    if integers[body, KIND] == BOUNCES:
        normal = ti.cast(row3(result, soonest, RESULT_NORMAL), ti.f64)
        advance_bouncing(
            bodies, integers, touches, result_rows, body, time, kind, row, normal / ti.max(normal.norm(), 1e-9)
        )
    else:
        advance_following(bodies, integers, touches, result_rows, body, time, kind, row)
    if bodies[body, REST] > 0.0 and (integers[body, KIND] == BOUNCES or integers[body, TRIES] == 0):
        propose(bodies, integers, body)
