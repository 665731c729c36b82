# SPDX-License-Identifier: Apache-2.0
"""Color space metadata: ICC profiles and PNG chunks, of 8-bit and 16-bit images."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image, ImageCms

from tests.usd.materials.test_png16 import chunk, png
from tiscene.usd.materials.color_profile import declared_transfer
from tiscene.usd.materials.image import read_picture

SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
ENCODED = np.linspace(0.0, 1.0, 1025)
DECODED = np.where(ENCODED <= 0.04045, ENCODED / 12.92, ((ENCODED + 0.055) / 1.055) ** 2.4)


def curve(*values: int) -> bytes:
    return b"curv" + bytes(4) + struct.pack(f">I{len(values)}H", len(values), *values)


def parametric(kind: int, *numbers: float) -> bytes:
    return b"para" + bytes(4) + struct.pack(f">HH{len(numbers)}i", kind, 0, *(round(65536 * n) for n in numbers))


def profile(**tags: bytes) -> bytes:
    """Return an ICC profile with the given tags and an empty header."""
    start = 128 + 4 + 12 * len(tags)
    table, content = struct.pack(">I", len(tags)), b""
    for name, tag in tags.items():
        table += struct.pack(">4sII", name.encode(), start + len(content), len(tag))
        content += tag
    return bytes(128) + table + content


@pytest.mark.parametrize(
    ("icc", "expected"),
    [
        (SRGB, "srgb"),
        (profile(gTRC=curve(*np.rint(65535 * DECODED).astype(int).tolist())), "srgb"),
        (profile(gTRC=curve(round(2.2 * 256))), "srgb"),
        (profile(kTRC=curve(round(2.2 * 256))), "srgb"),
        (profile(gTRC=parametric(3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)), "srgb"),
        (profile(gTRC=curve()), "linear"),
        (profile(gTRC=curve(256)), "linear"),
        (profile(gTRC=parametric(0, 1.0)), "linear"),
        (profile(gTRC=curve(0, 65535)), "linear"),
        (profile(gTRC=curve(round(1.8 * 256))), None),
        (profile(desc=b"mluc" + "sRGB v4 preference".encode("utf-16-be")), "srgb"),
        (profile(desc=b"desc" + b"U.S. Web Coated (SWOP) v2"), None),
        (profile(gTRC=curve(1, 2, 3)[:14]), None),
        (b"damaged", None),
    ],
)
def test_profile_declares_its_transfer_function(icc, expected):
    assert declared_transfer(profile=icc) == expected


def test_profile_precedes_srgb_chunk_which_precedes_gamma():
    assert declared_transfer(profile=profile(gTRC=curve()), has_srgb_chunk=True, gamma=0.45455) == "linear"
    assert declared_transfer(has_srgb_chunk=True, gamma=1.0) == "srgb"
    assert [declared_transfer(gamma=g) for g in (0.45455, 1.0, 0.6, 0.0)] == ["srgb", "linear", None, None]


@pytest.mark.parametrize(("icc", "srgb"), [(SRGB, True), (profile(gTRC=curve()), False)])
@pytest.mark.parametrize("channels", [2, 3, 4])
def test_16_bit_color_png_follows_its_profile(tmp_path, channels, icc, srgb):
    values = np.full((2, 2, channels), 1000, np.uint16)
    more = chunk(b"iCCP", b"ICC Profile\0\0" + zlib.compress(icc))
    (tmp_path / "a.png").write_bytes(png(values, [0], more))
    assert read_picture(str(tmp_path / "a.png")).srgb == srgb


@pytest.mark.parametrize("format", ["PNG", "JPEG"])
@pytest.mark.parametrize("mode", ["L", "RGB"])
@pytest.mark.parametrize(("icc", "srgb"), [(SRGB, True), (profile(gTRC=curve()), False)])
def test_8_bit_image_follows_its_profile(tmp_path, mode, format, icc, srgb):
    buffer = io.BytesIO()
    Image.new(mode, (2, 2)).save(buffer, format, icc_profile=icc)
    (tmp_path / "image").write_bytes(buffer.getvalue())
    assert read_picture(str(tmp_path / "image")).srgb == srgb


def test_16_bit_gray_png_follows_its_profile(tmp_path):
    Image.fromarray(np.full((2, 2), 1000, np.uint16)).save(tmp_path / "a.png", icc_profile=SRGB)
    assert read_picture(str(tmp_path / "a.png")).srgb


def test_damaged_profile_chunk_is_ignored(tmp_path):
    (tmp_path / "a.png").write_bytes(png(np.zeros((1, 1, 3), np.uint16), [0], chunk(b"iCCP", b"name\0\0garbage")))
    assert not read_picture(str(tmp_path / "a.png")).srgb
