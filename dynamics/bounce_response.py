# SPDX-License-Identifier: Apache-2.0
"""Motion of bodies that fly straight and bounce off what they hit: Taichi functions.

Implements the collisions of `UniformMovementRandomBounce`.

Common arguments: `bodies` and `integers`, the columns of `dynamics.body_layout`; `touches` and `counts`, the touches of
each sphere group and their number (`dynamics.contact`); `body`, the row of one body.
"""

import taichi as ti

from dynamics.body_access import apply_motion, max_step_angle, read3, record_contact, vec3d, write3
from dynamics.body_layout import (
    ANGULAR_SPEED,
    ATTEMPTS,
    FIRST_GROUP,
    FREE_TIME,
    GROUP_COUNT,
    HIT_COUNT,
    LOST_TIME,
    NAME_HASH,
    RADIUS,
    SEED,
    SPEED,
    SPIN,
    STEP_TIME,
    TIME_LEFT,
    VELOCITY,
    WALL_PUSHED,
)
from dynamics.contact import ARM, GAP, MAX_TOUCHES, NORMAL, SKIN, TOUCH_KIND, WAIT, WALL
from dynamics.kernel_types import Template
from dynamics.random import ball, hemisphere, uniform4

MAX_DRAWS = 24  # of directions at one hit; the last third without spin
MAX_ATTEMPTS = 6  # bounces in one substep; then the body stops until the next
MIN_TIME = 1e-12  # s: less than this counts as none left
LOOK_AHEAD_TIME = 0.08  # s: longest motion that is tested against obstacles at once


@ti.func
def look_ahead_time(bodies: Template, body: ti.i32, rate):
    """Return how long, s, chords approximate a motion that spins at `rate` rad/s; LOOK_AHEAD_TIME at most."""
    result = rate * 0.0 + LOOK_AHEAD_TIME
    if rate * LOOK_AHEAD_TIME > max_step_angle(bodies, body):
        result = max_step_angle(bodies, body) / rate
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
    """Return whether a velocity and spin move every touching sphere away from what it touches."""
    all_separate = True
    rate = spin.norm()
    # Margin for the curvature of the spheres' paths.
    margin = 0.5 * bodies[body, RADIUS] * rate * rate * look_ahead_time(bodies, body, rate) + 1e-4 * bodies[body, SPEED]
    first = integers[body, FIRST_GROUP]
    for group in range(first, first + integers[body, GROUP_COUNT]):
        if all_separate:
            for slot in range(counts[group]):
                at = group * MAX_TOUCHES + slot
                if touches[at, GAP] < 0.5 * SKIN and ti.cast(touches[at, TOUCH_KIND], ti.i32) != WAIT:
                    normal = ti.cast(read3(touches, at, NORMAL), ti.f64)
                    arm = ti.cast(read3(touches, at, ARM), ti.f64)
                    if normal.dot(velocity + spin.cross(arm)) < margin:
                        all_separate = False
    return all_separate


@ti.func
def bounce(
    bodies: Template,
    integers: Template,
    touches: Template,
    counts: Template,
    body: ti.i32,
    normal,
):
    """Draw a new velocity and spin that lead away from all touches; reverse the motion if no draw does."""
    hit = integers[body, HIT_COUNT]
    integers[body, HIT_COUNT] = hit + 1
    found = False
    velocity = -read3(bodies, body, VELOCITY)
    spin = -read3(bodies, body, SPIN)
    for draw in range(MAX_DRAWS):
        if not found:
            u = uniform4(integers[body, SEED], integers[body, NAME_HASH], hit, 2 * draw)
            w = uniform4(integers[body, SEED], integers[body, NAME_HASH], hit, 2 * draw + 1)
            new_velocity = bodies[body, SPEED] * hemisphere(normal, u[0], u[1])
            new_spin = bodies[body, ANGULAR_SPEED] * ball(w[0], w[1], w[2])
            if 3 * draw >= 2 * MAX_DRAWS:
                new_spin = vec3d(0.0)
            if separates(bodies, integers, touches, counts, body, new_velocity, new_spin):
                found = True
                velocity = new_velocity
                spin = new_spin
    write3(bodies, body, VELOCITY, velocity)
    write3(bodies, body, SPIN, spin)


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
    """Move a bouncing body up to its first hit and draw a new motion there.

    Args:
        time: Part (0..1) of the attempted motion until the hit; 1 without a hit.
        kind: What is hit: NOTHING, OBSTACLE, MOVER, WALL, or WAIT.
        row: Row of the instance, mover or wall that is hit.
        normal: Unit contact normal, towards the body.
    """
    stopped = False
    if time > 0.0:
        apply_motion(bodies, body, time)
        bodies[body, TIME_LEFT] -= bodies[body, STEP_TIME] * time
        bodies[body, FREE_TIME] = ti.max(bodies[body, FREE_TIME] - bodies[body, STEP_TIME] * time, 0.0)
        if bodies[body, TIME_LEFT] < MIN_TIME:
            bodies[body, TIME_LEFT] = 0.0
        stopped = time < 1.0 and kind == WAIT
    elif kind == WAIT:
        stopped = True
    elif integers[body, WALL_PUSHED] > 0 and kind != WALL:
        # Something blocks the push back inside the walls: give it up for this substep.
        integers[body, WALL_PUSHED] = 0
    else:
        record_contact(integers, body, kind, row)
        bounce(bodies, integers, touches, counts, body, normal)
        bodies[body, FREE_TIME] = 0.0
        integers[body, ATTEMPTS] += 1
        stopped = integers[body, ATTEMPTS] > MAX_ATTEMPTS
    if stopped:
        bodies[body, LOST_TIME] += bodies[body, TIME_LEFT]
        bodies[body, TIME_LEFT] = 0.0
