"""Lone spikes of a difference, evened out for the denoiser, which takes a speck in a clean picture for a detail.

A bright path that few frames have is a speck where it comes, and a dark one where the base has it and the frame not.
What is more than its surroundings explain is spread over the neighbours, so that no light is lost.
"""

import taichi as ti

from tiscene.render.integrators.path_kernels import Floats2

vec3 = ti.math.vec3
Image = ti.types.ndarray(dtype=ti.f32, ndim=3)

SURROUNDINGS, REACH = 2, 3  # pixels each way: what a change is compared with, how far a spike is spread
# A change may be so much of the radiance below it, and so many times the mean change around it.
OF_RADIANCE, OF_SURROUNDINGS = 0.25, 3.0


@ti.func
def same_surface(change: ti.template(), pixel: ti.i32) -> ti.i32:
    """Whether no mover has come into the pixel itself: albedo and normal have not changed."""
    changed = 0.0
    for c in ti.static(range(3, 9)):
        changed += ti.abs(change[pixel, c])
    return ti.cast(changed == 0.0, ti.i32)


@ti.kernel
def find_spikes(width: ti.i32, height: ti.i32, change: Floats2, hdr: Image, spikes: Image):
    """To spikes [h, w, 4]: what of each pixel is too much, and one over the number of pixels to spread it over."""
    for pixel in range(width * height):
        x, y = pixel % width, pixel // width
        for c in ti.static(range(4)):
            spikes[y, x, c] = 0.0
        own = vec3(change[pixel, 0], change[pixel, 1], change[pixel, 2])
        size = ti.abs(own).sum()
        if size > 0.0 and same_surface(change, pixel):
            around, neighbours = 0.0, 0.0
            for dy in range(ti.max(-SURROUNDINGS, -y), ti.min(SURROUNDINGS, height - 1 - y) + 1):
                for dx in range(ti.max(-SURROUNDINGS, -x), ti.min(SURROUNDINGS, width - 1 - x) + 1):
                    other = pixel + dy * width + dx
                    if other != pixel:
                        neighbours += 1.0
                        for c in ti.static(range(3)):
                            around += ti.abs(change[other, c])
            below = ti.max(vec3(hdr[y, x, 0], hdr[y, x, 1], hdr[y, x, 2]).sum() - own.sum(), 0.0)
            limit = OF_RADIANCE * below + OF_SURROUNDINGS * around / ti.max(neighbours, 1.0)
            if size > limit:
                takers = 0.0
                for dy in range(ti.max(-REACH, -y), ti.min(REACH, height - 1 - y) + 1):
                    for dx in range(ti.max(-REACH, -x), ti.min(REACH, width - 1 - x) + 1):
                        takers += same_surface(change, pixel + dy * width + dx)
                for c in ti.static(range(3)):
                    spikes[y, x, c] = own[c] * (1.0 - limit / size)
                spikes[y, x, 3] = 1.0 / takers


@ti.kernel
def spread_spikes(width: ti.i32, height: ti.i32, change: Floats2, spikes: Image, hdr: Image, even: Image):
    """The radiance with its spikes spread."""
    for pixel in range(width * height):
        x, y = pixel % width, pixel // width
        value = vec3(0.0)
        for c in ti.static(range(3)):
            value[c] = hdr[y, x, c] - spikes[y, x, c]
        if same_surface(change, pixel):
            for dy in range(ti.max(-REACH, -y), ti.min(REACH, height - 1 - y) + 1):
                for dx in range(ti.max(-REACH, -x), ti.min(REACH, width - 1 - x) + 1):
                    part = spikes[y + dy, x + dx, 3]
                    if part > 0.0:
                        for c in ti.static(range(3)):
                            value[c] += part * spikes[y + dy, x + dx, c]
        for c in ti.static(range(3)):
            even[y, x, c] = value[c]
