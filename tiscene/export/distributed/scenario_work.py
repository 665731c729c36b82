# SPDX-License-Identifier: Apache-2.0
"""ScenarioWork: render the scenarios of a data set, a few consecutive ones in each task."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tiscene.export.distributed.task_plan import task_size
from tiscene.export.generation.data_set_index import DataSet
from tiscene.export.generation.generator import ScenarioRenderer


class ScenarioWork:
    """Renders scenarios of a data set. A worker keeps its stream, and with it the scenes that it has read.

    Args:
        data_set: The data set.
        arch: "cpu" or "cuda"; None: as of `Stream`.
    """

    def __init__(self, data_set: DataSet, arch: str | None) -> None:
        self.data_set, self.arch = data_set, arch
        self._size = task_size(data_set.count)
        self.count = -(-data_set.count // self._size)
        self._renderer: ScenarioRenderer | None = None

    def numbers(self, task: int) -> range:
        """Return the scenarios of a task."""
        return range(self.data_set.count)[task * self._size : (task + 1) * self._size]

    def open(self) -> dict[str, Any]:
        """Prepare; scenes are read when they are drawn."""
        self._renderer = ScenarioRenderer(self.data_set, self.arch)
        return {}

    def run(self, task: int, check: Callable[[], None]) -> None:
        """Render the scenarios of a task that are not there."""
        assert self._renderer is not None
        for number in self.numbers(task):
            self._renderer.render(number, lambda *_: check())

    def size(self, task: int) -> int:
        """Return the number of scenarios of a task."""
        return len(self.numbers(task))

    def steps(self, task: int) -> int:
        """Return the number of scenarios of a task that are there."""
        return sum(self.data_set.has(number) for number in self.numbers(task))
