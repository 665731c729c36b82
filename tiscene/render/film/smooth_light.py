# SPDX-License-Identifier: Apache-2.0
"""Light of reduced size in a full-size image: it replaces what varies slowly, and adds what has changed.

Parts of an image that are denoised each by itself differ slightly in mean light, the more so the more noise there was,
which shows as a grid on plain walls. There irradiance of reduced size is as good, and it is denoised in the image as a
whole. Details that it cannot show are kept: what the image has and its own irradiance of reduced size has not. Where
light or surfaces differ between neighbors, or the two irradiances do, the image stays as it is.
"""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Bytes2, Float8s1, Floats3, float8, vec3
from tiscene.device.memory import device_array
from tiscene.device.vector_mode import vector_mode
from tiscene.render.film.upsample import modulation, read, similarity, spline

FloatImage = NDArray[np.float32]

DIFFERENCE = 0.3  # of the two irradiances, relative, up to which both are trusted; fades out to the double
NORMAL_RANGE = 0.3  # of a component of the normal in 3 x 3 pixels, above which there is an edge
DARKEST = 1e-3  # added to sums of red, green and blue, so that black is no contrast
NOISE = 3.0  # contrast up to which light varies slowly, in mean relative differences of noisy light from denoised
AROUND = 2  # px to each side over which that difference is averaged
DETAIL = 0.4  # relative difference of light from its surroundings that is a detail, in contrasts; half of it is none


def apply_reduced_light(
    image: FloatImage,
    own: FloatImage,
    irradiance: FloatImage,
    noisy: FloatImage,
    change: FloatImage,
    normal: FloatImage,
    guides: tuple[FloatImage, FloatImage],
    kept: NDArray[np.bool_],
    mask: FloatImage,
    downscale: int,
    contrast: float,
) -> None:
    """Replace an image's light where it varies slowly, then add a change, in place.

    Args:
        image: Input and output, radiance, float32 [h, w, 3].
        own: Its irradiance at reduced size, float32 [h', w', 3], see `demodulate`.
        irradiance: What takes its place, float32 [h', w', 3].
        noisy: The same, not denoised.
        change: Irradiance to add, float32 [h', w', 3]; where it is negative, the share of `irradiance` to take away.
        normal: Normals at reduced size, float32 [h', w', 3].
        guides: Albedo and normal, float32 [h, w, 3] each.
        kept: bool [h, w], pixels that stay as they are.
        mask: float32 [h, w, 1], factor of the change.
        downscale: Of `demodulate`.
        contrast: Of irradiance in 3 x 3 pixels, difference over sum of extremes, up to which light varies slowly; fades
            out to the double. Where there is much noise, it is larger.
    """
    rows = device_array(float8, 2 * own.shape[0] * own.shape[1])
    with vector_mode():
        _find_smooth(own, irradiance, noisy, change, normal, contrast, rows)
        _apply(image, rows, *own.shape[:2], *guides, kept.view(np.uint8), mask, 1.0 / downscale)


