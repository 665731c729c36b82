# SPDX-License-Identifier: Apache-2.0
"""The path tracer's own kernels: start paths, compact the live ones, add finished ones to the film, develop it.

Each thread owns the rows, chunks or pixels it writes, and sums run in one fixed order, so that every result has the
same bytes for any number of threads and any size of batch.
"""

import taichi as ti

from tiscene.device.kernel_types import Floats1, Floats2, Floats3, Ints1, Ints2, Template, uint3, vec3
from tiscene.render.integrators.path.path_state import (
    DIRECT,
    DROPPED,
    FEATURE_COLUMNS,
    FILM_COLUMNS,
    LIVE,
    PDF,
    RADIANCE,
    RELATIVE_IOR2,
    SAMPLED,
    SPREAD,
    THROUGHPUT,
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

LANES = 16  # paths whose random numbers are computed together, as SIMD
Words = ti.types.vector(LANES, ti.u32)

# Sets of two dimensions: where on the pixel, where on the lens, then some for each step of a path.
PIXEL_SET, LENS_SET, FIRST_STEP_SET = 0, 1, 2


@ti.func
def path_index(pixels: Template, path: ti.i32, spp: ti.i32, bits: ti.i32, first_sample: ti.i32) -> ti.u32:
    """Which points of the picture's are a path's, as `draw` takes it."""
    return reverse_bits(path_number(pixels, path, spp, bits, first_sample))


@ti.func
def path_number(pixels: Template, path: ti.i32, spp: ti.i32, bits: ti.i32, first_sample: ti.i32) -> ti.u32:
    """The same, not reversed: those of a pixel are 2**bits in a row."""
    place = ti.cast(pixels[path // spp][PLACE], ti.u32)
    return (place << bits) + ti.cast(first_sample + path % spp, ti.u32)


@ti.func
def pixel_offset(pixel_filter: Template, keys: uint3, index: ti.u32) -> ti.math.vec2:
    """Where a path goes through its pixel, px from the center. keys: of PIXEL_SET. index: `path_index`."""
    u = draw(keys, index)
    return ti.math.vec2(sample_offset(pixel_filter, u.x), sample_offset(pixel_filter, u.y))


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
):
    """Send the paths first .. first + count - 1 through their pixels, `spp` each, numbered from first_sample on.

    Their random numbers are made LANES paths side by side.

    bits: they count all of a pixel's samples, of which these may be a part.
    """
    # A pixel's paths share it; no pixel is looked at closer than this.
    spread = 2.0 * view[CURRENT, TANGENT] / height * ti.max(1.0 / ti.sqrt(ti.cast(1 << bits, ti.f32)), 0.25)
    ti.loop_config(block_dim=32)
    for block in range((count + LANES - 1) // LANES):
        begin = block * LANES
        number = Words(0)
        for lane in range(LANES):
            number[lane] = path_number(pixels, first + ti.min(begin + lane, count - 1), spp, bits, first_sample)
        index = reverse_bits(number)
        # Keys are made here, since vectors made before the loop are kept where they are not aligned.
        x, y = draw_words(set_keys(frame_key, PIXEL_SET), index)
        for lane in range(ti.min(LANES, count - begin)):
            i = begin + lane
            pixel = pixels[(first + i) // spp][ROW]
            right, down = sample_offset(pixel_filter, unit(x[lane])), sample_offset(pixel_filter, unit(y[lane]))
            origin, direction = camera_ray(view, CURRENT, pixel % width + right, pixel // width + down, width, height)
            radius = view[CURRENT, LENS_RADIUS]
            if radius > 0.0:
                focus = origin + direction * (
                    view[CURRENT, FOCUS_DISTANCE] / direction.dot(view_vector(view, CURRENT, FORWARD))
                )
                lens = radius * warp.disk(draw(set_keys(frame_key, LENS_SET), index[lane]))
                origin += view_vector(view, CURRENT, RIGHT) * lens.x + view_vector(view, CURRENT, UP) * lens.y
                direction = (focus - origin).normalized()
            write_ray(rays, i, origin, direction, ti.math.inf)
            set3(state, i, THROUGHPUT, vec3(1.0))
            set3(state, i, RADIANCE, vec3(0.0))
            state[i][PDF] = 0.0
            state[i][RELATIVE_IOR2] = 1.0
            state[i][SPREAD] = spread
            status[i] = LIVE
            queue[i] = i


@ti.kernel
def compact(
    status: Ints1,
    queue: Ints1,
    count: ti.i32,
    live: Ints1,
    shadows: Ints1,
    chunks: Ints2,
) -> ti.i64:
    """Of queue[0..count) the live paths to `live` and the SAMPLED ones to `shadows`, in the same order.

    Returns how many: live + shadows * 2^32.
    """
    size = chunk_size(count)
    chunk_count = (count + size - 1) // size
    for chunk in range(chunk_count):
        lives, casts = 0, 0
        for k in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            i = queue[k]
            if status[i] & LIVE:
                lives += 1
            if status[i] & SAMPLED:
                casts += 1
        chunks[chunk, 0] = lives
        chunks[chunk, 1] = casts
    ti.loop_config(serialize=True)
    for column in range(2):
        total = 0
        for chunk in range(chunk_count):
            here = chunks[chunk, column]
            chunks[chunk, column] = total
            total += here
        chunks[chunk_count, column] = total
    for chunk in range(chunk_count):
        lives, casts = chunks[chunk, 0], chunks[chunk, 1]
        for k in range(chunk * size, ti.min(count, (chunk + 1) * size)):
            i = queue[k]
            if status[i] & LIVE:
                live[lives] = i
                lives += 1
            if status[i] & SAMPLED:
                shadows[casts] = i
                casts += 1
    return ti.cast(chunks[chunk_count, 0], ti.i64) + (ti.cast(chunks[chunk_count, 1], ti.i64) << 32)


@ti.kernel
def expose(
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
):
    """Add a batch to the sums of its pixels, sample by sample in their order; the samples from 0 on begin them anew.

    clamp: what the largest channel of a path's radiance is brought down to; infinite for all of it.
    """
    pixel_keys = set_keys(frame_key, PIXEL_SET)
    for rank in range(first // spp, (first + count - 1) // spp + 1):
        pixel = pixels[rank][ROW]
        begin, end = ti.max(first, rank * spp), ti.min(first + count, (rank + 1) * spp)
        fresh = begin == rank * spp and first_sample == 0
        sums = ti.Vector.zero(ti.f32, FILM_COLUMNS)
        if not fresh:
            for c in ti.static(range(FILM_COLUMNS)):
                sums[c] = film[pixel, c]
        for path in range(begin, end):
            i = path - first
            radiance = get3(state, i, RADIANCE)
            if (status[i] & SAMPLED) != 0 and occluded[i] == 0:
                radiance += get3(state, i, DIRECT)
            if ti.abs(radiance.sum()) < ti.math.inf:  # false for nan too
                if radiance.max() > clamp:
                    radiance *= clamp / radiance.max()
                if pixel_filter[0] != 1.0:  # some weights are negative
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
            film[pixel, c] = sums[c]


@ti.kernel
def develop(
    film: Floats2,
    width: ti.i32,
    height: ti.i32,
    spp: ti.i32,
    hdr: Floats3,
    albedo: Floats3,
    normal: Floats3,
    dropped: Ints2,
):
    """Means of the sums, as images."""
    for pixel in range(width * height):
        x, y = pixel % width, pixel // width
        kept = ti.max(spp - film[pixel, DROPPED], 1.0)
        for c in ti.static(range(3)):
            hdr[y, x, c] = film[pixel, c] / kept
            albedo[y, x, c] = film[pixel, 3 + c] / spp
            normal[y, x, c] = film[pixel, 6 + c] / spp
        dropped[y, x] = ti.cast(film[pixel, DROPPED], ti.i32)
