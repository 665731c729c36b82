# SPDX-License-Identifier: Apache-2.0
"""MaterialX's standard operations on values, after the MaterialX specification 1.39.

`OPERATIONS` maps a node category to its inputs, with their defaults, and its function of arrays [..., c].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
LUMINANCE = (0.2722287, 0.6740818, 0.0536895)  # default lumacoeffs of the specification (ACEScg)

_POWERS = np.arange(3.0, -1.0, -1.0)
_CHROMATICITY = np.array(
    [  # coefficients of the powers of 1000 K over the temperature, which give x; of x, which give y
        (-0.2661239, -0.2343580, 0.8776956, 0.179910),
        (-3.0258469, 2.1070379, 0.2226347, 0.240390),
        (-1.1063814, -1.34811020, 2.18555832, -0.20219683),
        (-0.9549476, -1.37418593, 2.09137015, -0.16748867),
        (3.0817580, -5.87338670, 3.75112997, -0.37001483),
    ]
)
_XYZ_TO_REC709 = np.array([(3.2406, -0.9689, 0.0557), (-1.5372, 1.8758, -0.2040), (-0.4986, 0.0415, 1.0570)])

Operation = tuple[Sequence[tuple[str, Any]], Callable[..., Array]]


def _remainder(values: Array, period: float) -> Array:
    """Return `values % period`, the same bits several times as fast for what is at most a few periods off."""
    if not (values.min(initial=0.0) >= -period and values.max(initial=0.0) < 3.0 * period):
        return np.asarray(values % period)
    shifts = np.where(
        values < 0.0, period, np.where(values < period, 0.0, np.where(values < 2.0 * period, -period, -2.0 * period))
    )
    return np.asarray(values + shifts.astype(values.dtype))


def rgb_to_hsv(rgb: Array) -> Array:
    """Return hue (0..1), saturation and value of colors [..., 3]."""
    r, g, b = (rgb[..., each] for each in range(3))
    value, low = np.maximum(np.maximum(r, g), b), np.minimum(np.minimum(r, g), b)
    span = value - low
    safe = np.where(span > 0.0, span, 1.0)
    hue = np.where(value == r, (g - b) / safe, np.where(value == g, 2.0 + (b - r) / safe, 4.0 + (r - g) / safe))
    hue = np.where(span > 0.0, _remainder(hue / 6.0, 1.0), 0.0)
    return np.stack([hue, np.where(value > 0.0, span / np.where(value > 0.0, value, 1.0), 0.0), value], axis=-1)


def hsv_to_rgb(hsv: Array) -> Array:
    """Return the colors [..., 3] of hue (0..1), saturation and value."""
    hue, saturation, value = (hsv[..., each] for each in range(3))
    steps = _remainder(np.stack([hue * 6.0 + 5.0, hue * 6.0 + 3.0, hue * 6.0 + 1.0], axis=-1), 6.0)
    weight = np.clip(np.minimum(steps, 4.0 - steps), 0.0, 1.0)
    return np.asarray(value[..., None] * (1.0 - saturation[..., None] * weight))


def luminance(color: Array, coefficients: Array) -> Array:
    """Return the luminance of colors [..., 3], in all their channels."""
    return np.broadcast_to((color * coefficients).sum(axis=-1, keepdims=True), color.shape)


def saturate(color: Array, amount: Array, coefficients: Array) -> Array:
    """Return colors with their saturation multiplied by an amount."""
    gray = luminance(color, coefficients)
    return np.asarray(gray + (color - gray) * amount)


def hsv_adjust(color: Array, amount: Array) -> Array:
    """Return colors with a hue offset, and factors of saturation and value."""
    hsv = rgb_to_hsv(color)
    shape = np.broadcast_shapes(hsv.shape, amount.shape)
    hsv, amount = np.broadcast_to(hsv, shape), np.broadcast_to(amount, shape)
    changed = [hsv[..., 0] + amount[..., 0], hsv[..., 1] * amount[..., 1], hsv[..., 2] * amount[..., 2]]
    return hsv_to_rgb(np.stack(changed, axis=-1))


def remap(value: Array, inlow: Array, inhigh: Array, outlow: Array, outhigh: Array) -> Array:
    """Return values of one range mapped to another."""
    return np.asarray(outlow + (value - inlow) * (outhigh - outlow) / np.where(inhigh == inlow, 1.0, inhigh - inlow))


def ranged(
    value: Array, inlow: Array, inhigh: Array, gamma: Array, outlow: Array, outhigh: Array, clamp: Array
) -> Array:
    """Return values of one range mapped to another, with a gamma and, if asked for, clamped."""
    unit = (value - inlow) / np.where(inhigh == inlow, 1.0, inhigh - inlow)
    curved = np.sign(unit) * np.abs(unit) ** (1.0 / np.where(gamma == 0.0, 1.0, gamma))
    result = outlow + curved * (outhigh - outlow)
    return np.asarray(np.where(clamp > 0.5, np.clip(result, outlow, outhigh), result))


def smoothstep(value: Array, low: Array, high: Array) -> Array:
    """Return the smooth transition from 0 at `low` to 1 at `high`, a step at `high` where that is not above `low`."""
    unit = np.clip((value - low) / np.where(high > low, high - low, 1.0), 0.0, 1.0)
    return np.asarray(np.where(high > low, unit * unit * (3.0 - 2.0 * unit), value >= high))


def color_correct(
    color: Array,
    hue: Array,
    saturation: Array,
    gamma: Array,
    lift: Array,
    gain: Array,
    contrast: Array,
    pivot: Array,
    exposure: Array,
) -> Array:
    """Return colors after hue, saturation, gamma, lift, gain, contrast and exposure, in this order."""
    turn = np.concatenate([hue, np.ones((*hue.shape[:-1], 2))], axis=-1)
    changed = saturate(hsv_adjust(color, turn), saturation, np.asarray(LUMINANCE))
    changed = np.sign(changed) * np.abs(changed) ** (1.0 / np.where(gamma == 0.0, 1.0, gamma))
    changed = (changed * (1.0 - lift) + lift) * gain
    return np.asarray(((changed - pivot) * contrast + pivot) * 2.0**exposure)


def _chosen(test: Callable[[Array, Array], Array], yes: float = 0.0) -> Operation:
    inputs = (("value1", 0.0 if test is np.equal else 1.0), ("value2", 0.0), ("in1", yes), ("in2", 0.0))
    return inputs, lambda a, b, yes, no: np.asarray(np.where(test(a, b), yes, no))


def _pair(function: Callable[[Array, Array], Array], first: float, second: float) -> Operation:
    return (("in1", first), ("in2", second)), function


def _blend(function: Callable[[Array, Array, Array], Array]) -> Operation:
    return (("bg", 0.0), ("fg", 0.0), ("mix", 1.0)), function


def _logic(function: Callable[[Array, Array], Array]) -> Operation:
    return (("in1", 0.0), ("in2", 0.0)), lambda a, b: np.where(function(a > 0.5, b > 0.5), 1.0, 0.0)


def _of_color(function: Callable[..., Array]) -> Callable[..., Array]:
    """Return a function of colors [..., 3] as one of colors that may have an alpha, which stays."""

    def applied(color: Array, *others: Array) -> Array:
        result = function(color[..., :3], *(each[..., :3] for each in others))
        if color.shape[-1] < 4:
            return result
        return np.concatenate([result, np.broadcast_to(color[..., 3:], (*result.shape[:-1], 1))], axis=-1)

    return applied


def _composite(function: Callable[[Array, Array], Array]) -> Operation:
    return _blend(lambda below, above, mix: below + (function(below, above) - below) * mix)


def _matte(below: Array, above: Array) -> Array:
    cover = above[..., 3:]
    return np.concatenate([above[..., :3] * cover, cover], axis=-1) + below * (1.0 - cover)


def _single(function: Callable[[Array], Array]) -> Operation:
    return (("in", 0.0),), function


# Of ramps and splits along u and along v.
_ENDS = ((("valuel", 0.0), ("valuer", 0.0)), (("valueb", 0.0), ("valuet", 0.0)))


def _ramp(axis: int) -> Operation:
    def ramp(low: Array, high: Array, at: Array) -> Array:
        return np.asarray(low + (high - low) * np.clip(at[..., axis : axis + 1], 0.0, 1.0))

    return (*_ENDS[axis], ("texcoord", None)), ramp


def _split(axis: int) -> Operation:
    def split(low: Array, high: Array, center: Array, at: Array) -> Array:
        return np.where(at[..., axis : axis + 1] >= center, high, low)

    return (*_ENDS[axis], ("center", 0.5), ("texcoord", None)), split


def _checkerboard(first: Array, second: Array, tiling: Array, offset: Array, at: Array) -> Array:
    place = np.floor(at[..., :2] * tiling[..., :2] - offset[..., :2])  # which have more components beside colors
    return np.where(place.sum(axis=-1, keepdims=True) % 2.0 < 0.5, second, first)


def _ramp4(top_left: Array, top_right: Array, bottom_left: Array, bottom_right: Array, at: Array) -> Array:
    u, v = np.clip(at[..., :1], 0.0, 1.0), np.clip(at[..., 1:2], 0.0, 1.0)
    top, bottom = top_left + (top_right - top_left) * u, bottom_left + (bottom_right - bottom_left) * u
    return np.asarray(bottom + (top - bottom) * v)


_STOPS = ((0.0, 0.0, 0.0, 1.0), *((1.0, 1.0, 1.0, 1.0),) * 9)  # default colors of a ramp


def _gradient(
    x: Array, low: Array, high: Array, first: Array, last: Array, kind: Array, before: Array, row: Array, count: Array
) -> Array:
    """Return one interval of a ramp: linear, smooth or a step, above its start; `before` is the color below it."""
    linear = (np.clip(x, low, high) - low) / np.where(high == low, 1.0, high - low)
    mixed = first + (last - first) * np.where(kind > 0.5, smoothstep(x, low, high), linear)
    color = np.where(kind > 1.5, np.where(high > x, first, last), mixed)
    return np.where((x > low) & (row < count), color, before)


def _ramp_of_colors(at: Array, shape: Array, kind: Array, count: Array, *stops: Array) -> Array:
    """Return a ramp of colors along u, around the middle, or by the distance from it: in a circle or a box."""
    centered = at - 0.5
    angle = np.arctan2(centered[..., :1], centered[..., 1:2]) / (2.0 * np.pi) + 0.5
    distances = 1.414 * np.linalg.norm(centered, axis=-1, keepdims=True), 2.0 * np.abs(centered).max(-1, keepdims=True)
    x = np.select([shape < 0.5, shape < 1.5, shape < 2.5], [at[..., :1], angle, distances[0]], distances[1])
    places, colors = stops[: len(_STOPS)], stops[len(_STOPS) :]
    result = colors[0]
    for row in range(1, len(_STOPS)):
        ends = places[row - 1], places[row]
        result = _gradient(x, *ends, colors[row - 1], colors[row], kind, result, np.array([row]), count)
    return result


def blackbody(kelvin: Array) -> Array:
    """Return the linear Rec. 709 color [..., 3], of luminance 1, of a black body of 800 to 25,000 kelvins.

    The chromaticity is by the cubic approximations of Kang et al. 2002.
    """
    kelvin = np.clip(kelvin, 800.0, 25000.0)
    rows = (
        np.where(kelvin < 4000.0, _CHROMATICITY[0], _CHROMATICITY[1]),
        np.where(kelvin < 2222.0, _CHROMATICITY[2], np.where(kelvin < 4000.0, _CHROMATICITY[3], _CHROMATICITY[4])),
    )
    x = (rows[0] * (1000.0 / kelvin) ** _POWERS).sum(axis=-1, keepdims=True)
    y = (rows[1] * x**_POWERS).sum(axis=-1, keepdims=True)
    color = np.concatenate([x / y, np.ones_like(x), (1.0 - x - y) / y], axis=-1) @ _XYZ_TO_REC709
    return np.asarray(np.maximum(color, 0.0))


def rotate3d(vector: Array, degrees: Array, axis: Array) -> Array:
    """Return vectors [..., 3] turned clockwise about an axis."""
    axis = axis / np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-12)
    turn = np.radians(degrees)
    along = axis * (axis * vector).sum(axis=-1, keepdims=True)
    return np.asarray(vector * np.cos(turn) + np.cross(vector, axis) * np.sin(turn) + along * (1.0 - np.cos(turn)))


def _circle(at: Array, center: Array, radius: Array) -> Array:
    return np.where(((at - center) ** 2).sum(axis=-1, keepdims=True) > radius**2, 0.0, 1.0)


def _overlay(below: Array, above: Array, mix: Array) -> Array:
    both = np.where(below >= 0.5, 1.0 - 2.0 * (1.0 - below) * (1.0 - above), 2.0 * below * above)
    return np.asarray(below + (both - below) * mix)


def _burn(below: Array, above: Array, mix: Array) -> Array:
    burnt = 1.0 - (1.0 - below) / np.where(above == 0.0, 1.0, above)
    return np.asarray(np.where(above == 0.0, 0.0, below + (burnt - below) * mix))


def _dodge(below: Array, above: Array, mix: Array) -> Array:
    lit = below / np.where(above == 1.0, 1.0, 1.0 - above)
    return np.asarray(np.where(above == 1.0, 0.0, below + (lit - below) * mix))


_LOGIC = {
    "and": _logic(np.logical_and),
    "or": _logic(np.logical_or),
    "xor": _logic(np.logical_xor),
    "not": _single(lambda a: np.where(a > 0.5, 0.0, 1.0)),
}
_TESTS = {"ifgreater": np.greater, "ifgreatereq": np.greater_equal, "ifequal": np.equal}

OPERATIONS: dict[str, Operation] = {
    "multiply": _pair(lambda a, b: a * b, 0.0, 1.0),
    "divide": _pair(lambda a, b: a / np.where(b == 0.0, 1.0, b), 0.0, 1.0),
    "add": _pair(lambda a, b: a + b, 0.0, 0.0),
    "subtract": _pair(lambda a, b: a - b, 0.0, 0.0),
    "modulo": _pair(lambda a, b: a - b * np.floor(a / np.where(b == 0.0, 1.0, b)), 0.0, 1.0),
    "power": _pair(lambda a, b: np.sign(a) * np.abs(a) ** b, 0.0, 1.0),
    "safepower": _pair(lambda a, b: np.sign(a) * np.abs(a) ** b, 0.0, 1.0),
    "min": _pair(np.minimum, 0.0, 0.0),
    "max": _pair(np.maximum, 0.0, 0.0),
    "dotproduct": _pair(lambda a, b: (a * b).sum(axis=-1, keepdims=True), 0.0, 0.0),
    "invert": ((("in", 0.0), ("amount", 1.0)), lambda a, b: b - a),
    "absval": _single(np.abs),
    "sign": _single(np.sign),
    "floor": _single(np.floor),
    "ceil": _single(np.ceil),
    "round": _single(np.round),
    "sin": _single(np.sin),
    "cos": _single(np.cos),
    "tan": _single(np.tan),
    "asin": _single(lambda a: np.arcsin(np.clip(a, -1.0, 1.0))),
    "acos": _single(lambda a: np.arccos(np.clip(a, -1.0, 1.0))),
    "atan2": ((("iny", 0.0), ("inx", 1.0)), np.arctan2),
    "fract": _single(lambda a: a - np.floor(a)),
    "trianglewave": _single(lambda a: 0.5 - np.abs(np.abs(a) % 1.0 - 0.5)),
    "rotate3d": ((("in", 0.0), ("amount", 0.0), ("axis", (0.0, 1.0, 0.0))), rotate3d),
    "crossproduct": _pair(lambda a, b: np.cross(a[..., :3], b[..., :3]), 0.0, 0.0),
    "distance": _pair(lambda a, b: np.linalg.norm(a - b, axis=-1, keepdims=True), 0.0, 0.0),
    **{f"{prefix}{name}": operation for name, operation in _LOGIC.items() for prefix in ("", "logical_")},
    "inside": ((("in", 0.0), ("mask", 1.0)), lambda a, mask: a * mask),
    "outside": ((("in", 0.0), ("mask", 0.0)), lambda a, mask: a * (1.0 - mask)),
    "premult": _single(lambda a: np.concatenate([a[..., :3] * a[..., 3:], a[..., 3:]], axis=-1)),
    "unpremult": _single(
        lambda a: np.concatenate([a[..., :3] / np.where(a[..., 3:] == 0.0, 1.0, a[..., 3:]), a[..., 3:]], axis=-1)
    ),
    "sqrt": _single(lambda a: np.sqrt(np.maximum(a, 0.0))),
    "ln": _single(lambda a: np.log(np.maximum(a, 1e-12))),
    "exp": _single(np.exp),
    "magnitude": _single(lambda a: np.linalg.norm(a, axis=-1, keepdims=True)),
    "normalize": _single(lambda a: a / np.maximum(np.linalg.norm(a, axis=-1, keepdims=True), 1e-12)),
    "rgbtohsv": _single(_of_color(rgb_to_hsv)),
    "hsvtorgb": _single(_of_color(hsv_to_rgb)),
    "clamp": ((("in", 0.0), ("low", 0.0), ("high", 1.0)), np.clip),
    "mix": ((("bg", 0.0), ("fg", 0.0), ("mix", 0.0)), lambda a, b, mix: a + (b - a) * mix),
    "remap": ((("in", 0.0), ("inlow", 0.0), ("inhigh", 1.0), ("outlow", 0.0), ("outhigh", 1.0)), remap),
    "range": (
        (
            *(("in", 0.0), ("inlow", 0.0), ("inhigh", 1.0), ("gamma", 1.0)),
            *(("outlow", 0.0), ("outhigh", 1.0), ("doclamp", 0.0)),
        ),
        ranged,
    ),
    "smoothstep": ((("in", 0.0), ("low", 0.0), ("high", 1.0)), smoothstep),
    "contrast": ((("in", 0.0), ("amount", 1.0), ("pivot", 0.5)), lambda a, amount, pivot: (a - pivot) * amount + pivot),
    "luminance": ((("in", 0.0), ("lumacoeffs", LUMINANCE)), _of_color(luminance)),
    "saturate": ((("in", 0.0), ("amount", 1.0), ("lumacoeffs", LUMINANCE)), _of_color(saturate)),
    "hsvadjust": ((("in", 0.0), ("amount", (0.0, 1.0, 1.0))), _of_color(hsv_adjust)),
    "colorcorrect": (
        (
            ("in", 1.0),
            *(("hue", 0.0), ("saturation", 1.0), ("gamma", 1.0), ("lift", 0.0), ("gain", 1.0)),
            *(("contrast", 1.0), ("contrastpivot", 0.5), ("exposure", 0.0)),
        ),
        _of_color(color_correct),
    ),
    "plus": _blend(lambda a, b, mix: a + b * mix),
    "minus": _blend(lambda a, b, mix: a - b * mix),
    "screen": _blend(lambda a, b, mix: a + (b - a * b) * mix),
    "over": _composite(lambda below, above: above + below * (1.0 - above[..., 3:])),
    "in": _composite(lambda below, above: above * below[..., 3:]),
    "out": _composite(lambda below, above: above * (1.0 - below[..., 3:])),
    "mask": _composite(lambda below, above: below * above[..., 3:]),
    "matte": _composite(_matte),
    "difference": _blend(lambda a, b, mix: a + (np.abs(a - b) - a) * mix),
    "overlay": _blend(_overlay),
    "burn": _blend(_burn),
    "dodge": _blend(_dodge),
    **{name: _chosen(test) for name, test in _TESTS.items()},
    # Those of boolean outputs have no values to choose from.
    **{f"{name}_boolean{kind}": _chosen(test, 1.0) for name, test in _TESTS.items() for kind in ("", "I", "B")},
    "ramplr": _ramp(0),
    "ramptb": _ramp(1),
    "splitlr": _split(0),
    "splittb": _split(1),
    "ramp4": ((("valuetl", 0.0), ("valuetr", 0.0), ("valuebl", 0.0), ("valuebr", 0.0), ("texcoord", None)), _ramp4),
    "ramp_gradient": (
        (
            *(("x", 0.0), ("interval1", 0.0), ("interval2", 1.0), ("color1", _STOPS[0]), ("color2", _STOPS[1])),
            *(("interpolation", 1.0), ("prev_color", _STOPS[0]), ("interval_num", 1.0), ("num_intervals", 2.0)),
        ),
        _gradient,
    ),
    "ramp": (
        (
            *(("texcoord", None), ("type", 0.0), ("interpolation", 1.0), ("num_intervals", 2.0)),
            *((f"interval{row + 1}", float(row > 0)) for row in range(len(_STOPS))),
            *((f"color{row + 1}", color) for row, color in enumerate(_STOPS)),
        ),
        _ramp_of_colors,
    ),
    "blackbody": ((("temperature", 5000.0),), blackbody),
    "circle": ((("texcoord", None), ("center", (0.0, 0.0)), ("radius", 0.5)), _circle),
    "checkerboard": (
        (("color1", 1.0), ("color2", 0.0), ("uvtiling", (8.0, 8.0)), ("uvoffset", (0.0, 0.0)), ("texcoord", None)),
        _checkerboard,
    ),
}
