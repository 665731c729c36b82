# SPDX-License-Identifier: Apache-2.0
"""Kernels of reprojection: points that subpixels show, and their light in the cells of a panorama."""

from typing import NamedTuple

import taichi as ti

from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import (
    Float4s1,
    Float8s1,
    Floats2,
    Floats4,
    Ints1,
    Ints2,
    Ints3,
    Template,
    float4,
    float8,
    vec3,
)
from tiscene.render.integrators.panorama.packed_cells import UNIT, unpacked
from tiscene.render.integrators.panorama.panorama_kernels import (
    BLOCK,
    BLOCK_BITS,
    COARSE_BITS,
    Blocks,
    block_row,
    cells_around,
    even_cells,
    need_around,
)
from tiscene.render.intersect.ray_queue import HitIds, Hits, Rays, ray_direction, write_ray
from tiscene.render.intersect.surface_interaction import Geometry, surface_at
from tiscene.render.view import camera_ray
from tiscene.scene.material_table import FLAGS, GLASS, MAY_MIRROR
from tiscene.scene.placement import CURRENT

SIDE = 2  # subpixels along a side of a pixel
SUBPIXELS = SIDE * SIDE
ALL_KNOWN = (1 << SUBPIXELS) - 1  # bits of the subpixels of a pixel
NONE_KNOWN = -1
NOT_FOUND = -2  # whether subpixels are known is not yet found out
# Places of the subpixels' points in a pixel, to the right and down. No two are in the same row or column of a lattice:
# an edge along a row or a column of pixels crosses them one by one.
PLACES = ((-0.375, -0.125), (0.125, -0.375), (-0.125, 0.375), (0.375, 0.125))
FLATNESS = 0.01  # relative difference of the distances of a surface and of a plane in the same direction
FAR = 1e5  # distance of the background, m
DISTANCE_ERROR = 0.01  # relative difference of the distances of a cell and of a point that it shows
EDGE = 0.95  # of the distance of a point: what is nearer there belongs to another surface
LEAST_WEIGHT = 0.1  # of the cells around a point that show it


@ti.kernel
@bundled
def find_surfaces(
    count: ti.i32,
    rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
    geometry: Geometry,
    material_info: Ints2,
    surfaces: Float8s1,
):
    """Find the planes that the rays of a pinhole camera hit.

    Args:
        count: Number of rays.
        rays: Rays of a pinhole camera.
        hits: Their hits, at distances from the camera.
        hit_ids: Their instances and triangles.
        geometry: Of the scene.
        material_info: Of the scene.
        surfaces: Output, for each ray the point as seen from the camera, world, m; 1 where it looks alike from
            anywhere, 0 at mirrors and glass; the normal; and 0.
    """
    for i in range(count):
        direction = ray_direction(rays, i)
        distance, alike, normal = FAR, 1.0, -direction
        if hit_ids[i][0] >= 0:
            distance = hits[i][0]
            if material_info[geometry.triangle_material[hit_ids[i][1]], FLAGS] & (GLASS | MAY_MIRROR) != 0:
                alike = 0.0
            surface = surface_at(geometry, hit_ids[i][0], hit_ids[i][1], hits[i][1], hits[i][2], CURRENT, direction)
            normal = surface.geometric_normal
        point = distance * direction
        surfaces[i] = float8(point.x, point.y, point.z, alike, normal.x, normal.y, normal.z, 0.0)


