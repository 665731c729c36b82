# SPDX-License-Identifier: Apache-2.0
"""EXR export: parts, channel names, types and values."""

from types import SimpleNamespace

import numpy as np
import OpenEXR
import pytest

from tests.export.fake_stream import FakeStream
from tiscene.export import exr
from tiscene.export.array_files import resolved


@pytest.fixture
def parts(tmp_path):
    def read(frame):
        path = tmp_path / "frame.exr"
        (data,) = resolved(exr.encode(frame)).values()
        path.write_bytes(data)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return {
                part.name(): {name: channel.pixels.copy() for name, channel in part.channels.items()}
                for part in file.parts
            }

    return read


def test_every_buffer_is_a_part_of_its_type(parts):
    frame = FakeStream()[5]
    assert list(resolved(exr.encode(frame))) == ["000005.exr"]
    loaded = parts(frame)
    assert set(loaded) == set(frame.buffers)
    channels = {
        "rgb": ("BGR", np.float16),
        "hdr": ("BGR", np.float16),
        "albedo": ("BGR", np.float16),
        "depth": ("Z", np.float32),
        "position": ("XYZ", np.float32),
        "uv": ("UV", np.float32),
        "backward_flow": ("UV", np.float32),
        "roughness": ("Y", np.float32),
        "forward_occlusion": ("Y", np.float16),
    }
    for name, (letters, dtype) in channels.items():
        assert sorted(loaded[name]) == list(letters)
        assert {plane.dtype for plane in loaded[name].values()} == {np.dtype(dtype)}
    for name in ("semantic", "instance", "part"):
        np.testing.assert_array_equal(loaded[name]["id"], frame.buffers[name])
        assert loaded[name]["id"].dtype == np.uint32
    for rank in range(6):
        for k, what in enumerate(("id", "weight")):
            np.testing.assert_array_equal(loaded["coverage"][f"{what}{rank}"], frame.coverage[..., rank, k])
            of_materials = frame.material_coverage[..., rank, k]
            np.testing.assert_array_equal(loaded["material_coverage"][f"{what}{rank}"], of_materials)
    for name, buffer in frame.buffers.items():
        if name not in (*exr.COLORS, "semantic", "instance", "part", "coverage", "material_coverage"):
            letters = "XYZ" if "X" in loaded[name] else "UV" if "U" in loaded[name] else loaded[name]
            planes = np.stack([loaded[name][letter] for letter in letters], axis=2)
            np.testing.assert_array_equal(planes.reshape(buffer.shape), buffer.astype(np.float32))


def test_rgb_is_recovered_exactly_from_half_floats(parts):
    values = np.arange(256, dtype=np.uint8).reshape(16, 16)
    frame = SimpleNamespace(index=0, buffers={"rgb": np.stack([values] * 3, axis=2)})
    linear = parts(frame)["rgb"]["G"].astype(np.float64)
    display = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    np.testing.assert_array_equal(np.round(display * 255.0), values)


def test_radiance_beyond_half_is_clamped_and_infinite_depth_is_kept(parts):
    buffers = {"hdr": np.full((2, 2, 3), 1e6, np.float32), "depth": np.full((2, 2), np.inf, np.float32)}
    loaded = parts(SimpleNamespace(index=0, buffers=buffers))
    assert (loaded["hdr"]["R"] == 65504.0).all()
    assert np.isposinf(loaded["depth"]["Z"]).all()
