# SPDX-License-Identifier: Apache-2.0
"""`tiscene merge` of shards of an export."""

import contextlib

from tiscene.cli import main as cli
from tiscene.cli import merge
from tiscene.export.manifest import Manifest
from tiscene.export.packing import PACKING


def test_shard_leaves_what_a_merge_is_packing(tmp_path, fake):
    render = ["render", "somewhere", "--width", "12", "--height", "8", "-o", str(tmp_path), "--frames", "0:5"]
    assert cli.main(render) == 0
    half = tmp_path / PACKING / "half"
    half.mkdir(parents=True)
    assert cli.main([*render, "--shard", "0/2"]) == 0
    assert half.exists()


def test_merge_shows_progress_towards_the_number_of_frames(tmp_path, fake, monkeypatch, capsys):
    size = ("--width", "12", "--height", "8")
    for shard in ("0/2", "1/2"):
        assert cli.main(["render", "somewhere", *size, "-o", str(tmp_path), "--frames", "0:5", "--shard", shard]) == 0
    totals, steps = [], []

    @contextlib.contextmanager
    def progress(task, total):
        totals.append(total)
        yield lambda **_: steps.append(1)

    monkeypatch.setattr(merge, "progress", progress)
    assert cli.main(["merge", str(tmp_path)]) == 0
    assert (totals, len(steps)) == ([5], 5)
    assert capsys.readouterr().out.splitlines()[-1] == str(tmp_path)


def test_shards_of_other_settings_replace_merged_ones_on_request(tmp_path, fake, capsys):
    render = ["render", "somewhere", "--width", "12", "--height", "8", "--frames", "0:5", "-o"]
    assert cli.main([*render, str(tmp_path / "out")]) == 0
    render += [str(tmp_path / "out"), "--seed", "1"]
    for shard in ("0/2", "1/2"):
        assert cli.main([*render, "--shard", shard, "--overwrite"]) == 0
    merging = ["merge", str(tmp_path / "out")]
    assert cli.main(merging) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert cli.main([*merging, "--overwrite"]) == 0
    assert Manifest.load(tmp_path / "out").provenance["settings"]["seed"] == 1
