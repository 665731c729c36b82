# SPDX-License-Identifier: Apache-2.0
"""What a library says while it prepares: nothing to files, nothing for what is short, and it wipes its line."""

from __future__ import annotations

import io
import sys

import pytest

from tiscene.stream import progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_a_terminal_shows_what_is_long(monkeypatch: pytest.MonkeyPatch, clock: list[float]) -> None:
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    report = progress.ProgressBar()
    report("base image", 0.1)
    clock[0] = 1.9
    report("base image", 0.4)
    assert terminal.getvalue() == ""
    clock[0] = 2.1
    report("base image", 0.5)
    assert terminal.getvalue() == "\rtiscene: base image [############            ]"
    report("base image", 1.0)
    assert terminal.getvalue().endswith("]\r\033[K")
    report("paths", 0.0)  # a work of its own, with its own patience
    clock[0] = 3.0
    report("paths", 0.5)
    assert "paths" not in terminal.getvalue()


def test_files_are_told_nothing(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    report = progress.ProgressBar()
    report("base image", 0.1)
    clock[0] = 5.0
    report("base image", 0.5)
    report("base image", 1.0)
    assert capsys.readouterr() == ("", "")
