"""The film: exposure, and the tone curve from scene-linear radiance to display sRGB.

The curve follows the design of AgX (T. Sobotka, "AgX", 2022): colours are first drawn towards grey a little (inset), so
that bright saturated light bleaches as on film instead of clipping to a primary; each channel then goes through a
sigmoid over stops around middle grey, and the inset is undone. Middle grey, 0.18, is shown as middle grey.
"""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

FLOATS = ti.types.ndarray(dtype=ti.f32, ndim=3)
BYTES = ti.types.ndarray(dtype=ti.u8, ndim=3)

MIDDLE_GREY = 0.18
DISPLAY_GAMMA = 2.2
# Stops below and above middle grey that the curve shows.
STOPS_BELOW, STOPS_ABOVE = 10.0, 6.5
# Slope at middle grey in the plane of (part of the stops, display value), and how sharply toe and shoulder bend.
SLOPE, BEND = 2.6, 1.5

# Rec.709 to the inset primaries, as AgX chooses them, each row scaled to keep white white.
_INSET = np.array([[0.8425, 0.0784, 0.0791], [0.0423, 0.8785, 0.0792], [0.0424, 0.0784, 0.8792]])
_INSET /= _INSET.sum(axis=1, keepdims=True)
_OUTSET = np.linalg.inv(_INSET)

_PIVOT = STOPS_BELOW / (STOPS_BELOW + STOPS_ABOVE)
_PIVOT_VALUE = MIDDLE_GREY ** (1.0 / DISPLAY_GAMMA)

_WEIGHTS = np.array([0.2126, 0.7152, 0.0722])


def _reach(run: float, rise: float) -> float:
    """The scale with which the sigmoid, leaving the pivot at SLOPE, has climbed `rise` after `run`."""
    return float(SLOPE * run / ((SLOPE * run / rise) ** BEND - 1.0) ** (1.0 / BEND))


_TOE = _reach(_PIVOT, _PIVOT_VALUE)
_SHOULDER = _reach(1.0 - _PIVOT, 1.0 - _PIVOT_VALUE)


def tone_map(hdr: NDArray[np.float32], exposure: float) -> NDArray[np.uint8]:
    """Display sRGB uint8 [h, w, 3] of scene-linear Rec.709 [h, w, 3]. exposure: stops, radiance times 2**exposure."""
    result = np.empty(hdr.shape, np.uint8)
    _tone_map(np.ascontiguousarray(hdr), float(2.0**exposure), result)
    return result


def meter(hdr: NDArray[np.float32]) -> float:
    """Stops that bring the picture's mean brightness to middle grey.

    The mean is over logarithms and leaves out the darkest and brightest twentieth, such as a lamp in the picture.
    """
    luminance = np.sort((hdr.astype(np.float64) @ _WEIGHTS).ravel())
    edge = len(luminance) // 20
    middle = luminance[edge : len(luminance) - edge]
    middle = middle[middle > 0.0]
    if not len(middle):
        return 0.0
    return float(np.log2(MIDDLE_GREY) - np.log2(middle).mean())


@ti.func
def _sigmoid(value: ti.f32) -> ti.f32:
    """Exposed inset radiance to a display value, 0..1."""
    stops = ti.log(ti.max(value, 1e-10) / MIDDLE_GREY) * (1.0 / 0.6931471805599453)
    x = ti.math.clamp((stops + STOPS_BELOW) / (STOPS_BELOW + STOPS_ABOVE), 0.0, 1.0) - _PIVOT
    scale = _SHOULDER
    if x < 0.0:
        scale = _TOE
    u = ti.abs(SLOPE * x / scale)
    y = scale * u / (1.0 + u**BEND) ** (1.0 / BEND)
    if x < 0.0:
        y = -y
    return _PIVOT_VALUE + y


@ti.kernel
def _tone_map(hdr: FLOATS, gain: ti.f32, result: BYTES):
    inset = ti.Matrix(_INSET.tolist())
    outset = ti.Matrix(_OUTSET.tolist())
    for y, x in ti.ndrange(hdr.shape[0], hdr.shape[1]):
        color = ti.max(ti.math.vec3(hdr[y, x, 0], hdr[y, x, 1], hdr[y, x, 2]) * gain, 0.0)
        color = inset @ color
        color = ti.math.vec3(_sigmoid(color.x), _sigmoid(color.y), _sigmoid(color.z))
        color = outset @ color
        for c in ti.static(range(3)):
            result[y, x, c] = ti.cast(ti.math.clamp(color[c], 0.0, 1.0) * 255.0 + 0.5, ti.u8)
