# SPDX-License-Identifier: Apache-2.0
"""Buffers as a page stores them: a WebP picture to look at, and the values to read.

Values are rounded to a fixed number of decimals, so that the page shows what the array holds, and stored without loss:
each is predicted from its neighbors (the median predictor of LOCO-I: Weinberger et al. 2000) or from the frame before,
whichever takes less room, and the residuals are deflated. `values.js` is the decoder.
"""

from __future__ import annotations

import base64
import io
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tiscene.frame.buffers import COLORS, Buffer
from tiscene.frame.visualize import Limits, picture

DECIMALS = {"m": 3, "px": 2}  # by unit: millimeters, hundredths of a pixel
OTHER_DECIMALS = 2
MAX_DIFFERENCES = 7  # frames in a row that are stored as differences: what a jump to any frame decodes at most
DEFLATE_LEVEL = 7
PHOTO_QUALITY, FALSE_COLOR_QUALITY = 86, 72  # of WebP
LARGEST = 2**31 - 8  # beyond it are the stored forms of what is not finite
POSITIVE_INFINITY, NEGATIVE_INFINITY, NOT_A_NUMBER = 2**31 - 1, 2**31 - 2, 2**31 - 3


@dataclass(frozen=True)
class PageBuffer:
    """How a page shows a buffer.

    Attributes:
        buffer: its entry in BUFFERS.
        limits: the ends of its color scale, the same in all frames.
    """

    buffer: Buffer
    limits: Limits

    @property
    def has_values(self) -> bool:
        """Whether the page has values; colors have a picture alone, since they would fill the page."""
        return self.buffer.name not in COLORS

    @property
    def is_discrete(self) -> bool:
        """Whether values are ids or truth values, whose pictures must not be smoothed."""
        return self.buffer.dtype in ("int32", "bool") or self.buffer.name.endswith("coverage")

    @property
    def decimals(self) -> int:
        """Number of decimals of the values."""
        if self.buffer.dtype in ("int32", "bool", "uint8"):
            return 0
        if self.buffer.name.endswith("coverage"):
            return 4  # sixteenths
        return DECIMALS.get(self.buffer.unit, OTHER_DECIMALS)

    def to_json(self, example: NDArray[Any]) -> dict[str, Any]:
        """Return what the page's script needs to know.

        Args:
            example: the array of one frame.
        """
        return {
            "name": self.buffer.name,
            "unit": self.buffer.unit,
            "doc": self.buffer.doc,
            "planes": int(np.prod(self.buffer.channels, dtype=int)) if self.has_values else 0,
            "decimals": self.decimals,
            "isMask": self.buffer.dtype == "bool",
            "caption": picture(self.buffer.name, example, self.limits).caption if not self.is_discrete else "",
        }

    def picture(self, array: NDArray[Any]) -> str:
        """Return a picture of an array as base64 WebP."""
        data = io.BytesIO()
        quality = PHOTO_QUALITY if self.buffer.name in COLORS else FALSE_COLOR_QUALITY
        options: dict[str, Any] = {"lossless": True} if self.is_discrete else {"quality": quality}
        Image.fromarray(picture(self.buffer.name, array, self.limits).image).save(data, "webp", **options)
        return base64.b64encode(data.getvalue()).decode()


def quantize(array: NDArray[Any], decimals: int) -> NDArray[np.int32]:
    """Round values to decimals.

    Args:
        array: [h, w, ...].
        decimals: their number.

    Returns:
        int32 [planes, h, w]: values times 10^decimals, clamped to LARGEST; other numbers stand for what is not finite.
    """
    planes = np.moveaxis(array.reshape(*array.shape[:2], -1), -1, 0).astype(np.float64)
    finite = np.isfinite(planes)
    scaled = np.rint(np.where(finite, planes, 0.0) * 10.0**decimals)
    result = np.clip(scaled, -LARGEST, LARGEST).astype(np.int64)
    result[np.isnan(planes)] = NOT_A_NUMBER
    result[planes == np.inf] = POSITIVE_INFINITY
    result[planes == -np.inf] = NEGATIVE_INFINITY
    return result.astype(np.int32)


class ValueEncoder:
    """Compresses the values of a buffer, frame by frame, without loss.

    Args:
        buffer: how the page shows it.
    """

    def __init__(self, buffer: PageBuffer) -> None:
        self._buffer = buffer
        self._previous: NDArray[np.int32] | None = None
        self._since_key = 0

    def encode(self, array: NDArray[Any]) -> str:
        """Return the next frame: "k" (key) or "d" (difference from the frame before), then base64 data."""
        planes = quantize(array, self._buffer.decimals)
        data, kind = deflated(spatial_residuals(planes)), "k"
        if self._previous is not None and self._since_key < MAX_DIFFERENCES:
            difference = deflated(_wrapped(planes.astype(np.int64) - self._previous))
            if len(difference) < len(data):
                data, kind = difference, "d"
        self._previous = planes
        self._since_key = self._since_key + 1 if kind == "d" else 0
        return kind + base64.b64encode(data).decode()


def spatial_residuals(planes: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return values [planes, h, w] minus their predictions from the pixels to the left and above, modulo 2^32."""
    padded = np.pad(planes.astype(np.int64), ((0, 0), (1, 0), (1, 0)))
    left, up, corner = padded[:, 1:, :-1], padded[:, :-1, 1:], padded[:, :-1, :-1]
    low, high = np.minimum(left, up), np.maximum(left, up)
    predicted = np.where(corner >= high, low, np.where(corner <= low, high, left + up - corner))
    return _wrapped(planes.astype(np.int64) - predicted)


def deflated(residuals: NDArray[np.int32]) -> bytes:
    """Return residuals [planes, h, w] as raw deflate data.

    Of each plane it has the lowest bytes of all pixels, then the second lowest, and so on, in zigzag order: 0, -1, 1,
    -2, ...
    """
    zigzag = (residuals << 1) ^ (residuals >> 31)
    as_bytes = np.ascontiguousarray(zigzag, "<i4").view(np.uint8).reshape(*residuals.shape, 4)
    deflate = zlib.compressobj(DEFLATE_LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
    return deflate.compress(np.moveaxis(as_bytes, -1, 1).tobytes()) + deflate.flush()


def _wrapped(values: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return int64 values modulo 2^32."""
    return values.astype(np.uint32).astype(np.int32)
