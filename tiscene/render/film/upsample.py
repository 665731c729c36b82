# SPDX-License-Identifier: Apache-2.0
"""Guided upsampling of images path-traced at a lower resolution.

Radiance is demodulated: irradiance, radiance over albedo, is smooth over a surface. It is denoised and upsampled from
neighbors with a similar normal (joint bilateral upsampling, Kopf et al. 2007), then multiplied by the noise-free albedo
of the full resolution. Mirrors and glass keep the lower resolution.
"""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats3, Template, vec3

FloatImage = NDArray[np.float32]

ALBEDO_OFFSET = 0.08  # added to every albedo: black surfaces reflect specularly
MIN_SIMILARITY = 1e-5  # of neighbors with different normals, so that the sum of weights is not 0


def reduced_size(width: int, height: int, downscale: int) -> tuple[int, int]:
    """Return (width, height), px, of the lower resolution, with at least the same field of view."""
    low_height = -(-height // downscale)
    return -(-width * low_height // height), low_height


def demodulate(
    radiance: FloatImage, albedo: FloatImage, normal: FloatImage, downscale: int = 1
) -> tuple[FloatImage, FloatImage, FloatImage]:
    """Divide radiance by albedo, and average blocks of downscale x downscale pixels (edges are replicated).

    Returns:
        (irradiance, white, normal), float32 [h, w, 3]. irradiance: where there is no surface, the radiance. white: the
        albedo of the irradiance, 1, and 0 where there is no surface.
    """
    height, width = (-(-length // downscale) for length in radiance.shape[:2])
    irradiance_out, white, mean_normal = (np.empty((height, width, 3), np.float32) for _ in range(3))
    _demodulate(radiance, albedo, normal, downscale, irradiance_out, white, mean_normal)
    return irradiance_out, white, mean_normal


def block_means(image: FloatImage, downscale: int) -> FloatImage:
    """Return the means of blocks of downscale x downscale pixels of an image, [h, w, c]; edges are replicated."""
    height, width = (-(-length // downscale) for length in image.shape[:2])
    means = np.empty((height, width, image.shape[2]), np.float32)
    _block_means(image, downscale, means)
    return means


def interpolated(mask: NDArray[np.bool_], shape: tuple[int, ...], downscale: int) -> FloatImage:
    """Return a mask of blocks of downscale x downscale pixels, interpolated between their centers, float32 [h, w]."""
    result = mask.astype(np.float32)
    for axis, length in enumerate(shape):
        place = np.clip((np.arange(length, dtype=np.float32) + 0.5) / downscale - 0.5, 0.0, mask.shape[axis] - 1.0)
        first = place.astype(np.int64)
        share = (place - first).reshape((-1, 1) if axis == 0 else (1, -1))
        after = np.minimum(first + 1, mask.shape[axis] - 1)
        result = (1.0 - share) * result.take(first, axis) + share * result.take(after, axis)
    return result


def upsample(
    irradiance: FloatImage,
    normal: FloatImage,
    full_albedo: FloatImage,
    full_normal: FloatImage,
    downscale: int | None = None,
) -> FloatImage:
    """Upsample irradiance and multiply it by albedo.

    Args:
        irradiance: float32 [h', w', 3], of `demodulate`.
        normal: float32 [h', w', 3], of the lower resolution.
        full_albedo: float32 [h, w, 3].
        full_normal: float32 [h, w, 3]; zero where there is no surface.
        downscale: Of `demodulate`; None: the lower resolution is that of `reduced_size`.

    Returns:
        Radiance, float32 [h, w, 3].
    """
    height, width = full_albedo.shape[:2]
    low_height, low_width = irradiance.shape[:2]
    if downscale is None:
        scale = low_height / height
        first_y, first_x = 0.5 * (low_height - 1 - (height - 1) * scale), 0.5 * (low_width - 1 - (width - 1) * scale)
    else:
        scale = 1.0 / downscale
        first_y = first_x = 0.5 * scale - 0.5
    radiance = np.empty_like(full_albedo)
    _upsample(irradiance, normal, full_albedo, full_normal, scale, first_y, first_x, radiance)
    return radiance


@ti.func
def read(image: Template, y: ti.i32, x: ti.i32) -> vec3:
    """Return one pixel."""
    return vec3(image[y, x, 0], image[y, x, 1], image[y, x, 2])


@ti.kernel
def _demodulate(
    radiance: Floats3,
    albedo: Floats3,
    normal: Floats3,
    downscale: ti.i32,
    irradiance_out: Floats3,
    white: Floats3,
    mean_normal: Floats3,
):
    height, width = radiance.shape[0], radiance.shape[1]
    for y, x in ti.ndrange(irradiance_out.shape[0], irradiance_out.shape[1]):
        light_sum, surface_sum, normal_sum = vec3(0.0), 0.0, vec3(0.0)
        for offset in range(downscale * downscale):
            row = ti.min(y * downscale + offset // downscale, height - 1)
            column = ti.min(x * downscale + offset % downscale, width - 1)
            n, demodulated = read(normal, row, column), read(radiance, row, column)
            if n.norm_sqr() > 0.0:
                demodulated /= read(albedo, row, column) + ALBEDO_OFFSET
                surface_sum += 1.0
            light_sum += demodulated
            normal_sum += n
        for c in ti.static(range(3)):
            irradiance_out[y, x, c] = light_sum[c] / (downscale * downscale)
            white[y, x, c] = surface_sum / (downscale * downscale)
            mean_normal[y, x, c] = normal_sum[c] / (downscale * downscale)


@ti.kernel
def _block_means(image: Floats3, downscale: ti.i32, means: Floats3):
    for y, x in ti.ndrange(means.shape[0], means.shape[1]):
        for c in range(means.shape[2]):
            total = 0.0
            for offset in range(downscale * downscale):
                row = ti.min(y * downscale + offset // downscale, image.shape[0] - 1)
                column = ti.min(x * downscale + offset % downscale, image.shape[1] - 1)
                total += image[row, column, c]
            means[y, x, c] = total / (downscale * downscale)


@ti.func
def spline(offset: ti.f32) -> vec3:
    """Return the quadratic B-spline at distances -1 - offset, -offset and 1 - offset."""
    return vec3(0.5 * (0.5 - offset) ** 2, 0.75 - offset * offset, 0.5 * (0.5 + offset) ** 2)


@ti.kernel
def _upsample(
    irradiance: Floats3,
    normal: Floats3,
    full_albedo: Floats3,
    full_normal: Floats3,
    scale: ti.f32,
    first_y: ti.f32,
    first_x: ti.f32,
    radiance: Floats3,
):
    """Kernel of `upsample`; first_y, first_x: position of the first pixel's center in the lower resolution."""
    height, width = full_albedo.shape[0], full_albedo.shape[1]
    for pixel in range(width * height):
        y, x = pixel // width, pixel % width
        n = read(full_normal, y, x)
        white = read(full_albedo, y, x)
        result = upsampled(irradiance, normal, first_y + y * scale, first_x + x * scale, n, white)
        for c in ti.static(range(3)):
            radiance[y, x, c] = result[c]


@ti.func
def upsampled(irradiance: Template, normal: Template, low_y: ti.f32, low_x: ti.f32, n: vec3, albedo: vec3) -> vec3:
    """Return the radiance at a place of the lower resolution, of a surface with a normal and albedo.

    Where the normal is zero there is no surface, and the irradiance is the radiance.
    """
    center_y, center_x = ti.round(low_y, ti.i32), ti.round(low_x, ti.i32)
    weights_y, weights_x = spline(low_y - center_y), spline(low_x - center_x)
    sums, total = vec3(0.0), 0.0
    for row, column in ti.static(ti.ndrange(3, 3)):
        at_y = ti.math.clamp(center_y + row - 1, 0, irradiance.shape[0] - 1)
        at_x = ti.math.clamp(center_x + column - 1, 0, irradiance.shape[1] - 1)
        weight = weights_y[row] * weights_x[column] * similarity(n, read(normal, at_y, at_x))
        sums += weight * read(irradiance, at_y, at_x)
        total += weight
    return sums / total * modulation(n, albedo)


@ti.func
def similarity(n: vec3, other: vec3) -> ti.f32:
    """Return the weight of a neighbor with another normal; zero normals are no surface."""
    result = ti.max(n.dot(other), 0.0) ** 4
    if not n.norm_sqr() > 0.0:
        result = ti.select(other.norm_sqr() > 0.0, 0.0, 1.0)
    return result + MIN_SIMILARITY


@ti.func
def modulation(n: vec3, albedo: vec3) -> vec3:
    """Return radiance over irradiance, as of `demodulate`."""
    return ti.select(n.norm_sqr() > 0.0, albedo + ALBEDO_OFFSET, vec3(1.0))
