# SPDX-License-Identifier: Apache-2.0
"""Kernels that record paths while they are traced, and sort the records by path.

A record is a ray that a mover may block together with the light that the pixel loses if one does. There are two kinds,
distinguished by column 3 of the ray:

- a *segment* between two path vertices, with the emission found at its end. Column 3 is the index of its restart state,
  from which the path can be traced again.
- a *shadow ray* that reached its light, with the light sample's contribution. Column 3 is
  SHADOW - g - MAX_GROUPS * links, where g is the light group and links the LINKS of the ray.

The records of a path are stored in the order of tracing, the segment to a vertex before the vertex's shadow ray.
Segments hold the light of group 0. The light of the other groups is recorded as shadow rays, also where a segment found
it: the paths are the same, and a mover that blocks one group's light blocks that of the other groups.
"""

import taichi as ti

from tiscene.device.kernel_types import Float8s1, Floats1, Floats2, Ints1, Template, vec3
from tiscene.render.columns import read3, write3
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
from tiscene.render.intersect.ray_queue import LINKS, ROW, Hits, Pixels, Rays, ray_direction, ray_origin
from tiscene.render.lights.intersect import nearest_light
from tiscene.render.lights.light_sample import LightTables

SEGMENT = 3  # column of a recorded ray: index of its restart state, or
SHADOW = -1.0  # the kind of a shadow ray of light group 0 without links
MAX_GROUPS = 16  # light groups that a kind tells apart

# Columns of mean and base images: light of group 0, albedo, normal, light of groups 1, 2, ...
AUXILIARY = 3

# Columns of a restart state: what `shade` needs to trace a path again from the start of a segment.
RESTART_COLUMNS = 11
R_THROUGHPUT, R_PDF, R_IOR2, R_VERTEX, R_STATUS, R_SPREAD, R_DIFFUSE = 0, 3, 4, 5, 8, 9, 10


@ti.pyfunc
def light_column(group: ti.i32) -> ti.i32:
    """Return the first column of a light group in mean and base images."""
    return FEATURE_COLUMNS + 3 * group if group > 0 else 0


@ti.kernel
def record_segments(
    queue: Ints1,
    count: ti.i32,
    path_rays: Rays,
    state: States,
    status: Ints1,
    paths: Ints1,
    rays: Rays,
    restart: Floats2,
):
    """Record the segments that the paths in the queue trace next, and reset their radiance to isolate what is added.

    Args:
        paths: Output, i32 [count], row of each record's path.
        rays: Output, the segments.
        restart: Output, f32 [count, RESTART_COLUMNS].
    """
    for k in range(count):
        i = queue[k]
        paths[k] = i
        rays[k] = path_rays[i]
        write3(restart, k, R_THROUGHPUT, get3(state, i, THROUGHPUT))
        restart[k, R_PDF] = state[i][PDF]
        restart[k, R_IOR2] = state[i][RELATIVE_IOR2]
        write3(restart, k, R_VERTEX, get3(state, i, ORIGIN))
        restart[k, R_STATUS] = ti.cast(status[i], ti.f32)
        restart[k, R_SPREAD] = state[i][SPREAD]
        restart[k, R_DIFFUSE] = state[i][DIFFUSE_FRACTION]
        set3(state, i, RADIANCE, vec3(0.0))


@ti.func
def group_of(rays: Template, row: ti.i32) -> ti.i32:
    """Return the light group of a record."""
    return ti.max(-1 - ti.cast(rays[row][SEGMENT], ti.i32), 0) % MAX_GROUPS


