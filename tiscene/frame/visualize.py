# SPDX-License-Identifier: Apache-2.0
"""Buffers as color images, uint8 [h, w, 3].

::

    from tiscene.frame.visualize import picture
    picture("depth", frame.depth).image            # and .caption: "0.82 to 7.30 m"

Color maps are defined in OKLab (Ottosson 2020), which is perceptually uniform: lightness shows distances, hue separates
ids. The flow wheel is that of Baker et al., *A Database and Evaluation Methodology for Optical Flow* (2011).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tiscene.errors import counted
from tiscene.scene.color import encode_srgb

Pixels = NDArray[np.uint8]
Limits = tuple[float, float]

BACKGROUND = (24, 25, 30)
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))

# Steps of hue from one primary to the next on the flow wheel: red, yellow, green, cyan, blue, magenta, red.
WHEEL_STEPS = (15, 6, 4, 11, 13, 6)


@dataclass(frozen=True)
class Picture:
    """An image of a buffer.

    Attributes:
        image: uint8 [h, w, 3].
        caption: The range of the color scale, in a few words.
    """

    image: Pixels
    caption: str


def picture(name: str, buffer: NDArray[Any], limits: Limits | None = None) -> Picture:
    """Return an image of a buffer.

    Args:
        name: The name of the buffer.
        buffer: Its array.
        limits: The values at the two ends of the color scale, for equal colors in several frames (see `limits_of`);
            None for the limits of this array.
    """
    low, high = limits or limits_of(name, [buffer])
    if name == "rgb":
        return Picture(buffer, "display sRGB")
    if name in ("hdr", "denoised"):
        return Picture(_display(buffer / max(high, 1e-6)), f"radiance, white is {high:.3g}")
    if name in ("depth", "distance"):
        return Picture(depth_picture(buffer, low, high), f"{low:.2f} to {high:.2f} m")
    if name in ("forward_flow", "backward_flow"):
        return Picture(flow_picture(buffer, high), f"full color at {high:.3g} px")
    if name in ("instance", "part", "semantic"):
        count = np.count_nonzero(np.unique(buffer))
        return Picture(id_picture(buffer), counted(int(count), "id"))
    if name.endswith("coverage"):
        return Picture(coverage_picture(buffer), f"{100.0 * (buffer[..., 1, 1] > 0).mean():.1f} % shared")
    if buffer.dtype == np.bool_:
        return Picture(mask_picture(buffer), f"{100.0 * buffer.mean():.1f} % true")
    if "normal" in name:
        return Picture(normal_picture(buffer), "x, y, z as red, green, blue")
    if name == "albedo":
        return Picture(_display(buffer), "linear Rec.709")
    if name == "scene_flow":
        scale = max(abs(low), abs(high), 1e-9)
        return Picture(_to_bytes(0.5 + 0.5 * buffer / scale), f"gray is 0, up to {scale:.3g} m")
    if name == "position":
        return Picture(_ranged(buffer, low, high), f"{low:.2f} to {high:.2f} m")
    if name == "uv":
        return Picture(_to_bytes(_three_channels(buffer - np.floor(buffer))), "u, v as red, green")
    return Picture(_ranged(buffer, low, high), f"{low:.3g} to {high:.3g}")


def limits_of(name: str, buffers: Iterable[NDArray[Any]]) -> Limits:
    """Return the ends of a color scale for several arrays of one buffer.

    Args:
        name: The name of the buffer.
        buffers: Its arrays.
    """
    if name in ("rgb", "albedo", "roughness", "metallic", "object_coordinates"):
        return (0.0, 1.0)
    values = []
    for buffer in buffers:
        vectors = buffer.ndim == 3 and "flow" in name
        flat = np.linalg.norm(buffer, axis=2).ravel() if vectors else np.asarray(buffer, dtype=np.float64).ravel()
        values.append(flat[np.isfinite(flat)])
    finite = np.concatenate(values) if values else np.empty(0)
    if finite.size == 0:
        return (0.0, 1.0)
    if name in ("hdr", "denoised"):
        return (0.0, float(np.percentile(finite, 98.0)))
    if "flow" in name:
        # A percentile of the moving pixels: a single fast object would make all others pale.
        moving = finite[finite > 0.01 * finite.max()]
        return (0.0, float(np.percentile(moving, 95.0)) if moving.size else 0.0)
    low, high = np.percentile(finite, [0.5, 99.5])
    return (float(low), float(high))


def depth_picture(depth: ArrayLike, near: float, far: float) -> Pixels:
    """Draw depth (m) from pale yellow (near) over red to violet (far); no hit is the background color."""
    depth = np.asarray(depth, dtype=np.float64)
    finite = np.isfinite(depth)
    closeness = 1.0 - (np.where(finite, depth, far) - near) / max(far - near, 1e-9)
    image = sequential(closeness)
    image[~finite] = BACKGROUND
    return image


def sequential(values: ArrayLike) -> Pixels:
    """Map 0..1 to colors of linearly rising lightness: violet, red, orange, pale yellow. Values outside are clamped."""
    t = np.clip(np.asarray(values, dtype=np.float64), 0.0, 1.0)
    hue = np.radians(-75.0 + 170.0 * t)
    return oklch(0.18 + 0.77 * t, 0.07 + 0.11 * np.sin(np.pi * t), hue)


def id_picture(ids: NDArray[Any]) -> Pixels:
    """Draw ids in distinct colors, the same color for an id in every frame; 0 is the background color."""
    distinct, rows = np.unique(ids, return_inverse=True)
    return id_colors(distinct)[rows.reshape(ids.shape)]


def id_colors(ids: ArrayLike) -> Pixels:
    """Return colors [n, 3] of ids [n]: hues by multiples of the golden angle, lightness in four steps."""
    ids = np.asarray(ids, dtype=np.int64)
    lightness = np.array([0.70, 0.56, 0.82, 0.44])[ids % 4]
    colors = oklch(lightness, np.full(ids.shape, 0.135), ids * GOLDEN_ANGLE)
    colors[ids == 0] = BACKGROUND
    return colors


def coverage_picture(coverage: NDArray[np.floating]) -> Pixels:
    """Draw a coverage buffer: the colors of `id_picture` mixed by their weights, over the background color."""
    colors = id_picture(np.round(coverage[..., 0]).astype(np.int64)).astype(np.float64)
    weights = coverage[..., 1, None]
    mixed = (weights * colors).sum(axis=2) + (1.0 - weights.sum(axis=2)) * np.array(BACKGROUND)
    return _to_bytes(mixed / 255.0)


def mask_picture(mask: NDArray[np.bool_]) -> Pixels:
    """Draw a mask: True is pale orange, False the background color."""
    return np.where(mask[..., None], np.array((255, 176, 92), np.uint8), np.array(BACKGROUND, np.uint8))


def normal_picture(normal: NDArray[np.floating]) -> Pixels:
    """Map -1..1 to 0..255 in each channel; no hit (the zero vector) is the background color."""
    image = _to_bytes(0.5 + 0.5 * normal)
    image[~np.any(normal, axis=2)] = BACKGROUND
    return image


def flow_picture(flow: NDArray[np.floating], longest: float | None = None, legend: bool = True) -> Pixels:
    """Draw optical flow with the color wheel: hue is the direction, white is no motion, black is not finite.

    Args:
        flow: [h, w, 2], dx right and dy down, px.
        longest: The length that has full color, px; longer vectors are darkened. None for the longest in the array.
        legend: Whether the wheel is drawn into the lower right corner: center no motion, right +dx, below +dy.
    """
    length = np.linalg.norm(flow, axis=2)
    finite = np.isfinite(length)
    if longest is None:
        longest = float(length[finite].max(initial=0.0))
    image = _wheel_colors(np.where(finite[..., None], flow, 0.0) / max(longest, 1e-9))
    image[~finite] = 0
    height, width = length.shape
    radius = min(height, width) // 9
    if legend and radius >= 6:
        y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
        square = np.stack([x, y], axis=2)
        distance = np.hypot(x, y)
        corner = image[height - 2 * radius - 4 : height - 3, width - 2 * radius - 4 : width - 3]
        corner[distance <= radius] = (40, 42, 48)
        inside = distance <= radius - 1.5
        corner[inside] = _wheel_colors(square / (radius - 1.5))[inside]
    return image


def sailenv_flow_picture(flow: NDArray[np.floating], *, backward: bool = False) -> Pixels:
    """Draw flow as SAILenv's client does: `direction_picture` of its flow, (-dx, +dy) with dy downwards.

    Args:
        flow: [h, w, 2], dx right and dy down, px.
        backward: Whether it points to the frame before, against the motion.
    """
    return direction_picture(flow * (np.array((1.0, -1.0)) if backward else np.array((-1.0, 1.0))))


def direction_picture(vectors: NDArray[np.floating]) -> Pixels:
    """Draw vectors [h, w, 2]: the hue is the direction (red: +x), the value is the length.

    The longest vector has full value, the shortest is black.
    """
    x, y = np.moveaxis(np.asarray(vectors, np.float64), -1, 0)
    length, hue = np.hypot(x, y), np.arctan2(y, x) * (3.0 / np.pi) % 6.0
    span = length.max() - length.min()
    value = (length - length.min()) / (span if span > 0.0 else 1.0)
    channels = [(sector + hue) % 6.0 for sector in (5.0, 3.0, 1.0)]  # red, green, blue
    return _to_bytes(np.stack([value * (1.0 - np.clip(np.minimum(k, 4.0 - k), 0.0, 1.0)) for k in channels], axis=-1))


def _wheel_colors(flow: NDArray[np.floating]) -> Pixels:
    """Return colors of vectors [h, w, 2]; length 1 has full color."""
    wheel = _flow_wheel()
    angle = np.arctan2(-flow[..., 1], -flow[..., 0]) / np.pi  # -1 and 1: right, 0: left
    position = (angle + 1.0) / 2.0 * (len(wheel) - 1)
    below = np.floor(position).astype(np.int64)
    fraction = (position - below)[..., None]
    color = (1.0 - fraction) * wheel[below] + fraction * wheel[(below + 1) % len(wheel)]
    length = np.linalg.norm(flow, axis=2)[..., None]
    return _to_bytes(np.where(length <= 1.0 + 1e-6, 1.0 - length * (1.0 - color), 0.75 * color))


def _flow_wheel() -> NDArray[np.float64]:
    """Return the 55 saturated colors of the wheel [55, 3]; each segment raises or lowers one channel."""
    corners = [(1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (1, 0, 1), (1, 0, 0)]
    segments = []
    for steps, start, end in zip(WHEEL_STEPS, corners[:-1], corners[1:], strict=True):
        fraction = np.arange(steps)[:, None] / steps
        segments.append((1.0 - fraction) * np.array(start) + fraction * np.array(end))
    return np.concatenate(segments)


def oklch(lightness: ArrayLike, chroma: ArrayLike, hue: ArrayLike) -> Pixels:
    """Convert OKLCh colors to 8-bit sRGB, clamped.

    Args:
        lightness: OKLab lightness [...], 0..1.
        chroma: [...], about 0..0.3.
        hue: [...], radians.

    Returns:
        uint8 [..., 3].
    """
    level, a, b = np.broadcast_arrays(lightness, chroma * np.cos(hue), chroma * np.sin(hue))
    cone_from_lab = np.array(
        [
            [1.0, 0.3963377774, 0.2158037573],
            [1.0, -0.1055613458, -0.0638541728],
            [1.0, -0.0894841775, -1.2914855480],
        ]
    )
    linear_from_cone = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    cones = (np.stack([level, a, b], axis=-1) @ cone_from_lab.T) ** 3
    return _display(cones @ linear_from_cone.T)


def _display(linear: NDArray[Any]) -> Pixels:
    """Encode scene-linear values 0..1 by the sRGB curve."""
    x = np.clip(np.nan_to_num(linear, nan=0.0), 0.0, 1.0)
    return _to_bytes(encode_srgb(x))


def _ranged(buffer: NDArray[Any], low: float, high: float) -> Pixels:
    """Map low..high to 0..255; values that are not finite have the background color."""
    values = _three_channels(np.asarray(buffer, dtype=np.float64))
    finite = np.isfinite(values).all(axis=2)
    image = _to_bytes((np.where(finite[..., None], values, low) - low) / max(high - low, 1e-9))
    image[~finite] = BACKGROUND
    return image


def _three_channels(buffer: NDArray[Any]) -> NDArray[Any]:
    """Return [h, w] and [h, w, 1] as gray, [h, w, 2] with a third channel of 0, and [h, w, 3] unchanged."""
    if buffer.ndim == 2:
        buffer = buffer[..., None]
    if buffer.shape[2] == 1:
        return np.repeat(buffer, 3, axis=2)
    if buffer.shape[2] == 2:
        return np.concatenate([buffer, np.zeros_like(buffer[..., :1])], axis=2)
    return buffer


def _to_bytes(unit: NDArray[Any]) -> Pixels:
    image: Pixels = np.round(np.clip(unit, 0.0, 1.0) * 255.0).astype(np.uint8)
    return image
