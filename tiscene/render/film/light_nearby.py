# SPDX-License-Identifier: Apache-2.0
"""The light that parts of pixels should have, as what is known of the image says.

Beside edges, pixels of reduced size mix surfaces: dark curtains with the bright reveals of windows. So the known parts
of a pixel and of its neighbors count first, as far as they are oriented alike.
"""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats2, Floats3, Ints1
from tiscene.render.columns import read3
from tiscene.render.film.upsample import modulation, read, similarity, upsampled

FloatImage = NDArray[np.float32]

REDUCED = 0.01  # weight of light of reduced size, in known pixels of the same orientation
BESIDE = 0.25  # weight of a neighbor in a pixel's row or column, in the pixel itself


def light_nearby(
    pixels: NDArray[np.int32],
    albedo: FloatImage,
    normal: FloatImage,
    known: tuple[FloatImage, FloatImage, FloatImage, FloatImage],
    irradiance: FloatImage,
    reduced_normal: FloatImage,
    downscale: int,
) -> FloatImage:
    """Return the radiance that parts of some pixels should have.

    Args:
        pixels: int32 [n], y * width + x.
        albedo: Of the parts, float32 [n, 3].
        normal: Of the parts, float32 [n, 3]; zero where there is no surface.
        known: Radiance of the known parts of pixels, as if the others were black, float32 [h, w, 3]; the share of these
            parts, float32 [h, w, 1]; albedo and normal of the pixels, float32 [h, w, 3] each.
        irradiance: At reduced size, float32 [h', w', 3], see `demodulate`.
        reduced_normal: The same of normals.
        downscale: Of `demodulate`.

    Returns:
        float32 [n, 3].
    """
    radiance = np.empty_like(albedo)
    _find(pixels, albedo, normal, *known, irradiance, reduced_normal, 1.0 / downscale, radiance)
    return radiance


@ti.kernel
def _find(
    pixels: Ints1,
    albedo: Floats2,
    normal: Floats2,
    known: Floats3,
    share: Floats3,
    full_albedo: Floats3,
    full_normal: Floats3,
    irradiance: Floats3,
    reduced_normal: Floats3,
    scale: ti.f32,
    radiance: Floats2,
):
    """Kernel of `light_nearby`; scale: one over `downscale`."""
    height, width = known.shape[0], known.shape[1]
    for i in range(pixels.shape[0]):
        y, x = pixels[i] // width, pixels[i] % width
        n = read3(normal, i, 0)
        white = read3(albedo, i, 0)
        low_y, low_x = (y + 0.5) * scale - 0.5, (x + 0.5) * scale - 0.5
        sums = REDUCED * upsampled(irradiance, reduced_normal, low_y, low_x, n, white)
        total = REDUCED
        for down, right in ti.static(ti.ndrange((-1, 2), (-1, 2))):
            at_y, at_x = ti.math.clamp(y + down, 0, height - 1), ti.math.clamp(x + right, 0, width - 1)
            facing = read(full_normal, at_y, at_x)
            weight = BESIDE ** (down * down + right * right) * similarity(n, facing)
            light = read(known, at_y, at_x) / modulation(facing, read(full_albedo, at_y, at_x))
            sums += weight * light * modulation(n, white)
            total += weight * share[at_y, at_x, 0]
        for c in ti.static(range(3)):
            radiance[i, c] = sums[c] / total
