# SPDX-License-Identifier: Apache-2.0
"""Kernels of the wavefront path tracer: generate camera rays, compact queues, accumulate samples, develop the film.

Each thread owns the rows, chunks or pixels that it writes, and sums are evaluated in a fixed order: results have the
same bytes for any number of threads and any batch size.
"""

import taichi as ti

from tiscene.device.kernel_types import Floats1, Floats2, Floats3, Ints1, Ints2, Template, uint3, vec3
from tiscene.device.prefix_sums import exclusive_scan, scans_in_blocks
from tiscene.render.integrators.path.frame_stack import frame_of, key_of
from tiscene.render.integrators.path.path_state import (
    DIRECT,
    DROPPED,
    FEATURE_COLUMNS,
    FILM_COLUMNS,
    LIGHT_PENDING,
    LIVE,
    PDF,
    RADIANCE,
    RELATIVE_IOR2,
    SPREAD,
    THROUGHPUT,
    PathState,
    States,
    chunk_size,
    get3,
    set3,
)
from tiscene.render.intersect.ray_queue import PLACE, ROW, Pixels, Rays, write_ray
from tiscene.render.sampling import warp
from tiscene.render.sampling.pixel_filter import offset_weight, sample_offset
from tiscene.render.sampling.sobol import draw, draw_words, reverse_bits, set_keys, unit
from tiscene.render.view import FOCUS_DISTANCE, FORWARD, LENS_RADIUS, RIGHT, TANGENT, UP, camera_ray, view_vector
from tiscene.scene.placement import CURRENT

LANES = 16  # paths whose random numbers are computed in one SIMD vector
Words = ti.types.vector(LANES, ti.u32)

# Each set is two dimensions of the sample: position in the pixel, position on the lens, then the sets of each segment.
PIXEL_SET, LENS_SET, FIRST_STEP_SET = 0, 1, 2


@ti.func
def path_index(pixels: Template, path: ti.i32, spp: ti.i32, bits: ti.i32, first_sample: ti.i32) -> ti.u32:
    """Return the index of a path's Sobol point, bit-reversed as `draw` expects it."""
    return reverse_bits(path_number(pixels, path, spp, bits, first_sample))


