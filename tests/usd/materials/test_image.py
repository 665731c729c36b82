# SPDX-License-Identifier: Apache-2.0
"""Decoding of PNG, JPEG, OpenEXR and Radiance HDR files, also from packages."""

from __future__ import annotations

import zipfile

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from pxr import Sdf, UsdUtils

from tests.usd.helpers import preview_material, write
from tiscene.usd.materials.image import read_file, read_picture, read_radiance
from tiscene.usd.read.stage_reader import read_stage

RGB = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [10, 20, 30]], [[1, 2, 3], [4, 5, 6]]], dtype=np.uint8)


def opaque(rgb: np.ndarray) -> np.ndarray:
    return np.concatenate([rgb, np.full((*rgb.shape[:2], 1), 255, np.uint8)], axis=-1)


@pytest.mark.parametrize("suffix", ["png", "bmp", "tga", "tif"])
def test_rgb_png_is_opaque_srgb(tmp_path, suffix):
    Image.fromarray(RGB).save(tmp_path / f"a.{suffix}")
    picture = read_picture(str(tmp_path / f"a.{suffix}"))
    np.testing.assert_array_equal(picture.pixels, opaque(RGB))
    assert picture.pixels.dtype == np.uint8
    assert picture.srgb


def test_rgba_png_keeps_alpha(tmp_path):
    rgba = opaque(RGB)
    rgba[..., 3] = 7
    Image.fromarray(rgba).save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_picture(str(tmp_path / "a.png")).pixels, rgba)


@pytest.mark.parametrize("mode", ["RGB", "CMYK", "L"])
def test_jpeg_is_decoded(tmp_path, mode):
    flat = Image.new("RGB", (16, 8), (200, 100, 50)).convert(mode)
    flat.save(tmp_path / "a.jpg", quality=95)
    picture = read_picture(str(tmp_path / "a.jpg"))
    assert picture.pixels.shape == (8, 16, 4)
    expected = np.asarray(flat.convert("RGB"))[0, 0].astype(int)
    assert np.abs(picture.pixels[..., :3].astype(int) - expected).max() <= 4
    assert picture.srgb == (mode != "L")  # one channel of 8 bits is raw


def test_gray_png_is_repeated_and_raw(tmp_path):
    gray = np.array([[0, 100, 255]], dtype=np.uint8)
    Image.fromarray(gray).save(tmp_path / "a.png")
    picture = read_picture(str(tmp_path / "a.png"))
    np.testing.assert_array_equal(picture.pixels[0, :, :3], np.repeat(gray[0][:, None], 3, axis=1))
    assert (picture.pixels[..., 3] == 255).all()
    assert not picture.srgb


def test_gray_png_with_alpha_keeps_alpha(tmp_path):
    channels = [Image.fromarray(np.array([values], dtype=np.uint8)) for values in ([10, 30], [20, 40])]
    Image.merge("LA", channels).save(tmp_path / "a.png")
    picture = read_picture(str(tmp_path / "a.png"))
    np.testing.assert_array_equal(picture.pixels[0], [[10, 10, 10, 20], [30, 30, 30, 40]])
    assert not picture.srgb


@pytest.mark.parametrize(("mode", "colors"), [("RGB", [(9, 8, 7), (9, 8, 6)]), ("L", [9, 8]), ("I;16", [999, 998])])
def test_transparent_color_of_a_png_becomes_alpha(tmp_path, mode, colors):
    image = Image.new(mode, (2, 1), colors[0])
    image.putpixel((1, 0), colors[1])
    image.save(tmp_path / "a.png", transparency=colors[0])
    picture = read_picture(str(tmp_path / "a.png"))
    assert picture.pixels[0, :, 3].tolist() == [0, 1 if mode == "I;16" else 255]
    scale = 65535.0 if mode == "I;16" else 1.0
    expected = [np.broadcast_to(color, 3) / np.float32(scale) for color in colors]
    np.testing.assert_allclose(picture.pixels[0, :, :3], expected)
    assert picture.srgb == (mode == "RGB")


def test_palette_png_is_decoded(tmp_path):
    Image.fromarray(RGB).quantize(6).save(tmp_path / "a.png")
    picture = read_picture(str(tmp_path / "a.png"))
    assert picture.pixels.shape == (3, 2, 4)
    assert picture.srgb


def test_16_bit_gray_png_is_float_and_raw(tmp_path):
    values = np.array([[0, 1000, 65535]], dtype=np.uint16)
    Image.fromarray(values).save(tmp_path / "a.png")
    picture = read_picture(str(tmp_path / "a.png"))
    assert picture.pixels.dtype == np.float32
    np.testing.assert_allclose(picture.pixels[0, :, 1], values[0] / 65535.0, atol=1e-6)
    assert not picture.srgb


