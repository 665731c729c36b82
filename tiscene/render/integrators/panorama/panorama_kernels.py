# SPDX-License-Identifier: Apache-2.0
"""Kernels of panoramas: which blocks a view shows, and its image, resampled from cells."""

from typing import NamedTuple

import taichi as ti

from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import Floats2, Floats3, Floats4, Ints1, Ints2, Ints3, Template, vec3, vec4
from tiscene.render.integrators.panorama.packed_cells import UNIT, unpacked
from tiscene.render.intersect.ray_queue import Rays, write_ray
from tiscene.render.sampling.cube import extent_on_cube, place_on_cube
from tiscene.render.view import CENTER, RIGHT, TANGENT, UP, camera_ray, view_vector
from tiscene.scene.placement import CURRENT

# Powers of two: kernels shift and mask, since Taichi's integer division rounds down at some cost.
TILE_BITS, BLOCK_BITS = 3, 5
TILE = 1 << TILE_BITS  # cells along a side of a tile
BLOCK = 1 << BLOCK_BITS  # cells along a side of a block
WINDOW = BLOCK + 2 * TILE  # cells along a side of a block and the tiles around it
COARSE_BITS = BLOCK_BITS - 1
COARSE = 1 << COARSE_BITS  # coarse cells along a side of a block, each the mean of 2 x 2 cells
BLOCK_ROWS = BLOCK * BLOCK + COARSE * COARSE  # of cells, and then of coarse cells
NORMAL_RANGE, DISTANCE_RANGE = 0.1, 1.1  # of even cells: difference of components of normals, ratio of distances
_CLEARANCE = 0.01  # cells that footprints are enlarged by to find blocks, since rounding may differ between kernels


class Blocks(NamedTuple):
    """The blocks of a panorama; a parameter of kernels, see `argument_bundles`.

    Attributes:
        size: Cells along a side of a face.
        slots: i32 [6, blocks, blocks], place of each block in `cells`, in blocks; negative if it is not there.
        cells: i32 [slots * BLOCK_ROWS, words], see `packed_cells`: the columns that views need, and the distance, see
            `Panorama`; of coarse cells as of `fill_blocks`.
    """

    size: ti.i32
    slots: Ints3
    cells: Ints2


