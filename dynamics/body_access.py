# SPDX-License-Identifier: Apache-2.0
"""Access to the arrays of bodies, rotations, and motions shared by all kinds of bodies: Taichi functions.

`bodies` and `integers` have the columns of `dynamics.body_layout`; `body` is a row of both.
"""

import taichi as ti

from dynamics.body_layout import CONTACT_COUNT, FIRST_CONTACT, MAX_CONTACTS, MOVE, POSITION, RADIUS, ROTATION, TURN
from dynamics.contact import SKIN, WAIT
from dynamics.kernel_types import Template
from dynamics.trajectory_kernel import multiply, unit

vec3d = ti.types.vector(3, ti.f64)
vec4d = ti.types.vector(4, ti.f64)
MAX_BEND = 0.25 * SKIN  # m: largest distance between a sphere's arc and the chord that collision tests use


@ti.func
def read3(table: Template, row: ti.i32, column: ti.i32):
    """Return three consecutive columns of a float64 table."""
    return vec3d(table[row, column], table[row, column + 1], table[row, column + 2])


@ti.func
def read4(table: Template, row: ti.i32, column: ti.i32):
    """Return four consecutive columns of a float64 table."""
    return vec4d(table[row, column], table[row, column + 1], table[row, column + 2], table[row, column + 3])


@ti.func
def write3(table: Template, row: ti.i32, column: ti.i32, v):
    """Write three consecutive columns."""
    for i in ti.static(range(3)):
        table[row, column + i] = v[i]


@ti.func
def write4(table: Template, row: ti.i32, column: ti.i32, v):
    """Write four consecutive columns."""
    for i in ti.static(range(4)):
        table[row, column + i] = v[i]


@ti.func
def quaternion_from_rotation_vector(turn):
    """Return the unit quaternion of a rotation vector, rad."""
    angle = turn.norm()
    half = 0.5 * angle
    scale = half * 0.0 + 0.5
    if angle > 1e-9:
        scale = ti.sin(half) / angle
    return vec4d(ti.cos(half), scale * turn[0], scale * turn[1], scale * turn[2])


@ti.func
def rotation_vector_between(start, end):
    """Return the rotation vector, rad, of the shorter turn from one unit quaternion to another."""
    q = multiply(end, vec4d(start[0], -start[1], -start[2], -start[3]))
    if q[0] < 0.0:
        q = -q
    axis = vec3d(q[1], q[2], q[3])
    sine = axis.norm()
    scale = sine * 0.0 + 2.0
    if sine > 1e-12:
        scale = 2.0 * ti.atan2(sine, q[0]) / sine
    return scale * axis


@ti.func
def record_contact(integers: Template, body: ti.i32, kind: ti.i32, row: ti.i32):
    """Add a contact to those of this frame, unless it is recorded already or MAX_CONTACTS are."""
    if kind == WAIT:
        kind = 0
    known = kind == 0
    for i in range(integers[body, CONTACT_COUNT]):
        if integers[body, FIRST_CONTACT + 2 * i] == kind and integers[body, FIRST_CONTACT + 2 * i + 1] == row:
            known = True
    if not known and integers[body, CONTACT_COUNT] < MAX_CONTACTS:
        at = FIRST_CONTACT + 2 * integers[body, CONTACT_COUNT]
        integers[body, at] = kind
        integers[body, at + 1] = row
        integers[body, CONTACT_COUNT] += 1


@ti.func
def max_step_angle(bodies: Template, body: ti.i32):
    """Return the largest angle, rad, at which every sphere stays within MAX_BEND of its chord."""
    return ti.sqrt(8.0 * MAX_BEND / ti.max(bodies[body, RADIUS], 1e-6))


@ti.func
def apply_motion(bodies: Template, body: ti.i32, part):
    """Apply the fraction `part` (0..1) of the attempted motion to the body's pose."""
    move = read3(bodies, body, MOVE)
    turn = read3(bodies, body, TURN)
    write3(bodies, body, POSITION, read3(bodies, body, POSITION) + part * move)
    rotation = multiply(quaternion_from_rotation_vector(part * turn), read4(bodies, body, ROTATION))
    write4(bodies, body, ROTATION, unit(rotation, rotation))
