# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the tests of exports."""

import pytest

from tests.export.fake_stream import FRAMES, FakeStream, fake_stream_for, skip_without_extra
from tiscene.export import export


@pytest.fixture
def exported(tmp_path):
    """Export a fake stream in a format; return the folder and the frames."""

    def run(format, buffers=None, **arguments):
        skip_without_extra(format)
        stream = FakeStream(buffers, **arguments) if buffers else fake_stream_for(format, **arguments)
        export(stream, tmp_path, format=format, frames=range(FRAMES), objects="all")
        return tmp_path, [stream[index] for index in range(FRAMES)]

    return run
