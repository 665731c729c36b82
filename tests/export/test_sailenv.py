# SPDX-License-Identifier: Apache-2.0
"""The layout of SAILenv's recordings, read back by `Recording` and by plain NumPy."""

import gzip
import json

import numpy as np
import pytest

from tests.export.fake_stream import FakeStream
from tiscene.errors import ArgumentError, ExportError, MissingFile
from tiscene.export import FORMATS, export
from tiscene.export.sailenv_layout import Recording


def classes_of(semantic):
    """Return 0 and 1 for ids 1 and 2, "chair" and "table", and 2 for the background."""
    return np.where((semantic == 0) | (semantic > 2), 2, semantic - 1)


def test_recording_returns_the_exported_frames(tmp_path):
    stream = FakeStream(FORMATS["sailenv"].buffers)
    export(stream, tmp_path, format="sailenv", frames=[0, 1, 99, 100, 101])
    recording = Recording(tmp_path)
    assert (len(recording), recording.fps, recording.categories) == (
        102,
        25.0,
        {0: "chair", 1: "table", 2: "background"},
    )
    for index in (0, 1, 99, 100, 101):
        frame, back = stream[index], recording[index]
        np.testing.assert_array_equal(back.rgb, frame.rgb)
        np.testing.assert_array_equal(back.flow, frame.backward_flow * (1, -1))
        np.testing.assert_array_equal(back.category, classes_of(frame.semantic))
        assert (back.rgb.dtype, back.flow.dtype, back.category.dtype) == (np.uint8, np.float32, np.int32)
    with pytest.raises(IndexError, match=r"0\.\.101"):
        recording[102]
    with pytest.raises(MissingFile, match=r"frames/00000001/051\.png"):
        recording[50]


def test_layout_of_folders_and_files(tmp_path):
    stream = FakeStream(FORMATS["sailenv"].buffers)
    export(stream, tmp_path, format="sailenv", frames=[0, 99, 100])
    for place in ("00000001/001", "00000001/100", "00000002/001"):
        for name in (
            f"frames/{place}.png",
            f"motion/{place}.bin",
            f"sup/{place}.targets.bin",
            f"sup/{place}.indices.bin",
        ):
            assert (tmp_path / name).is_file()
    assert json.loads((tmp_path / "frames/fps.json").read_text()) == {"fps": 25.0, "frames_count": 101}
    assert json.loads((tmp_path / "sup/map.json").read_text()) == {"chair": 0, "table": 1, "background": 2}
    with gzip.open(tmp_path / "sup/00000002/001.targets.bin") as file:
        targets = np.load(file)
    with gzip.open(tmp_path / "sup/00000002/001.indices.bin") as file:
        indices = np.load(file)
    semantic = stream[100].semantic.ravel()
    assert targets.dtype == indices.dtype == np.int32
    np.testing.assert_array_equal(indices, np.arange(semantic.size))
    np.testing.assert_array_equal(targets, classes_of(semantic))
    with gzip.open(tmp_path / "motion/00000001/001.bin") as file:
        assert np.load(file).shape == (8, 12, 2)


def test_overwriting_a_recording_deletes_all_of_its_files(tmp_path):
    export(FakeStream(FORMATS["sailenv"].buffers), tmp_path, format="sailenv", frames=[0])
    export(FakeStream(("rgb",)), tmp_path, format="npz", frames=[0], overwrite=True)
    left = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert left == {"000000.npz", "000000.json", "tiscene.json"}


def test_missing_buffers_and_damaged_files_raise(tmp_path):
    stream = FakeStream(("rgb", "semantic"))
    with pytest.raises(
        ArgumentError, match=r"requires the buffer 'backward_flow': make the stream with buffers=\('rgb', "
    ):
        export(stream, tmp_path, format="sailenv", frames=[0])
    assert stream.rendered == []
    with pytest.raises(MissingFile, match=r"fps\.json"):
        Recording(tmp_path / "nowhere")
    export(FakeStream(FORMATS["sailenv"].buffers), tmp_path, format="sailenv", frames=[0], overwrite=True)
    (tmp_path / "motion/00000001/001.bin").write_bytes(b"nothing")
    with pytest.raises(ExportError, match=r"001\.bin"):
        Recording(tmp_path)[0]
    (tmp_path / "sup/map.json").write_text("{")
    with pytest.raises(ExportError, match=r"map\.json"):
        Recording(tmp_path)
