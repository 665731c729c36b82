# SPDX-License-Identifier: Apache-2.0
"""PNG export: every buffer is read back exactly, or within the precision stated in `png.py`."""

import io
import struct
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from tests.export.fake_stream import FakeStream
from tiscene.errors import ExportError
from tiscene.export import png
from tiscene.export.array_files import resolved
from tiscene.frame.buffers import BUFFERS


def read(name: str, data: bytes) -> np.ndarray:
    if name.endswith(".npy"):
        return np.load(io.BytesIO(data))
    if name.endswith(".flo"):
        tag, width, height = struct.unpack_from("<fii", data)
        assert tag == np.float32(202021.25)
        assert data[:4] == b"PIEH"
        return np.frombuffer(data, "<f4", offset=12).reshape(height, width, 2)
    return np.asarray(Image.open(io.BytesIO(data)))


def frame(**buffers):
    return SimpleNamespace(index=3, buffers=buffers)


def test_every_buffer_is_read_back():
    original = FakeStream()[12]
    files = resolved(png.encode(original))
    assert len(files) == len(BUFFERS)
    for name, data in files.items():
        folder, file = name.split("/")
        assert file.startswith("000012.")
        buffer, loaded = original.buffers[folder], read(name, data)
        if folder in ("depth", "distance"):
            hit = np.isfinite(buffer)
            assert loaded.dtype == np.uint16
            assert (loaded[~hit] == 0).all()
            np.testing.assert_allclose(loaded[hit] / 1000.0, buffer[hit], atol=0.00051)
        elif buffer.dtype == np.bool_:
            np.testing.assert_array_equal(loaded, buffer * 255)
        else:
            np.testing.assert_array_equal(loaded, buffer)


def test_suffixes_are_those_of_the_documentation():
    suffixes = {name.split("/")[0]: name.rpartition(".")[2] for name in resolved(png.encode(FakeStream()[0]))}
    assert {name for name, suffix in suffixes.items() if suffix == "flo"} == {"forward_flow", "backward_flow"}
    assert {name for name, suffix in suffixes.items() if suffix == "png"} == {
        *("rgb", "depth", "distance", "semantic", "instance", "part", "forward_occlusion", "backward_occlusion")
    }


def test_depth_is_rounded_to_millimeters_and_clipped():
    depth = np.array([[0.0001, 0.0015, 65.5349, 65.535, 1e6, np.inf]], np.float32)
    loaded = read("x.png", resolved(png.encode(frame(depth=depth)))["depth/000003.png"])
    assert loaded.tolist() == [[1, 2, 65535, 65535, 65535, 0]]


def test_id_beyond_16_bits_raises_export_error():
    ids = np.array([[0, 65535]], np.int32)
    assert read("x.png", resolved(png.encode(frame(instance=ids)))["instance/000003.png"]).tolist() == [[0, 65535]]
    with pytest.raises(ExportError, match=r"'instance' has the id 65536.*exr or npz"):
        resolved(png.encode(frame(instance=ids + 1)))
    with pytest.raises(ExportError, match=r"'semantic' has the id 70000; this format holds ids 0\.\.65535"):
        resolved(png.encode(frame(semantic=np.array([[70_000]], np.int32))))
    with pytest.raises(ExportError, match=r"'instance' has the id -1"):
        resolved(png.encode(frame(instance=ids - 1)))
