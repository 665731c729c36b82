# SPDX-License-Identifier: Apache-2.0
"""Kernels of a frame that replays cached paths: find the rows that a mover gets in the way of, take off the light that
is lost, put the paths that are cut back on their way, and add up what changed."""

import taichi as ti

from tiscene.device.kernel_types import Floats2, Floats3, Ints1, Ints2, vec3
from tiscene.render.integrators.incremental.mover_coverage import SUBPIXELS
from tiscene.render.integrators.incremental.mover_culling import add_up
from tiscene.render.integrators.incremental.path_recording import (
    R_DIFFUSE,
    R_IOR2,
    R_PDF,
    R_SPREAD,
    R_STATUS,
    R_THROUGHPUT,
    R_VERTEX,
    SEGMENT,
    group_of,
    light_column,
)
from tiscene.render.integrators.path.path_state import (
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
    chunk_size,
    get3,
    set3,
)
from tiscene.render.integrators.path.shading import read3, write3
from tiscene.render.intersect.ray_queue import ROW, Pixels, Rays, ray_direction, ray_origin, write_ray

PARTS = 16  # paths are taken up in so many rounds through the picture

# Columns of the change of a pixel, means over its paths: of light, albedo and normal; how many met a mover first.
CORRECTION_COLUMNS, MOVER_HITS = 10, 9
# Of pixels in which some did, sums over those: light, albedo, normal; over the others: change of light; number of all.
MOVER_COLUMNS, MISS_LIGHT, PATH_COUNT = 13, 9, 12


