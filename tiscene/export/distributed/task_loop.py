# SPDX-License-Identifier: Apache-2.0
"""The loop that keeps the workers of a pool busy with tasks until all are done."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from tiscene.errors import DeviceError, StageWarning
from tiscene.export.distributed.task_plan import TaskPlan
from tiscene.export.manifest_difference import differences, listing

POLL_INTERVAL = 0.5  # s
PATIENCE = 300.0  # s without any worker


class Work(Protocol):
    """What the workers do. The caller has one, and each worker a copy of its own."""

    def open(self) -> dict[str, Any]:
        """Prepare, in a worker. Returns everything that results depend on, which must be the same in all workers."""

    def run(self, task: int, check: Callable[[], None]) -> None:
        """Do a task, in a worker. `check` is called now and then, and raises an exception if the run was stopped."""

    def size(self, task: int) -> int:
        """Return the number of frames or scenarios of a task."""

    def steps(self, task: int) -> int:
        """Return how many frames or scenarios of a task are there, in the caller."""


@dataclass(frozen=True)
class Opened:
    """What a worker reports once it is prepared.

    Attributes:
        depends: What results depend on (see `Work.open`).
        machine: What bytes depend on beside that (see `shards.machine`).
    """

    depends: dict[str, Any]
    machine: dict[str, str]


@dataclass(frozen=True)
class PoolEvent:
    """Something that happened to a worker.

    Attributes:
        worker: Its name.
        kind: "opened", "done", "failed" (an error, the worker is there) or "lost" (the worker is gone).
        opened: Its report, if it was opened.
        reason: The error.
        warnings: Texts of warnings.
    """

    worker: str
    kind: Literal["opened", "done", "failed", "lost"]
    opened: Opened | None = None
    reason: str = ""
    warnings: Sequence[str] = ()


class Pool(Protocol):
    """Workers somewhere. Each has one task at a time, so that nothing piles up where one is slow."""

    def start_workers(self) -> None:
        """Start workers on nodes that have none. Raises DeviceError if no node can have one."""

    def wait(self, timeout: float) -> Sequence[PoolEvent]:
        """Return what has happened since the last call; wait for something for some seconds."""

    def submit(self, worker: str, task: int) -> None:
        """Give a worker a task."""


def run_tasks(
    pool: Pool,
    plan: TaskPlan,
    *,
    unlike: bool = False,
    opened: Callable[[dict[str, Any]], None] | None = None,
    progress: Callable[[], None] | None = None,
) -> None:
    """Run all tasks of a plan on the workers of a pool.

    Tasks of workers that are lost or report an error are done again, by any worker.

    Args:
        pool: The workers.
        plan: The tasks.
        unlike: Whether workers may be machines that render other bytes.
        opened: Called once with what the first worker reports that results depend on, before it gets a task.
        progress: Called now and then.

    Raises:
        DeviceError: A task failed too often; a worker cannot be prepared; workers are unlike; or there are none.
    """
    reference: PoolEvent | None = None
    idle: list[str] = []
    shown: set[str] = set()
    busy_at = time.monotonic()
    while not plan.finished:
        pool.start_workers()
        for event in pool.wait(POLL_INTERVAL):
            for text in event.warnings:
                if text not in shown:
                    shown.add(text)
                    warnings.warn(text, StageWarning, stacklevel=3)
            if event.kind == "opened":
                if reference is None:
                    reference = event
                    if opened is not None and event.opened is not None:
                        opened(event.opened.depends)
                _check_alike(reference, event, unlike)
            elif event.kind == "done":
                plan.finish(event.worker)
            else:
                plan.give_back(event.worker, event.reason)
            if event.kind == "lost":
                idle = [worker for worker in idle if worker != event.worker]
            else:
                idle.append(event.worker)
        waiting, idle = idle, []
        for worker in waiting:
            task = plan.take(worker)
            if task is None:
                idle.append(worker)
            else:
                pool.submit(worker, task)
        if plan.held or plan.finished:
            busy_at = time.monotonic()
        elif time.monotonic() - busy_at > PATIENCE:
            raise DeviceError(
                f"no worker has started for {PATIENCE:.0f} s. Are all processors of the cluster in use? "
                "`ray status` shows them; workers with fewer processors (cpus=, --worker-cpus) fit beside other jobs"
            )
        if progress is not None:
            progress()


def _check_alike(first: PoolEvent, other: PoolEvent, unlike: bool) -> None:
    """Raise DeviceError if two workers would write different bytes."""
    if first.opened is None or other.opened is None:
        return
    workers = f"{first.worker} and {other.worker}"
    found = differences(first.opened.depends, other.opened.depends)
    if found:
        raise DeviceError(f"{workers} have other versions or files of the scene:{listing(found)}")
    one, two = first.opened.machine, other.opened.machine
    names = [name for name in one if one[name] != two.get(name)]
    if names and not unlike:
        raise DeviceError(
            f"{workers} are unlike machines ({', '.join(names)}), whose color may differ in "
            "the last bits: use nodes of one kind, or permit it with unlike=True (--unlike)"
        )
