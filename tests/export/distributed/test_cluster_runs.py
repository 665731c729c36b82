# SPDX-License-Identifier: Apache-2.0
"""Runs on a cluster: merged, continued, extended and refused as exports of one process. Workers are in this process."""

import contextlib
import copy
import json

import pytest

from tests.export.folders import contents
from tests.export.generation.test_recipe import RECIPE
from tiscene.errors import ArgumentError, DeviceError, ExportError
from tiscene.export import distributed, export
from tiscene.export.distributed import cluster_runs
from tiscene.export.distributed.ray_worker import RayWorker
from tiscene.export.distributed.task_loop import PoolEvent
from tiscene.export.generation.generator import generate
from tiscene.export.generation.recipe import Recipe
from tiscene.stream.stream import Stream

FRAMES = range(2, 9)
SETTINGS = {"width": 24, "height": 18, "buffers": ("instance", "depth")}


class LocalPool:
    """Two workers in this process, which take turns; `interrupt_at` counts tasks until Ctrl-C."""

    interrupt_at = None
    done = 0

    def __init__(self, work, run_file, *, arch, cpus):
        self.workers = {name: RayWorker(copy.copy(work), run_file, run_file.parent, {}) for name in ("a", "b")}
        self.calls = [(name, "open", ()) for name in self.workers]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def start_workers(self):
        pass

    def submit(self, worker, task):
        self.calls.append((worker, "run", (task,)))

    def wait(self, timeout):
        worker, method, arguments = self.calls.pop(0)
        outcome = getattr(self.workers[worker], method)(*arguments)
        if outcome.error:
            raise DeviceError(outcome.error)
        if method == "open":
            return [PoolEvent(worker, "opened", opened=outcome.opened)]
        LocalPool.done += 1
        if LocalPool.done == LocalPool.interrupt_at:
            raise KeyboardInterrupt
        return [PoolEvent(worker, "done")]


@pytest.fixture(autouse=True)
def local(monkeypatch):
    monkeypatch.setattr(cluster_runs, "RayPool", LocalPool)
    monkeypatch.setattr(cluster_runs, "connected", lambda address: contextlib.nullcontext())
    monkeypatch.setattr(LocalPool, "done", 0)
    monkeypatch.setattr(LocalPool, "interrupt_at", None)


def render(folder, frames=FRAMES, **options):
    LocalPool.done = 0
    return distributed.render("solid_benchmark", folder, frames=frames, **SETTINGS, **options)


@pytest.mark.parametrize("format", ["png", "webdataset"])
def test_export_is_continued_and_a_finished_one_is_left_alone(tmp_path, monkeypatch, format):
    with Stream("solid_benchmark", **SETTINGS) as stream:
        export(stream, tmp_path / "one", format=format, frames=FRAMES)
    counts = []
    monkeypatch.setattr(LocalPool, "interrupt_at", 3)
    with pytest.raises(KeyboardInterrupt):
        render(tmp_path / "many", format=format)
    assert len(list((tmp_path / "many" / "shards").glob("*/tiscene.json"))) == 3
    monkeypatch.setattr(LocalPool, "interrupt_at", None)
    manifest = render(tmp_path / "many", format=format, progress=counts.append)
    assert list(manifest.frames) == list(FRAMES)
    assert contents(tmp_path / "many") == contents(tmp_path / "one")
    assert counts == sorted(counts)
    assert counts[-1] == len(FRAMES)
    render(tmp_path / "many", format=format)
    assert LocalPool.done == 0
    assert contents(tmp_path / "many") == contents(tmp_path / "one")


def test_export_of_other_settings_is_refused_or_replaced_and_a_longer_one_keeps_frames(tmp_path):
    render(tmp_path)
    assert list(render(tmp_path, range(2, 12)).frames) == list(range(2, 12))
    assert LocalPool.done == 3
    with pytest.raises(ExportError, match=r"settings\.seed: 0 in the folder, 3 requested"):
        render(tmp_path, seed=3)
    assert list(render(tmp_path, range(2), seed=3, overwrite=True).frames) == [0, 1]
    assert not list(tmp_path.rglob("000005.*"))


def test_mistakes_are_reported_before_workers_start(tmp_path):
    with pytest.raises(ArgumentError, match="cpus=0: must be at least 1"):
        render(tmp_path, cpus=0)
    with pytest.raises(ArgumentError, match="has no frames"):
        render(tmp_path, range(0))
    with pytest.raises(DeviceError, match="no camera 'Nobody'"):
        render(tmp_path, camera="Nobody")
    assert not list(tmp_path.glob(".tiscene-run-*"))


def test_data_set_has_the_bytes_of_one_process(tmp_path):
    recipe, counts = Recipe.from_json(RECIPE | {"scenes": ["object_view"], "frames": 2}), []
    generate(recipe, tmp_path / "one", 3)
    distributed.generate(recipe, tmp_path / "many", 3, progress=counts.append)
    assert contents(tmp_path / "many") == contents(tmp_path / "one")
    assert counts[-1] == 3
    LocalPool.done = 0
    data_set = distributed.generate(recipe, tmp_path / "many", 3)
    assert LocalPool.done == 0
    about = {"number": 1, "split": recipe.split(1), "error": "its scene is not there"}
    (data_set.scenario_folder(1) / "summary.json").write_text(json.dumps(about))  # now it is
    distributed.generate(recipe, tmp_path / "many", 3)
    assert contents(tmp_path / "many") == contents(tmp_path / "one")
