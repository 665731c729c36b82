# SPDX-License-Identifier: Apache-2.0
"""Light traced in a smaller picture, brought to full size along the surfaces that the labels show.

What varies least over a surface is the light that reaches it: radiance over albedo. That is what is denoised and
enlarged, from neighbors with a like normal only (joint bilateral upsampling, Kopf et al. 2007), before the albedo of
each pixel, which is free of noise, makes radiance of it again. Mirrors and glass are as coarse as they were traced.
"""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats3, Template, vec3

FloatImage = NDArray[np.float32]

FLOOR = 0.08  # added to every albedo: what shines on black is not diffuse
ANY = 1e-5  # the weight, of all, that a neighbor of quite another kind has


def reduced(width: int, height: int, downscale: int) -> tuple[int, int]:
    """The size, px, of the picture in which light is traced for one of that size: as wide an angle at least."""
    low_height = -(-height // downscale)
    return -(-width * low_height // height), low_height


def light(
    radiance: FloatImage, albedo: FloatImage, normal: FloatImage, downscale: int = 1
) -> tuple[FloatImage, FloatImage, FloatImage]:
    """What reaches the surfaces, the albedo of that [h, w, 3]: 1, and 0 where there is no surface and the light is the
    radiance; and the normal. All as means of squares of so many pixels; the last rows and columns count as often as it
    takes to fill them."""
    height, width = (-(-length // downscale) for length in radiance.shape[:2])
    reached, white, coarse = (np.empty((height, width, 3), np.float32) for _ in range(3))
    _light(radiance, albedo, normal, downscale, reached, white, coarse)
    return reached, white, coarse


def upsample(
    light: FloatImage,
    normal: FloatImage,
    full_albedo: FloatImage,
    full_normal: FloatImage,
    downscale: int | None = None,
) -> FloatImage:
    """Radiance, float32 [h, w, 3], of the size of the full albedo and normal; no normal (0) says that nothing is there.

    light, normal: as of `light`, of a picture of the size that `reduced` says, or with that downscale.
    """
    height, width = full_albedo.shape[:2]
    low_height, low_width = light.shape[:2]
    if downscale is None:
        scale = low_height / height
        first_y, first_x = 0.5 * (low_height - 1 - (height - 1) * scale), 0.5 * (low_width - 1 - (width - 1) * scale)
    else:
        scale = 1.0 / downscale
        first_y = first_x = 0.5 * scale - 0.5
    radiance = np.empty_like(full_albedo)
    _upsample(light, normal, full_albedo, full_normal, scale, first_y, first_x, radiance)
    return radiance


@ti.func
def read(image: Template, y: ti.i32, x: ti.i32) -> vec3:
    return vec3(image[y, x, 0], image[y, x, 1], image[y, x, 2])


@ti.kernel
def _light(
    radiance: Floats3,
    albedo: Floats3,
    normal: Floats3,
    downscale: ti.i32,
    reached: Floats3,
    white: Floats3,
    coarse: Floats3,
):
    height, width = radiance.shape[0], radiance.shape[1]
    for y, x in ti.ndrange(reached.shape[0], reached.shape[1]):
        light_sum, surface_sum, normal_sum = vec3(0.0), 0.0, vec3(0.0)
        for place in range(downscale * downscale):
            row = ti.min(y * downscale + place // downscale, height - 1)
            column = ti.min(x * downscale + place % downscale, width - 1)
            n, shown = read(normal, row, column), read(radiance, row, column)
            if n.norm_sqr() > 0.0:
                shown /= read(albedo, row, column) + FLOOR
                surface_sum += 1.0
            light_sum += shown
            normal_sum += n
        for c in ti.static(range(3)):
            reached[y, x, c] = light_sum[c] / (downscale * downscale)
            white[y, x, c] = surface_sum / (downscale * downscale)
            coarse[y, x, c] = normal_sum[c] / (downscale * downscale)


@ti.func
def spline(offset: ti.f32) -> vec3:
    """The quadratic B-spline at a distance of -1 - offset, -offset and 1 - offset."""
    return vec3(0.5 * (0.5 - offset) ** 2, 0.75 - offset * offset, 0.5 * (0.5 + offset) ** 2)


@ti.kernel
def _upsample(
    light: Floats3,
    normal: Floats3,
    full_albedo: Floats3,
    full_normal: Floats3,
    scale: ti.f32,
    first_y: ti.f32,
    first_x: ti.f32,
    radiance: Floats3,
):
    """first_y, first_x: where in the smaller picture the first pixel's center is."""
    height, width = full_albedo.shape[0], full_albedo.shape[1]
    low_height, low_width = light.shape[0], light.shape[1]
    for pixel in range(width * height):
        y, x = pixel // width, pixel % width
        low_y, low_x = first_y + y * scale, first_x + x * scale
        center_y, center_x = ti.round(low_y, ti.i32), ti.round(low_x, ti.i32)
        weights_y, weights_x = spline(low_y - center_y), spline(low_x - center_x)
        n = read(full_normal, y, x)
        surface = n.norm_sqr() > 0.0
        sums, total = vec3(0.0), 0.0
        for row, column in ti.static(ti.ndrange(3, 3)):
            at_y = ti.math.clamp(center_y + row - 1, 0, low_height - 1)
            at_x = ti.math.clamp(center_x + column - 1, 0, low_width - 1)
            other = read(normal, at_y, at_x)
            alike = ti.max(n.dot(other), 0.0) ** 4
            if not surface:
                alike = ti.select(other.norm_sqr() > 0.0, 0.0, 1.0)
            weight = weights_y[row] * weights_x[column] * (alike + ANY)
            sums += weight * read(light, at_y, at_x)
            total += weight
        result = sums / total
        if surface:
            result *= read(full_albedo, y, x) + FLOOR
        for c in ti.static(range(3)):
            radiance[y, x, c] = result[c]
