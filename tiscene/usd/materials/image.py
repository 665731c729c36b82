# SPDX-License-Identifier: Apache-2.0
"""Decoding of image files: PNG, JPEG and other formats of Pillow, OpenEXR, Radiance HDR, also inside .usdz packages.

Formats are recognized by their content, not by their suffix.
"""

from __future__ import annotations

import io
import tempfile
import warnings
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray
from PIL import Image

from tiscene.scene.description import FloatArray
from tiscene.usd.core.package import split_package
from tiscene.usd.materials.color_profile import declared_transfer
from tiscene.usd.materials.png16 import is_deep_color, read_deep_color, with_transparent_color

_MAX_PIXELS = 1 << 29  # of a Radiance picture: a few bytes can repeat a pixel that often


@dataclass(frozen=True, eq=False)
class ImageData:
    """A decoded image file, row 0 at the top.

    Attributes:
        pixels: uint8 or float32 [h, w, 4]; gray is repeated to RGB, missing alpha is opaque.
        srgb: whether UsdUVTexture's sourceColorSpace "auto" reads the values as sRGB: by the file's metadata, or, if
            it has none, for 8 bits of 3 or 4 channels.
    """

    pixels: NDArray[np.uint8] | FloatArray
    srgb: bool


def read_picture(path: str) -> ImageData:
    """Read an image file, or one inside a package ("room.usdz[wood.png]").

    Raises:
        OSError: the file cannot be opened.
        ValueError: it is not a readable image.
    """
    return _decode(read_file(path), Path(split_package(path)[-1]).suffix.lower())


def read_file(path: str) -> bytes:
    """Return the bytes of a file, or of one inside a package or nested packages.

    Raises:
        OSError: the file cannot be opened.
        ValueError: a package is damaged or lacks the file.
    """
    package, *inner = split_package(path)
    data = Path(package).read_bytes()
    try:
        for name in inner:
            with zipfile.ZipFile(io.BytesIO(data), metadata_encoding="utf-8") as archive:  # as USD writes names
                data = archive.read(name)
    except Exception as error:  # zipfile and its decompressors raise many types on damaged and encrypted archives
        raise ValueError(f"not a readable package: {error}") from error
    return data


def _decode(data: bytes, suffix: str) -> ImageData:
    """Decode an image; `suffix` is for messages only."""
    if data[:4] == b"\x76\x2f\x31\x01":
        return ImageData(_with_alpha(_read_exr(data)), srgb=False)
    if data[:2] == b"#?":
        return ImageData(_with_alpha(read_radiance(data)), srgb=False)
    if is_deep_color(data):
        values, transfer = read_deep_color(data)
        return ImageData(_with_alpha(values.astype(np.float32) / np.float32(65535.0)), srgb=transfer == "srgb")
    return _from_pillow(open_picture(data, suffix))


def open_picture(data: bytes, suffix: str = "") -> Image.Image:
    """Decode an image file by Pillow.

    Args:
        data: the bytes of the file.
        suffix: of its name, for messages only.

    Raises:
        ValueError: it is not a readable image.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about metadata
            image = Image.open(io.BytesIO(data))
            image.load()
    except Exception as error:  # Pillow's decoders raise many types on damaged files
        raise ValueError(f"not a readable {suffix or 'image'} file: {error}") from error
    return image


def _from_pillow(image: Image.Image) -> ImageData:
    """Return an image of Pillow as 8-bit, 16-bit (scaled to 0..1) or float pixels."""
    transfer = declared_transfer(
        profile=image.info.get("icc_profile"), has_srgb_chunk="srgb" in image.info, gamma=image.info.get("gamma")
    )
    if image.mode in ("P", "CMYK", "YCbCr", "LAB", "HSV", "PA", "RGBX", "1"):
        transparent = "transparency" in image.info or image.mode == "PA"
        image = image.convert("L" if image.mode == "1" else "RGBA" if transparent else "RGB")
    values = np.asarray(image)
    if "transparency" in image.info and image.mode in ("L", "RGB", "I;16"):
        values = with_transparent_color(values, image.info["transparency"])
    if image.mode.startswith("I") or values.dtype in (np.uint16, np.int32, np.uint32):
        return ImageData(_with_alpha(values.astype(np.float32) / np.float32(65535.0)), srgb=transfer == "srgb")
    if values.dtype == np.float32:
        return ImageData(_with_alpha(values), srgb=False)
    channels = 1 if values.ndim == 2 else values.shape[2]
    return ImageData(_with_alpha(values), srgb=transfer == "srgb" or (transfer is None and channels >= 3))


def _with_alpha(values: NDArray[Any]) -> NDArray[Any]:
    """Return [h, w] or [h, w, 1-4] as [h, w, 4]: gray, gray and alpha, RGB or RGBA."""
    if values.ndim == 2:
        values = values[:, :, None]
    height, width, channels = values.shape
    opaque = 255 if values.dtype == np.uint8 else 1
    pixels = np.full((height, width, 4), opaque, dtype=values.dtype)
    pixels[:, :, :3] = values[:, :, :3] if channels >= 3 else values[:, :, :1]
    if channels in (2, 4):
        pixels[:, :, 3] = values[:, :, -1]
    return pixels


def _read_exr(data: bytes) -> FloatArray:
    """Return the color channels [h, w, c] of an OpenEXR file's first part; without RGB, gray or the first channel."""
    with tempfile.TemporaryDirectory() as folder:  # OpenEXR reads files only
        file = Path(folder, "picture.exr")
        file.write_bytes(data)
        try:
            with OpenEXR.File(str(file)) as exr:
                channels = {name: channel.pixels for name, channel in exr.channels().items()}
        except RuntimeError as error:
            raise ValueError(f"not a readable EXR file: {error}") from error
    for name in ("RGBA", "RGB", "Y", "L"):
        if name in channels:
            return np.asarray(channels[name], dtype=np.float32)
    separate = [channels[name] for name in ("R", "G", "B", "A") if name in channels]
    if not separate:
        separate = list(channels.values())[:1]
    if not separate:
        raise ValueError("an EXR file without channels")
    return np.asarray(np.dstack(separate), dtype=np.float32)


