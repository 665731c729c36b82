# SPDX-License-Identifier: Apache-2.0
"""From scene-linear radiance to a picture for the screen: exposure, a filmic tone curve, sRGB.

The curve is a sigmoid over stops of exposure, applied to each channel of a slightly less saturated RGB, in the manner
of Sobotka's AgX: bright saturated colors roll off towards white instead of turning into the nearest primary. Middle
gray (0.18) stays itself; black is 10 stops below it and white 6.5 above.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Bytes3, Floats1, Floats3, Template, vec3
from tiscene.scene.color import decode_srgb, encode_srgb

LUMINANCE = (0.2126, 0.7152, 0.0722)

GREY = 0.18
DARKEST, BRIGHTEST = -10.0, 6.5  # stops about gray
CONTRAST = 0.165  # of the encoded value per stop, at gray; an sRGB screen without any curve has 0.145
PIVOT = GREY ** (1.0 / 2.2)
# How much of each channel is spread over all three before the curve, and taken back after it.
INSET, OUTSET = 0.16, 0.13


def _amplitude(stops: float, height: float) -> float:
    """Of the half-sigmoid a x / sqrt(1 + x^2), x = CONTRAST stops / a, that reaches `height` at `stops`."""
    rise = CONTRAST * stops
    return rise / math.sqrt((rise / height) ** 2 - 1.0)


TOE = _amplitude(-DARKEST, PIVOT)
SHOULDER = _amplitude(BRIGHTEST, 1.0 - PIVOT)


def curve(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Encoded display values (gamma 2.2) of linear scene values."""
    stops = np.clip(np.log2(values / GREY), DARKEST, BRIGHTEST)
    amplitude = np.where(stops > 0.0, SHOULDER, TOE)
    x = stops * CONTRAST / amplitude
    encoded: NDArray[np.float64] = PIVOT + amplitude * x / np.sqrt(1.0 + x * x)
    return encoded


# Powers and logarithms are tables here, with so many values between a power of 2 and the next and straight lines from
# one to the next: no code of 8 bits is wrong by more than 0.5025.
STEPS_LOG2 = 7
SCENE_FROM, SCENE_TO = -13, 5  # powers of 2 around what the curve tells apart
DISPLAY_FROM, DISPLAY_TO = -9, 1  # below, sRGB is linear


def _table(function: Callable[[NDArray[np.float64]], NDArray[np.float64]], first: int, end: int) -> NDArray[np.float32]:
    steps = 1 << STEPS_LOG2
    number = np.arange((end - first) * steps + 1)
    return function((1.0 + number % steps / steps) * 2.0 ** (first + number // steps)).astype(np.float32)


DISPLAY_OF_SCENE = _table(lambda values: np.maximum(curve(values), 0.0) ** 2.2, SCENE_FROM, SCENE_TO)
CODE_OF_DISPLAY = _table(lambda values: 255.0 * encode_srgb(values), DISPLAY_FROM, DISPLAY_TO)


@ti.func
def looked_up(table: Template, first: Template, value: ti.f32) -> ti.f32:
    """Between the values of a table that begins at 2 ** first. A float's bits count the steps: exponent, then part."""
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
            told_apart = ti.math.clamp(scene[c], 2.0**SCENE_FROM, 0.99 * 2.0**SCENE_TO)
            display[c] = looked_up(display_of_scene, SCENE_FROM, told_apart)
        # The inverse of an inset by OUTSET.
        display = (display - display.sum() * (OUTSET / 3.0)) * (1.0 / (1.0 - OUTSET))
        for c in ti.static(range(3)):
            shown = ti.min(display[c], 1.0)
            code = 255.0 * 12.92 * ti.max(shown, 0.0)
            if shown > 2.0**DISPLAY_FROM:
                code = looked_up(code_of_display, DISPLAY_FROM, shown)
            rgb[y, x, c] = ti.cast(code + 0.5, ti.u8)


def tone_map(hdr: NDArray[np.float32], exposure: float = 0.0) -> NDArray[np.uint8]:
    """uint8 [h, w, 3], sRGB, of float32 radiance [h, w, 3]. exposure: stops; radiance is multiplied by 2**exposure."""
    rgb = np.empty(hdr.shape, np.uint8)
    tables = DISPLAY_OF_SCENE, CODE_OF_DISPLAY
    _tone_map(np.ascontiguousarray(hdr, np.float32), float(2.0**exposure), *tables, rgb)
    return rgb


def radiance_shown_as(color: tuple[int, int, int], exposure: float) -> tuple[float, float, float]:
    """What `tone_map` shows as an 8-bit color; of those that it cannot show, what comes near."""
    display = decode_srgb(np.asarray(color, np.float64) / 255.0)
    curved = display * (1.0 - OUTSET) + display.sum() * (OUTSET / 3.0)
    above = curved ** (1.0 / 2.2) - PIVOT
    amplitude = np.where(above > 0.0, SHOULDER, TOE)
    ratio = np.clip(above / amplitude, -0.999999, 0.999999)
    stops = ratio / np.sqrt(1.0 - ratio * ratio) * amplitude / CONTRAST
    inset = GREY * np.exp2(np.clip(stops, DARKEST, BRIGHTEST))
    scene = (inset - inset.sum() * (INSET / 3.0)) / (1.0 - INSET)
    r, g, b = (np.maximum(scene, 0.0) * 2.0**-exposure).tolist()
    return (r, g, b)


def meter(hdr: NDArray[Any]) -> float:
    """The exposure in stops that shows an image well: its geometric mean becomes middle gray.

    The darkest and the brightest twentieth count as what lies next to them, and what is black (there is nothing) not at
    all. Where more than a twentieth would then be almost white (5 stops above gray), it is exposed for that instead.
    0 for a black image.
    """
    luminance = np.asarray(hdr, np.float64) @ np.array(LUMINANCE)
    luminance = luminance[np.isfinite(luminance) & (luminance > 0.0)]
    if luminance.size == 0:
        return 0.0
    stops = np.log2(luminance / GREY)
    low, high = np.percentile(stops, (5.0, 95.0))
    exposure = -float(np.mean(np.clip(stops, low, high)))
    return float(min(exposure, 5.0 - high))
