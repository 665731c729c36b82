"""Kernels of a frame that replays cached paths: find the rows that a mover gets in the way of, take off the light that
is lost, put the paths that are cut back on their way, and add up what changed."""

import taichi as ti

from tiscene.render.integrators.path_kernels import Floats2, Ints1, Ints2
from tiscene.render.integrators.path_shading import read3, write3
from tiscene.render.integrators.path_state import (
    CHUNK,
    DIFFUSE_PART,
    DIRECT,
    FEATURE_COLUMNS,
    ORIGIN,
    PDF,
    RADIANCE,
    RELATIVE_IOR2,
    SAMPLED,
    SEEN,
    SPREAD,
    THROUGHPUT,
    States,
    get3,
    set3,
)
from tiscene.render.integrators.replay_near import ROWS, add_up
from tiscene.render.integrators.replay_record import (
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
from tiscene.render.ray_arrays import ROW, Hits, Pixels, Rays, ray_direction, ray_origin, write_ray
from tiscene.render.view import camera_ray
from tiscene.scene.placement import CURRENT

vec3 = ti.math.vec3
Image = ti.types.ndarray(dtype=ti.f32, ndim=3)

LOOKS = 4  # rays through a pixel, at fixed places, that tell how much of it the movers cover


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
    starts: ti.types.ndarray(dtype=ti.i32, ndim=1),
):
    """What each path loses; those that a mover cuts are put back to where the segment begins that it cuts.

    factors: how much of its light each group of lights gives, f32 [groups, 3].
    cut: of every row, whether a mover is in the way. difference: f32 [count, 3]. cut_at: of every path the number of
    the segment cut, -1 for none, and its step. entering[starts[s] .. starts[s + 1]): the paths cut at step s.
    """
    chunk_count = (count + CHUNK - 1) // CHUNK
    for chunk in range(chunk_count):
        for s in range(steps):
            chunks[chunk, s] = 0
        for i in range(chunk * CHUNK, ti.min(count, (chunk + 1) * CHUNK)):
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
                state[i][DIFFUSE_PART] = restore[at, R_DIFFUSE]
                set3(state, i, ORIGIN, read3(restore, at, R_VERTEX))
                status[i] = ti.cast(restore[at, R_STATUS], ti.i32)
                for c in ti.static(range(FEATURE_COLUMNS)):
                    features[i, c] = 0.0
    ti.loop_config(serialize=True)
    for _ in range(1):
        total = 0
        for s in range(steps):
            starts[s] = total
            for chunk in range(chunk_count):
                here = chunks[chunk, s]
                chunks[chunk, s] = total
                total += here
        starts[steps] = total
    for chunk in range(chunk_count):
        for i in range(chunk * CHUNK, ti.min(count, (chunk + 1) * CHUNK)):
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
):
    """The mean change of light, albedo and normal of the pixels whose paths these are: film [n, 9].

    others: of how many paths a pixel that has the mean already.
    """
    for rank in range(first // spp, (first + count) // spp):
        sums = ti.Vector.zero(ti.f32, 3 + FEATURE_COLUMNS)
        for i in range(rank * spp - first, (rank + 1) * spp - first):
            change = read3(difference, i, 0)
            at = cut_at[i, 0]
            if at >= 0:
                change += get3(state, i, RADIANCE)
                if (status[i] & SAMPLED) != 0 and occluded[i] == 0:
                    change += get3(state, i, DIRECT)
                if (ti.cast(restore[at, R_STATUS], ti.i32) & SEEN) == 0:
                    for c in ti.static(range(FEATURE_COLUMNS)):
                        sums[3 + c] += features[i, c] - base_features[i, c]
            if ti.abs(change.sum()) < ti.math.inf:  # false for nan too
                for c in ti.static(range(3)):
                    sums[c] += change[c]
        pixel = pixels[rank][ROW]
        for c in ti.static(range(3 + FEATURE_COLUMNS)):
            before = film[pixel, c] * others if others > 0 else 0.0
            film[pixel, c] = (before + sums[c]) / (others + spp)


@ti.kernel
def look_rays(view: Floats2, pixels: Pixels, width: ti.i32, height: ti.i32, rays: Rays, queue: Ints1):
    """LOOKS rays through each pixel."""
    for k in range(width * height * LOOKS):
        pixel = pixels[k // LOOKS][ROW]
        x = pixel % width - 0.25 + 0.5 * (k % 2)
        y = pixel // width - 0.25 + 0.5 * (k // 2 % 2)
        origin, direction = camera_ray(view, CURRENT, x, y, width, height)
        write_ray(rays, k, origin, direction, ti.math.inf)
        queue[k] = k


@ti.kernel
def end_looks(count: ti.i32, hits: Hits, rays: Rays):
    """Let each ray end where it met something."""
    for k in range(count):
        rays[k][7] = hits[k][0]


@ti.kernel
def count_looks(pixels: Pixels, count: ti.i32, covered: Ints1, looks: Ints1):
    """In how many of the LOOKS of each pixel a mover is in front. covered: of each, by the pixel's rank."""
    for rank in range(count):
        found = 0
        for k in ti.static(range(LOOKS)):
            found += covered[rank * LOOKS + k]
        looks[pixels[rank][ROW]] = found


@ti.kernel
def combine(
    width: ti.i32,
    height: ti.i32,
    looks: Ints1,
    change: Floats2,
    factors: Floats2,
    mean: Floats2,
    base: Image,
    hdr: Image,
    albedo: Image,
    normal: Image,
    unmoved: Image,
):
    """The picture: the change added to the base image, and where movers cover most of a pixel, to its own paths' mean.

    looks: as of `count_looks`. change: f32 [n, 9]; factors: as of `settle`;
    mean [n, ...], base [h, w, ...]: columns as `light_column` says.
    unmoved: 1 where what is seen first has not changed, else 0.
    """
    for pixel in range(width * height):
        x, y = pixel % width, pixel // width
        changed = ti.cast(looks[pixel], ti.f32)
        for c in ti.static(range(3, 9)):
            changed += ti.abs(change[pixel, c])
        unmoved[y, x, 0] = ti.cast(changed == 0.0, ti.f32)
        for c in ti.static(range(3)):
            below = vec3(base[y, x, c], base[y, x, 3 + c], base[y, x, 6 + c])
            if 2 * looks[pixel] > LOOKS:
                below = vec3(mean[pixel, c], mean[pixel, 3 + c], mean[pixel, 6 + c])
            for group in range(1, factors.shape[0]):
                column = light_column(group) + c
                part = base[y, x, column]
                if 2 * looks[pixel] > LOOKS:
                    part = mean[pixel, column]
                below[0] += factors[group, c] * part
            hdr[y, x, c] = below[0] + change[pixel, c]
            albedo[y, x, c] = below[1] + change[pixel, 3 + c]
            normal[y, x, c] = below[2] + change[pixel, 6 + c]


@ti.kernel
def find_cut_shadows(candidates: Ints1, count: ti.i32, rays: Rays, cut: Ints1, rows: Ints1, chunks: Ints1) -> ti.i32:
    """The rows of the shadow rays that a mover is in the way of, in order. Returns how many."""
    chunk_count = (count + ROWS - 1) // ROWS
    for chunk in range(chunk_count):
        found = 0
        for k in range(chunk * ROWS, ti.min(count, (chunk + 1) * ROWS)):
            row = candidates[k]
            if cut[row] > 0 and rays[row][SEGMENT] < 0.0:
                found += 1
        chunks[chunk] = found
    ti.loop_config(serialize=True)
    for _ in range(1):
        add_up(chunks, chunk_count)
    for chunk in range(chunk_count):
        at = chunks[chunk]
        for k in range(chunk * ROWS, ti.min(count, (chunk + 1) * ROWS)):
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
