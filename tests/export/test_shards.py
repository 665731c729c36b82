# SPDX-License-Identifier: Apache-2.0
"""An export in four parts, each by a stream of its own, has the bytes of one run."""

from pathlib import Path

import pytest

import tiscene as ts
from tests.stream.test_stream import moving_scenario
from tiscene.export import export
from tiscene.render.render_settings import PRESETS

FRAMES = 8


def stream(preset: str) -> ts.Stream:
    spp = min(2, PRESETS[preset].spp)
    size = {"width": 16, "height": 12, "buffers": ("rgb", "hdr", "instance", "forward_flow")}
    return ts.Stream(moving_scenario(), **size, quality=preset, spp=spp, base_spp=4, frames=FRAMES)


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*.npz"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.parametrize("preset", PRESETS)
def test_four_shards_equal_one_run(preset, tmp_path):
    export(stream(preset), tmp_path / "whole", format="npz")
    parts = {}
    for shard in (2, 0, 3, 1):
        folder = tmp_path / f"shard{shard}"
        export(stream(preset), folder, format="npz", frames=range(shard, FRAMES, 4))
        parts |= contents(folder)
    assert parts == contents(tmp_path / "whole")
    assert len(parts) == FRAMES
