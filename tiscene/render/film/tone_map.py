# SPDX-License-Identifier: Apache-2.0
"""Tone mapping: scene-linear radiance to 8-bit sRGB by exposure and a filmic curve.

The curve is a sigmoid over stops of exposure, applied per channel to slightly desaturated RGB, similar to Sobotka's
AgX: bright saturated colors roll off to white instead of clipping to a primary. Middle gray (0.18) is preserved; black
is 10 stops below it, white 6.5 stops above.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Bytes3, Floats1, Floats3, Template, vec3
from tiscene.scene.color import LUMINANCE, decode_srgb, encode_srgb

GRAY = 0.18
BLACK_STOPS, WHITE_STOPS = -10.0, 6.5  # relative to gray
CONTRAST = 0.165  # slope of the encoded value per stop at gray; 0.145 without a curve
PIVOT = GRAY ** (1.0 / 2.2)
# Fraction of each channel that is spread over all three before the curve, and removed after it.
INSET, OUTSET = 0.16, 0.13


def _amplitude(stops: float, height: float) -> float:
    """Return a of the half-sigmoid a x / sqrt(1 + x^2), x = CONTRAST stops / a, that reaches `height` at `stops`."""
    rise = CONTRAST * stops
    return rise / math.sqrt((rise / height) ** 2 - 1.0)


TOE = _amplitude(-BLACK_STOPS, PIVOT)
SHOULDER = _amplitude(WHITE_STOPS, 1.0 - PIVOT)


def curve(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return encoded display values (gamma 2.2) of linear scene values."""
    stops = np.clip(np.log2(values / GRAY), BLACK_STOPS, WHITE_STOPS)
    amplitude = np.where(stops > 0.0, SHOULDER, TOE)
    x = stops * CONTRAST / amplitude
    encoded: NDArray[np.float64] = PIVOT + amplitude * x / np.sqrt(1.0 + x * x)
    return encoded


# Powers and logarithms are tables with 2^STEPS_LOG2 values per octave, linearly interpolated. The error of an 8-bit
# code, rounding included, is at most 0.5025.
STEPS_LOG2 = 7
SCENE_FROM, SCENE_TO = -13, 5  # exponents of 2 of the curve's domain
DISPLAY_FROM, DISPLAY_TO = -9, 1  # below, sRGB is linear


def _table(function: Callable[[NDArray[np.float64]], NDArray[np.float64]], first: int, end: int) -> NDArray[np.float32]:
    steps = 1 << STEPS_LOG2
    number = np.arange((end - first) * steps + 1)
    return function((1.0 + number % steps / steps) * 2.0 ** (first + number // steps)).astype(np.float32)


DISPLAY_OF_SCENE = _table(lambda values: np.maximum(curve(values), 0.0) ** 2.2, SCENE_FROM, SCENE_TO)
CODE_OF_DISPLAY = _table(lambda values: 255.0 * encode_srgb(values), DISPLAY_FROM, DISPLAY_TO)


@ti.func
def interpolate(table: Template, first: Template, value: ti.f32) -> ti.f32:
    """Interpolate in a table that begins at 2 ** first. A float's bits are the position: exponent, then fraction."""
    below = 23 - STEPS_LOG2
    bits = ti.bit_cast(value, ti.i32) - ((127 + first) << 23)
    row = bits >> below
    part = ti.cast(bits & ((1 << below) - 1), ti.f32) * (1.0 / (1 << below))
    return table[row] + part * (table[row + 1] - table[row])


@ti.kernel
def _tone_map(
    hdr: Floats3,
    gain: ti.f32,
    display_of_scene: Floats1,
    code_of_display: Floats1,
    rgb: Bytes3,
):
    for y, x in ti.ndrange(hdr.shape[0], hdr.shape[1]):
        scene = vec3(0.0)
        for c in ti.static(range(3)):
            value = hdr[y, x, c]
            if value > 0.0:  # false for nan
                scene[c] = ti.min(value * gain, 1e30)
        scene = scene * (1.0 - INSET) + scene.sum() * (INSET / 3.0)
        display = vec3(0.0)
        for c in ti.static(range(3)):
            clamped = ti.math.clamp(scene[c], 2.0**SCENE_FROM, 0.99 * 2.0**SCENE_TO)
            display[c] = interpolate(display_of_scene, SCENE_FROM, clamped)
        # The inverse of an inset by OUTSET.
        display = (display - display.sum() * (OUTSET / 3.0)) * (1.0 / (1.0 - OUTSET))
        for c in ti.static(range(3)):
            displayed = ti.min(display[c], 1.0)
            code = 255.0 * 12.92 * ti.max(displayed, 0.0)
            if displayed > 2.0**DISPLAY_FROM:
                code = interpolate(code_of_display, DISPLAY_FROM, displayed)
            rgb[y, x, c] = ti.cast(code + 0.5, ti.u8)


def tone_map(hdr: NDArray[np.float32], exposure: float = 0.0) -> NDArray[np.uint8]:
    """Tone-map radiance.

    Args:
        hdr: float32 [h, w, 3], linear Rec.709.
        exposure: Stops; radiance is multiplied by 2**exposure.

    Returns:
        uint8 [h, w, 3], sRGB.
    """
    rgb = np.empty(hdr.shape, np.uint8)
    tables = DISPLAY_OF_SCENE, CODE_OF_DISPLAY
    _tone_map(np.ascontiguousarray(hdr, np.float32), float(2.0**exposure), *tables, rgb)
    return rgb


def radiance_shown_as(color: tuple[int, int, int], exposure: float) -> tuple[float, float, float]:
    """Return radiance that `tone_map` maps to an 8-bit color, or near it if the color is outside its gamut."""
    display = decode_srgb(np.asarray(color, np.float64) / 255.0)
    curved = display * (1.0 - OUTSET) + display.sum() * (OUTSET / 3.0)
    above = curved ** (1.0 / 2.2) - PIVOT
    amplitude = np.where(above > 0.0, SHOULDER, TOE)
    ratio = np.clip(above / amplitude, -0.999999, 0.999999)
    stops = ratio / np.sqrt(1.0 - ratio * ratio) * amplitude / CONTRAST
    inset = GRAY * np.exp2(np.clip(stops, BLACK_STOPS, WHITE_STOPS))
    scene = (inset - inset.sum() * (INSET / 3.0)) / (1.0 - INSET)
    r, g, b = (np.maximum(scene, 0.0) * 2.0**-exposure).tolist()
    return (r, g, b)


def auto_exposure(hdr: NDArray[Any]) -> float:
    """Return the automatic exposure of an image in stops: its geometric mean becomes middle gray.

    Luminance is clipped to its 5th and 95th percentiles; black pixels (background) are ignored. If the 95th percentile
    would be more than 5 stops above gray, almost white, it is exposed for that percentile instead. 0 for a black image.
    """
    luminance = np.asarray(hdr, np.float64) @ LUMINANCE
    luminance = luminance[np.isfinite(luminance) & (luminance > 0.0)]
    if luminance.size == 0:
        return 0.0
    stops = np.log2(luminance / GRAY)
    low, high = np.percentile(stops, (5.0, 95.0))
    exposure = -float(np.mean(np.clip(stops, low, high)))
    return float(min(exposure, 5.0 - high))