def test_srgb_chunk_marks_gray_png_as_srgb(tmp_path):
    from PIL.PngImagePlugin import PngInfo

    info = PngInfo()
    info.add(b"sRGB", b"\0")
    Image.fromarray(np.array([[5]], dtype=np.uint8)).save(tmp_path / "a.png", pnginfo=info)
    assert read_picture(str(tmp_path / "a.png")).srgb


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_exr_channels_become_rgba(tmp_path, dtype, channels):
    values = (np.arange(2 * 3 * channels, dtype=dtype).reshape(2, 3, channels) * 1.5).astype(dtype)
    named = {"RGBA": values} if channels == 4 else {"RGB": values} if channels == 3 else {"Y": values[..., 0].copy()}
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, named) as file:
        file.write(str(tmp_path / "a.exr"))
    picture = read_picture(str(tmp_path / "a.exr"))
    assert picture.pixels.dtype == np.float32
    assert not picture.srgb
    np.testing.assert_array_equal(picture.pixels[..., :3], np.broadcast_to(values[..., :3], (2, 3, 3)))
    np.testing.assert_array_equal(picture.pixels[..., 3], values[..., 3] if channels == 4 else np.ones((2, 3)))


def radiance(width: int, height: int, body: bytes, size: bytes | None = None) -> bytes:
    size = size or f"-Y {height} +X {width}".encode()
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n" + size + b"\n" + body


def test_radiance_without_run_lengths():
    pixels = bytes([128, 64, 0, 129, 255, 0, 0, 136])  # exponents 2^1 and 2^8, over 256
    np.testing.assert_allclose(read_radiance(radiance(2, 1, pixels)), [[[1.0, 0.5, 0.0], [255.0, 0.0, 0.0]]])
    assert not read_radiance(radiance(1, 1, bytes(4))).any()


def test_radiance_with_new_run_length_encoding():
    line = bytes([2, 2, 0, 9])
    red = bytes([128 + 9, 128])  # nine times the same
    green = bytes([9, *range(9)])  # nine as they are
    blue = bytes([128 + 4, 7, 5, 1, 2, 3, 4, 5])
    exponent = bytes([128 + 9, 136])
    values = read_radiance(radiance(9, 2, (line + red + green + blue + exponent) * 2))
    assert values.shape == (2, 9, 3)
    np.testing.assert_array_equal(values[1, :, 0], np.full(9, 128.0))
    np.testing.assert_array_equal(values[0, :, 1], np.arange(9.0))
    np.testing.assert_array_equal(values[0, :, 2], [7, 7, 7, 7, 1, 2, 3, 4, 5])


def test_radiance_with_old_run_length_encoding():
    pixel, run = [9, 0, 0, 136], [1, 1, 1]
    body = bytes([*pixel, *run, 4, 7, 0, 0, 136, *run, 2, *run, 1])  # 1 + 4, then 1 + 2 + 256 times
    values = read_radiance(radiance(264, 1, body))
    np.testing.assert_array_equal(values[0, :, 0], [9.0] * 5 + [7.0] * 259)


def test_radiance_scan_order_is_normalized():
    body = bytes([1, 0, 0, 136, 2, 0, 0, 136, 3, 0, 0, 136, 4, 0, 0, 136])
    assert read_radiance(radiance(2, 2, body))[..., 0].tolist() == [[1, 2], [3, 4]]
    assert read_radiance(radiance(2, 2, body, b"+Y 2 +X 2"))[..., 0].tolist() == [[3, 4], [1, 2]]
    assert read_radiance(radiance(2, 2, body, b"-Y 2 -X 2"))[..., 0].tolist() == [[2, 1], [4, 3]]


@pytest.mark.parametrize(
    ("width", "height", "body", "expected"),
    [
        (131071, 131071, bytes(16), "may have 536,870,912 in all"),
        (16384, 16384, bytes(16), "ends early"),
        (16384, 16384, bytes([2, 2, 64, 0, 137, 1]), "ends early"),
    ],
)
def test_radiance_of_a_size_that_its_bytes_cannot_have_needs_no_memory(monkeypatch, width, height, body, expected):
    monkeypatch.setattr(np, "empty", None)
    with pytest.raises(ValueError, match=expected):
        read_radiance(radiance(width, height, body))


