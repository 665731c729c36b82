# SPDX-License-Identifier: Apache-2.0
"""16-bit PNG decoding against an encoder that follows the filter definitions row by row."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest

from tiscene.usd.materials.image import read_picture
from tiscene.usd.materials.png16 import is_deep_color, read_deep_color


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def filtered(values: np.ndarray, kinds: list[int]) -> bytes:
    """Return filtered scanlines; row k uses filter kinds[k % len(kinds)]."""
    height, width, channels = values.shape
    step = 2 * channels
    rows = np.frombuffer(values.astype(">u2").tobytes(), np.uint8).reshape(height, width * step).astype(int)
    result = b""
    for y, row in enumerate(rows):
        above = rows[y - 1] if y else np.zeros_like(row)
        left = np.concatenate([np.zeros(step, int), row[:-step]])
        corner = np.concatenate([np.zeros(step, int), above[:-step]])
        estimate = left + above - corner
        a, b, c = (np.abs(estimate - other) for other in (left, above, corner))
        paeth = np.where((a <= b) & (a <= c), left, np.where(b <= c, above, corner))
        kind = kinds[y % len(kinds)]
        predicted = [0 * row, left, above, (left + above) // 2, paeth][kind]
        result += bytes([kind]) + ((row - predicted) & 255).astype(np.uint8).tobytes()
    return result


def png(values: np.ndarray, kinds: list[int], more: bytes = b"", interlaced: bool = False) -> bytes:
    height, width, channels = values.shape
    header = struct.pack(">IIBBBBB", width, height, 16, {3: 2, 2: 4, 4: 6}[channels], 0, 0, int(interlaced))
    data = filtered(values, kinds)
    if interlaced:
        passes = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)]
        parts = [values[y::dy, x::dx] for x, y, dx, dy in passes]
        data = b"".join(filtered(part, kinds) for part in parts if part.size)
    body = chunk(b"IHDR", header) + more + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def test_transparent_color_becomes_alpha():
    values = np.array([[[1, 2, 3], [1, 2, 4]]], np.uint16)
    more = chunk(b"tRNS", struct.pack(">3H", 1, 2, 3))
    pixels, _ = read_deep_color(png(values, [0], more))
    np.testing.assert_array_equal(pixels, [[[1, 2, 3, 0], [1, 2, 4, 65535]]])


@pytest.mark.parametrize("interlaced", [False, True])
@pytest.mark.parametrize("shape", [(7, 5, 3), (5, 9, 4), (1, 6, 2), (6, 1, 3), (1, 1, 3), (17, 33, 4)])
def test_every_filter_and_interlacing_round_trips(shape, interlaced):
    values = np.random.default_rng(1).integers(0, 1 << 16, shape).astype(np.uint16)
    data = png(values, [4, 3, 2, 1, 0], interlaced=interlaced)
    assert is_deep_color(data)
    pixels, transfer = read_deep_color(data)
    np.testing.assert_array_equal(pixels, values)
    assert transfer is None


@pytest.mark.parametrize("more", [chunk(b"sRGB", b"\0"), chunk(b"gAMA", struct.pack(">I", 45455))])
def test_color_space_chunks_mark_file_as_srgb(tmp_path, more):
    values = np.array([[[65535, 0, 257]]], np.uint16)
    (tmp_path / "a.png").write_bytes(png(values, [0], more))
    picture = read_picture(str(tmp_path / "a.png"))
    assert picture.srgb
    np.testing.assert_array_equal(picture.pixels, np.array([[[1.0, 0.0, 257 / 65535, 1.0]]], np.float32))
    (tmp_path / "b.png").write_bytes(png(values, [0]))
    assert not read_picture(str(tmp_path / "b.png")).srgb


def test_damaged_png_raises_value_error():
    good = png(np.random.default_rng(2).integers(0, 1 << 16, (4, 4, 3)).astype(np.uint16), [0])
    size = struct.pack(">II", 4, 4)
    for bad in (
        good[:80],
        good.replace(size, struct.pack(">II", 4, 9)),
        good.replace(size, struct.pack(">II", 4, 1 << 20)),
    ):
        with pytest.raises(ValueError, match="PNG"):
            read_deep_color(bad)


def test_unknown_filter_raises_value_error():
    data = filtered(np.zeros((2, 2, 3), np.uint16), [0]).replace(b"\0", b"\x07", 1)
    header = struct.pack(">IIBBBBB", 2, 2, 16, 2, 0, 0, 0)
    with pytest.raises(ValueError, match="unknown filter"):
        read_deep_color(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(data)))
