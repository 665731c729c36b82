# SPDX-License-Identifier: Apache-2.0
"""A buffer added from outside the package, in one file."""

import numpy as np
import pytest

import tiscene as ts
from tiscene.errors import ArgumentError, BufferNotFound
from tiscene.export import export
from tiscene.frame.buffers import BUFFERS, Buffer, register_buffer

INVERSE_DEPTH = Buffer(
    "inverse_depth",
    "float32",
    (),
    "1/m",
    0.0,
    "Inverse of `depth`.",
    inputs=("depth",),
    compute=lambda depth: np.reciprocal(depth),
)


@pytest.fixture
def registered():
    register_buffer(INVERSE_DEPTH)
    yield
    del BUFFERS["inverse_depth"]


def test_registered_buffer_is_streamed_and_exported(registered, tmp_path):
    stream = ts.Stream("object_view", width=16, height=12, frames=1, buffers=("inverse_depth", "instance"))
    frame = stream[0]
    depth = ts.Stream("object_view", width=16, height=12, buffers=("depth",))[0]["depth"]
    assert list(frame) == ["inverse_depth", "instance"]
    np.testing.assert_array_equal(frame.inverse_depth, 1.0 / depth)
    export(stream, tmp_path, format="npz")
    with np.load(tmp_path / "000000.npz") as saved:
        np.testing.assert_array_equal(saved["inverse_depth"], frame.inverse_depth)


def test_unregistered_buffer_is_unknown():
    with pytest.raises(BufferNotFound, match="inverse_depth"):
        ts.Stream("object_view", buffers=("inverse_depth",))


@pytest.mark.parametrize(
    ("buffer", "message"),
    [
        (Buffer("depth", "float32", (), "", 0.0, "", ("depth",), np.copy), "'depth': the name is taken"),
        (Buffer("new", "float32", (), "", 0.0, ""), "'new': give inputs= and compute="),
    ],
)
def test_invalid_buffers_are_refused(buffer, message):
    with pytest.raises(ArgumentError, match=message):
        register_buffer(buffer)