def test_last_run_of_a_radiance_picture_needs_no_more_memory_than_the_picture():
    """The last of four runs repeats its pixel 255 * 2^24 times, in 17 GB."""
    values = read_radiance(radiance(264, 1, bytes([9, 0, 0, 136, *[1, 1, 1, 0] * 3, 1, 1, 1, 255])))
    np.testing.assert_array_equal(values[0, :, 0], 9.0)


@pytest.mark.parametrize(
    "data",
    [
        b"#?RADIANCE\n\n-Y 1 +X 1\n",
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n+X 1 +Y 1\n1234",
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 9999999 +X 1\n1234",
        radiance(2, 2, b"123"),
        radiance(2, 2, bytes([1, 1, 1, 4, 5, 5, 5, 5])),
        radiance(2, 2, bytes([5, 5, 5, 5, 1, 1, 1, 2])),
        radiance(9, 1, bytes([2, 2, 0, 9, 137])),
        radiance(9, 1, bytes([2, 2, 0, 9, 0, 0, 0, 0])),
        radiance(9, 1, bytes([2, 2, 0, 9, 200, 5])),
        radiance(9, 2, bytes([2, 2, 0, 9, *([137, 1] * 4), 2, 2, 0, 8])),
    ],
)
def test_damaged_radiance_raises_value_error(data):
    with pytest.raises(ValueError, match="Radiance"):
        read_radiance(data)


def test_damaged_images_raise_oserror_or_value_error(tmp_path):
    for name, data in {
        "a.exr": b"\x76\x2f\x31\x01 and nothing after it",
        "b.png": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR",
        "c.jpg": b"\xff\xd8\xff\xe0",
        "d.txt": b"hello",
        "e.tif": b"II*\0\xff\xff\xff\xff",
        "f.png": b"",
    }.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises((OSError, ValueError)):
            read_picture(str(tmp_path / name))


@pytest.mark.parametrize("folder", ["plain", "take [2], café"])
def test_image_inside_usdz_is_read(tmp_path, folder):
    tmp_path = tmp_path / folder
    tmp_path.mkdir()
    Image.fromarray(RGB).save(tmp_path / "color.png")
    body = """
def Cube "C" (prepend apiSchemas = ["MaterialBindingAPI"])
{
    rel material:binding = </M>
}
"""
    texture = """def Shader "T"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @color.png@
        float3 outputs:rgb
    }"""
    body += preview_material("/M", "color3f inputs:diffuseColor.connect = </M/T.outputs:rgb>", shaders=texture)
    stage = write(tmp_path, body)
    from pxr import UsdUtils

    package = tmp_path / "packed.usdz"
    assert UsdUtils.CreateNewUsdzPackage(str(stage), str(package))
    assert zipfile.is_zipfile(package)
    (texture,) = read_stage(package, root=tmp_path).textures
    np.testing.assert_array_equal(texture.pixels, opaque(RGB))
    assert texture.name == "color.png"


def test_file_with_a_unicode_name_in_a_package_of_usd(tmp_path):
    """USD writes names as UTF-8 without the flag that says so."""
    Image.new("RGB", (2, 2), (10, 20, 30)).save(tmp_path / "ü 木.png")
    (tmp_path / "stage.usda").write_text('#usda 1.0\ndef "A"\n{\nasset file = @./ü 木.png@\n}\n', encoding="utf-8")
    package = str(tmp_path / "stage.usdz")
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "stage.usda")), package)
    assert read_picture(f"{package}[ü 木.png]").pixels[0, 0].tolist() == [10, 20, 30, 255]


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2])
def test_damaged_compressed_file_in_a_package_raises_value_error(tmp_path, method):
    package = tmp_path / "a.usdz"
    with zipfile.ZipFile(package, "w", method) as archive:
        archive.writestr("b.png", bytes(range(256)))
    data = bytearray(package.read_bytes())
    start = data.index(b"b.png") + 5
    data[start : start + 20] = (byte ^ 0xFF for byte in data[start : start + 20])
    package.write_bytes(data)
    with pytest.raises(ValueError, match="not a readable package"):
        read_file(f"{package}[b.png]")


def test_encrypted_file_in_a_package_raises_value_error(tmp_path):
    package = tmp_path / "a.usdz"
    with zipfile.ZipFile(package, "w") as archive:
        archive.writestr("b.png", b"123")
    data = bytearray(package.read_bytes())
    for signature, offset in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
        data[data.index(signature) + offset] |= 1
    package.write_bytes(data)
    with pytest.raises(ValueError, match="encrypted"):
        read_file(f"{package}[b.png]")
