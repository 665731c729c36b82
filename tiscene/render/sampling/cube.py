# SPDX-License-Identifier: Apache-2.0
"""Directions as places on the faces of a cube, which are divided into cells by equal angles.

Faces 0 and 1 look along -x and x, 2 and 3 along -y and y, 4 and 5 along -z and z. Rows and columns are planes through
the center with equal angles between them (an equi-angular cube map): squares of equal size would be five times as dense
in the corners as in the middle of a face, these are at most 1.4 times.
"""

import math

import taichi as ti

from tiscene.device.kernel_types import vec3
from tiscene.render.sampling.warp import ARCTANGENT, polynomial

FACES = 6
FACE_ANGLE = 0.5 * math.pi  # that a face spans along a middle line, rad
_FROM_MIDDLE = [4.0 / math.pi * coefficient for coefficient in ARCTANGENT]  # of a tangent -1..1: a place -1..1


@ti.func
def place_on_cube(direction: vec3, size: ti.i32) -> vec3:
    """Return the cube face that a direction goes through, and the row and column there, in cells, with fractions.

    Args:
        direction: Need not have unit length.
        size: Cells along a side of a face.
    """
    axis = nearest_axis(direction)
    ahead, across, down = along_axes(direction, axis)
    half, inverse = 0.5 * ti.cast(size, ti.f32), 1.0 / ahead
    u, v = across * inverse, down * ti.abs(inverse)
    row = (v * polynomial(_FROM_MIDDLE, v * v) + 1.0) * half
    column = (u * polynomial(_FROM_MIDDLE, u * u) + 1.0) * half
    return vec3(2 * axis + ti.cast(ahead > 0.0, ti.i32), row, column)


@ti.func
def nearest_axis(direction: vec3) -> ti.i32:
    """Return the axis that a direction is nearest to: 0, 1 or 2."""
    x, y, z = ti.abs(direction.x), ti.abs(direction.y), ti.abs(direction.z)  # of the vector: not in vector mode
    axis = 0
    if y > x and y >= z:
        axis = 1
    elif z > x:
        axis = 2
    return axis


@ti.func
def along_axes(vector: vec3, axis: ti.i32):
    """Return the components of a vector along an axis, along the columns of its faces, and along their rows."""
    result = vector
    if axis == 1:
        result = vector.yzx
    elif axis == 2:
        result = vector.zxy
    return result.x, result.y, result.z


@ti.func
def extent_on_cube(direction: vec3, right: vec3, down: vec3, size: ti.i32) -> ti.math.vec2:
    """Return the rows and columns that a pixel extends over, in cells: those of a rectangle with its second moments.

    Args:
        direction: To its center, as of `place_on_cube`.
        right, down: The steps to the directions to the next pixels.
        size: Cells along a side of a face.
    """
    axis = nearest_axis(direction)
    ahead, across, below = along_axes(direction, axis)
    u, v = across / ahead, below / ti.abs(ahead)
    extent = ti.math.vec2(0.0)
    for step in ti.static((right, down)):
        ahead_change, across_change, below_change = along_axes(step, axis)
        u_change = (across_change - u * ahead_change) / ahead
        v_change = (below_change - v * ahead_change * ti.math.sign(ahead)) / ahead
        extent += ti.math.vec2(v_change, u_change) ** 2
    return size * (1.0 / FACE_ANGLE) * ti.sqrt(extent) / (1.0 + ti.math.vec2(v, u) ** 2)


@ti.func
def cell_of(direction: vec3, size: ti.i32) -> ti.math.ivec3:
    """Return the cube face that a direction goes through, and the row and column of the cell on it; see above."""
    place = place_on_cube(direction, size)
    face, row, column = ti.cast(place[0], ti.i32), ti.cast(place[1], ti.i32), ti.cast(place[2], ti.i32)
    return ti.math.ivec3(face, ti.math.clamp(row, 0, size - 1), ti.math.clamp(column, 0, size - 1))


@ti.func
def direction_to(face: ti.i32, row: ti.f32, column: ti.f32, size: ti.i32) -> vec3:
    """Return a direction through a place of `place_on_cube`, or on the plane of a face beyond its edges."""
    angle = FACE_ANGLE / ti.cast(size, ti.f32)
    ahead = ti.cast(2 * (face % 2) - 1, ti.f32)
    across = ahead * ti.tan((column - 0.5 * size) * angle)
    down = ti.tan((row - 0.5 * size) * angle)
    direction = vec3(ahead, across, down)
    if face // 2 == 1:
        direction = vec3(down, ahead, across)
    elif face // 2 == 2:
        direction = vec3(across, down, ahead)
    return direction
