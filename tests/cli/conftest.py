# SPDX-License-Identifier: Apache-2.0
"""A fake stream takes the place of rendering in commands."""

import pytest

from tests.cli.fake_command_stream import FakeCommandStream


@pytest.fixture
def fake(monkeypatch):
    from tiscene.cli import bench, demo, render

    monkeypatch.setattr(FakeCommandStream, "made", [])
    for command in (bench, demo, render):
        monkeypatch.setattr(command, "Stream", FakeCommandStream)
    return FakeCommandStream
