# SPDX-License-Identifier: Apache-2.0
"""Worker processes on one machine: each runs a command of its own, and is started again if it dies."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import IO

from tiscene.errors import DeviceError, StageWarning

INCOMPLETE = 3  # exit status of a command that has made a data set, of which scenarios have an error
MAX_DEATHS = 3  # of each worker
POLL_INTERVAL = 0.2  # s
WARNING = "tiscene: warning: "
PARENT = "TISCENE_WORKER_OF"  # environment variable that `tiscene.cli.interruption` reads


@dataclass
class _Worker:
    """A process that runs a command; `errors` is what it writes to stderr, at its end wherever it is read meanwhile."""

    arguments: Sequence[str]
    errors: IO[bytes] = field(default_factory=lambda: tempfile.TemporaryFile("a+b"))  # noqa: SIM115
    process: subprocess.Popen[bytes] | None = None
    deaths: int = 0

    def start(self, threads: int) -> None:
        """Start the command."""
        environment = os.environ | {"TI_CPU_MAX_NUM_THREADS": str(threads), PARENT: str(os.getpid())}
        command = [sys.executable, "-m", "tiscene", *self.arguments]
        # Not in this process group: Ctrl-C is passed on by `run_workers`, once.
        self.process = subprocess.Popen(
            command, env=environment, stdout=subprocess.DEVNULL, stderr=self.errors, start_new_session=True
        )

    def lines(self) -> list[str]:
        """Return the lines that the process has written to stderr so far."""
        self.errors.seek(0)
        return self.errors.read().decode(errors="replace").strip().splitlines()

    def message(self) -> str:
        """Return the last line that the process wrote to stderr."""
        lines = self.lines()
        return lines[-1].removeprefix("tiscene: ") if lines else "it wrote nothing to stderr"

    def warnings(self) -> list[str]:
        """Return the warnings that the process has written so far; their further lines are indented."""
        found: list[str] = []
        for line in self.lines():
            if line.startswith(WARNING):
                found.append(line.removeprefix(WARNING))
            elif line.startswith(" ") and found:
                found[-1] += f"\n{line}"
        return found


def run_workers(commands: Sequence[Sequence[str]], progress: Callable[[], None] | None = None) -> None:
    """Run `tiscene` commands at the same time until all have succeeded; the processor is divided among them.

    Their warnings are passed on, each once.

    A worker that dies by a signal, such as one that the system kills for its memory, is started again. Workers end
    soon after this process, however it ends.

    Args:
        commands: The arguments of each.
        progress: Called now and then.

    Raises:
        DeviceError: A command failed, or a worker died too often. All others have been stopped.
        KeyboardInterrupt: All workers have been interrupted and have ended.
    """
    threads = max(1, len(os.sched_getaffinity(0)) // len(commands)) if hasattr(os, "sched_getaffinity") else 1
    workers = [_Worker(command) for command in commands]
    shown: set[str] = set()
    try:
        for worker in workers:
            worker.start(threads)
        running = list(workers)
        while running:
            time.sleep(POLL_INTERVAL)
            running = [worker for worker in running if not _has_succeeded(worker, threads)]
            for text in (text for worker in workers for text in worker.warnings() if text not in shown):
                shown.add(text)
                warnings.warn(StageWarning(text), stacklevel=2)
            if progress is not None:
                progress()
    finally:
        _stop(workers)


def shard_commands(arguments: Sequence[str], count: int) -> list[list[str]]:
    """Return the command of each of some workers: a command with `--workers`, with `--shard` in its place."""
    kept = [each for each in arguments if not each.startswith("--workers=")]
    while "--workers" in kept:
        place = kept.index("--workers")
        del kept[place : place + 2]
    return [[*kept, "--shard", f"{number}/{count}"] for number in range(count)]


def _has_succeeded(worker: _Worker, threads: int) -> bool:
    """Return whether a worker has ended well; start it again if it has died."""
    status = worker.process.poll() if worker.process is not None else None
    if status is None:
        return False
    if status < 0 and worker.deaths < MAX_DEATHS:
        worker.deaths += 1
        worker.start(threads)
        return False
    if status not in (0, INCOMPLETE):
        how = f"died {worker.deaths + 1} times by signal {-status}" if status < 0 else worker.message()
        raise DeviceError(f"the worker `tiscene {' '.join(worker.arguments)}` failed: {how}")
    return True


def _stop(workers: Sequence[_Worker]) -> None:
    """Interrupt the workers that run, and wait until they have saved their manifests."""
    for worker in workers:
        if worker.process is not None and worker.process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                worker.process.send_signal(signal.SIGINT)
    for worker in workers:
        if worker.process is not None:
            try:
                worker.process.wait(timeout=30.0)
            except subprocess.TimeoutExpired:
                worker.process.kill()
                worker.process.wait()
        worker.errors.close()
