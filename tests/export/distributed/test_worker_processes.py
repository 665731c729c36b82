# SPDX-License-Identifier: Apache-2.0
"""Worker processes: failures are reported, killed workers are started again, bytes are those of one process."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from tests.export.folders import contents
from tests.export.generation.test_recipe import RECIPE
from tiscene.cli import main as cli
from tiscene.errors import DeviceError, StageWarning
from tiscene.export.distributed import worker_processes
from tiscene.export.distributed.worker_processes import run_workers
from tiscene.export.manifest import listed_frames
from tiscene.export.shards import SHARDS

RENDER = ["render", "solid_benchmark", "--width", "32", "--height", "24", "--buffers", "instance,depth,forward_flow"]
RENDER += ["--format", "webdataset"]


def test_failing_command_is_reported_with_its_reason():
    with pytest.raises(
        DeviceError, match=r"the worker `tiscene show nowhere_at_all` failed: no scene 'nowhere_at_all'"
    ):
        run_workers([["list", "--json"], ["show", "nowhere_at_all"]])


def test_warnings_of_workers_are_passed_on_once(tmp_path):
    broken = tmp_path / "broken.usda"
    broken.write_text('#usda 1.0\ndef Cube "Box" (references = @gone.usda@) {}\n')
    with pytest.warns(StageWarning) as warned:
        run_workers([["show", str(broken)]] * 2)
    texts = [str(each.message) for each in warned]
    assert any("broken.usda is not drawn quite as authored:\n  </Box> composition: Could" in text for text in texts)
    assert len(set(texts)) == len(texts)


def test_killed_worker_is_started_again_but_not_forever(monkeypatch):
    started = []
    start = worker_processes._Worker.start

    def start_and_kill(worker, threads):
        start(worker, threads)
        started.append(worker)
        if len(started) <= killed:
            os.kill(worker.process.pid, signal.SIGKILL)

    monkeypatch.setattr(worker_processes._Worker, "start", start_and_kill)
    killed = 2
    run_workers([["list", "--json"]])
    assert len(started) == 3
    started.clear()
    killed = 10
    with pytest.raises(DeviceError, match="died 4 times by signal 9"):
        run_workers([["list", "--json"]])


@pytest.mark.slow
def test_workers_write_the_bytes_of_one_process_also_if_one_is_killed(tmp_path, capsys):
    frames = ["--frames", "0:2400"]  # a worker saves its manifest after 1,000
    assert cli.main([*RENDER, *frames, "-o", str(tmp_path / "one")]) == 0

    def kill_one():
        shard = tmp_path / "two" / SHARDS / "00001-of-00002"
        while not listed_frames(shard):
            time.sleep(0.01)
        lock = (shard / ".tiscene.lock").read_text()
        os.kill(int(lock.split()[1]), signal.SIGKILL)

    killer = threading.Thread(target=kill_one)
    killer.start()
    assert cli.main([*RENDER, *frames, "--workers", "2", "-o", str(tmp_path / "two")]) == 0
    killer.join()
    assert contents(tmp_path / "two") == contents(tmp_path / "one")


@pytest.mark.slow
def test_interrupted_workers_are_continued_by_the_same_command(tmp_path):
    command = [sys.executable, "-m", "tiscene", *RENDER, "--frames", "0:400", "--workers", "2", "-o", str(tmp_path)]
    running = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    shards = [tmp_path / SHARDS / f"{number:05d}-of-00002" for number in range(2)]
    while len(listed_frames(*shards)) < 2:
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)
    _, errors = running.communicate(timeout=60)
    assert running.returncode in (130, -signal.SIGINT)
    assert "The same command continues from there" in errors
    done = len(listed_frames(*shards))
    assert 2 <= done < 400
    subprocess.run(command, check=True)
    assert not (tmp_path / SHARDS).exists()


@pytest.mark.slow
def test_workers_generate_the_data_set_of_one_process(tmp_path):
    recipe = tmp_path / "recipe.json"
    recipe.write_text(json.dumps(RECIPE | {"scenes": ["object_view"]}))
    generate = ["generate", str(recipe), "-n", "6"]
    assert cli.main([*generate, "-o", str(tmp_path / "one")]) == 0
    assert cli.main([*generate, "-o", str(tmp_path / "two"), "--workers", "2"]) == 0
    assert contents(tmp_path / "two") == contents(tmp_path / "one")


@pytest.mark.slow
@pytest.mark.parametrize("handler", [signal.SIG_DFL, signal.SIG_IGN])
def test_workers_end_when_their_command_is_killed(handler, tmp_path):
    command = [sys.executable, "-m", "tiscene", *RENDER, "--frames", "0:100000", "--workers", "2", "-o", str(tmp_path)]
    before = signal.signal(signal.SIGINT, handler)  # ignored by background jobs of a script, and inherited
    running = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    signal.signal(signal.SIGINT, before)
    locks = [tmp_path / SHARDS / f"{number:05d}-of-00002" / ".tiscene.lock" for number in range(2)]
    while not all(lock.exists() and lock.read_text() for lock in locks):
        time.sleep(0.05)
    workers = [int(lock.read_text().split()[1]) for lock in locks]
    running.kill()
    running.wait()
    end = time.monotonic() + 20.0
    while any(map(is_running, workers)) and time.monotonic() < end:
        time.sleep(0.05)
    left = [worker for worker in workers if is_running(worker)]
    for worker in left:
        os.kill(worker, signal.SIGKILL)
    assert not left


def is_running(process: int) -> bool:
    """Return whether a process exists and has not ended; no one may have asked for the status of an orphan."""
    try:
        status = Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return False
    return status.rpartition(")")[2].split()[0] != "Z"
