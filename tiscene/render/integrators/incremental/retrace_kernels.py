# SPDX-License-Identifier: Apache-2.0
"""Kernels of an incremental frame: find invalidated paths, restart them, and add the corrections to the base image.

A mover that blocks a recorded shadow ray removes that ray's light. A mover that blocks a segment *invalidates* the rest
of its path: all light recorded from that segment on is removed, and the path is traced again from the segment's start,
with the same random numbers, in the scene with the movers.
"""

import taichi as ti

from tiscene.device.kernel_types import Floats2, Floats3, Ints1, Ints2, Template, vec3
from tiscene.device.prefix_sums import exclusive_scan
from tiscene.render.columns import read3, write3
from tiscene.render.integrators.incremental.mover_coverage import SUBPIXELS
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
    links_of,
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
from tiscene.render.intersect.ray_queue import LINKS, ROW, Pixels, Rays, ray_direction, ray_origin, write_ray

STRIDES = 16  # restarted paths are queued in this many passes over the image, which balances the threads

# Columns of a pixel's correction: change of mean light, albedo and normal; number of camera rays that hit a mover.
CORRECTION_COLUMNS, MOVER_HITS = 10, 9
# Columns of a pixel's sums, valid where camera rays hit a mover: light, albedo and normal of those paths; change of
# light of the other paths; number of all paths.
MOVER_COLUMNS, MISS_LIGHT, PATH_COUNT = 13, 9, 12