@ti.func
def pixel_directions(view: Template, pixel: ti.i32, width: ti.i32, height: ti.i32):
    """Return the direction to a pixel's center, and the steps to the next pixel to the right and down."""
    scale = 2.0 * view[CURRENT, TANGENT] / height
    right, down = scale * view_vector(view, CURRENT, RIGHT), -scale * view_vector(view, CURRENT, UP)
    x = ti.cast(pixel % width, ti.f32) - 0.5 * (width - 1)
    y = ti.cast(pixel // width, ti.f32) - 0.5 * (height - 1)
    return view_vector(view, CURRENT, CENTER) + x * right + y * down, right, down


@ti.func
def footprint(direction: vec3, right: vec3, down: vec3, size: ti.i32, enlarged: ti.f32):
    """Return the cube face at a pixel's center, and the box of cells that the pixel covers there.

    Args:
        direction, right, down: Of `pixel_directions`.
        size: Cells along a side of a face.
        enlarged: Cells that are added on each side.

    Returns:
        The face; the first and last row and column of the box, with fractions, as far as it is on the face.
    """
    place, half = place_on_cube(direction, size), 0.5 * extent_on_cube(direction, right, down, size) + enlarged
    first = ti.math.clamp(place.yz - half, 0.0, size - 1e-3)
    last = ti.math.clamp(place.yz + half, first + 1e-3, ti.cast(size, ti.f32))
    return ti.cast(place[0], ti.i32), first, last


@ti.kernel
def find_blocks(view: Floats2, width: ti.i32, height: ti.i32, size: ti.i32, needed: Ints3):
    """Set needed[face, row, column] to 1 for each block that the view shows.

    Args:
        view: The view, of a pinhole camera.
        size: Cells along a side of a face.
        needed: Output, i32 [FACES, blocks, blocks], zeros before.
    """
    for pixel in range(width * height):
        direction, right, down = pixel_directions(view, pixel, width, height)
        face, first, last = footprint(direction, right, down, size, _CLEARANCE)
        first_block = ti.cast(first, ti.i32) >> BLOCK_BITS
        last_block = ti.cast(ti.ceil(last) - 1.0, ti.i32) >> BLOCK_BITS
        for row in range(first_block[0], last_block[0] + 1):
            for column in range(first_block[1], last_block[1] + 1):
                needed[face, row, column] = 1
        need_around(direction, size >> 1, COARSE_BITS, needed)


@ti.kernel
def center_rays(pixels: Ints1, view: Floats2, width: ti.i32, height: ti.i32, rays: Rays):
    """Generate the rays through the centers of some pixels.

    Args:
        pixels: Pixels, y * width + x.
        view: The view.
        width, height: Image size, px.
        rays: Output, one for each of the pixels.
    """
    for i in range(pixels.shape[0]):
        x, y = pixels[i] % width, pixels[i] // width
        origin, direction = camera_ray(view, CURRENT, ti.cast(x, ti.f32), ti.cast(y, ti.f32), width, height)
        write_ray(rays, i, origin, direction, ti.math.inf)


@ti.func
def tile_row(tiles: Ints3, face: ti.i32, row: ti.i32, column: ti.i32) -> ti.i32:
    """Return the row of the cells of tiles that holds a cell, negative if none does.

    Rows and columns -TILE .. -1 are those of the margin of a face.
    """
    y, x = row + TILE, column + TILE
    slot = tiles[face, y >> TILE_BITS, x >> TILE_BITS]
    return (slot << (2 * TILE_BITS)) + ((y & (TILE - 1)) << TILE_BITS) + (x & (TILE - 1))


@ti.func
def block_row(blocks: Template, face: ti.i32, row: ti.i32, column: ti.i32) -> ti.i32:
    """Return the row of the cells of blocks that holds a cell, negative if none does."""
    slot = blocks.slots[face, row >> BLOCK_BITS, column >> BLOCK_BITS]
    return slot * BLOCK_ROWS + ((row & (BLOCK - 1)) << BLOCK_BITS) + (column & (BLOCK - 1))


@ti.func
def coarse_row(blocks: Template, face: ti.i32, row: ti.i32, column: ti.i32) -> ti.i32:
    """Return the row of the cells of blocks that holds a coarse cell, negative if none does."""
    slot = blocks.slots[face, row >> COARSE_BITS, column >> COARSE_BITS]
    first = slot * BLOCK_ROWS + BLOCK * BLOCK
    return first + ((row & (COARSE - 1)) << COARSE_BITS) + (column & (COARSE - 1))


@ti.func
def cells_around(seen: vec3, size: ti.i32):
    """Return the cube face that a point is seen through, the first of the four cells around, and the point's place.

    The cells are the first one and the next ones in its row and column. The place is from 0 to 1 between their centers,
    down and to the right.
    """
    place = place_on_cube(seen, size)
    row, column = ti.floor(place[1] - 0.5, ti.i32), ti.floor(place[2] - 0.5, ti.i32)
    within = ti.math.vec2(place[1] - 0.5 - row, place[2] - 0.5 - column)
    return ti.math.ivec3(ti.cast(place[0], ti.i32), row, column), within


@ti.func
def even_cells(seen: vec3, blocks: Template, columns: Template):
    """Interpolate between the coarse cells around a direction.

    Args:
        seen: The direction.
        blocks: Of the panorama, see `Blocks`.
        columns: Number of columns to interpolate.

    Returns:
        The values of the columns, in UNITs.
        The distance, m; 0 if one of the coarse cells is not even, see `fill_blocks`.
        Number of cells that are not there.
    """
    size = blocks.size >> 1
    first, within = cells_around(seen, size)
    values, distance, even, missing = ti.Vector.zero(ti.f32, columns), 0.0, 1, 0
    rows, weights = ti.Vector.zero(ti.i32, 4), ti.Vector.zero(ti.f32, 4)
    for down, right in ti.static(ti.ndrange(2, 2)):
        y, x = ti.math.clamp(first[1] + down, 0, size - 1), ti.math.clamp(first[2] + right, 0, size - 1)
        row = coarse_row(blocks, first[0], y, x)
        if row < 0:
            missing += 1
            row = 0
        rows[2 * down + right] = row
        weights[2 * down + right] = ti.abs(1 - down - within[0]) * ti.abs(1 - right - within[1])
        measured = unpacked(blocks.cells[row, columns // 2], columns)
        distance += weights[2 * down + right] * measured
        if not measured > 0.0:
            even = 0
    if even == 0:
        distance = 0.0
    else:
        for i in ti.static(range(4)):
            for c in ti.static(range(columns)):
                values[c] += weights[i] * unpacked(blocks.cells[rows[i], c // 2], c)
    return values, UNIT * distance, missing


@ti.func
def need_around(seen: vec3, size: ti.i32, block_bits: ti.i32, needed: Ints3):
    """Set needed[face, row, column] to 1 for the blocks with the four cells around a point.

    Args:
        seen: The point.
        size: Cells along a side of a face; half of them for coarse cells.
        block_bits: BLOCK_BITS or COARSE_BITS.
        needed: i32 [6, blocks, blocks].
    """
    first, _ = cells_around(seen, size)
    for y, x in ti.static(ti.ndrange(2, 2)):
        row, column = ti.math.clamp(first[1] + y, 0, size - 1), ti.math.clamp(first[2] + x, 0, size - 1)
        needed[first[0], row >> block_bits, column >> block_bits] = 1


@ti.kernel
def gather_windows(places: Ints2, tiles: Ints3, traced: Ints2, columns: Template, windows: Floats3):
    """Copy the cells of blocks and of the tiles around them.

    Args:
        places: i32 [n, 3], face, row and column of each block.
        tiles: i32 [6, tiles + 2, tiles + 2], place of each tile in `traced`, in tiles; the outermost are the margin.
        traced: i32 [slots * TILE * TILE, words], see `packed_cells`.
        columns: Their number of columns.
        windows: Output, f32 [n, WINDOW * WINDOW, at least as many], the last column at the end, the others in front.
    """
    for window, cell in ti.ndrange(places.shape[0], WINDOW * WINDOW):
        row = places[window, 1] * BLOCK - TILE + cell // WINDOW
        column = places[window, 2] * BLOCK - TILE + cell % WINDOW
        source = tile_row(tiles, places[window, 0], row, column)
        for c in ti.static(range(columns - 1)):
            windows[window, cell, c] = UNIT * unpacked(traced[source, c // 2], c)
        last = windows.shape[2] - 1
        windows[window, cell, last] = UNIT * unpacked(traced[source, (columns - 1) // 2], columns - 1)


@ti.kernel
def fill_blocks(windows: Floats3, normal: ti.i32, cells: Floats3):
    """Copy the cells of blocks from their windows, and average them to coarse cells.

    Args:
        windows: f32 [n, WINDOW * WINDOW, columns].
        normal: First column of the normal. The last column is the distance.
        cells: Output, f32 [n, BLOCK_ROWS, columns]. The distance of a coarse cell is 0 if it is not even: if normals or
            distances differ much in it and the cells around.
    """
    for block, row in ti.ndrange(cells.shape[0], BLOCK_ROWS):
        columns = cells.shape[2]
        if row < BLOCK * BLOCK:
            cell = (TILE + (row >> BLOCK_BITS)) * WINDOW + TILE + (row & (BLOCK - 1))
            for c in range(columns):
                cells[block, row, c] = windows[block, cell, c]
        else:
            coarse = row - BLOCK * BLOCK
            cell = (TILE + 2 * (coarse >> COARSE_BITS)) * WINDOW + TILE + 2 * (coarse & (COARSE - 1))
            for c in range(columns):
                upper = windows[block, cell, c] + windows[block, cell + 1, c]
                lower = windows[block, cell + WINDOW, c] + windows[block, cell + WINDOW + 1, c]
                cells[block, row, c] = 0.25 * (upper + lower)
            least, most = vec4(ti.math.inf), vec4(-ti.math.inf)  # of the normal and the distance
            for y, x in ti.ndrange((-1, 3), (-1, 3)):
                near = cell + y * WINDOW + x
                value = vec4(0.0)
                for c in ti.static(range(3)):
                    value[c] = windows[block, near, normal + c]
                value[3] = windows[block, near, columns - 1]
                least, most = ti.min(least, value), ti.max(most, value)
            range_of_normals = (most.xyz - least.xyz).max()
            if range_of_normals >= NORMAL_RANGE or least[3] <= 0.0 or most[3] >= DISTANCE_RANGE * least[3]:
                cells[block, row, columns - 1] = 0.0


@ti.kernel
@bundled
def resample_even(
    view: Floats2,
    width: ti.i32,
    height: ti.i32,
    blocks: Blocks,
    columns: Template,
    images: Floats4,
    even: Ints2,
    missing: Ints1,
):
    """Interpolate for each pixel between the coarse cells around its center, if they are even.

    Args:
        view: The view, of a pinhole camera.
        blocks: Of the panorama.
        columns: Number of columns to interpolate.
        images: Output, f32 [columns / 3, h, w, 3].
        even: Output, i32 [h, w], 1 where they are; else 0, and the images are not written.
        missing: Output, i32 [1], zero before: 1 if a cell is not there. Most pixels are left out then.
    """
    for pixel in range(width * height):
        if missing[0] == 0:
            y, x = pixel // width, pixel % width
            direction, _, _ = pixel_directions(view, pixel, width, height)
            values, distance, away = even_cells(direction, blocks, columns)
            if away > 0:
                missing[0] = 1
            even[y, x] = 0
            if distance > 0.0:
                even[y, x] = 1
                for c in ti.static(range(columns)):
                    images[c // 3, y, x, c % 3] = values[c] * UNIT


@ti.kernel
@bundled
def resample(
    pixels: Ints1,
    view: Floats2,
    width: ti.i32,
    height: ti.i32,
    blocks: Blocks,
    columns: Template,
    images: Floats4,
    missing: Ints1,
):
    """Average the cells that each pixel covers, by area.

    Args:
        pixels: Pixels, y * width + x.
        view, blocks, columns, images, missing: As of `resample_even`.
    """
    for i in range(pixels.shape[0]):
        if missing[0] == 0:
            pixel = pixels[i]
            sums = ti.Vector.zero(ti.f32, columns)
            direction, right, down = pixel_directions(view, pixel, width, height)
            face, first, last = footprint(direction, right, down, blocks.size, 0.0)
            for row in range(ti.cast(first[0], ti.i32), ti.cast(ti.ceil(last[0]), ti.i32)):
                height_here = ti.min(last[0], row + 1.0) - ti.max(first[0], row)
                for column in range(ti.cast(first[1], ti.i32), ti.cast(ti.ceil(last[1]), ti.i32)):
                    area = height_here * (ti.min(last[1], column + 1.0) - ti.max(first[1], column))
                    cell = block_row(blocks, face, row, column)
                    if cell < 0:
                        missing[0] = 1
                    else:
                        for c in ti.static(range(columns)):
                            sums[c] += area * unpacked(blocks.cells[cell, c // 2], c)
            scale = UNIT / ((last[0] - first[0]) * (last[1] - first[1]))
            for c in ti.static(range(columns)):
                images[c // 3, pixel // width, pixel % width, c % 3] = sums[c] * scale


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
