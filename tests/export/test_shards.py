# SPDX-License-Identifier: Apache-2.0
"""An export in shards, each by a stream of its own, has the bytes of one run, with every preset."""

import signal
import subprocess
import sys

import pytest

import tiscene as ts
from tests.export.folders import contents, merged
from tests.stream.test_stream import moving_scenario
from tiscene.errors import ExportError
from tiscene.export import export, merge
from tiscene.export.shards import Shard, machine
from tiscene.render.render_settings import PRESETS

FRAMES = 8
# Renders a shard, and kills itself after two frames.
KILLED = """
import os, signal, sys
from tests.export.test_shards import FRAMES, render_shard

def kill(index, frame):
    if index % 3 == 1:
        os.kill(os.getpid(), signal.SIGKILL)

render_shard(sys.argv[1], int(sys.argv[2]), 8, 3 * FRAMES, sys.argv[3], kill)
"""


def stream(preset: str, frames: int = FRAMES) -> ts.Stream:
    spp = min(2, PRESETS[preset].spp)
    size = {"width": 16, "height": 12, "buffers": ("rgb", "hdr", "instance", "forward_flow")}
    return ts.Stream(moving_scenario(), **size, quality=preset, spp=spp, base_spp=4, frames=frames)


def render_shard(preset, number, count, frames, folder, progress=None):
    """Render a shard with a stream of its own."""
    shard = Shard(number, count, (0, frames, 1), machine())
    place = shard.folder(folder)
    shard.save(place)
    with stream(preset, frames) as source:
        export(source, place, format="npz", frames=shard.own_frames, pack=False, progress=progress)


@pytest.mark.parametrize("preset", PRESETS)
def test_merged_shards_equal_one_run(preset, tmp_path):
    export(stream(preset), tmp_path / "whole", format="npz")
    for number in (2, 0, 3, 1, 0):
        render_shard(preset, number, 4, FRAMES, tmp_path / "parts")
    merge(tmp_path / "parts")
    assert merged(tmp_path / "parts") == contents(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.parametrize("preset", PRESETS)
def test_eight_shards_of_which_two_are_killed_equal_one_run(preset, tmp_path):
    frames = 3 * FRAMES
    with stream(preset, frames) as source:
        export(source, tmp_path / "whole", format="npz")
    order = [5, 2, 7, 0, 6, 3, 1, 4]
    for number in (2, 6):
        command = [sys.executable, "-c", KILLED, preset, str(number), str(tmp_path / "parts")]
        assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    for number in (*order, 3):
        if number == 1:
            with pytest.raises(ExportError, match=r"6 frames are missing, the first is 3: render the shards 1/8, 4/8"):
                merge(tmp_path / "parts")
        render_shard(preset, number, 8, frames, tmp_path / "parts")
    merge(tmp_path / "parts")
    assert merged(tmp_path / "parts") == contents(tmp_path / "whole")
