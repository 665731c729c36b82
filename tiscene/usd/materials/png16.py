# SPDX-License-Identifier: Apache-2.0
"""Decoder of PNG files with 16 bits per channel and more than one channel, which Pillow reduces to 8 bits.

Follows the PNG specification (ISO/IEC 15948): chunks, zlib stream, filters, Adam7 interlacing.
"""

from __future__ import annotations

import contextlib
import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.usd.materials.color_profile import Transfer, declared_transfer

_CHANNELS = {2: 3, 4: 2, 6: 4}  # by color type: RGB, gray and alpha, RGBA
_MAX_SIDE = 1 << 16  # pixels
_MAX_PROFILE = 1 << 24  # bytes of an ICC profile
# Passes of Adam7 interlacing: first column, first row, column step, row step.
_PASSES = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))


def is_deep_color(data: bytes) -> bool:
    """Return whether a file is a PNG of 16 bits per channel and more than one channel."""
    return data[:8] == b"\x89PNG\r\n\x1a\n" and len(data) > 33 and data[24] == 16 and data[25] in _CHANNELS


def read_deep_color(data: bytes) -> tuple[NDArray[np.uint16], Transfer | None]:
    """Decode a PNG for which `is_deep_color` holds.

    Returns:
        The pixels [h, w, channels], and the transfer function that the file declares.

    Raises:
        ValueError: the file is damaged or too large.
    """
    width, height, _, kind, _, _, interlaced = struct.unpack(">IIBBBBB", data[16:29])
    if not (0 < width <= _MAX_SIDE and 0 < height <= _MAX_SIDE):
        raise ValueError(f"a PNG of {width} x {height} pixels; each side must be in 1..{_MAX_SIDE}")
    channels, compressed, metadata = _CHANNELS[kind], [], {}
    for name, content in _chunks(data):
        if name == b"IDAT":
            compressed.append(content)
        elif name in (b"iCCP", b"sRGB", b"gAMA", b"tRNS"):
            metadata[name] = content
    passes = _PASSES if interlaced else ((0, 0, 1, 1),)
    sizes = [(-(-(height - y) // dy), -(-(width - x) // dx)) for x, y, dx, dy in passes]
    sizes = [(rows, columns) if rows > 0 and columns > 0 else (0, 0) for rows, columns in sizes]
    expected_size = sum(rows * (1 + 2 * channels * columns) for rows, columns in sizes)
    try:
        raw = zlib.decompressobj().decompress(b"".join(compressed), expected_size)
    except zlib.error as error:
        raise ValueError(f"a damaged PNG: {error}") from error
    if len(raw) < expected_size:
        raise ValueError("a PNG that ends early")
    pixels = np.empty((height, width, channels), dtype=np.uint16)
    at = 0
    for (x, y, dx, dy), (rows, columns) in zip(passes, sizes, strict=True):
        size = rows * (1 + 2 * channels * columns)
        if size:
            part = _unfilter(np.frombuffer(raw, np.uint8, size, at).reshape(rows, -1), 2 * channels)
            pixels[y::dy, x::dx] = part.view(">u2").reshape(rows, columns, channels)
        at += size
    if kind == 2 and len(metadata.get(b"tRNS", b"")) == 6:
        pixels = with_transparent_color(pixels, np.frombuffer(metadata[b"tRNS"], ">u2"))
    return pixels, _transfer(metadata)


def with_transparent_color(pixels: NDArray[Any], color: Any) -> NDArray[Any]:
    """Return integers [h, w] or [h, w, c] with alpha: 0 where they have a color of c values (PNG's tRNS), else full."""
    pixels = np.atleast_3d(pixels)
    alpha = np.where((pixels == color).all(axis=2, keepdims=True), 0, np.iinfo(pixels.dtype).max)
    return np.concatenate([pixels, alpha.astype(pixels.dtype)], axis=2)


def _transfer(metadata: dict[bytes, bytes]) -> Transfer | None:
    """Return the transfer function that the chunks iCCP, sRGB and gAMA declare."""
    profile = None
    if b"iCCP" in metadata:
        with contextlib.suppress(zlib.error):  # a name, a zero, the compression method, then the profile
            compressed = metadata[b"iCCP"].partition(b"\0")[2][1:]
            profile = zlib.decompressobj().decompress(compressed, _MAX_PROFILE)
    gamma = metadata.get(b"gAMA")
    return declared_transfer(
        profile=profile,
        has_srgb_chunk=b"sRGB" in metadata,
        gamma=struct.unpack(">I", gamma)[0] / 100000.0 if gamma is not None and len(gamma) == 4 else None,
    )


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield the type and content of each chunk."""
    at = 8
    while at + 8 <= len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        yield data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        at += 12 + length


def _unfilter(lines: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Undo the filters of scanlines, each of which begins with its filter type.

    A pixel depends on its left, upper and upper left neighbors, so all pixels of an antidiagonal are done at once.

    Args:
        lines: uint8 [h, 1 + w step].
        step: bytes per pixel.

    Returns:
        uint8 [h, w, step].
    """
    if lines[:, 0].max() > 4:
        raise ValueError("a PNG with an unknown filter")
    height, width = len(lines), (lines.shape[1] - 1) // step
    filters = lines[:, 0]
    rule = [
        np.where(filters == number, -1, 0).astype(np.int16)[:, None] for number in range(5)
    ]  # per filter: all bits set in its rows
    raw = np.ascontiguousarray(lines[:, 1:]).reshape(height * width, step)
    # A row and a column of zeros precede the image. Along an antidiagonal, flat indices differ by `width`.
    done = np.zeros(((height + 1) * (width + 1), step), dtype=np.int16)
    for diagonal in range(height + width - 1):
        first, last = max(0, diagonal - width + 1), min(height - 1, diagonal)
        count = last - first + 1
        here = (first + 1) * (width + 1) + 1 + diagonal - first

        def diagonal_at(start: int, count: int = count) -> NDArray[np.int16]:
            return done[start : start + (count - 1) * width + 1 : width]

        source = first * width + diagonal - first
        values = raw[source : source + (count - 1) * (width - 1) + 1 : max(width - 1, 1)]
        left, above, corner = diagonal_at(here - 1), diagonal_at(here - width - 1), diagonal_at(here - width - 2)
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
        diagonal_at(here)[:] = (values + predicted) & 255
    return np.ascontiguousarray(done.reshape(height + 1, width + 1, step)[1:, 1:].astype(np.uint8))
