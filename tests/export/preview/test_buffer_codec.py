# SPDX-License-Identifier: Apache-2.0
"""Values on a page, decoded by a plain version of `values.js`."""

import base64
import zlib

import numpy as np
import pytest

from tests.export.fake_stream import fake_buffer
from tiscene.export.preview import buffer_codec as codec
from tiscene.export.preview.buffer_codec import PageBuffer, ValueEncoder, quantize
from tiscene.frame.buffers import BUFFERS
from tiscene.frame.visualize import limits_of


def decode(text: str, shape: tuple[int, ...], previous: np.ndarray | None) -> np.ndarray:
    """Decode one pixel after the other, as the page does."""
    planes, height, width = shape
    data = np.frombuffer(zlib.decompress(base64.b64decode(text[1:]), -zlib.MAX_WBITS), np.uint8)
    parts = np.moveaxis(data.reshape(planes, 4, height, width), 1, -1)
    zigzag = np.ascontiguousarray(parts).view("<u4")[..., 0].astype(np.int64)
    residual = (zigzag >> 1) ^ -(zigzag & 1)
    values = np.zeros(shape, np.int64)
    for plane in range(planes):
        for y in range(height):
            for x in range(width):
                left = values[plane, y, x - 1] if x else 0
                up = values[plane, y - 1, x] if y else 0
                corner = values[plane, y - 1, x - 1] if x and y else 0
                median = sorted((left, up, left + up - corner))[1]
                predicted = median if text[0] == "k" else previous[plane, y, x]
                total = int(predicted + residual[plane, y, x])
                values[plane, y, x] = (total + 2**31) % 2**32 - 2**31
    return values


@pytest.mark.parametrize("name", [name for name in BUFFERS if PageBuffer(BUFFERS[name], (0, 1)).has_values])
def test_values_of_every_buffer_decode_to_the_rounded_array(name):
    page_buffer = PageBuffer(BUFFERS[name], (0.0, 1.0))
    encoder, previous = ValueEncoder(page_buffer), None
    for index in range(3):
        array = fake_buffer(name, index, 7, 5)
        expected = quantize(array, page_buffer.decimals)
        previous = decode(encoder.encode(array), expected.shape, previous)
        np.testing.assert_array_equal(previous, expected)
        finite = np.isfinite(array.astype(float))
        shown = np.moveaxis(previous.reshape(-1, 5, 7), 0, -1).reshape(array.shape) / 10.0**page_buffer.decimals
        np.testing.assert_allclose(shown[finite], array[finite], atol=0.501 * 10.0**-page_buffer.decimals)


def test_numbers_that_are_not_finite_or_too_large_keep_their_meaning():
    array = np.array([[np.inf, -np.inf, np.nan, 1e30, -1e30, 0.0015]])
    assert quantize(array, 3).ravel().tolist() == [
        codec.POSITIVE_INFINITY,
        codec.NEGATIVE_INFINITY,
        codec.NOT_A_NUMBER,
        codec.LARGEST,
        -codec.LARGEST,
        2,
    ]
    encoded = ValueEncoder(PageBuffer(BUFFERS["depth"], (0, 1))).encode(array.astype(np.float32))
    np.testing.assert_array_equal(decode(encoded, (1, 1, 6), None), quantize(array.astype(np.float32), 3))


def test_ids_are_exact_to_32_bits():
    ids = np.array([[0, 2**31 - 9, 1, 2**30]], np.int32)
    encoded = ValueEncoder(PageBuffer(BUFFERS["instance"], (0, 1))).encode(ids)
    np.testing.assert_array_equal(decode(encoded, (1, 1, 4), None)[0], ids)


def test_frames_that_do_not_change_are_small_and_a_key_comes_at_least_every_eighth_time():
    encoder = ValueEncoder(PageBuffer(BUFFERS["depth"], (0, 1)))
    depth = np.random.default_rng(1).random((48, 64)).astype(np.float32)
    encoded = [encoder.encode(depth) for _ in range(17)]
    assert "".join(each[0] for each in encoded) == "kdddddddkdddddddk"
    assert len(encoded[1]) < len(encoded[0]) / 50


def test_pictures_of_ids_are_exact_and_share_their_colors():
    import io

    from PIL import Image

    instance = fake_buffer("instance", 0, 12, 8)
    page_buffer = PageBuffer(BUFFERS["instance"], limits_of("instance", [instance]))
    shown = np.asarray(Image.open(io.BytesIO(base64.b64decode(page_buffer.picture(instance)))).convert("RGB"))
    for id in np.unique(instance):
        assert len(np.unique(shown[instance == id], axis=0)) == 1
