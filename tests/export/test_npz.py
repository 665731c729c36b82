# SPDX-License-Identifier: Apache-2.0
"""NPZ export: every buffer exactly, read by NumPy alone."""

import io
import zipfile

import numpy as np

from tests.export.fake_stream import FakeStream
from tiscene.export import npz
from tiscene.export.array_files import resolved


def test_every_buffer_is_read_back_exactly():
    frame = FakeStream()[7]
    files = resolved(npz.encode(frame))
    assert list(files) == ["000007.npz"]
    loaded = np.load(io.BytesIO(files["000007.npz"]))
    assert list(loaded) == list(frame.buffers)
    for name, buffer in frame.buffers.items():
        assert loaded[name].dtype == buffer.dtype
        np.testing.assert_array_equal(loaded[name], buffer)


def test_members_have_a_fixed_date():
    (data,) = resolved(npz.encode(FakeStream()[7])).values()
    assert {member.date_time for member in zipfile.ZipFile(io.BytesIO(data)).infolist()} == {(1980, 1, 1, 0, 0, 0)}
