# SPDX-License-Identifier: Apache-2.0
"""Directions as places on the faces of a cube, which are divided into square cells.

Faces 0 and 1 look along -x and x, 2 and 3 along -y and y, 4 and 5 along -z and z.
"""

import taichi as ti

from tiscene.device.kernel_types import vec3


@ti.func
def place_on_cube(direction: vec3, size: ti.i32) -> vec3:
    """Return the cube face that a direction goes through, and the row and column there, in cells, with fractions.

    Args:
        direction: Need not have unit length.
        size: Cells along a side of a face.
    """
    magnitude = ti.abs(direction)
    axis = 0
    ahead, across, down = direction.x, direction.y, direction.z
    if magnitude.y > magnitude.x and magnitude.y >= magnitude.z:
        axis = 1
        ahead, across, down = direction.y, direction.z, direction.x
    elif magnitude.z > magnitude.x:
        axis = 2
        ahead, across, down = direction.z, direction.x, direction.y
    half = 0.5 * ti.cast(size, ti.f32)
    column, row = (across / ahead + 1.0) * half, (down / ti.abs(ahead) + 1.0) * half
    return vec3(2 * axis + ti.cast(ahead > 0.0, ti.i32), row, column)


@ti.func
def cell_of(direction: vec3, size: ti.i32) -> ti.math.ivec3:
    """Return the cube face that a direction goes through, and the row and column of the cell on it; see above."""
    place = ti.cast(place_on_cube(direction, size), ti.i32)
    return ti.math.ivec3(place[0], ti.math.clamp(place[1], 0, size - 1), ti.math.clamp(place[2], 0, size - 1))
