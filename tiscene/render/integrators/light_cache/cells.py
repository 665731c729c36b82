# SPDX-License-Identifier: Apache-2.0
"""Cells of the light cache: the parts of surfaces in the cubes of a world-space grid, and a hash table of them.

A cell is the part of one instance's surface that is in one cube and faces about one direction. Cubes have sizes in
powers of two, so that a cell is about as large as a pixel wherever it is seen from. The table uses open addressing with
linear probing. Its order depends on the order of insertion; what a lookup returns does not.
"""

from typing import NamedTuple

import taichi as ti

from tiscene.device.kernel_types import Floats2, Ints2, Template, u32, vec2, vec3
from tiscene.render.sampling.sobol import combine, mix
from tiscene.render.sampling.warp import tangents

# A cell as a vector of integers: two words of its key, and what they are hashed from.
CELL_COLUMNS = 8
cell = ti.types.vector(CELL_COLUMNS, ti.i32)
CellList = ti.types.ndarray(cell, 1)
KEY1, KEY2, INSTANCE, LEVEL, X, Y, Z, SIDE = range(CELL_COLUMNS)

LEAST_LEVEL, LARGEST_LEVEL = -20, 12  # log2 of a cube's side, m
# Planes at round coordinates must not coincide with sides of cubes.
GRID_SHIFT = 0.37
# Normals are divided by their largest component's axis and sign, and by thirds of the other two components.
TILT = 0.35
LEAST_COSINE = 0.1
# Cells seen in reflections are of one size, m. Smaller cells would be needed once only, since each frame traces other
# rays.
REFLECTED_WIDTH = 0.2
# Points are displaced by up to so many cells: the noise of cells then differs between pixels, and can be denoised.
RADIUS = 2.0
VALUE_COLUMNS = 4
VALID = 3  # column of a value: 1 if the cell has light, 0 if no point of its surface was found
NOT_FOUND = -1


class Cells(NamedTuple):
    """The hash table on the device; a parameter of kernels, see `argument_bundles`.

    Attributes:
        keys: i32 [capacity, 2], two words of each key; second word 0: free. The capacity is a power of two.
        values: f32 [capacity, 4], radiance reflected by a white diffuse surface, W/m²/sr, and VALID.
    """

    keys: Ints2
    values: Floats2


@ti.func
def level_for(width: ti.f32) -> ti.i32:
    """Return the level of the largest cube that is not larger than a width, m: the exponent of the number."""
    return ti.math.clamp((ti.bit_cast(width, ti.i32) >> 23) - 127, LEAST_LEVEL, LARGEST_LEVEL)


@ti.func
def lookup_width(distance: ti.f32, spread: ti.f32, cell_width: ti.f32, reflected: ti.i32) -> ti.f32:
    """Return the width of the cells that a ray looks up, m.

    Args:
        distance: Of the hit, m.
        spread: Of the ray cone, m per m.
        cell_width: Width of a cell over that of the footprint.
        reflected: 1 after a vertex that is not mirror-like.
    """
    width = distance * spread * cell_width
    if reflected != 0:
        width = REFLECTED_WIDTH
    return width


@ti.func
def cell_size(level: ti.i32) -> ti.f32:
    """Return the side of the cubes of a level, m; exact."""
    return ti.bit_cast((level + 127) << 23, ti.f32)


@ti.func
def tilt(component: ti.f32) -> ti.i32:
    """Return which third a component of a normal is in, 0..2."""
    return ti.cast(component > -TILT, ti.i32) + ti.cast(component > TILT, ti.i32)


@ti.func
def side_of(normal: vec3) -> ti.i32:
    """Return the bin of a normal: (2 * axis + sign) * 9 + tilts."""
    size = ti.max(normal, -1.0 * normal)
    result = 0
    if size.x >= size.y and size.x >= size.z:
        result = ti.cast(normal.x < 0.0, ti.i32) * 9 + tilt(normal.y) * 3 + tilt(normal.z)
    elif size.y >= size.z:
        result = (2 + ti.cast(normal.y < 0.0, ti.i32)) * 9 + tilt(normal.z) * 3 + tilt(normal.x)
    else:
        result = (4 + ti.cast(normal.z < 0.0, ti.i32)) * 9 + tilt(normal.x) * 3 + tilt(normal.y)
    return result


@ti.func
def cell_at(instance: ti.i32, level: ti.i32, position: vec3, normal: vec3):
    """Return the cell of a point of a surface.

    Args:
        instance: Row of the instance.
        level: See `level_for`.
        position: World space, m.
        normal: Shading normal without the normal map, towards the viewer.
    """
    scale = 1.0 / cell_size(level)
    result = cell(0)
    result[INSTANCE], result[LEVEL], result[SIDE] = instance, level, side_of(normal)
    for axis in ti.static(range(3)):
        result[X + axis] = ti.cast(ti.floor(position[axis] * scale + GRID_SHIFT), ti.i32)
    key, other = mix(ti.cast(instance, u32) + u32(1)), mix(ti.cast(instance, u32) + u32(77))
    for column in ti.static((LEVEL, X, Y, Z, SIDE)):
        key = combine(key, ti.cast(result[column], u32))
    for column in ti.static((SIDE, Z, Y, X, LEVEL)):
        other = combine(other, ti.cast(result[column], u32))
    result[KEY1] = ti.cast(key, ti.i32)
    result[KEY2] = ti.cast(other | u32(1), ti.i32)
    return result


@ti.func
def cell_for(instance: ti.i32, width: ti.f32, surface: Template, direction: vec3, u: vec2):
    """Return the cell in which a ray's light is looked up: that of a point displaced at random along the surface.

    Args:
        instance: Row of the instance.
        width: Of a cell that faces the ray, m.
        surface: VisibleSurface.
        direction: Of the ray.
        u: Uniform in [0, 1)².
    """
    # Cells of surfaces seen at an angle are between the two sides of the footprint.
    cosine = ti.max(ti.abs(surface.geometric_normal.dot(direction)), LEAST_COSINE)
    level = level_for(width / ti.sqrt(cosine))
    s, t = tangents(surface.geometric_normal)
    offset = (s * (2.0 * u.x - 1.0) + t * (2.0 * u.y - 1.0)) * (RADIUS * cell_size(level))
    return cell_at(instance, level, surface.position + offset, surface.normal)


@ti.func
def own_cell(instance: ti.i32, width: ti.f32, surface: Template, direction: vec3):
    """Return the cell of the point itself, see `cell_for`."""
    return cell_for(instance, width, surface, direction, vec2(0.5))


@ti.func
def find(cells: Template, each: Template) -> ti.i32:
    """Return the slot of a cell in the table, or NOT_FOUND."""
    mask = cells.keys.shape[0] - 1
    slot, result, searching = each[KEY1] & mask, NOT_FOUND, True
    while searching:
        word = cells.keys[slot, 1]
        if word == 0:
            searching = False
        elif word == each[KEY2] and cells.keys[slot, 0] == each[KEY1]:
            result, searching = slot, False
        slot = (slot + 1) & mask
    return result


@ti.func
def lit_slot(cells: Template, each: Template) -> ti.i32:
    """Return the slot of a cell that has light, or NOT_FOUND."""
    slot = find(cells, each)
    if slot >= 0:
        if cells.values[slot, VALID] == 0.0:
            slot = NOT_FOUND
    return slot
