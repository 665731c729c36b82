# SPDX-License-Identifier: Apache-2.0
"""Exports that are killed at any file operation, several times, end with the bytes of an undisturbed one."""

import random
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest

import tiscene as ts
from tests.export.fake_stream import FAKE_FORMATS, FakeStream, fake_stream_for, skip_without_extra
from tests.export.folders import contents
from tiscene.export import export
from tiscene.export.formats import FORMATS, find_format

FRAMES = 9
# Kills itself before a file operation: renaming a file to its place, or deleting one.
KILLED = """
import os, signal, sys
from pathlib import Path
from tests.export.test_killed_exports import FRAMES, small_files, source
from tiscene.export import export

folder, format, operations = sys.argv[1], sys.argv[2], [int(number) for number in sys.argv[3].split(",")]
small_files(format)
replace, unlink = os.replace, Path.unlink

def kill_before(operation):
    def run(*arguments, **options):
        global left
        left -= 1
        if left < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return operation(*arguments, **options)
    return run

os.replace, Path.unlink = kill_before(replace), kill_before(unlink)
for number in operations:
    child = os.fork()
    if child == 0:
        left = number
        export(source(format), folder, format=format, frames=range(FRAMES))
        os._exit(0)
    print(os.waitpid(child, 0)[1])
"""


def source(format: str) -> FakeStream | ts.Stream:
    """Return a stream with all buffers that a format can hold; one that renders where points are followed."""
    if format in FAKE_FORMATS:
        return fake_stream_for(format)
    path = ts.LinearWaypoints([ts.Waypoint((-0.4, 0.0, 0.2)), ts.Waypoint((0.4, 0.0, 0.2))], total_time=0.4)
    scenario = ts.Scenario("object_view", [ts.Object("cube", "Cube", (-0.4, 0.0, 0.2), dynamic=path)])
    return ts.Stream(scenario, width=32, height=24, buffers=("instance",))


def small_files(format: str, set_attribute: Callable[[Any, str, Any], None] = setattr) -> None:
    """Make files of many frames hold four, so that there are several; `monkeypatch.setattr` undoes it."""
    writer = find_format(format).writer()
    if getattr(writer, "FRAMES_PER_FILE", None):
        set_attribute(writer, "FRAMES_PER_FILE", 4)


def kill(folder, format: str, operations: list[int]) -> list[int]:
    """Run exports, each killed before a file operation; return their wait statuses."""
    command = [sys.executable, "-c", KILLED, str(folder), format, ",".join(map(str, operations))]
    return [int(line) for line in subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()]


def check(tmp_path, monkeypatch, format: str, kills: int) -> None:
    skip_without_extra(format)
    small_files(format, monkeypatch.setattr)
    export(source(format), tmp_path / "whole", format=format, frames=range(FRAMES))
    operations = [random.Random(f"{format} {number}").randrange(1, 40) for number in range(kills)]
    statuses = kill(tmp_path / "killed", format, operations)
    assert 9 in statuses
    export(source(format), tmp_path / "killed", format=format, frames=range(FRAMES))
    assert contents(tmp_path / "killed") == contents(tmp_path / "whole")


def test_killed_export_of_shards_is_continued_to_the_same_bytes(tmp_path, monkeypatch):
    check(tmp_path, monkeypatch, "webdataset", 4)


@pytest.mark.slow
@pytest.mark.parametrize("format", FORMATS)
def test_export_killed_ten_times_is_continued_to_the_same_bytes(tmp_path, monkeypatch, format):
    check(tmp_path, monkeypatch, format, 10)
