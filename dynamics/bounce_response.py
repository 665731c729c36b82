# SPDX-License-Identifier: Apache-2.0
"""What a body does that flies straight and bounces: device functions.

(No postponed annotations in this module.) The columns are those of `dynamics.body_layout`.
"""

import taichi as ti

from dynamics.body_access import go, longest_turn, note, row3, set3, vec3d
from dynamics.body_layout import (
    AHEAD,
    ANGULAR_SPEED,
    FIRST_GROUP,
    GROUPS,
    HITS,
    LOST,
    NUMBER,
    PULLED,
    RADIUS,
    REST,
    SEED,
    SPEED,
    SPIN,
    STEP,
    TRIES,
    VELOCITY,
)
from dynamics.contact import ARM, GAP, NORMAL, SKIN, TOUCH_KIND, TOUCHES, WAIT, WALL
from dynamics.kernel_types import Template
from dynamics.random import ball, hemisphere, uniform4

DRAWS = 24  # of directions at one hit, the last third without spin
MOST_TRIES = 6  # hits without moving in one substep; then it waits for the next
DONE = 1e-12  # s
LEG = 0.08  # s that is looked ahead at most


@ti.func
def leg_time(bodies: Template, body: ti.i32, rate):
    """How long chords stand for a motion whose spin is `rate`, rad/s; LEG at most."""
    result = rate * 0.0 + LEG
    if rate * LEG > longest_turn(bodies, body):
        result = longest_turn(bodies, body) / rate
    return result


@ti.func
def separates(
    bodies: Template,
    integers: Template,
    touches: Template,
    counts: Template,
    body: ti.i32,
    velocity,
    spin,
):
    """Whether every sphere that touches anything would get away from it."""
    apart = True
    rate = spin.norm()
    # So much is lost because the path bends.
    margin = 0.5 * bodies[body, RADIUS] * rate * rate * leg_time(bodies, body, rate) + 1e-4 * bodies[body, SPEED]
    first = integers[body, FIRST_GROUP]
    for group in range(first, first + integers[body, GROUPS]):
        if apart:
            for slot in range(counts[group]):
                at = group * TOUCHES + slot
                if touches[at, GAP] < 0.5 * SKIN and ti.cast(touches[at, TOUCH_KIND], ti.i32) != WAIT:
                    normal = ti.cast(row3(touches, at, NORMAL), ti.f64)
                    arm = ti.cast(row3(touches, at, ARM), ti.f64)
                    if normal.dot(velocity + spin.cross(arm)) < margin:
                        apart = False
    return apart


@ti.func
def bounce(
    bodies: Template,
    integers: Template,
    touches: Template,
    counts: Template,
    body: ti.i32,
    normal,
):
    """A new velocity and spin that lead away from everything that is touched; if none is found, back."""
    hit = integers[body, HITS]
    integers[body, HITS] = hit + 1
    found = False
    velocity = -row3(bodies, body, VELOCITY)
    spin = -row3(bodies, body, SPIN)
    for draw in range(DRAWS):
        if not found:
            u = uniform4(integers[body, SEED], integers[body, NUMBER], hit, 2 * draw)
            w = uniform4(integers[body, SEED], integers[body, NUMBER], hit, 2 * draw + 1)
            new_velocity = bodies[body, SPEED] * hemisphere(normal, u[0], u[1])
            new_spin = bodies[body, ANGULAR_SPEED] * ball(w[0], w[1], w[2])
            if 3 * draw >= 2 * DRAWS:
                new_spin = vec3d(0.0)
            if separates(bodies, integers, touches, counts, body, new_velocity, new_spin):
                found = True
                velocity = new_velocity
                spin = new_spin
    set3(bodies, body, VELOCITY, velocity)
    set3(bodies, body, SPIN, spin)


@ti.func
def advance_bouncing(
    bodies: Template,
    integers: Template,
    touches: Template,
    counts: Template,
    body: ti.i32,
    time,
    kind: ti.i32,
    row: ti.i32,
    normal,
):
    stopped = False
    if time > 0.0:
        go(bodies, body, time)
        bodies[body, REST] -= bodies[body, STEP] * time
        bodies[body, AHEAD] = ti.max(bodies[body, AHEAD] - bodies[body, STEP] * time, 0.0)
        if bodies[body, REST] < DONE:
            bodies[body, REST] = 0.0
        stopped = time < 1.0 and kind == WAIT
    elif kind == WAIT:
        stopped = True
    elif integers[body, PULLED] > 0 and kind != WALL:
        # It cannot be pulled any farther here.
        integers[body, PULLED] = 0
    else:
        note(integers, body, kind, row)
        bounce(bodies, integers, touches, counts, body, normal)
        bodies[body, AHEAD] = 0.0
        integers[body, TRIES] += 1
        stopped = integers[body, TRIES] > MOST_TRIES
    if stopped:
        bodies[body, LOST] += bodies[body, REST]
        bodies[body, REST] = 0.0
