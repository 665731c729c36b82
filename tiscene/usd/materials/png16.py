# SPDX-License-Identifier: Apache-2.0
"""PNG files of 16 bits a channel and several channels, of which Pillow keeps 8."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

_CHANNELS = {2: 3, 4: 2, 6: 4}  # by color type: RGB, gray and alpha, RGBA
_LARGEST = 1 << 16
# Adam7: first column, first row, step between columns, step between rows of each pass.
_PASSES = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))


def is_deep_color(data: bytes) -> bool:
    """Whether a file is a PNG that this module is for."""
    return data[:8] == b"\x89PNG\r\n\x1a\n" and len(data) > 33 and data[24] == 16 and data[25] in _CHANNELS


def read_deep_color(data: bytes) -> tuple[NDArray[np.uint16], bool]:
    """The pixels [h, w, channels], and whether the file says that they are sRGB. Raises ValueError."""
    width, height, _, kind, _, _, interlaced = struct.unpack(">IIBBBBB", data[16:29])
    if not (0 < width <= _LARGEST and 0 < height <= _LARGEST):
        raise ValueError(f"a PNG of {width} x {height} pixels")
    channels, packed, says_srgb = _CHANNELS[kind], [], False
    for name, content in _chunks(data):
        if name == b"IDAT":
            packed.append(content)
        says_srgb |= name == b"sRGB" or (name == b"gAMA" and content == struct.pack(">I", 45455))
    passes = _PASSES if interlaced else ((0, 0, 1, 1),)
    sizes = [(-(-(height - y) // dy), -(-(width - x) // dx)) for x, y, dx, dy in passes]
    sizes = [(rows, columns) if rows > 0 and columns > 0 else (0, 0) for rows, columns in sizes]
    wanted = sum(rows * (1 + 2 * channels * columns) for rows, columns in sizes)
    try:
        raw = zlib.decompressobj().decompress(b"".join(packed), wanted)
    except zlib.error as error:
        raise ValueError(f"a damaged PNG: {error}") from error
    if len(raw) < wanted:
        raise ValueError("a PNG that ends early")
    pixels = np.empty((height, width, channels), dtype=np.uint16)
    at = 0
    for (x, y, dx, dy), (rows, columns) in zip(passes, sizes, strict=True):
        size = rows * (1 + 2 * channels * columns)
        if size:
            part = _unfiltered(np.frombuffer(raw, np.uint8, size, at).reshape(rows, -1), 2 * channels)
            pixels[y::dy, x::dx] = part.view(">u2").reshape(rows, columns, channels)
        at += size
    return pixels, says_srgb


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 8
    while at + 8 <= len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        yield data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        at += 12 + length


def _unfiltered(lines: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Undo the filters of rows that begin with their filter's number; `step` bytes a pixel.

    A pixel needs those to its left, above and above left: all pixels of an antidiagonal can be done at once.
    """
    if lines[:, 0].max() > 4:
        raise ValueError("a PNG with an unknown filter")
    height, width = len(lines), (lines.shape[1] - 1) // step
    filters = lines[:, 0]
    rule = [np.where(filters == number, -1, 0).astype(np.int16)[:, None] for number in range(5)]  # masks, all bits set
    raw = np.ascontiguousarray(lines[:, 1:]).reshape(height * width, step)
    # One row and column of zeros before the image; a flat index moves by `width` from a row to the next of a diagonal.
    done = np.zeros(((height + 1) * (width + 1), step), dtype=np.int16)
    for diagonal in range(height + width - 1):
        first, last = max(0, diagonal - width + 1), min(height - 1, diagonal)
        count = last - first + 1
        here = (first + 1) * (width + 1) + 1 + diagonal - first

        def cells(start: int, count: int = count) -> NDArray[np.int16]:
            return done[start : start + (count - 1) * width + 1 : width]

        source = first * width + diagonal - first
        values = raw[source : source + (count - 1) * (width - 1) + 1 : max(width - 1, 1)]
        left, above, corner = cells(here - 1), cells(here - width - 1), cells(here - width - 2)
        to_left, to_above = np.abs(above - corner), np.abs(left - corner)
        to_corner = np.abs(left + above - 2 * corner)
        nearest = np.where(
            (to_left <= to_above) & (to_left <= to_corner), left, np.where(to_above <= to_corner, above, corner)
        )
        use = slice(first, last + 1)
        predicted = (
            (left & rule[1][use])
            | (above & rule[2][use])
            | ((left + above >> 1) & rule[3][use])
            | (nearest & rule[4][use])
        )
        cells(here)[:] = (values + predicted) & 255
    return np.ascontiguousarray(done.reshape(height + 1, width + 1, step)[1:, 1:].astype(np.uint8))