@ti.kernel
def find_edges(surfaces: Float8s1, edges: Ints2):
    """Find the pixels that may show something else than their neighbors do.

    Args:
        surfaces: Of `find_surfaces`, for the centers of all pixels.
        edges: Output, i32 [h, w], 1 for each of them, 0 for pixels that show one plane.
    """
    height, width = edges.shape[0], edges.shape[1]
    for pixel in range(width * height):
        here = surfaces[pixel]
        point, normal = center_of(here), vec3(here[4], here[5], here[6])
        edge = 0
        for row, column in ti.static(((0, 1), (1, 0), (1, 2), (2, 1))):
            y = ti.math.clamp(pixel // width + row - 1, 0, height - 1)
            x = ti.math.clamp(pixel % width + column - 1, 0, width - 1)
            other = surfaces[y * width + x]
            on_plane = normal.dot(point) / ti.min(normal.dot(center_of(other)), -1e-6)
            if other[3] != here[3] or ti.abs(on_plane - 1.0) > FLATNESS:
                edge = 1
        edges[pixel // width, pixel % width] = edge


@ti.func
def center_of(surface: Template) -> vec3:
    """Return the point of a row of `find_surfaces`."""
    return vec3(surface[0], surface[1], surface[2])


@ti.func
def point_in_plane(
    surface: Template, view: Floats2, pixel: ti.i32, subpixel: Template, width: ti.i32, height: ti.i32
) -> vec3:
    """Return the point that a subpixel shows of the plane at a pixel's center, as seen from the camera, world, m.

    Args:
        surface: Row of `find_surfaces`.
        view: The view, of a pinhole camera.
        pixel: y * width + x.
        subpixel: Index into PLACES.
        width, height: Image size, px.
    """
    point, normal = center_of(surface), vec3(surface[4], surface[5], surface[6])
    right, down = PLACES[subpixel]
    _, direction = camera_ray(view, CURRENT, pixel % width + right, pixel // width + down, width, height)
    distance = normal.dot(point) / ti.min(normal.dot(direction), -1e-6)
    # Almost parallel to the plane, half a pixel may be far along it.
    return ti.math.clamp(distance, EDGE * point.norm(), point.norm() / EDGE) * direction


@ti.kernel
def subpixel_rays(pixels: Ints1, view: Floats2, width: ti.i32, height: ti.i32, rays: Rays):
    """Generate the rays through the subpixels of some pixels.

    Args:
        pixels: Pixels, y * width + x.
        view: The view, of a pinhole camera.
        width, height: Image size, px.
        rays: Output, for each pixel SUBPIXELS rays.
    """
    for i in range(pixels.shape[0]):
        x, y = pixels[i] % width, pixels[i] // width
        for s in ti.static(range(SUBPIXELS)):
            right, down = PLACES[s]
            origin, direction = camera_ray(view, CURRENT, x + right, y + down, width, height)
            write_ray(rays, i * SUBPIXELS + s, origin, direction, ti.math.inf)


@ti.kernel
def find_points(
    pixels: Ints1,
    rays: Rays,
    hits: Hits,
    hit_ids: HitIds,
    offset_x: ti.f32,
    offset_y: ti.f32,
    offset_z: ti.f32,
    points: Float4s1,
):
    """Find where the rays of `subpixel_rays` hit.

    Args:
        pixels: Pixels, y * width + x.
        rays: Their rays.
        hits: The hits, at distances from the camera.
        hit_ids: The instances and triangles.
        offset_x, offset_y, offset_z: From the anchor to the camera, world, m.
        points: Output, in row SUBPIXELS * (y * width + x) + subpixel the point as seen from the anchor, world, m.
    """
    for i in range(pixels.shape[0] * SUBPIXELS):
        distance = ti.select(hit_ids[i][0] >= 0, hits[i][0], FAR)
        seen = vec3(offset_x, offset_y, offset_z) + distance * ray_direction(rays, i)
        points[pixels[i // SUBPIXELS] * SUBPIXELS + i % SUBPIXELS] = float4(seen.x, seen.y, seen.z, 0.0)


class PixelSurfaces(NamedTuple):
    """What the pixels of a view show, as seen from an anchor; a parameter of kernels, see `argument_bundles`.

    Attributes:
        surfaces: Of `find_surfaces`, for the centers of all pixels.
        view: The view, of a pinhole camera.
        offset_x, offset_y, offset_z: From the anchor to the camera, world, m.
        edges: i32 [h, w], of `find_edges`.
    """

    surfaces: Float8s1
    view: Floats2
    offset_x: ti.f32
    offset_y: ti.f32
    offset_z: ti.f32
    edges: Ints2


@ti.kernel
@bundled
def find_blocks(
    pixels: PixelSurfaces,
    points: Float4s1,
    size: ti.i32,
    needed: Ints3,
):
    """Set needed[face, row, column] to 1 for each block with a cell around a point, or a coarse cell.

    Args:
        pixels: What pixels show.
        points: Of `find_points`, where there are edges.
        size: Cells along a side of a face.
        needed: Output, i32 [6, blocks, blocks], zeros before.
    """
    height, width = pixels.edges.shape[0], pixels.edges.shape[1]
    offset = vec3(pixels.offset_x, pixels.offset_y, pixels.offset_z)
    for pixel in range(width * height):
        is_edge = pixels.edges[pixel // width, pixel % width] > 0
        for s in ti.static(range(SUBPIXELS)):
            seen = points[pixel * SUBPIXELS + s].xyz
            if not is_edge:
                seen = offset + point_in_plane(pixels.surfaces[pixel], pixels.view, pixel, s, width, height)
            need_around(seen, size, BLOCK_BITS, needed)
        if not is_edge:
            need_around(offset + center_of(pixels.surfaces[pixel]), size >> 1, COARSE_BITS, needed)


@ti.kernel
@bundled
def reproject_planes(
    pixels: PixelSurfaces,
    points: Float4s1,
    blocks: Blocks,
    columns: Template,
    images: Floats4,
    known: Ints2,
    missing: Ints1,
):
    """Interpolate for each pixel that shows one plane between coarse cells, if they are even and show its center.

    Args:
        pixels: What pixels show.
        points: Output where known is NOT_FOUND and there is no edge, as of `find_points`.
        blocks: Of the panorama.
        columns: Number of columns to interpolate.
        images: Output, f32 [columns / 3, h, w, 3].
        known: Output, i32 [h, w]: ALL_KNOWN; 0 where the surface looks different from the anchor; else NOT_FOUND.
        missing: As of `resample_even`.
    """
    height, width = known.shape[0], known.shape[1]
    offset = vec3(pixels.offset_x, pixels.offset_y, pixels.offset_z)
    for pixel in range(width * height):
        if missing[0] == 0:
            y, x = pixel // width, pixel % width
            bits = NOT_FOUND
            if pixels.edges[y, x] == 0:
                seen = offset + center_of(pixels.surfaces[pixel])
                values, distance, away = even_cells(seen, blocks, columns)
                if away > 0:
                    missing[0] = 1
                if pixels.surfaces[pixel][3] == 0.0:
                    bits, values = 0, ti.Vector.zero(ti.f32, columns)
                elif ti.abs(distance - seen.norm()) < DISTANCE_ERROR * seen.norm():
                    bits = ALL_KNOWN
                if bits == NOT_FOUND:
                    for s in ti.static(range(SUBPIXELS)):
                        point = offset + point_in_plane(pixels.surfaces[pixel], pixels.view, pixel, s, width, height)
                        points[pixel * SUBPIXELS + s] = float4(point.x, point.y, point.z, 0.0)
                else:
                    for c in ti.static(range(columns)):
                        images[c // 3, y, x, c % 3] = values[c] * UNIT
            known[y, x] = bits


@ti.kernel
@bundled
def reproject(
    pixels: Ints1,
    points: Float4s1,
    blocks: Blocks,
    columns: Template,
    images: Floats4,
    known: Ints2,
    missing: Ints1,
):
    """Average for each pixel the cells that show its points.

    Args:
        pixels: Pixels, y * width + x.
        points: Of the subpixels, see `find_points`.
        blocks, columns: As of `reproject_planes`.
        images: Output, f32 [columns / 3, h, w, 3], means over the subpixels that are known.
        known: Output, i32 [h, w], one bit for each subpixel, set if cells show its point.
        missing: As of `resample_even`.
    """
    width = known.shape[1]
    for i in range(pixels.shape[0]):
        if missing[0] == 0:
            pixel = pixels[i]
            sums = ti.Vector.zero(ti.f32, columns)
            bits = 0
            least, most = FAR, 0.0
            for s in range(SUBPIXELS):
                distance = points[pixel * SUBPIXELS + s].xyz.norm()
                least, most = ti.min(least, distance), ti.max(most, distance)
            has_edge = least < EDGE * most
            tolerance = DISTANCE_ERROR + ti.min(1.0 - least / most, 1.0 - EDGE)  # surfaces may be slanted
            for s in range(SUBPIXELS):
                seen = points[pixel * SUBPIXELS + s].xyz
                distance = seen.norm()
                first, within = cells_around(seen, blocks.size)
                part = ti.Vector.zero(ti.f32, columns)
                total = 0.0
                # Mostly all four are in one block, and the place of that is enough.
                in_block = ti.max(first[1] & (BLOCK - 1), first[2] & (BLOCK - 1)) < BLOCK - 1
                corner = 0
                if in_block:
                    corner = block_row(blocks, first[0], first[1], first[2])
                for down, right in ti.static(ti.ndrange(2, 2)):
                    weight = ti.abs(1 - down - within[0]) * ti.abs(1 - right - within[1])
                    cell = corner + (down * BLOCK + right)
                    if not in_block:
                        row = ti.math.clamp(first[1] + down, 0, blocks.size - 1)
                        column = ti.math.clamp(first[2] + right, 0, blocks.size - 1)
                        cell = block_row(blocks, first[0], row, column)
                    if cell < 0:
                        missing[0] = 1
                        cell = 0
                    measured = UNIT * unpacked(blocks.cells[cell, columns // 2], columns)
                    # Cells behind an edge show some of what is in front, which the pixel must show too.
                    if has_edge:
                        measured = ti.abs(measured)
                    if ti.abs(measured - distance) < tolerance * distance:
                        total += weight
                        for c in ti.static(range(columns)):
                            part[c] += weight * unpacked(blocks.cells[cell, c // 2], c)
                if total > LEAST_WEIGHT:
                    bits |= 1 << s
                    sums += part * (UNIT / total)
            y, x = pixel // width, pixel % width
            known[y, x] = bits
            number = known_subpixels(bits)
            for c in ti.static(range(columns)):
                images[c // 3, y, x, c % 3] = sums[c] / ti.max(number, 1)


@ti.func
def known_subpixels(bits: ti.i32) -> ti.i32:
    """Return the number of subpixels whose bits are set."""
    number = 0
    if bits != NONE_KNOWN:
        for subpixel in ti.static(range(SUBPIXELS)):
            number += bits >> subpixel & 1
    return number