@ti.func
def links_of(rays: Template, row: ti.i32) -> ti.f32:
    """Return LINKS of a recorded shadow ray."""
    return ti.cast((-1 - ti.cast(rays[row][SEGMENT], ti.i32)) // MAX_GROUPS, ti.f32)


@ti.func
def finite(light: vec3) -> vec3:
    """Return the light, or zero if it is infinite or NaN."""
    result = light
    if not ti.abs(light.sum()) < ti.math.inf:
        result = vec3(0.0)
    return result


@ti.kernel
def record_segment_light(
    light_values: Floats2,
    light_nodes: Float8s1,
    light_distribution: Floats1,
    last_depth: ti.i32,
    group: ti.i32,
    paths: Ints1,
    count: ti.i32,
    hits: Hits,
    state: States,
    restart: Floats2,
    rays: Rays,
    light: Floats2,
    rows: Ints1,
):
    """After the segments are shaded: record where they ended and the light that they brought.

    The recorded end lies slightly beyond the hit or the light, so that a mover at that place is found. Segments that
    brought no light are dropped (t_max 0) in groups other than 0, and in group 0 from `last_depth` on.

    Args:
        last_depth: Path depth from which segments count by the emission at their ends only. Movers have none there, so
            they cannot change a segment without light.
        group: Light group that was traced.
        rows: i32 [paths], incremented by the number of records of each path.
    """
    lights = ti.static(LightTables(light_values, light_nodes, light_distribution))
    for k in range(count):
        i = paths[k]
        status = ti.cast(restart[k, R_STATUS], ti.i32)
        depth = status & DEPTH_MASK
        _, end = nearest_light(lights, depth, ray_origin(rays, k), ray_direction(rays, k), hits[i][0])
        contribution = finite(get3(state, i, RADIANCE))
        needed = group == 0 and ((status & DEPTH_MASK) < last_depth or (status & FEATURES_WRITTEN) == 0)
        if contribution.max() == 0.0 and not needed:
            end = 0.0
        else:
            rows[i] += 1
        rays[k][7] = end
        write3(light, k, 0, contribution)


@ti.kernel
def record_shadow_rays(queue: Ints1, count: ti.i32, shadow_rays: Rays, paths: Ints1, rays: Rays):
    """Record the shadow rays before they are cast: partially opaque surfaces change them."""
    for k in range(count):
        i = queue[k]
        paths[k] = i
        rays[k] = shadow_rays[i]


@ti.kernel
def record_shadow_light(
    paths: Ints1,
    count: ti.i32,
    occluded: Ints1,
    state: States,
    status: Ints1,
    rays: Rays,
    light: Floats2,
    rows: Ints1,
):
    """Record the contribution of unoccluded shadow rays (others get t_max 0), and clear LIGHT_PENDING of the paths.

    Args:
        rows: i32 [paths], incremented by the number of records of each path.
    """
    for k in range(count):
        i = paths[k]
        status[i] &= ~LIGHT_PENDING
        if occluded[i] == 0:
            write3(light, k, 0, finite(get3(state, i, DIRECT)))
            rows[i] += 1
        else:
            rays[k][7] = 0.0


@ti.kernel
def append_segments(
    paths: Ints1,
    count: ti.i32,
    rays: Rays,
    light: Floats2,
    restart: Floats2,
    next_row: Ints1,
    next_segment: Ints1,
    sorted_rays: Rays,
    sorted_light: Floats2,
    sorted_restart: Floats2,
):
    """Append the segments of one step to the records of their paths.

    Args:
        next_row: i32 [paths], row of each path's next record; incremented.
        next_segment: i32 [paths], index of each path's next restart state; incremented.
    """
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
                sorted_restart[segment, c] = restart[k, c]


@ti.kernel
def append_shadow_rays(
    paths: Ints1,
    count: ti.i32,
    rays: Rays,
    light: Floats2,
    next_row: Ints1,
    group: ti.i32,
    sorted_rays: Rays,
    sorted_light: Floats2,
):
    """Append the shadow rays of one step and light group to the records of their paths.

    Args:
        next_row: i32 [paths], row of each path's next record; incremented.
    """
    for k in range(count):
        if rays[k][7] > 0.0:
            i = paths[k]
            row = next_row[i]
            next_row[i] += 1
            sorted_rays[row] = rays[k]
            sorted_rays[row][SEGMENT] = SHADOW - group - MAX_GROUPS * rays[k][LINKS]
            write3(sorted_light, row, 0, read3(light, k, 0))


@ti.kernel
def average_paths(
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
    """Average light, albedo and normal over the paths of each pixel; first .. first + count - 1 are whole pixels.

    Args:
        groups: Number of light groups.
        offsets: i32 [count + 1], first record of each path.
        film: Output, f32 [pixels, light_column(groups)].
    """
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
def merge_features(count: ti.i32, group: ti.i32, features: Floats2, merged: Floats2):
    """Merge the denoiser features that the paths have under each light group, by maximum.

    A visible light writes its own emission as albedo, which is black while the lights of another group are traced.
    """
    for i in range(count):
        for c in ti.static(range(FEATURE_COLUMNS)):
            before = features[i, c] if group == 0 else merged[i, c]
            merged[i, c] = ti.max(features[i, c], before)


@ti.kernel
def gather_paths(
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
    """Copy the records of some paths; those of paths[k] begin at offsets[k]. Restart states stay where they are."""
    for k in range(count):
        begin = all_offsets[paths[k]]
        for row in range(all_offsets[paths[k] + 1] - begin):
            rays[offsets[k] + row] = all_rays[begin + row]
            write3(light, offsets[k] + row, 0, read3(all_light, begin + row, 0))
        for c in ti.static(range(FEATURE_COLUMNS)):
            features[k, c] = all_features[paths[k], c]
