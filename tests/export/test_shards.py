# SPDX-License-Identifier: Apache-2.0
"""An export in shards, each by a stream of its own, has the bytes of one run, with every preset."""

from pathlib import Path

import pytest

import tiscene as ts
from tests.stream.test_stream import moving_scenario
from tiscene.export import export, merge
from tiscene.export.shards import SHARDS, Shard, machine
from tiscene.render.render_settings import PRESETS

FRAMES = 8


def stream(preset: str) -> ts.Stream:
    spp = min(2, PRESETS[preset].spp)
    size = {"width": 16, "height": 12, "buffers": ("rgb", "hdr", "instance", "forward_flow")}
    return ts.Stream(moving_scenario(), **size, quality=preset, spp=spp, base_spp=4, frames=FRAMES)


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file() and SHARDS not in path.parts)
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.parametrize("preset", PRESETS)
def test_merged_shards_equal_one_run(preset, tmp_path):
    export(stream(preset), tmp_path / "whole", format="npz")
    for number in (2, 0, 3, 1, 0):
        shard = Shard(number, 4, (0, FRAMES, 1), machine())
        folder = shard.folder(tmp_path / "parts")
        export(stream(preset), folder, format="npz", frames=shard.own_frames, pack=False)
        shard.save(folder)
    merge(tmp_path / "parts")
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")