@ti.func
def place_in_queue(chunk: ti.i32, chunk_count: ti.i32) -> ti.i32:
    """Return how many chunks are queued before a chunk: first every STRIDES-th, then those after them, and so on.

    A thread traces neighboring entries of the queue: interleaving the chunks of the image balances the load.
    """
    stride = chunk % STRIDES
    return stride * (chunk_count // STRIDES) + ti.min(stride, chunk_count % STRIDES) + chunk // STRIDES


@ti.kernel
def find_invalidated(
    count: ti.i32,
    steps: ti.i32,
    offsets: Ints1,
    rays: Rays,
    light: Floats2,
    factors: Floats2,
    restart: Floats2,
    blocked: Ints1,
    path_rays: Rays,
    state: States,
    features: Floats2,
    status: Ints1,
    change: Floats2,
    invalidated: Ints2,
    chunks: Ints1,
    restart_queue: Ints1,
    restart_offsets: Ints1,
    in_blocks: Template,
):
    """Subtract the light that movers block from each path, and restore the state of invalidated paths.

    Args:
        count: Number of paths.
        steps: Largest number of segments of a path.
        offsets, rays, light, restart: The recorded paths, see `PathBlock`.
        factors: f32 [groups, 3], intensity of each light group relative to the recorded light.
        blocked: i32 [rows], whether a mover blocks each recorded ray.
        path_rays, state, features, status: Output, `PathState` arrays of the invalidated paths.
        change: Output, f32 [count, 3], minus the blocked light.
        invalidated: Output, i32 [count, 2], index of the restart state and step of the first blocked segment; -1, -1
            for valid paths.
        chunks: Scratch, i32 [chunks_for(count) * steps].
        restart_queue: Output, i32 [count], invalidated paths sorted by step.
        restart_offsets: Output, i32 [steps + 1], first entry of each step in restart_queue.
        in_blocks: Compile-time: see `exclusive_scan`.
    """
    size = chunk_size(count)
    chunk_count = (count + size - 1) // size
    for chunk in range(chunk_count):
        at = place_in_queue(chunk, chunk_count)
        for s in range(steps):
            chunks[s * chunk_count + at] = 0
        for i in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            lost = vec3(0.0)
            restart_index, step, restart_row, segments = -1, -1, -1, 0
            for row in range(offsets[i], offsets[i + 1]):
                if restart_index < 0 and blocked[row] > 0:
                    segment = ti.cast(rays[row][SEGMENT], ti.i32)
                    if segment >= 0:
                        restart_index, restart_row = segment, row
                        for earlier in range(offsets[i], row):
                            if rays[earlier][SEGMENT] >= 0.0:
                                segments += 1
                        step = segments
                if restart_index >= 0 or blocked[row] > 0:
                    lost += read3(light, row, 0) * read3(factors, group_of(rays, row), 0)
            write3(change, i, 0, -lost)
            invalidated[i, 0] = restart_index
            invalidated[i, 1] = step
            if restart_index >= 0:
                chunks[step * chunk_count + at] += 1
                write_ray(path_rays, i, ray_origin(rays, restart_row), ray_direction(rays, restart_row), ti.math.inf)
                set3(state, i, THROUGHPUT, read3(restart, restart_index, R_THROUGHPUT))
                set3(state, i, RADIANCE, vec3(0.0))
                state[i][PDF] = restart[restart_index, R_PDF]
                state[i][RELATIVE_IOR2] = restart[restart_index, R_IOR2]
                state[i][SPREAD] = restart[restart_index, R_SPREAD]
                state[i][DIFFUSE_FRACTION] = restart[restart_index, R_DIFFUSE]
                set3(state, i, ORIGIN, read3(restart, restart_index, R_VERTEX))
                status[i] = ti.cast(restart[restart_index, R_STATUS], ti.i32)
                for c in ti.static(range(FEATURE_COLUMNS)):
                    features[i, c] = 0.0
    exclusive_scan(chunks, steps * chunk_count, in_blocks)
    for s in range(steps + 1):
        restart_offsets[s] = chunks[s * chunk_count]
    for chunk in range(chunk_count):
        at = place_in_queue(chunk, chunk_count)
        for i in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            step = invalidated[i, 1]
            if step >= 0:
                restart_queue[chunks[step * chunk_count + at]] = i
                chunks[step * chunk_count + at] += 1


@ti.kernel
def append_restarts(restart_queue: Ints1, begin: ti.i32, end: ti.i32, queue: Ints1, live: ti.i32):
    """Append restart_queue[begin .. end) to the `live` paths of the queue."""
    for k in range(end - begin):
        queue[live + k] = restart_queue[begin + k]


@ti.kernel
def accumulate_corrections(
    pixels: Pixels,
    first: ti.i32,
    count: ti.i32,
    spp: ti.i32,
    invalidated: Ints2,
    restart: Floats2,
    base_features: Floats2,
    status: Ints1,
    occluded: Ints1,
    state: States,
    features: Floats2,
    change: Floats2,
    previous_paths: ti.i32,
    correction: Floats2,
    mover_sums: Floats2,
):
    """Average the changes of the paths of each pixel; first .. first + count - 1 are whole pixels.

    Args:
        base_features: f32 [count, FEATURE_COLUMNS], denoiser features of the recorded paths.
        change: f32 [count, 3], see `find_invalidated`; the light of the traced paths is added here.
        previous_paths: Paths per pixel that the outputs contain already.
        correction: Output, f32 [pixels, CORRECTION_COLUMNS].
        mover_sums: Output, f32 [pixels, MOVER_COLUMNS]; not written where no camera ray hits a mover.
    """
    for rank in range(first // spp, (first + count) // spp):
        sums = ti.Vector.zero(ti.f32, CORRECTION_COLUMNS)
        hit_sums = ti.Vector.zero(ti.f32, PATH_COUNT)
        for i in range(rank * spp - first, (rank + 1) * spp - first):
            path_change = read3(change, i, 0)
            restart_index, added = invalidated[i, 0], vec3(0.0)
            if restart_index >= 0:
                added = get3(state, i, RADIANCE)
                if (status[i] & LIGHT_PENDING) != 0 and occluded[i] == 0:
                    added += get3(state, i, DIRECT)
                path_change += added
                if (ti.cast(restart[restart_index, R_STATUS], ti.i32) & FEATURES_WRITTEN) == 0:
                    for c in ti.static(range(FEATURE_COLUMNS)):
                        sums[3 + c] += features[i, c] - base_features[i, c]
            is_finite = ti.abs(path_change.sum()) < ti.math.inf  # also false for NaN
            if is_finite:
                for c in ti.static(range(3)):
                    sums[c] += path_change[c]
            if invalidated[i, 1] == 0:
                sums[MOVER_HITS] += 1.0
                for c in ti.static(range(FEATURE_COLUMNS)):
                    hit_sums[3 + c] += features[i, c]
            if is_finite:
                for c in ti.static(range(3)):
                    if invalidated[i, 1] == 0:
                        hit_sums[c] += added[c]
                    else:
                        hit_sums[MISS_LIGHT + c] += path_change[c]
        pixel = pixels[rank][ROW]
        hits_before = correction[pixel, MOVER_HITS] if previous_paths > 0 else 0.0
        if hits_before + sums[MOVER_HITS] > 0.0:
            for c in ti.static(range(PATH_COUNT)):
                before = 0.0
                if hits_before > 0.0:
                    before = mover_sums[pixel, c]
                elif ti.static(c >= MISS_LIGHT):
                    if previous_paths > 0:
                        before = correction[pixel, c - MISS_LIGHT] * previous_paths
                mover_sums[pixel, c] = before + hit_sums[c]
            mover_sums[pixel, PATH_COUNT] = previous_paths + spp
        for c in ti.static(range(MOVER_HITS)):
            before = correction[pixel, c] * previous_paths if previous_paths > 0 else 0.0
            correction[pixel, c] = (before + sums[c]) / (previous_paths + spp)
        correction[pixel, MOVER_HITS] = hits_before + sums[MOVER_HITS]


@ti.kernel
def compose(
    width: ti.i32,
    height: ti.i32,
    coverage: Ints2,
    use_coverage: ti.i32,
    correction: Floats2,
    mover_sums: Floats2,
    factors: Floats2,
    mean: Floats2,
    base: Floats3,
    noise_matched: Floats3,
    hdr: Floats3,
    denoiser_input: Floats3,
    albedo: Floats3,
    normal: Floats3,
    static_mask: Floats3,
):
    """Compose the frame: base image plus correction, or path mean plus correction where movers cover most of a pixel.

    Args:
        coverage: i32 [h, w], covered subpixels, see `MoverCoverage.count`.
        use_coverage: 1: the denoiser's input weighs movers and static surfaces by `coverage` instead of by the few
            paths that hit each.
        correction, mover_sums: See `accumulate_corrections`.
        factors: f32 [groups, 3], intensity of each light group.
        mean: f32 [pixels, ...], mean of the cached paths; columns: see `light_column`.
        base: f32 [h, w, ...], base image; columns: see `light_column`.
        noise_matched: f32 [h, w, 3 * groups], see `IncrementalBase.noise_matched`.
        hdr: Output, radiance.
        denoiser_input: Output, radiance for the denoiser, with `noise_matched` in place of `base`.
        albedo, normal: Output, denoiser features.
        static_mask: Output, 1 where the visible surfaces are those of the base, else 0.
    """
    for pixel in range(width * height):
        x, y = pixel % width, pixel // width
        covered = ti.max(coverage[y, x], 0)
        changed = ti.cast(covered, ti.f32)
        for c in ti.static(range(3, 9)):
            changed += ti.abs(correction[pixel, c])
        static_mask[y, x, 0] = ti.cast(changed == 0.0, ti.f32)
        is_blended = use_coverage != 0 and coverage[y, x] >= 0 and correction[pixel, MOVER_HITS] > 0.0
        for c in ti.static(range(3)):  # each vector is one channel of light, albedo and normal
            static_value = vec3(base[y, x, c], base[y, x, 3 + c], base[y, x, 6 + c])
            path_mean = vec3(mean[pixel, c], mean[pixel, 3 + c], mean[pixel, 6 + c])
            noisy_light = noise_matched[y, x, c]
            for group in range(1, factors.shape[0]):
                column = light_column(group) + c
                static_value[0] += factors[group, c] * base[y, x, column]
                path_mean[0] += factors[group, c] * mean[pixel, column]
                noisy_light += factors[group, c] * noise_matched[y, x, 3 * group + c]
            change = vec3(correction[pixel, c], correction[pixel, 3 + c], correction[pixel, 6 + c])
            hdr[y, x, c] = change[0] + (static_value[0] if 2 * covered <= SUBPIXELS else path_mean[0])
            static_value[0] = noisy_light
            shown = change + (static_value if 2 * covered <= SUBPIXELS else path_mean)
            if is_blended:
                fraction, hits = ti.cast(covered, ti.f32) / SUBPIXELS, correction[pixel, MOVER_HITS]
                misses = ti.max(mover_sums[pixel, PATH_COUNT] - hits, 1.0)
                shown = fraction / hits * vec3(mover_sums[pixel, c], mover_sums[pixel, 3 + c], mover_sums[pixel, 6 + c])
                shown += (1.0 - fraction) * (static_value + vec3(mover_sums[pixel, MISS_LIGHT + c] / misses, 0.0, 0.0))
            denoiser_input[y, x, c] = shown[0]
            albedo[y, x, c] = shown[1]
            normal[y, x, c] = shown[2]


@ti.kernel
def select_blocked_shadow_rays(
    candidates: Ints1, count: ti.i32, rays: Rays, blocked: Ints1, rows: Ints1, chunks: Ints1, in_blocks: Template
) -> ti.i32:
    """Write to `rows` which candidates are blocked shadow rays, in order, and return their number.

    Args:
        chunks: Scratch, i32 [chunks_for(count)].
        in_blocks: Compile-time: see `exclusive_scan`.
    """
    size = chunk_size(count)
    chunk_count = (count + size - 1) // size
    for chunk in range(chunk_count):
        found = 0
        for k in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            row = candidates[k]
            if blocked[row] > 0 and rays[row][SEGMENT] < 0.0:
                found += 1
        chunks[chunk] = found
    exclusive_scan(chunks, chunk_count, in_blocks)
    for chunk in range(chunk_count):
        at = chunks[chunk]
        for k in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            row = candidates[k]
            if blocked[row] > 0 and rays[row][SEGMENT] < 0.0:
                rows[at] = row
                at += 1
    return chunks[chunk_count]


@ti.kernel
def gather_shadow_rays(rows: Ints1, begin: ti.i32, count: ti.i32, rays: Rays, shadow_rays: Rays, queue: Ints1):
    """Copy the rays rows[begin .. begin + count) to the first rows of `shadow_rays`, and queue them."""
    for k in range(count):
        queue[k] = k
        shadow_rays[k] = rays[rows[begin + k]]
        shadow_rays[k][LINKS] = links_of(rays, rows[begin + k])


@ti.kernel
def scatter_occlusion(rows: Ints1, begin: ti.i32, count: ti.i32, occluded: Ints1, blocked: Ints1):
    """Copy the visibility of gathered shadow rays back to blocked[rows[begin .. begin + count)]."""
    for k in range(count):
        blocked[rows[begin + k]] = occluded[k]