@ti.func
def path_number(pixels: Template, path: ti.i32, spp: ti.i32, bits: ti.i32, first_sample: ti.i32) -> ti.u32:
    """Return the index of a path's Sobol point. The 2**bits points of a pixel are consecutive."""
    place = ti.cast(pixels[path // spp][PLACE], ti.u32)
    return (place << bits) + ti.cast(first_sample + path % spp, ti.u32)


@ti.func
def pixel_offset(pixel_filter: Template, keys: uint3, index: ti.u32) -> ti.math.vec2:
    """Sample the pixel filter: offset of a path from the pixel center, px.

    Args:
        pixel_filter: Table of the filter, see `pixel_filter.PixelFilter.table`.
        keys: Keys of PIXEL_SET.
        index: See `path_index`.
    """
    u = draw(keys, index)
    return ti.math.vec2(sample_offset(pixel_filter, u.x), sample_offset(pixel_filter, u.y))


@ti.func
def pixel_spread(view: Template, camera: ti.i32, height: ti.i32, bits: ti.i32) -> ti.f32:
    """Return the ray-cone spread of camera rays: the pixel's paths share its footprint, down to a quarter of it."""
    return 2.0 * view[camera, TANGENT] / height * ti.max(1.0 / ti.sqrt(ti.cast(1 << bits, ti.f32)), 0.25)


@ti.kernel
def start_paths(
    view: Floats2,
    pixel_filter: Floats1,
    pixels: Pixels,
    width: ti.i32,
    height: ti.i32,
    first: ti.i32,
    count: ti.i32,
    spp: ti.i32,
    bits: ti.i32,
    frame_key: ti.i32,
    rays: Rays,
    state: States,
    status: Ints1,
    queue: Ints1,
    first_sample: ti.i32,
    keys: Ints1,
    stacked: Template,
):
    """Generate the camera rays of paths first .. first + count - 1, and reset their state.

    Path p belongs to pixels[p // spp]. Random numbers are computed for LANES paths at a time.

    Args:
        bits: Bits that number all samples of a pixel, of which `spp` may be a part.
        first_sample: Number of the first of these samples in each pixel.
        keys, stacked: `FrameStack.arguments`.
    """
    first_spread = pixel_spread(view, CURRENT, height, bits)
    ti.loop_config(block_dim=32)
    for block in range((count + LANES - 1) // LANES):
        begin = block * LANES
        number = Words(0)
        for lane in range(LANES):
            number[lane] = path_number(pixels, first + ti.min(begin + lane, count - 1), spp, bits, first_sample)
        index = reverse_bits(number)
        # Vectors must be created inside the loop: memory of vectors created before it is not aligned for SIMD.
        x, y = draw_words(set_keys(frame_key, PIXEL_SET), index)
        for lane in range(ti.min(LANES, count - begin)):
            i = begin + lane
            pixel = pixels[(first + i) // spp][ROW]
            right, down = sample_offset(pixel_filter, unit(x[lane])), sample_offset(pixel_filter, unit(y[lane]))
            camera, row, spread = CURRENT, pixel // width, first_spread
            key = key_of(frame_key, keys, first + i, stacked)
            if ti.static(stacked):
                offset = pixel_offset(pixel_filter, set_keys(key, PIXEL_SET), index[lane])
                right, down = offset.x, offset.y
                camera += 3 * frame_of(keys, first + i, stacked)
                row %= height
                spread = pixel_spread(view, camera, height, bits)
            origin, direction = camera_ray(view, camera, pixel % width + right, row + down, width, height)
            radius = view[camera, LENS_RADIUS]
            if radius > 0.0:
                focus = origin + direction * (
                    view[camera, FOCUS_DISTANCE] / direction.dot(view_vector(view, camera, FORWARD))
                )
                lens = radius * warp.disk(draw(set_keys(key, LENS_SET), index[lane]))
                origin += view_vector(view, camera, RIGHT) * lens.x + view_vector(view, camera, UP) * lens.y
                direction = (focus - origin).normalized()
            write_ray(rays, i, origin, direction, ti.math.inf)
            set3(state, i, THROUGHPUT, vec3(1.0))
            set3(state, i, RADIANCE, vec3(0.0))
            state[i][PDF] = 0.0
            state[i][RELATIVE_IOR2] = 1.0
            state[i][SPREAD] = spread
            status[i] = LIVE
            queue[i] = i


def compact(state: PathState, count: int) -> tuple[int, int]:
    """Compact the first `count` paths of the queue, see `PathPass.advance` for what is returned."""
    queues = state.queue, count, state.next_queue, state.shadow_queue
    counts = compact_queue(state.status, *queues, *state.chunks, scans_in_blocks())
    state.swap_queues()
    return counts & 0xFFFFFFFF, counts >> 32


@ti.kernel
def compact_queue(
    status: Ints1,
    queue: Ints1,
    count: ti.i32,
    live: Ints1,
    shadows: Ints1,
    live_chunks: Ints1,
    shadow_chunks: Ints1,
    in_blocks: Template,
) -> ti.i64:
    """Compact queue[0..count): live paths to `live`, paths with LIGHT_PENDING to `shadows`, both in queue order.

    Args:
        live_chunks, shadow_chunks: Scratch, i32 [chunks_for(count)].
        in_blocks: Compile-time: see `exclusive_scan`.

    Returns:
        Their numbers in one integer: live + shadows * 2^32.
    """
    size = chunk_size(count)
    chunk_count = (count + size - 1) // size
    for chunk in range(chunk_count):
        live_count, shadow_count = 0, 0
        for k in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            i = queue[k]
            if status[i] & LIVE:
                live_count += 1
            if status[i] & LIGHT_PENDING:
                shadow_count += 1
        live_chunks[chunk] = live_count
        shadow_chunks[chunk] = shadow_count
    exclusive_scan(live_chunks, chunk_count, in_blocks)
    exclusive_scan(shadow_chunks, chunk_count, in_blocks)
    for chunk in range(chunk_count):
        live_count, shadow_count = live_chunks[chunk], shadow_chunks[chunk]
        for k in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            i = queue[k]
            if status[i] & LIVE:
                live[live_count] = i
                live_count += 1
            if status[i] & LIGHT_PENDING:
                shadows[shadow_count] = i
                shadow_count += 1
    return ti.cast(live_chunks[chunk_count], ti.i64) + (ti.cast(shadow_chunks[chunk_count], ti.i64) << 32)


@ti.kernel
def accumulate(
    pixel_filter: Floats1,
    clamp: ti.f32,
    pixels: Pixels,
    first: ti.i32,
    count: ti.i32,
    spp: ti.i32,
    bits: ti.i32,
    frame_key: ti.i32,
    status: Ints1,
    occluded: Ints1,
    state: States,
    features: Floats2,
    film: Floats2,
    first_sample: ti.i32,
    keys: Ints1,
    stacked: Template,
):
    """Add the paths first .. first + count - 1 to the sums of their pixels, in order of their samples.

    Sample 0 of a pixel resets the pixel's sums. Non-finite samples are counted and left out of the radiance.

    Args:
        clamp: Limit of the largest channel of a path's radiance, W/m²/sr; infinity to disable.
        film: f32 [pixels, FILM_COLUMNS], in the order of `pixels`.
        keys, stacked: `FrameStack.arguments`.
    """
    single_keys = set_keys(frame_key, PIXEL_SET)
    for rank in range(first // spp, (first + count - 1) // spp + 1):
        begin, end = ti.max(first, rank * spp), ti.min(first + count, (rank + 1) * spp)
        is_first = begin == rank * spp and first_sample == 0
        sums = ti.Vector.zero(ti.f32, FILM_COLUMNS)
        pixel_keys = single_keys
        if ti.static(stacked):
            pixel_keys = set_keys(key_of(frame_key, keys, begin, stacked), PIXEL_SET)
        if not is_first:
            for c in ti.static(range(FILM_COLUMNS)):
                sums[c] = film[rank, c]
        for path in range(begin, end):
            i = path - first
            radiance = get3(state, i, RADIANCE)
            if (status[i] & LIGHT_PENDING) != 0 and occluded[i] == 0:
                radiance += get3(state, i, DIRECT)
            if ti.abs(radiance.sum()) < ti.math.inf:  # also false for NaN
                if radiance.max() > clamp:
                    radiance *= clamp / radiance.max()
                if pixel_filter[0] != 1.0:  # the filter has negative lobes
                    index = path_index(pixels, path, spp, bits, first_sample)
                    offset = pixel_offset(pixel_filter, pixel_keys, index)
                    radiance *= offset_weight(pixel_filter, offset.x, offset.y)
                for c in ti.static(range(3)):
                    sums[c] += radiance[c]
            else:
                sums[DROPPED] += 1.0
            for c in ti.static(range(FEATURE_COLUMNS)):
                sums[3 + c] += features[i, c]
        for c in ti.static(range(FILM_COLUMNS)):
            film[rank, c] = sums[c]


@ti.kernel
def read_film(film: Floats2, rows: Ints1, values: Floats2):
    """Copy rows of the film to the rows `rows` of `values`."""
    for rank in range(rows.shape[0]):
        for c in range(values.shape[1]):
            values[rows[rank], c] = film[rank, c]


@ti.kernel
def develop(
    film: Floats2,
    pixels: Pixels,
    spp: ti.i32,
    hdr: Floats3,
    albedo: Floats3,
    normal: Floats3,
    dropped: Ints2,
):
    """Divide the film by the number of samples and write it as images [height, width, 3].

    Args:
        dropped: Output, i32 [height, width], number of non-finite samples of each pixel.
    """
    width = hdr.shape[1]
    for rank in range(width * hdr.shape[0]):
        x, y = pixels[rank][ROW] % width, pixels[rank][ROW] // width
        valid = ti.max(spp - film[rank, DROPPED], 1.0)
        for c in ti.static(range(3)):
            hdr[y, x, c] = film[rank, c] / valid
            albedo[y, x, c] = film[rank, 3 + c] / spp
            normal[y, x, c] = film[rank, 6 + c] / spp
        dropped[y, x] = ti.cast(film[rank, DROPPED], ti.i32)
