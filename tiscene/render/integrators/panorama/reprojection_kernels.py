# SPDX-License-Identifier: Apache-2.0
"""Kernels of reprojection: points that subpixels show, and their light in the cells of a panorama."""

import taichi as ti

from tiscene.device.kernel_types import Float4s1, Floats2, Floats3, Ints1, Ints2, Ints3, Template, float4, vec3
from tiscene.render.integrators.panorama.panorama_kernels import BLOCK, denoised_row, place_on_cube, traced_row
from tiscene.render.intersect.ray_queue import HitIds, Hits, Rays, ray_direction
from tiscene.scene.material_table import FLAGS, GLASS, MAY_MIRROR

SIDE = 2  # subpixels along a side of a pixel
FAR = 1e5  # distance of the background, m
DISTANCE_ERROR = 0.01  # relative difference of the distances of a cell and of a point that it shows
EDGE = 0.95  # of the distance of a point: what is nearer there belongs to another surface
LEAST_WEIGHT = 0.1  # of the cells around a point that show it
LEAST_SUBPIXELS = 2  # of a pixel that are known


@ti.kernel
def find_points(
    count: ti.i32,
    first: ti.i32,
    rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
    triangle_material: Ints1,
    material_info: Ints2,
    offset_x: ti.f32,
    offset_y: ti.f32,
    offset_z: ti.f32,
    points: Float4s1,
):
    """Find where rays hit.

    Args:
        count: Number of rays.
        first: Row of the first one's point.
        rays: Rays of a pinhole camera.
        hits: Their hits, at distances from the camera.
        offset_x, offset_y, offset_z: From the anchor to the camera, world, m.
        points: Output, for each ray the point as seen from the anchor, world, m; and 1 where it looks alike from there,
            else 0.
    """
    for i in range(count):
        distance, alike = FAR, 1.0
        if hit_ids[i][0] >= 0:
            distance = hits[i][0]
            if material_info[triangle_material[hit_ids[i][1]], FLAGS] & (GLASS | MAY_MIRROR) != 0:
                alike = 0.0
        seen = vec3(offset_x, offset_y, offset_z) + distance * ray_direction(rays, i)
        points[first + i] = float4(seen.x, seen.y, seen.z, alike)


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


@ti.kernel
def find_blocks(points: Float4s1, size: ti.i32, needed: Ints3):
    """Set needed[face, row, column] to 1 for each block with a cell around a point.

    Args:
        points: The points.
        size: Cells along a side of a face.
        needed: Output, i32 [6, blocks, blocks], zeros before.
    """
    for i in range(points.shape[0]):
        first, _ = cells_around(points[i].xyz, size)
        for y, x in ti.static(ti.ndrange(2, 2)):
            row, column = ti.math.clamp(first[1] + y, 0, size - 1), ti.math.clamp(first[2] + x, 0, size - 1)
            needed[first[0], row // BLOCK, column // BLOCK] = 1


@ti.kernel
def reproject(
    points: Float4s1,
    size: ti.i32,
    tiles: Ints3,
    traced: Floats2,
    columns: Template,
    blocks: Ints3,
    denoised: Floats2,
    denoised_columns: Template,
    image: Floats3,
    known: Ints2,
):
    """Average for each pixel the cells that show its points.

    Args:
        points: One per subpixel, rows of an image of SIDE times the size.
        size: Cells along a side of a face.
        tiles: i32 [6, tiles + 2, tiles + 2], place of each tile in `traced`, in tiles; the outermost are the margin.
        traced: f32 [slots * TILE * TILE, columns + 1], the distance in the last column, see `Panorama`.
        columns: Number of columns to average.
        blocks: i32 [6, blocks, blocks], place of each block in `denoised`, in blocks.
        denoised: f32 [slots * BLOCK * BLOCK, denoised_columns].
        denoised_columns: Their number of columns.
        image: Output, f32 [h, w, columns + denoised_columns].
        known: Output, i32 [h, w], 1 where enough subpixels have cells that show their points, else 0.
    """
    height, width = known.shape[0], known.shape[1]
    for pixel in range(width * height):
        sums = ti.Vector.zero(ti.f32, columns + denoised_columns)
        count = 0
        corner = pixel // width * SIDE * width * SIDE + pixel % width * SIDE
        least, most = FAR, 0.0
        for y, x in ti.ndrange(SIDE, SIDE):
            distance = points[corner + y * width * SIDE + x].xyz.norm()
            least, most = ti.min(least, distance), ti.max(most, distance)
        has_edge = least < EDGE * most
        tolerance = DISTANCE_ERROR + ti.min(1.0 - least / most, 1.0 - EDGE)  # surfaces may be slanted
        for y, x in ti.ndrange(SIDE, SIDE):
            shown = points[corner + y * width * SIDE + x]
            distance = shown.xyz.norm()
            first, within = cells_around(shown.xyz, size)
            part = ti.Vector.zero(ti.f32, columns + denoised_columns)
            total = 0.0
            for down, right in ti.static(ti.ndrange(2, 2)):
                row, column = ti.math.clamp(first[1] + down, 0, size - 1), ti.math.clamp(first[2] + right, 0, size - 1)
                weight = ti.abs(1 - down - within[0]) * ti.abs(1 - right - within[1])
                cell = traced_row(tiles, first[0], row, column)
                measured = traced[cell, columns]
                # Cells behind an edge show some of what is in front, which the pixel must show too.
                if has_edge:
                    measured = ti.abs(measured)
                if ti.abs(measured - distance) < tolerance * distance:
                    total += weight
                    for c in ti.static(range(columns)):
                        part[c] += weight * traced[cell, c]
                    cell = denoised_row(blocks, first[0], row, column)
                    for c in ti.static(range(denoised_columns)):
                        part[columns + c] += weight * denoised[cell, c]
            if total > LEAST_WEIGHT and shown.w > 0.0:
                count += 1
                sums += part / total
        known[pixel // width, pixel % width] = ti.cast(count >= LEAST_SUBPIXELS, ti.i32)
        for c in ti.static(range(columns + denoised_columns)):
            image[pixel // width, pixel % width, c] = sums[c] / ti.max(count, 1)
