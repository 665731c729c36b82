# SPDX-License-Identifier: Apache-2.0
"""Writing of image files without time stamps: PNG by Pillow, and Radiance HDR."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Array = NDArray[np.float64]


def encoded(linear: Array) -> Array:
    """Return sRGB values, 0..1, of linear ones."""
    x = np.clip(linear, 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1.0 / 2.4) - 0.055)


def decoded(srgb: Array) -> Array:
    """Return linear values of sRGB ones, 0..1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def save_color(path: Path, linear: Array) -> None:
    """Write a scene-linear albedo [h, w, 3] as 8-bit sRGB PNG."""
    _save(path, encoded(linear))


def save_raw(path: Path, values: Array) -> None:
    """Write values 0..1, [h, w], as 8-bit grayscale PNG."""
    _save(path, np.clip(values, 0.0, 1.0))


def save_normal(path: Path, normals: Array) -> None:
    """Write unit normals [h, w, 3] as 8-bit PNG, to be read with scale 2 and bias -1."""
    _save(path, normals * 0.5 + 0.5)


def _save(path: Path, values: Array) -> None:
    """Write values 0..1 as 8-bit PNG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.round(values * 255.0).astype(np.uint8)).save(path, optimize=True)


def save_hdr(path: Path, radiance: NDArray[np.floating]) -> None:
    """Write radiance [h, w, 3] as a Radiance RGBE file with the new run-length encoding."""
    height, width = radiance.shape[:2]
    brightest = radiance.max(axis=-1)
    mantissa, exponent = np.frexp(brightest)
    scale = np.where(brightest > 1e-32, mantissa * 256.0 / np.maximum(brightest, 1e-32), 0.0)
    rgbe = np.zeros((height, width, 4), dtype=np.uint8)
    rgbe[..., :3] = np.clip(radiance * scale[..., None], 0.0, 255.0)
    rgbe[..., 3] = np.where(brightest > 1e-32, exponent + 128, 0)
    data = bytearray(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n")
    data += f"-Y {height} +X {width}\n".encode()
    for row in rgbe:
        data += bytes([2, 2, width >> 8, width & 255])
        for channel in range(4):
            data += _run_length(row[:, channel].tobytes())
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(bytes(data))


def _run_length(line: bytes) -> bytes:
    """Encode runs of 4 or more equal bytes as (128 + n, value), other bytes as (n, bytes)."""
    out, at, literal = bytearray(), 0, 0
    while at < len(line):
        run = 1
        while at + run < len(line) and run < 127 and line[at + run] == line[at]:
            run += 1
        if run >= 4 or at - literal == 128:
            while literal < at:
                count = min(128, at - literal)
                out += bytes([count]) + line[literal : literal + count]
                literal += count
        if run >= 4:
            out += bytes([128 + run, line[at]])
            at += run
            literal = at
        else:
            at += 1
    while literal < len(line):
        count = min(128, len(line) - literal)
        out += bytes([count]) + line[literal : literal + count]
        literal += count
    return bytes(out)
