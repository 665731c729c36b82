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

Operation = tuple[Sequence[tuple[str, Any]], Callable[..., Array]]


def rgb_to_hsv(rgb: Array) -> Array:
    """Return hue (0..1), saturation and value of colors [..., 3]."""
    r, g, b = (rgb[..., each] for each in range(3))
    value, low = rgb.max(axis=-1), rgb.min(axis=-1)
    span = value - low
    safe = np.where(span > 0.0, span, 1.0)
    hue = np.where(value == r, (g - b) / safe, np.where(value == g, 2.0 + (b - r) / safe, 4.0 + (r - g) / safe))
    hue = np.where(span > 0.0, hue / 6.0 % 1.0, 0.0)
    return np.stack([hue, np.where(value > 0.0, span / np.where(value > 0.0, value, 1.0), 0.0), value], axis=-1)


def hsv_to_rgb(hsv: Array) -> Array:
    """Return the colors [..., 3] of hue (0..1), saturation and value."""
    hue, saturation, value = (hsv[..., each] for each in range(3))
    steps = (np.stack([hue * 6.0 + 5.0, hue * 6.0 + 3.0, hue * 6.0 + 1.0], axis=-1)) % 6.0
    weight = np.clip(np.minimum(steps, 4.0 - steps), 0.0, 1.0)
    return np.asarray(value[..., None] * (1.0 - saturation[..., None] * weight))


def luminance(color: Array, coefficients: Array) -> Array:
    """Return the luminance of colors [..., 3], in all their channels."""
    return np.broadcast_to((color[..., :3] * coefficients[..., :3]).sum(axis=-1, keepdims=True), color.shape)


def saturate(color: Array, amount: Array, coefficients: Array) -> Array:
    """Return colors with their saturation multiplied by an amount."""
    gray = luminance(color, coefficients)
    return np.asarray(gray + (color - gray) * amount)


def hsv_adjust(color: Array, amount: Array) -> Array:
    """Return colors with a hue offset, and factors of saturation and value."""
    hsv = rgb_to_hsv(color[..., :3])
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
    """Return the smooth transition from 0 at `low` to 1 at `high`."""
    unit = np.clip((value - low) / np.where(high == low, 1.0, high - low), 0.0, 1.0)
    return np.asarray(unit * unit * (3.0 - 2.0 * unit))


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
    shape = (*np.broadcast_shapes(color.shape[:-1], hue.shape[:-1], saturation.shape[:-1]), 1)
    amount = [np.broadcast_to(each, shape) for each in (hue, saturation, np.ones(1))]
    changed = hsv_adjust(color, np.concatenate(amount, axis=-1))
    changed = np.maximum(changed, 0.0) ** (1.0 / np.where(gamma == 0.0, 1.0, gamma))
    changed = (changed * (1.0 - lift) + lift) * gain
    return np.asarray(((changed - pivot) * contrast + pivot) * 2.0**exposure)


def _chosen(test: Callable[[Array, Array], Array]) -> Operation:
    inputs = (("value1", 1.0), ("value2", 0.0), ("in1", 0.0), ("in2", 0.0))
    return inputs, lambda a, b, yes, no: np.asarray(np.where(test(a, b), yes, no))


def _pair(function: Callable[[Array, Array], Array], first: float, second: float) -> Operation:
    return (("in1", first), ("in2", second)), function


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
    place = np.floor(at * tiling - offset)
    return np.where(place.sum(axis=-1, keepdims=True) % 2.0 < 0.5, first, second)


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
    "sqrt": _single(lambda a: np.sqrt(np.maximum(a, 0.0))),
    "ln": _single(lambda a: np.log(np.maximum(a, 1e-12))),
    "exp": _single(np.exp),
    "magnitude": _single(lambda a: np.linalg.norm(a, axis=-1, keepdims=True)),
    "normalize": _single(lambda a: a / np.maximum(np.linalg.norm(a, axis=-1, keepdims=True), 1e-12)),
    "rgbtohsv": _single(rgb_to_hsv),
    "hsvtorgb": _single(hsv_to_rgb),
    "clamp": ((("in", 0.0), ("low", 0.0), ("high", 1.0)), np.clip),
    "mix": ((("bg", 0.0), ("fg", 0.0), ("mix", 0.0)), lambda a, b, mix: a + (b - a) * mix),
    "remap": ((("in", 0.0), ("inlow", 0.0), ("inhigh", 1.0), ("outlow", 0.0), ("outhigh", 1.0)), remap),
    "range": (
        (
            ("in", 0.0),
            ("inlow", 0.0),
            ("inhigh", 1.0),
            ("gamma", 1.0),
            ("outlow", 0.0),
            ("outhigh", 1.0),
            ("doclamp", 0.0),
        ),
        ranged,
    ),
    "smoothstep": ((("in", 0.0), ("low", 0.0), ("high", 1.0)), smoothstep),
    "contrast": ((("in", 0.0), ("amount", 1.0), ("pivot", 0.5)), lambda a, amount, pivot: (a - pivot) * amount + pivot),
    "luminance": ((("in", 0.0), ("lumacoeffs", LUMINANCE)), luminance),
    "saturate": ((("in", 0.0), ("amount", 1.0), ("lumacoeffs", LUMINANCE)), saturate),
    "hsvadjust": ((("in", 0.0), ("amount", (0.0, 1.0, 1.0))), hsv_adjust),
    "colorcorrect": (
        (
            ("in", 1.0),
            *(("hue", 0.0), ("saturation", 1.0), ("gamma", 1.0), ("lift", 0.0), ("gain", 1.0)),
            *(("contrast", 1.0), ("contrastpivot", 0.5), ("exposure", 0.0)),
        ),
        color_correct,
    ),
    "plus": ((("bg", 0.0), ("fg", 0.0), ("mix", 1.0)), lambda a, b, mix: a + b * mix),
    "minus": ((("bg", 0.0), ("fg", 0.0), ("mix", 1.0)), lambda a, b, mix: a - b * mix),
    "screen": ((("bg", 0.0), ("fg", 0.0), ("mix", 1.0)), lambda a, b, mix: a + (b - a * b) * mix),
    "ifgreater": _chosen(np.greater),
    "ifgreatereq": _chosen(np.greater_equal),
    "ifequal": _chosen(np.equal),
    "ramplr": _ramp(0),
    "ramptb": _ramp(1),
    "splitlr": _split(0),
    "splittb": _split(1),
    "checkerboard": (
        (("color1", 1.0), ("color2", 0.0), ("uvtiling", (8.0, 8.0)), ("uvoffset", (0.0, 0.0)), ("texcoord", None)),
        _checkerboard,
    ),
}
