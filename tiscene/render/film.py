"""From scene-linear radiance to a picture for the screen: exposure, a filmic tone curve, sRGB.

The curve is a sigmoid over stops of exposure, applied to each channel of a slightly less saturated RGB, in the manner
of Sobotka's AgX: bright saturated colours roll off towards white instead of turning into the nearest primary. Middle
grey (0.18) stays itself; black is 10 stops below it and white 6.5 above.
"""

import math
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

vec3 = ti.math.vec3
LUMINANCE = (0.2126, 0.7152, 0.0722)

GREY = 0.18
DARKEST, BRIGHTEST = -10.0, 6.5  # stops about grey
CONTRAST = 0.165  # of the encoded value per stop, at grey; an sRGB screen without any curve has 0.145
PIVOT = GREY ** (1.0 / 2.2)
STOPS_PER_E = 1.0 / math.log(2.0)
# How much of each channel is spread over all three before the curve, and taken back after it.
INSET, OUTSET = 0.16, 0.13


def _amplitude(stops: float, height: float) -> float:
    """Of the half-sigmoid a x / sqrt(1 + x^2), x = CONTRAST stops / a, that reaches `height` at `stops`."""
    rise = CONTRAST * stops
    return rise / math.sqrt((rise / height) ** 2 - 1.0)


TOE = _amplitude(-DARKEST, PIVOT)
SHOULDER = _amplitude(BRIGHTEST, 1.0 - PIVOT)


@ti.func
def curve(value: ti.f32) -> ti.f32:
    """Encoded display value (gamma 2.2) of a linear scene value."""
    stops = ti.math.clamp(ti.log(ti.max(value, 1e-9) / GREY) * STOPS_PER_E, DARKEST, BRIGHTEST)
    amplitude = SHOULDER if stops > 0.0 else TOE
    x = stops * (CONTRAST / amplitude)
    return PIVOT + amplitude * x / ti.sqrt(1.0 + x * x)


@ti.func
def srgb_encoded(value: ti.f32) -> ti.f32:
    """IEC 61966-2-1 of a linear value in 0..1."""
    result = 12.92 * value
    if value > 0.0031308:
        result = 1.055 * value ** (1.0 / 2.4) - 0.055
    return result


@ti.kernel
def _tone_map(
    hdr: ti.types.ndarray(dtype=ti.f32, ndim=3),
    gain: ti.f32,
    rgb: ti.types.ndarray(dtype=ti.u8, ndim=3),
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
            display[c] = ti.max(curve(scene[c]), 0.0) ** 2.2
        # The inverse of an inset by OUTSET.
        display = (display - display.sum() * (OUTSET / 3.0)) * (1.0 / (1.0 - OUTSET))
        for c in ti.static(range(3)):
            rgb[y, x, c] = ti.cast(srgb_encoded(ti.math.clamp(display[c], 0.0, 1.0)) * 255.0 + 0.5, ti.u8)


def tone_map(hdr: NDArray[np.float32], exposure: float = 0.0) -> NDArray[np.uint8]:
    """uint8 [h, w, 3], sRGB, of float32 radiance [h, w, 3]. exposure: stops; radiance is multiplied by 2**exposure."""
    rgb = np.empty(hdr.shape, np.uint8)
    _tone_map(np.ascontiguousarray(hdr, np.float32), float(2.0**exposure), rgb)
    return rgb


def radiance_shown_as(color: tuple[int, int, int], exposure: float) -> tuple[float, float, float]:
    """What `tone_map` shows as an 8-bit colour; of those that it cannot show, what comes near."""
    encoded = np.asarray(color, np.float64) / 255.0
    display = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
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
    """The exposure in stops that shows an image well: its geometric mean becomes middle grey.

    The darkest and the brightest twentieth count as what lies next to them, and what is black (there is nothing) not at
    all. Where more than a twentieth would then be almost white (5 stops above grey), it is exposed for that instead.
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
