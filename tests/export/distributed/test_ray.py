# SPDX-License-Identifier: Apache-2.0
"""Exports and data sets on a Ray cluster have the bytes of one process, also if workers and nodes are lost."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.export.distributed.ray_cluster import COUNT, FRAMES, SETTINGS, recipe
from tests.export.folders import contents
from tiscene.cli import main as cli
from tiscene.cli.parser import parser
from tiscene.errors import ExportError, MissingExtra
from tiscene.export import distributed, export
from tiscene.export.distributed.ray_worker import RayWorker
from tiscene.export.distributed.worker_processes import shard_commands
from tiscene.export.generation.generator import generate
from tiscene.export.manifest import listed_frames
from tiscene.export.shards import SHARDS
from tiscene.stream.stream import Stream

MAX_MEMORY = 700e6  # bytes of a worker that renders labels
ENVIRONMENT = os.environ | {"RAY_USAGE_STATS_ENABLED": "0"}


class CountedWork:
    """Work that counts steps, in place of rendering."""

    def __init__(self, error=None):
        self.error, self.done = error, []

    def open(self):
        if self.error:
            raise self.error
        return {"seed": 1}

    def run(self, task, check):
        check()
        self.done.append(task)


def worker(tmp_path, work, present=True):
    if present:
        (tmp_path / "run").touch()
    return RayWorker(work, tmp_path / "run", tmp_path, {"TISCENE_TEST_THREADS": "3"})


def test_worker_reports_results_and_errors_as_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TISCENE_TEST_THREADS", "1")
    work = CountedWork()
    first = worker(tmp_path, work)
    assert os.environ["TISCENE_TEST_THREADS"] == "3"
    assert first.open().opened.depends == {"seed": 1}
    assert first.run(4).error == ""
    assert work.done == [4]
    (tmp_path / "run").unlink()
    first._checked_at = float("-inf")
    assert first.run(5).error == "stopped"
    assert work.done == [4]
    assert worker(tmp_path, CountedWork(ExportError("disk full"))).open().error == "disk full"
    assert "ZeroDivisionError: by 0" in worker(tmp_path, CountedWork(ZeroDivisionError("by 0"))).open().error


def test_folder_that_nodes_do_not_share_is_an_error_with_the_cure(tmp_path):
    outcome = worker(tmp_path, CountedWork(), present=False).open()
    assert outcome.opened is None
    assert "workers write into one folder that all nodes share" in outcome.error
    assert "--shard" in outcome.error


def test_missing_ray_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingExtra, match=r"ray is not installed: pip install 'tiscene\[ray\]'"):
        distributed.render("object_view", tmp_path, frames=range(2))


def test_address_is_read_from_the_command_line(capsys):
    render = ["render", "object_view", "-o", "out"]
    assert parser().parse_args(render).ray is None
    assert parser().parse_args([*render, "--ray"]).ray == ""
    assert parser().parse_args([*render, "--ray", "10.0.0.5:6379"]).ray == "10.0.0.5:6379"
    for wrong in (["--ray", "room_02"], ["--ray", "--workers", "2"]):
        with pytest.raises(SystemExit):
            parser().parse_args([*render, *wrong])
    assert "not allowed with argument --ray" in capsys.readouterr().err


def test_commands_of_workers_have_a_shard_in_place_of_workers():
    for given in (["--workers", "2"], ["--workers=2"]):
        commands = shard_commands(["generate", "r.json", *given, "-n", "4"], 2)
        assert commands == [["generate", "r.json", "-n", "4", "--shard", f"{number}/2"] for number in range(2)]


def on_cluster(kind, folder, nodes, faults):
    pytest.importorskip("ray")
    command = [sys.executable, "-m", "tests.export.distributed.ray_cluster", kind, str(folder), str(nodes), faults]
    done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "last"), [("render", FRAMES), ("generate", COUNT)])
def test_killed_worker_and_removed_node_do_not_change_an_export_or_a_data_set(tmp_path, kind, last):
    report = on_cluster(kind, tmp_path / "ray", 3, "kill")
    assert len(report["faults"]) == 2
    assert report["last"] == last
    assert report["peak"] < MAX_MEMORY
    if kind == "generate":
        generate(recipe(), tmp_path / "one", COUNT)
    else:
        with Stream("solid_benchmark", **SETTINGS) as stream:
            export(stream, tmp_path / "one", format="webdataset", frames=range(FRAMES))
    assert contents(tmp_path / "ray") == contents(tmp_path / "one")


@pytest.mark.slow
def test_interrupted_command_is_continued_and_a_finished_one_renders_nothing(tmp_path):
    pytest.importorskip("ray")
    render = ["render", "solid_benchmark", "--width", "32", "--height", "24", "--buffers", "instance,depth"]
    render += ["--frames", "0:600", "-o", str(tmp_path / "ray")]
    command = [sys.executable, "-m", "tiscene", *render, "--ray", "local"]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT)
    shards = tmp_path / "ray" / SHARDS
    while len(listed_frames(*shards.glob("*"))) < 5:
        time.sleep(0.1)
        assert running.poll() is None, running.communicate()
    running.send_signal(signal.SIGINT)
    out, errors = running.communicate(timeout=60)
    assert (running.returncode, out) == (130, "")
    assert "The same command continues from there" in errors
    assert not list((tmp_path / "ray").glob(".tiscene-run-*"))
    done = len(listed_frames(*shards.glob("*")))
    assert 5 <= done < 600
    first = next(path for path in sorted(shards.rglob("*.png")))
    written = first.stat().st_mtime_ns
    subprocess.run(command, check=True, env=ENVIRONMENT, capture_output=True)
    assert cli.main([*render[:-1], str(tmp_path / "one")]) == 0
    assert contents(tmp_path / "ray") == contents(tmp_path / "one")
    kept = (tmp_path / "ray").joinpath(*first.relative_to(shards).parts[1:])
    assert kept.stat().st_mtime_ns == written
    again = subprocess.run(command, check=True, env=ENVIRONMENT, capture_output=True, text=True)
    assert again.stdout == f"{tmp_path / 'ray'}\n"
    assert not shards.exists()
    other = subprocess.run([*command, "--seed", "3"], env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert other.returncode == 2
    assert "settings.seed: 0 in the folder, 3 requested" in other.stderr
    bad = subprocess.run([*command, "--camera", "Nobody"], env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert bad.returncode == 2
    assert "worker 1 on" in bad.stderr
    assert "no camera 'Nobody'" in bad.stderr
    assert Path(kept).is_file()