def read_radiance(data: bytes) -> FloatArray:
    """Decode a Radiance picture (.hdr).

    Returns:
        float32 [h, w, 3], linear, row 0 at the top.

    Raises:
        ValueError: it is damaged, too large, or stored by columns.
    """
    header, separator, rest = data.partition(b"\n\n")
    size_line, _, body = rest.partition(b"\n")
    words = size_line.split()
    if not separator or len(words) != 4 or b"32-bit_rle_rgbe" not in header:
        raise ValueError("not a Radiance picture of the 32-bit_rle_rgbe format with its size as '-Y height +X width'")
    if words[0] not in (b"-Y", b"+Y") or words[2] not in (b"+X", b"-X"):
        raise ValueError(f"a Radiance picture stored by columns ({size_line!r}) is not supported")
    height, width = int(words[1]), int(words[3])
    if not (0 < height < 1 << 17 and 0 < width < 1 << 17):
        raise ValueError(f"a Radiance picture of {width} x {height} pixels; each side must be in 1..131071")
    if height * width > _MAX_PIXELS:
        raise ValueError(f"a Radiance picture of {width} x {height} pixels; it may have {_MAX_PIXELS:,} in all")
    rgbe = _scanlines(np.frombuffer(body, dtype=np.uint8), height, width)
    scale = np.where(rgbe[..., 3] > 0, np.ldexp(np.float32(1.0), rgbe[..., 3].astype(np.int32) - 136), 0.0)
    values = rgbe[..., :3].astype(np.float32) * scale[..., None].astype(np.float32)
    if words[0] == b"+Y":
        values = values[::-1]
    if words[2] == b"-X":
        values = values[:, ::-1]
    return np.ascontiguousarray(values)


def _scanlines(body: NDArray[np.uint8], height: int, width: int) -> NDArray[np.uint8]:
    """Decode the run-length encoded RGBE scanlines: uint8 [h, w, 4]."""
    if not (8 <= width < 1 << 15 and len(body) >= 4 and body[0] == 2 and body[1] == 2 and body[2] < 128):
        words = body[: len(body) // 4 * 4].reshape(-1, 4)
        return _old_scanlines(words, height * width).reshape(height, width, 4)
    if len(body) < height * (4 + 8 * -(-width // 127)):  # a run of 127 pixels has two bytes
        raise ValueError("a Radiance picture that ends early")
    result = np.empty((height, 4, width), dtype=np.uint8)
    data, at = body.tobytes(), 0
    for row in range(height):
        if data[at : at + 4] != bytes((2, 2, width >> 8, width & 255)):
            raise ValueError(f"a Radiance picture whose row {row} is damaged")
        at += 4
        for channel in range(4):
            line = bytearray()
            while len(line) < width:
                if at + 1 >= len(data):
                    raise ValueError("a Radiance picture that ends early")
                count = data[at]
                if count > 128:
                    line += data[at + 1 : at + 2] * (count - 128)
                    at += 2
                else:
                    line += data[at + 1 : at + 1 + count]
                    at += 1 + count
                    if count == 0 or at > len(data):
                        raise ValueError(f"a Radiance picture whose row {row} is damaged")
            if len(line) != width:
                raise ValueError(f"a Radiance picture whose row {row} is damaged")
            result[row, channel] = np.frombuffer(line, dtype=np.uint8)
    return result.transpose(0, 2, 1)


def _old_scanlines(words: NDArray[np.uint8], count: int) -> NDArray[np.uint8]:
    """Decode the old run-length encoding: uint8 [count, 4].

    A pixel (1, 1, 1, n) repeats the previous pixel n times; the next such pixel right after it, n * 256 times.
    """
    runs = (words[:, :3] == 1).all(axis=1)
    index = np.arange(len(words))
    last_pixel = np.maximum.accumulate(np.where(runs, -1, index))
    order = np.minimum(index - last_pixel - 1, 3)  # number of runs between a run and its pixel
    repeats = np.where(runs, words[:, 3].astype(np.int64) << (8 * np.maximum(order, 0)), 1).clip(max=count)
    if len(words) and last_pixel[0] < 0:
        raise ValueError("a Radiance picture that begins with a run")
    ends = np.cumsum(repeats)
    if len(words) == 0 or ends[-1] < count:
        raise ValueError("a Radiance picture that ends early")
    needed = int(np.searchsorted(ends, count)) + 1
    return np.repeat(words[last_pixel[:needed]], repeats[:needed], axis=0)[:count]
