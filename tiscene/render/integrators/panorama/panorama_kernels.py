# SPDX-License-Identifier: Apache-2.0
"""Kernels of panoramas: which blocks a view shows, and its image, resampled from cells."""

import taichi as ti

from tiscene.device.kernel_types import Floats2, Floats3, Floats4, Ints1, Ints2, Ints3, Template
from tiscene.render.integrators.panorama.packed_cells import UNIT, unpacked
from tiscene.render.sampling.cube import cell_of
from tiscene.render.view import CENTER, RIGHT, TANGENT, UP, view_vector
from tiscene.scene.placement import CURRENT

# Powers of two: kernels shift and mask, since Taichi's integer division rounds down at some cost.
TILE_BITS, BLOCK_BITS = 3, 5
TILE = 1 << TILE_BITS  # cells along a side of a tile
BLOCK = 1 << BLOCK_BITS  # cells along a side of a block
WINDOW = BLOCK + 2 * TILE  # cells along a side of a block and the tiles around it
SIDE = 4  # subpixels along a side of a pixel


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
def find_blocks(view: Floats2, width: ti.i32, height: ti.i32, size: ti.i32, needed: Ints3):
    """Set needed[face, row, column] to 1 for each block that the view shows.

    Args:
        view: The view, of a pinhole camera.
        size: Cells along a side of a face.
        needed: Output, i32 [6, blocks, blocks], zeros before.
    """
    for pixel in range(width * height):
        corner, right, down = pixel_directions(view, pixel, width, height)
        # Blocks are wider than two pixels, so that any block shows at a border or contains a pixel's first subpixel.
        x, y = pixel % width, pixel // width
        is_inside = ti.min(x, width - 1 - x, y, height - 1 - y) > 0
        count = 1 if is_inside else SIDE * SIDE
        for subpixel in range(count):
            cell = cell_of(corner + subpixel % SIDE * right + subpixel // SIDE * down, size)
            needed[cell[0], cell[1] // BLOCK, cell[2] // BLOCK] = 1


@ti.func
def tile_row(tiles: Ints3, face: ti.i32, row: ti.i32, column: ti.i32) -> ti.i32:
    """Return the row of the cells of tiles that holds a cell, negative if none does.

    Rows and columns -TILE .. -1 are those of the margin of a face.
    """
    y, x = row + TILE, column + TILE
    slot = tiles[face, y >> TILE_BITS, x >> TILE_BITS]
    return (slot << (2 * TILE_BITS)) + ((y & (TILE - 1)) << TILE_BITS) + (x & (TILE - 1))


@ti.func
def block_row(blocks: Ints3, face: ti.i32, row: ti.i32, column: ti.i32) -> ti.i32:
    """Return the row of the cells of blocks that holds a cell, negative if none does."""
    slot = blocks[face, row >> BLOCK_BITS, column >> BLOCK_BITS]
    return (slot << (2 * BLOCK_BITS)) + ((row & (BLOCK - 1)) << BLOCK_BITS) + (column & (BLOCK - 1))


@ti.kernel
def gather_windows(places: Ints2, tiles: Ints3, traced: Ints2, columns: Template, windows: Floats3):
    """Copy the cells of blocks and of the tiles around them.

    Args:
        places: i32 [n, 3], face, row and column of each block.
        tiles: i32 [6, tiles + 2, tiles + 2], place of each tile in `traced`, in tiles; the outermost are the margin.
        traced: i32 [slots * TILE * TILE, words], see `packed_cells`.
        columns: Their number of columns.
        windows: Output, f32 [n, WINDOW * WINDOW, columns].
    """
    for window, cell in ti.ndrange(places.shape[0], WINDOW * WINDOW):
        row = places[window, 1] * BLOCK - TILE + cell // WINDOW
        column = places[window, 2] * BLOCK - TILE + cell % WINDOW
        source = tile_row(tiles, places[window, 0], row, column)
        for c in ti.static(range(columns)):
            windows[window, cell, c] = UNIT * unpacked(traced[source, c // 2], c)


@ti.kernel
def resample(
    view: Floats2,
    width: ti.i32,
    height: ti.i32,
    size: ti.i32,
    blocks: Ints3,
    cells: Ints2,
    columns: Template,
    images: Floats4,
) -> ti.i32:
    """Average the cells that the subpixels of each pixel show.

    Args:
        view: The view, of a pinhole camera.
        size: Cells along a side of a face.
        blocks: i32 [6, blocks, blocks], place of each block in `cells`, in blocks.
        cells: i32 [slots * BLOCK * BLOCK, words], see `packed_cells`; at least `columns` values.
        columns: Number of columns to average.
        images: Output, f32 [columns / 3, h, w, 3].

    Returns:
        Number of times that a cell was not there; 0: the images are complete.
    """
    missing = 0
    for pixel in range(width * height):
        sums = ti.Vector.zero(ti.f32, columns)
        corner, right, down = pixel_directions(view, pixel, width, height)
        for y, x in ti.ndrange(SIDE, SIDE):
            cell = cell_of(corner + x * right + y * down, size)
            row = block_row(blocks, cell[0], cell[1], cell[2])
            if row < 0:
                missing += 1
            else:
                for c in ti.static(range(columns)):
                    sums[c] += unpacked(cells[row, c // 2], c)
        for c in ti.static(range(columns)):
            images[c // 3, pixel // width, pixel % width, c % 3] = sums[c] * (UNIT / (SIDE * SIDE))
    return missing


@ti.kernel
def store_cells(values: Ints3, slots: Ints1, cells: Ints2):
    """Copy groups of cells to their places.

    Args:
        values: i32 [n, size, words].
        slots: i32 [n], place of each group in `cells`, in groups.
        cells: Output, i32 [slots * size, words].
    """
    size = values.shape[1]
    for group, cell in ti.ndrange(slots.shape[0], size):
        for word in range(values.shape[2]):
            cells[slots[group] * size + cell, word] = values[group, cell, word]
