# SPDX-License-Identifier: Apache-2.0
"""Kernels that write paths down while they are traced, and sort what was written by path.

A row is a ray that a mover may get in the way of, as tiscene.render.intersect wants it, and the light that is lost if
one does. Two kinds, told apart by column 3: a *segment* from one vertex to the next (its number among the segments, by
which its entry in `restore` is found), with what its end emits towards the path; a *shadow ray* to a light that was
seen (-1), with the light sampled. Rows of a path stand in the order in which it was traced, a vertex's segment first.
The light is that of the lights of group 0. What the other groups of lights bring has rows of its own, all of the second
kind, with -1 - group in column 3: the paths are the same, and a mover that takes one's light takes the other's too.
"""

import taichi as ti

from tiscene.device.kernel_types import Float8s1, Floats1, Floats2, Ints1, Template, vec3
from tiscene.render.integrators.path.path_state import (
    DEPTH_MASK,
    DIFFUSE_FRACTION,
    DIRECT,
    FEATURE_COLUMNS,
    FEATURES_WRITTEN,
    LIGHT_PENDING,
    ORIGIN,
    PDF,
    RADIANCE,
    RELATIVE_IOR2,
    SPREAD,
    THROUGHPUT,
    States,
    get3,
    set3,
)
from tiscene.render.integrators.path.shading import read3, write3
from tiscene.render.intersect.ray_queue import ROW, Hits, Pixels, Rays, ray_direction, ray_origin
from tiscene.render.lights.intersect import nearest_light
from tiscene.render.lights.light_sample import LightTables

SEGMENT = 3  # column of a row
SHADOW = -1.0

# Columns of a mean or a picture: light of group 0, albedo, normal, light of the other groups.
AUXILIARY = 3


@ti.pyfunc
def light_column(group: ti.i32) -> ti.i32:
    """Where the light of a group begins."""
    return FEATURE_COLUMNS + 3 * group if group > 0 else 0


# Columns of `restore`: what a path needs to be traced again from the beginning of a segment.
RESTART_COLUMNS = 11
R_THROUGHPUT, R_PDF, R_IOR2, R_VERTEX, R_STATUS, R_SPREAD, R_DIFFUSE = 0, 3, 4, 5, 8, 9, 10


@ti.kernel
def begin_segments(
    queue: Ints1,
    count: ti.i32,
    path_rays: Rays,
    state: States,
    status: Ints1,
    paths: Ints1,
    rays: Rays,
    restore: Floats2,
):
    """Before a step: note the paths in the queue as they are, and empty their radiance so that it tells what is new."""
    for k in range(count):
        i = queue[k]
        paths[k] = i
        rays[k] = path_rays[i]
        write3(restore, k, R_THROUGHPUT, get3(state, i, THROUGHPUT))
        restore[k, R_PDF] = state[i][PDF]
        restore[k, R_IOR2] = state[i][RELATIVE_IOR2]
        write3(restore, k, R_VERTEX, get3(state, i, ORIGIN))
        restore[k, R_STATUS] = ti.cast(status[i], ti.f32)
        restore[k, R_SPREAD] = state[i][SPREAD]
        restore[k, R_DIFFUSE] = state[i][DIFFUSE_FRACTION]
        set3(state, i, RADIANCE, vec3(0.0))


@ti.func
def group_of(rays: Template, row: ti.i32) -> ti.i32:
    """The number of the lights whose light a row has."""
    return ti.max(-1 - ti.cast(rays[row][SEGMENT], ti.i32), 0)


@ti.func
def finite(light: vec3) -> vec3:
    """The light, or none where it is no number."""
    result = light
    if not ti.abs(light.sum()) < ti.math.inf:
        result = vec3(0.0)
    return result


@ti.kernel
def end_segments(
    light_values: Floats2,
    light_nodes: Float8s1,
    light_distribution: Floats1,
    last_depth: ti.i32,
    group: ti.i32,
    paths: Ints1,
    count: ti.i32,
    hits: Hits,
    state: States,
    restore: Floats2,
    rays: Rays,
    light: Floats2,
    rows: Ints1,
):
    """After the step: where the segments ended (a little beyond, which a mover there must not be lost for), and what
    they brought. rows: how many each path has.

    last_depth: of what is met after so many surfaces only the emission counts, and no mover has any; what brought no
    light is then not worth a row (t_max 0). Of groups other than 0, none is that brought no light.
    """
    lights = ti.static(LightTables(light_values, light_nodes, light_distribution))
    for k in range(count):
        i = paths[k]
        _, end = nearest_light(lights, ray_origin(rays, k), ray_direction(rays, k), hits[i][0])
        brought = finite(get3(state, i, RADIANCE))
        status = ti.cast(restore[k, R_STATUS], ti.i32)
        needed = group == 0 and ((status & DEPTH_MASK) < last_depth or (status & FEATURES_WRITTEN) == 0)
        if brought.max() == 0.0 and not needed:
            end = 0.0
        else:
            rows[i] += 1
        rays[k][7] = end
        write3(light, k, 0, brought)


