# SPDX-License-Identifier: Apache-2.0
"""OpenEXR reads the files of `sparse_exr`, and has the arrays to the bit."""

import numpy as np
import OpenEXR
import pytest

from tiscene.errors import ExportError
from tiscene.export.sparse_exr import scan_lines


def planes(height, width):
    """Return channels of every type: noise, which deflating does not shorten, and mostly 0."""
    noise = np.random.default_rng(height)
    sparse = np.zeros((height, width), np.float32)
    sparse[::3, ::2] = noise.random(sparse[::3, ::2].shape)
    bits = noise.integers(1 << 23, 0x7F000000, (height, width), np.uint32)
    return {
        "B.id": bits.view(np.float32),
        "A.half": noise.random((height, width)).astype(np.float16),
        "empty": np.zeros((height, width), np.float32),
        "sparse": sparse,
        "ids": bits[:, ::-1],  # not contiguous
    }


def read(tmp_path, data):
    path = tmp_path / "file.exr"
    path.write_bytes(data)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        assert len(file.parts) == 1
        assert file.parts[0].type() == OpenEXR.scanlineimage
        return dict(file.header()), {name: channel.pixels for name, channel in file.channels().items()}


@pytest.mark.parametrize(("height", "width"), [(1, 1), (16, 5), (17, 3), (40, 64)])
def test_openexr_reads_channels_of_every_type(tmp_path, height, width):
    channels = planes(height, width)
    header, found = read(tmp_path, scan_lines(channels, {"name": "mattes", "tiscene/note": "Mädchen"}))
    assert header["compression"] == OpenEXR.ZIP_COMPRESSION
    assert (header["name"], header["tiscene/note"]) == ("mattes", "Mädchen")
    assert set(found) == set(channels)
    for name, plane in channels.items():
        assert found[name].dtype == plane.dtype
        np.testing.assert_array_equal(found[name].view(np.uint8), np.ascontiguousarray(plane).view(np.uint8), name)


def test_opencv_reads_the_picture(tmp_path, monkeypatch):
    monkeypatch.setenv("OPENCV_IO_ENABLE_OPENEXR", "1")
    cv2 = pytest.importorskip("cv2")
    picture = np.random.default_rng(0).random((20, 30, 3)).astype(np.float16)
    path = tmp_path / "file.exr"
    path.write_bytes(scan_lines({name: picture[..., k] for k, name in enumerate("RGB")}, {}))
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(found[..., ::-1], picture.astype(np.float32))


def test_empty_planes_take_a_two_hundredth_of_their_bytes():
    empty = {f"plane{number}": np.zeros((64, 256), np.float32) for number in range(24)}
    assert len(scan_lines(empty, {})) < 64 * 256 * 4 * 24 / 200


def test_names_that_readers_would_cut_are_refused():
    with pytest.raises(ExportError, match="at most 31 bytes"):
        scan_lines({"n" * 32: np.zeros((2, 2), np.float32)}, {})
