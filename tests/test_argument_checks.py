# SPDX-License-Identifier: Apache-2.0
"""Validation of the arguments of streams and render settings."""

from __future__ import annotations

import numpy as np
import pytest

from dynamics.argument_checks import distinct_names, positive
from tiscene.errors import ArgumentError, BufferNotFound
from tiscene.frame.buffers import buffer_names
from tiscene.render.render_settings import preset
from tiscene.stream.shutter import shutter_times


def test_numpy_numbers_become_plain_ones():
    parts = preset("preview", spp=np.int64(3), max_depth=np.uint8(2), relative_error=np.float32(0.5), denoise=np.False_)
    assert [type(each) for each in (parts.spp, parts.max_depth, parts.relative_error)] == [int, int, float]
    assert parts.denoise is False


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (lambda: positive(0, "fps"), "fps=0: must be greater than 0"),
        (lambda: shutter_times((0.5, 0.0)), r"shutter=\(0.5, 0.0\): must be -1 <= open <= close <= 1"),
        (lambda: shutter_times(0.5), "shutter=0.5: must be two numbers"),
        (lambda: distinct_names("chair", "categories"), "categories='chair': must be a sequence of names"),
        (lambda: distinct_names(3, "categories"), "categories=3: must be a sequence of names"),
        (lambda: distinct_names((), "categories"), r"categories=\(\): must be one or more names"),
        (lambda: distinct_names(("chair", ""), "categories"), "categories=.*none of them empty"),
        (lambda: distinct_names(("chair", 3), "categories"), "categories=.*must be one or more names"),
        (lambda: distinct_names(["a", "b", "a"], "categories"), "categories: 'a' is named twice; name each once"),
        (lambda: preset("preview", max_depth=1.5), "max_depth=1.5: must be a whole number"),
        (lambda: preset("preview", base_spp="many"), "base_spp='many': must be a whole number"),
        (lambda: preset("preview", relative_error="low"), "relative_error='low': must be a number"),
        (lambda: buffer_names(3), "buffers=3: must be a sequence of names"),
        (lambda: buffer_names(()), "buffers=.*name at least one"),
    ],
)
def test_invalid_arguments_raise_argument_error_that_names_them(check, message):
    with pytest.raises(ArgumentError, match=message):
        check()


def test_buffer_names_are_deduplicated_and_checked():
    assert buffer_names(iter(["depth", "rgb", "depth"])) == ("depth", "rgb")
    for wrong, shown in ((3, "3"), (["rgb"], r"\['rgb'\]")):
        with pytest.raises(BufferNotFound, match=f"no buffer {shown}"):
            buffer_names((wrong,))