@ti.kernel
def begin_shadows(queue: Ints1, count: ti.i32, shadow_rays: Rays, paths: Ints1, rays: Rays):
    """Note the shadow rays before they are cast, which may change them."""
    for k in range(count):
        i = queue[k]
        paths[k] = i
        rays[k] = shadow_rays[i]


@ti.kernel
def end_shadows(
    paths: Ints1,
    count: ti.i32,
    occluded: Ints1,
    state: States,
    status: Ints1,
    rays: Rays,
    light: Floats2,
    rows: Ints1,
):
    """Note the light of those that reached it (t_max 0 for the others), and take it from the paths."""
    for k in range(count):
        i = paths[k]
        status[i] &= ~LIGHT_PENDING
        if occluded[i] == 0:
            write3(light, k, 0, finite(get3(state, i, DIRECT)))
            rows[i] += 1
        else:
            rays[k][7] = 0.0


@ti.kernel
def sort_segments(
    paths: Ints1,
    count: ti.i32,
    rays: Rays,
    light: Floats2,
    restore: Floats2,
    next_row: Ints1,
    next_segment: Ints1,
    sorted_rays: Rays,
    sorted_light: Floats2,
    sorted_restore: Floats2,
):
    """Put one step's segments behind what their paths have already."""
    for k in range(count):
        if rays[k][7] > 0.0:
            i = paths[k]
            row, segment = next_row[i], next_segment[i]
            next_row[i] += 1
            next_segment[i] += 1
            sorted_rays[row] = rays[k]
            sorted_rays[row][SEGMENT] = ti.cast(segment, ti.f32)
            write3(sorted_light, row, 0, read3(light, k, 0))
            for c in ti.static(range(RESTART_COLUMNS)):
                sorted_restore[segment, c] = restore[k, c]


@ti.kernel
def sort_shadows(
    paths: Ints1,
    count: ti.i32,
    rays: Rays,
    light: Floats2,
    next_row: Ints1,
    group: ti.i32,
    sorted_rays: Rays,
    sorted_light: Floats2,
):
    """Put one step's rays that reached lights of a group behind what their paths have already."""
    for k in range(count):
        if rays[k][7] > 0.0:
            i = paths[k]
            row = next_row[i]
            next_row[i] += 1
            sorted_rays[row] = rays[k]
            sorted_rays[row][SEGMENT] = SHADOW - group
            write3(sorted_light, row, 0, read3(light, k, 0))


@ti.kernel
def mean_of_paths(
    pixels: Pixels,
    first: ti.i32,
    count: ti.i32,
    spp: ti.i32,
    groups: ti.i32,
    offsets: Ints1,
    rays: Rays,
    light: Floats2,
    features: Floats2,
    film: Floats2,
):
    """The mean light, albedo and normal of the paths first .. first + count - 1, all of their pixels, to film."""
    for rank in range(first // spp, (first + count) // spp):
        begin, end, pixel = rank * spp - first, (rank + 1) * spp - first, pixels[rank][ROW]
        for group in range(groups):
            sums = vec3(0.0)
            for i in range(begin, end):
                for row in range(offsets[i], offsets[i + 1]):
                    if group_of(rays, row) == group:
                        sums += read3(light, row, 0)
            write3(film, pixel, light_column(group), sums / spp)
        for c in ti.static(range(FEATURE_COLUMNS)):
            total = 0.0
            for i in range(begin, end):
                total += features[i, c]
            film[pixel, AUXILIARY + c] = total / spp


@ti.kernel
def keep_features(count: ti.i32, group: ti.i32, features: Floats2, kept: Floats2):
    """Keep what the denoiser is told about each path: under lights of other groups, a lamp itself is black."""
    for i in range(count):
        for c in ti.static(range(FEATURE_COLUMNS)):
            other = features[i, c] if group == 0 else kept[i, c]
            kept[i, c] = ti.max(features[i, c], other)


@ti.kernel
def gather(
    count: ti.i32,
    paths: Ints1,
    offsets: Ints1,
    all_offsets: Ints1,
    all_rays: Rays,
    all_light: Floats2,
    all_features: Floats2,
    rays: Rays,
    light: Floats2,
    features: Floats2,
):
    """The rows of some paths one after another, from offsets[k] on those of paths[k]; their entries in `restore` stay
    where they are."""
    for k in range(count):
        begin = all_offsets[paths[k]]
        for row in range(all_offsets[paths[k] + 1] - begin):
            rays[offsets[k] + row] = all_rays[begin + row]
            write3(light, offsets[k] + row, 0, read3(all_light, begin + row, 0))
        for c in ti.static(range(FEATURE_COLUMNS)):
            features[k, c] = all_features[paths[k], c]
