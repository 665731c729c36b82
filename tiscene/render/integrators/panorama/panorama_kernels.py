# SPDX-License-Identifier: Apache-2.0
"""Kernels of panoramas: which tiles a view shows, and its image, resampled from their cells."""

import taichi as ti

from tiscene.device.kernel_types import Floats2, Floats3, Ints1, Ints3, Template, vec3
from tiscene.render.view import CENTER, RIGHT, TANGENT, UP, view_vector
from tiscene.scene.placement import CURRENT

TILE = 16  # cells along a side of a tile
SIDE = 4  # subpixels along a side of a pixel


@ti.func
def cell_of(direction: vec3, size: ti.i32) -> ti.math.ivec3:
    """Return the cube face that a direction goes through, and the row and column of the cell on it.

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
    column = ti.cast((across / ahead + 1.0) * half, ti.i32)
    row = ti.cast((down / ti.abs(ahead) + 1.0) * half, ti.i32)
    face = 2 * axis + ti.cast(ahead > 0.0, ti.i32)
    return ti.math.ivec3(face, ti.math.clamp(row, 0, size - 1), ti.math.clamp(column, 0, size - 1))


@ti.func
def pixel_directions(view: Template, pixel: ti.i32, width: ti.i32, height: ti.i32):
    """Return the directions to the center of a pixel's first subpixel, and the steps to the next column and row."""
    scale = 2.0 * view[CURRENT, TANGENT] / height
    right, down = scale * view_vector(view, CURRENT, RIGHT), -scale * view_vector(view, CURRENT, UP)
    first = 0.5 / SIDE - 0.5
    x = ti.cast(pixel % width, ti.f32) - 0.5 * (width - 1) + first
    y = ti.cast(pixel // width, ti.f32) - 0.5 * (height - 1) + first
    return view_vector(view, CURRENT, CENTER) + x * right + y * down, right / SIDE, down / SIDE


@ti.kernel
def find_tiles(view: Floats2, width: ti.i32, height: ti.i32, size: ti.i32, needed: Ints3):
    """Set needed[face, row, column] to 1 for each tile that the view shows.

    Args:
        view: The view, of a pinhole camera.
        size: Cells along a side of a face.
        needed: Output, i32 [6, tiles, tiles], zeros before.
    """
    for pixel in range(width * height):
        corner, right, down = pixel_directions(view, pixel, width, height)
        for y, x in ti.ndrange(SIDE, SIDE):
            cell = cell_of(corner + x * right + y * down, size)
            needed[cell[0], cell[1] // TILE, cell[2] // TILE] = 1


@ti.kernel
def resample(
    view: Floats2,
    width: ti.i32,
    height: ti.i32,
    size: ti.i32,
    slots: Ints3,
    cells: Floats2,
    columns: Template,
    image: Floats3,
):
    """Average the cells that the subpixels of each pixel show.

    Args:
        view: The view, of a pinhole camera.
        size: Cells along a side of a face.
        slots: i32 [6, tiles, tiles], place of each tile in `cells`, in tiles.
        cells: f32 [slots * TILE * TILE, columns].
        columns: Their number of columns.
        image: Output, f32 [h, w, columns].
    """
    for pixel in range(width * height):
        sums = ti.Vector.zero(ti.f32, columns)
        corner, right, down = pixel_directions(view, pixel, width, height)
        for y, x in ti.ndrange(SIDE, SIDE):
            cell = cell_of(corner + x * right + y * down, size)
            tile = slots[cell[0], cell[1] // TILE, cell[2] // TILE]
            row = tile * (TILE * TILE) + cell[1] % TILE * TILE + cell[2] % TILE
            for c in ti.static(range(columns)):
                sums[c] += cells[row, c]
        for c in ti.static(range(columns)):
            image[pixel // width, pixel % width, c] = sums[c] / (SIDE * SIDE)


@ti.kernel
def store_tiles(tiles: Floats3, slots: Ints1, columns: ti.i32, cells: Floats2):
    """Copy tiles to their places.

    Args:
        tiles: f32 [n, TILE * TILE, columns].
        slots: i32 [n], place of each tile in `cells`, in tiles.
        columns: Their number of columns.
        cells: Output, f32 [slots * TILE * TILE, columns].
    """
    for tile, cell in ti.ndrange(slots.shape[0], TILE * TILE):
        for c in range(columns):
            cells[slots[tile] * (TILE * TILE) + cell, c] = tiles[tile, cell, c]