@ti.kernel
def _find_smooth(
    own: Floats3,
    irradiance: Floats3,
    noisy: Floats3,
    change: Floats3,
    normal: Floats3,
    contrast: ti.f32,
    rows: Float8s1,
):
    """Gather what `_apply` reads of each pixel of reduced size: two rows, so that it reads memory in one place.

    The first is own (3), irradiance (3), how smooth light is, 0..1, and the contrast up to which it is; the second is
    change (3), normal (3), 0, 0.
    """
    height, width = own.shape[0], own.shape[1]
    for y, x in ti.ndrange(height, width):
        low, high = 1e30, 0.0
        here, target = read(own, y, x), read(irradiance, y, x)
        added, facing = read(change, y, x), read(normal, y, x)
        least, most = facing, facing
        for row, column in ti.ndrange(3, 3):
            at_y = ti.math.clamp(y + row - 1, 0, height - 1)
            at_x = ti.math.clamp(x + column - 1, 0, width - 1)
            light, n = read(own, at_y, at_x).sum() + DARKEST, read(normal, at_y, at_x)
            low, high = ti.min(low, light), ti.max(high, light)
            least, most = ti.min(least, n), ti.max(most, n)
        noise, total = 0.0, 0.0
        for row, column in ti.ndrange((-AROUND, AROUND + 1), (-AROUND, AROUND + 1)):
            at_y = ti.math.clamp(y + row, 0, height - 1)
            at_x = ti.math.clamp(x + column, 0, width - 1)
            clean, raw = read(irradiance, at_y, at_x).sum(), read(noisy, at_y, at_x).sum()
            # Either of both may be off by more: where the denoiser has blurred an edge, or where a block has an error.
            noise += ti.min(ti.abs(raw - clean), ti.abs(raw - read(own, at_y, at_x).sum()))
            total += clean + DARKEST
        limit = ti.max(contrast, NOISE * noise / total)
        difference = ti.abs(target[0] - here[0]) + ti.abs(target[1] - here[1]) + ti.abs(target[2] - here[2])
        weight = ti.math.clamp(2.0 - (high - low) / (high + low) / limit, 0.0, 1.0)
        weight *= ti.math.clamp(2.0 - difference / (here.sum() + DARKEST) / DIFFERENCE, 0.0, 1.0)
        if (most - least).max() >= NORMAL_RANGE:
            weight = 0.0
        first = 2 * (y * width + x)
        rows[first] = float8(here[0], here[1], here[2], target[0], target[1], target[2], weight, limit)
        rows[first + 1] = float8(added[0], added[1], added[2], facing[0], facing[1], facing[2], 0.0, 0.0)


@ti.kernel
def _apply(
    image: Floats3,
    rows: Float8s1,
    height: ti.i32,
    width: ti.i32,
    full_albedo: Floats3,
    full_normal: Floats3,
    kept: Bytes2,
    mask: Floats3,
    scale: ti.f32,
):
    """Blend the image and the upsampled irradiance with the image's details, and add the upsampled change."""
    for y, x in ti.ndrange(image.shape[0], image.shape[1]):
        shown = read(image, y, x)
        if kept[y, x] == 0:
            low_y, low_x = (y + 0.5) * scale - 0.5, (x + 0.5) * scale - 0.5
            n = read(full_normal, y, x)
            center_y, center_x = ti.round(low_y, ti.i32), ti.round(low_x, ti.i32)
            weights_y, weights_x = spline(low_y - center_y), spline(low_x - center_x)
            lights, changes, total, blend = float8(0.0), float8(0.0), 0.0, 0.0
            for row, column in ti.static(ti.ndrange(3, 3)):
                near_y, near_x = low_y - (center_y + row - 1), low_x - (center_x + column - 1)
                at_y = ti.math.clamp(center_y + row - 1, 0, height - 1)
                at_x = ti.math.clamp(center_x + column - 1, 0, width - 1)
                first, second = rows[2 * (at_y * width + at_x)], rows[2 * (at_y * width + at_x) + 1]
                weight = weights_y[row] * weights_x[column] * similarity(n, vec3(second[3], second[4], second[5]))
                lights += weight * first
                changes += weight * second
                total += weight
                blend += ti.max(1.0 - ti.abs(near_y), 0.0) * ti.max(1.0 - ti.abs(near_x), 0.0) * first[6]
            light = modulation(n, read(full_albedo, y, x)) / total
            before = vec3(lights[0], lights[1], lights[2]) * light
            after = vec3(lights[3], lights[4], lights[5]) * light
            detail = DETAIL * lights[7] / total
            excess = shown / ti.max(before, 1e-6) - 1.0
            largest = ti.max(ti.abs(excess[0]), ti.abs(excess[1]), ti.abs(excess[2]))
            smooth = after * (1.0 + ti.math.smoothstep(0.5 * detail, detail, largest) * excess)
            shown += blend * (smooth - shown)
            if n.norm_sqr() > 0.0:  # else there is no surface that is lit
                added = light * vec3(changes[0], changes[1], changes[2])
                # A shadow takes a share of the light, so that what was dark beside an edge of light is not black.
                lost = ti.math.clamp(ti.min(added, 0.0) / ti.max(after, 1e-6), -1.0, 0.0)
                shown += mask[y, x, 0] * (ti.max(added, 0.0) + lost * shown)
        for c in ti.static(range(3)):
            image[y, x, c] = ti.max(shown[c], 0.0)
