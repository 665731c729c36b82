# SPDX-License-Identifier: Apache-2.0
"""`tiscene measure`: the table, the JSON and the plot agree with `frame.difficulty`."""

from __future__ import annotations

import json

import pytest

import tiscene as ts
from tiscene.cli import main as cli
from tiscene.frame.difficulty import MEASURES


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "run.json"
    way = ts.LinearWaypoints([ts.Waypoint((-0.5, 1, -3)), ts.Waypoint((0.5, 1, -3))], total_time=2.0)
    ts.Scenario("object_view", [ts.Object("a", "Sphere", dynamic=way)]).save(path)
    return path


def test_measure_prints_a_table_and_writes_json_and_a_plot(scenario, tmp_path, capsys):
    out = tmp_path / "out"
    command = ["measure", str(scenario), "-o", str(out), "--frames", "0:30:10", "--width", "32", "--height", "24"]
    assert cli.main(command) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["measure", "mean", "min", "max"]
    assert [line.split()[0] for line in lines[1:-1]] == list(MEASURES)
    assert lines[-1] == str(out)
    content = json.loads((out / "difficulty.json").read_text())
    assert content["frames"] == [0, 10, 20]
    with ts.Stream(str(scenario), width=32, height=24, buffers=("instance", "forward_flow")) as stream:
        expected = [stream[k].difficulty for k in (0, 10, 20)]
    assert content["measures"]["motion"] == [each.motion for each in expected]
    assert content["summary"]["size"]["max"] == max(each.size for each in expected)
    assert content["measures"]["contrast"] == [None] * 3
    assert (out / "difficulty.png").read_bytes().startswith(b"\x89PNG")


def test_measure_refuses_endless_ranges_and_unknown_scenes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["measure", "object_view", "--frames", "5:"]) == 2
    assert "must have an end" in capsys.readouterr().err
    assert cli.main(["measure", "object_vew"]) == 2
    assert "Did you mean 'object_view'" in capsys.readouterr().err
    (tmp_path / "file").write_text("")
    assert cli.main(["measure", "object_view", "--frames", "0:1", "--width", "8", "--height", "6", "-o", "file"]) == 2
    assert "tiscene: cannot write 'file': it is a file, not a folder" in capsys.readouterr().err
    assert not list(tmp_path.glob("tiscene-measure*"))