@ti.kernel
def settle(
    count: ti.i32,
    steps: ti.i32,
    offsets: Ints1,
    rays: Rays,
    light: Floats2,
    factors: Floats2,
    restore: Floats2,
    cut: Ints1,
    path_rays: Rays,
    state: States,
    features: Floats2,
    status: Ints1,
    difference: Floats2,
    cut_at: Ints2,
    chunks: Ints2,
    entering: Ints1,
    starts: Ints1,
):
    """What each path loses; those that a mover cuts are put back to where the segment begins that it cuts.

    factors: how much of its light each group of lights gives, f32 [groups, 3].
    cut: of every row, whether a mover is in the way. difference: f32 [count, 3]. cut_at: of every path the number of
    the segment cut, -1 for none, and its step. entering[starts[s] .. starts[s + 1]): the paths cut at step s.
    """
    size = chunk_size(count)
    chunk_count = (count + size - 1) // size
    for chunk in range(chunk_count):
        for s in range(steps):
            chunks[chunk, s] = 0
        for i in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            lost = vec3(0.0)
            at, step, begins, segments = -1, -1, -1, 0
            for row in range(offsets[i], offsets[i + 1]):
                if at < 0 and cut[row] > 0:
                    segment = ti.cast(rays[row][SEGMENT], ti.i32)
                    if segment >= 0:
                        at, begins = segment, row
                        for earlier in range(offsets[i], row):
                            if rays[earlier][SEGMENT] >= 0.0:
                                segments += 1
                        step = segments
                if at >= 0 or cut[row] > 0:
                    lost += read3(light, row, 0) * read3(factors, group_of(rays, row), 0)
            write3(difference, i, 0, -lost)
            cut_at[i, 0] = at
            cut_at[i, 1] = step
            if at >= 0:
                chunks[chunk, step] += 1
                write_ray(path_rays, i, ray_origin(rays, begins), ray_direction(rays, begins), ti.math.inf)
                set3(state, i, THROUGHPUT, read3(restore, at, R_THROUGHPUT))
                set3(state, i, RADIANCE, vec3(0.0))
                state[i][PDF] = restore[at, R_PDF]
                state[i][RELATIVE_IOR2] = restore[at, R_IOR2]
                state[i][SPREAD] = restore[at, R_SPREAD]
                state[i][DIFFUSE_FRACTION] = restore[at, R_DIFFUSE]
                set3(state, i, ORIGIN, read3(restore, at, R_VERTEX))
                status[i] = ti.cast(restore[at, R_STATUS], ti.i32)
                for c in ti.static(range(FEATURE_COLUMNS)):
                    features[i, c] = 0.0
    ti.loop_config(serialize=True)
    for _ in range(1):
        total = 0
        for s in range(steps):
            starts[s] = total
            # Each thread gets what is next to each other: let that be from all over the picture.
            for part in range(PARTS):
                for k in range((chunk_count - part + PARTS - 1) // PARTS):
                    chunk = k * PARTS + part
                    here = chunks[chunk, s]
                    chunks[chunk, s] = total
                    total += here
        starts[steps] = total
    for chunk in range(chunk_count):
        for i in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            step = cut_at[i, 1]
            if step >= 0:
                entering[chunks[chunk, step]] = i
                chunks[chunk, step] += 1


@ti.kernel
def join(entering: Ints1, begin: ti.i32, end: ti.i32, queue: Ints1, live: ti.i32):
    """Put entering[begin .. end) behind the paths that are on their way."""
    for k in range(end - begin):
        queue[live + k] = entering[begin + k]


@ti.kernel
def collect(
    pixels: Pixels,
    first: ti.i32,
    count: ti.i32,
    spp: ti.i32,
    cut_at: Ints2,
    restore: Floats2,
    base_features: Floats2,
    status: Ints1,
    occluded: Ints1,
    state: States,
    features: Floats2,
    difference: Floats2,
    others: ti.i32,
    film: Floats2,
    met: Floats2,
):
    """What the paths of these pixels say, to film [n, CORRECTION_COLUMNS] and met [n, MOVER_COLUMNS].

    others: of how many paths a pixel that is there already.
    """
    for rank in range(first // spp, (first + count) // spp):
        sums = ti.Vector.zero(ti.f32, CORRECTION_COLUMNS)
        first_sums = ti.Vector.zero(ti.f32, PATH_COUNT)
        for i in range(rank * spp - first, (rank + 1) * spp - first):
            change = read3(difference, i, 0)
            at, brought = cut_at[i, 0], vec3(0.0)
            if at >= 0:
                brought = get3(state, i, RADIANCE)
                if (status[i] & LIGHT_PENDING) != 0 and occluded[i] == 0:
                    brought += get3(state, i, DIRECT)
                change += brought
                if (ti.cast(restore[at, R_STATUS], ti.i32) & FEATURES_WRITTEN) == 0:
                    for c in ti.static(range(FEATURE_COLUMNS)):
                        sums[3 + c] += features[i, c] - base_features[i, c]
            is_number = ti.abs(change.sum()) < ti.math.inf  # false for nan too
            if is_number:
                for c in ti.static(range(3)):
                    sums[c] += change[c]
            if cut_at[i, 1] == 0:
                sums[MOVER_HITS] += 1.0
                for c in ti.static(range(FEATURE_COLUMNS)):
                    first_sums[3 + c] += features[i, c]
            if is_number:
                for c in ti.static(range(3)):
                    if cut_at[i, 1] == 0:
                        first_sums[c] += brought[c]
                    else:
                        first_sums[MISS_LIGHT + c] += change[c]
        pixel = pixels[rank][ROW]
        met_before = film[pixel, MOVER_HITS] if others > 0 else 0.0
        if met_before + sums[MOVER_HITS] > 0.0:
            for c in ti.static(range(PATH_COUNT)):
                before = 0.0
                if met_before > 0.0:
                    before = met[pixel, c]
                elif ti.static(c >= MISS_LIGHT):
                    if others > 0:
                        before = film[pixel, c - MISS_LIGHT] * others
                met[pixel, c] = before + first_sums[c]
            met[pixel, PATH_COUNT] = others + spp
        for c in ti.static(range(MOVER_HITS)):
            before = film[pixel, c] * others if others > 0 else 0.0
            film[pixel, c] = (before + sums[c]) / (others + spp)
        film[pixel, MOVER_HITS] = met_before + sums[MOVER_HITS]


@ti.kernel
def combine(
    width: ti.i32,
    height: ti.i32,
    looks: Ints2,
    by_looks: ti.i32,
    change: Floats2,
    met: Floats2,
    factors: Floats2,
    mean: Floats2,
    base: Floats3,
    rough: Floats3,
    hdr: Floats3,
    drawn: Floats3,
    albedo: Floats3,
    normal: Floats3,
    unmoved: Floats3,
):
    """The picture: the change added to the base image, and where movers cover most of a pixel, to its own paths' mean.

    looks: as of `MoverCoverage.covered`. change, met: as of `collect`; factors: as of `settle`;
    mean [n, ...], base [h, w, ...]: columns as `light_column` says.
    drawn: what the denoiser gets, with `rough` [h, w, 3 * groups] in the place of the base. If by_looks is 1, movers
    cover as much of a pixel there, and of albedo and normal, as the looks say, not as much as a few paths meet.
    unmoved: 1 where what is seen first has not changed, else 0.
    """
    for pixel in range(width * height):
        x, y = pixel % width, pixel // width
        seen = ti.max(looks[y, x], 0)
        changed = ti.cast(seen, ti.f32)
        for c in ti.static(range(3, 9)):
            changed += ti.abs(change[pixel, c])
        unmoved[y, x, 0] = ti.cast(changed == 0.0, ti.f32)
        mixed = by_looks != 0 and looks[y, x] >= 0 and change[pixel, MOVER_HITS] > 0.0
        for c in ti.static(range(3)):
            below = vec3(base[y, x, c], base[y, x, 3 + c], base[y, x, 6 + c])
            own = vec3(mean[pixel, c], mean[pixel, 3 + c], mean[pixel, 6 + c])
            noisy = rough[y, x, c]
            for group in range(1, factors.shape[0]):
                column = light_column(group) + c
                below[0] += factors[group, c] * base[y, x, column]
                own[0] += factors[group, c] * mean[pixel, column]
                noisy += factors[group, c] * rough[y, x, 3 * group + c]
            all_changed = vec3(change[pixel, c], change[pixel, 3 + c], change[pixel, 6 + c])
            hdr[y, x, c] = all_changed[0] + (below[0] if 2 * seen <= SUBPIXELS else own[0])
            below[0] = noisy
            shown = all_changed + (below if 2 * seen <= SUBPIXELS else own)
            if mixed:
                covers, meets = ti.cast(seen, ti.f32) / SUBPIXELS, change[pixel, MOVER_HITS]
                missing = ti.max(met[pixel, PATH_COUNT] - meets, 1.0)
                shown = covers / meets * vec3(met[pixel, c], met[pixel, 3 + c], met[pixel, 6 + c])
                shown += (1.0 - covers) * (below + vec3(met[pixel, MISS_LIGHT + c] / missing, 0.0, 0.0))
            drawn[y, x, c] = shown[0]
            albedo[y, x, c] = shown[1]
            normal[y, x, c] = shown[2]


@ti.kernel
def find_cut_shadows(candidates: Ints1, count: ti.i32, rays: Rays, cut: Ints1, rows: Ints1, chunks: Ints1) -> ti.i32:
    """The rows of the shadow rays that a mover is in the way of, in order. Returns how many."""
    size = chunk_size(count)
    chunk_count = (count + size - 1) // size
    for chunk in range(chunk_count):
        found = 0
        for k in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            row = candidates[k]
            if cut[row] > 0 and rays[row][SEGMENT] < 0.0:
                found += 1
        chunks[chunk] = found
    ti.loop_config(serialize=True)
    for _ in range(1):
        add_up(chunks, chunk_count)
    for chunk in range(chunk_count):
        at = chunks[chunk]
        for k in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            row = candidates[k]
            if cut[row] > 0 and rays[row][SEGMENT] < 0.0:
                rows[at] = row
                at += 1
    return chunks[chunk_count]


@ti.kernel
def copy_rays(rows: Ints1, begin: ti.i32, count: ti.i32, rays: Rays, shadow_rays: Rays, queue: Ints1):
    """The rays rows[begin .. begin + count) to the first rows of `shadow_rays`."""
    for k in range(count):
        queue[k] = k
        shadow_rays[k] = rays[rows[begin + k]]


@ti.kernel
def note_answers(rows: Ints1, begin: ti.i32, count: ti.i32, occluded: Ints1, cut: Ints1):
    """Whether the movers let the light of those rows through after all."""
    for k in range(count):
        cut[rows[begin + k]] = occluded[k]
