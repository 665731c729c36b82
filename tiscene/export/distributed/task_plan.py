# SPDX-License-Identifier: Apache-2.0
"""TaskPlan: which task each worker does next."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from tiscene.errors import DeviceError

MAX_ATTEMPTS = 4  # of each task
MAX_TASK = 16  # frames or scenarios of one task, up to MAX_TASKS tasks
MIN_TASKS = 64  # tasks that a run is cut into, if it has as many frames
MAX_TASKS = 2000


def task_size(count: int) -> int:
    """Return how many consecutive frames or scenarios make one task.

    It depends on their number alone, so that a run on another cluster continues the same tasks.
    """
    return max(1, min(MAX_TASK, count // MIN_TASKS), -(-count // MAX_TASKS))


class TaskPlan:
    """Hands out numbered tasks to workers. A worker gets consecutive tasks as far as possible, since its caches fit.

    A worker that has come to the end of its run of tasks takes the second half of the longest run that is left.

    Args:
        tasks: Numbers of the tasks.
    """

    def __init__(self, tasks: Iterable[int]) -> None:
        self._runs: list[range] = []  # tasks that nobody has, ascending
        self._last: dict[str, int] = {}  # the task that each worker had last, or has
        self._held: dict[str, int] = {}
        self._attempts: Counter[int] = Counter()
        self.done: list[int] = []  # in the order of their ends; skipped tasks too
        for task in sorted(set(tasks)):
            self._put(task)

    @property
    def finished(self) -> bool:
        """Whether all tasks are done."""
        return not self._runs and not self._held

    @property
    def held(self) -> list[int]:
        """Tasks that workers have."""
        return sorted(self._held.values())

    def take(self, worker: str) -> int | None:
        """Return the next task of a worker that has none; None if no task is left."""
        if not self._runs:
            return None
        place = next((place for place, run in enumerate(self._runs) if run[0] == self._last.get(worker, -2) + 1), None)
        if place is None:
            place = max(range(len(self._runs)), key=lambda place: len(self._runs[place]))
        run = self._runs[place]
        others = {task for other, task in self._held.items() if other != worker}
        start = len(run) // 2 if run[0] - 1 in others else 0  # another worker will continue with the first half
        self._runs[place : place + 1] = [part for part in (run[:start], run[start + 1 :]) if part]
        self._last[worker] = self._held[worker] = run[start]
        self._attempts[run[start]] += 1
        return run[start]

    def finish(self, worker: str) -> int:
        """Note that a worker has done its task. Returns the task."""
        task = self._held.pop(worker)
        self.done.append(task)
        return task

    def give_back(self, worker: str, reason: str) -> None:
        """Hand out the task of a worker again, because it has failed or the worker is lost.

        Args:
            worker: The worker; nothing happens if it has no task.
            reason: What happened, for the error.

        Raises:
            DeviceError: The task has failed too often.
        """
        task = self._held.pop(worker, None)
        self._last.pop(worker, None)
        if task is None:
            return
        if self._attempts[task] >= MAX_ATTEMPTS:
            raise DeviceError(f"task {task} failed {self._attempts[task]} times, the last time on {worker}: {reason}")
        self._put(task)

    def skip(self, tasks: Iterable[int]) -> None:
        """Leave out tasks that nobody has and that need not be done."""
        skipped = set(tasks)
        runs, self._runs = self._runs, []
        for run in runs:
            for task in run:
                if task in skipped:
                    self.done.append(task)
                else:
                    self._put(task)

    def _put(self, task: int) -> None:
        """Add a task to the runs."""
        place = sum(run[0] < task for run in self._runs)
        before = self._runs[place - 1] if place and self._runs[place - 1].stop == task else range(task, task)
        after = self._runs[place] if place < len(self._runs) and self._runs[place][0] == task + 1 else range(0)
        first, stop = before.start, after.stop if after else task + 1
        self._runs[place - bool(before) : place + bool(after)] = [range(first, stop)]
