# SPDX-License-Identifier: Apache-2.0
"""RayWorker: the actor that runs on a node of a Ray cluster, in a process with a Taichi of its own."""

from __future__ import annotations

import os
import socket
import time
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from tiscene.errors import ExportError, StageWarning, TisceneError
from tiscene.export.distributed.task_loop import Opened, Work
from tiscene.export.shards import machine

CHECK_INTERVAL = 1.0  # s between two looks at the run's file


@dataclass(frozen=True)
class Outcome:
    """What a call of a worker returns; exceptions of the worker arrive as text, since not all of them can be sent.

    Attributes:
        opened: The report of `open`.
        error: The message of an error; "" without one.
        warnings: Texts of StageWarnings.
    """

    opened: Opened | None = None
    error: str = ""
    warnings: tuple[str, ...] = ()


class RunStopped(Exception):
    """The caller has ended the run."""


class RayWorker:
    """Does tasks of a run, one at a time.

    Args:
        work: What to do.
        run_file: A file in the output folder that exists while the caller runs: it shows that the folder is shared.
        working_folder: The caller's, for relative paths; left alone if it does not exist here.
        environment: Environment variables to set before Taichi starts.
    """

    def __init__(self, work: Work, run_file: Path, working_folder: Path, environment: Mapping[str, str]) -> None:
        os.environ.update(environment)
        if working_folder.is_dir():
            os.chdir(working_folder)
        self._work, self._run_file = work, run_file
        self._checked_at = 0.0

    def open(self) -> Outcome:
        """Prepare the work."""

        def prepare() -> Opened:
            if not self._run_file.exists():
                raise ExportError(
                    f"the folder {str(self._run_file.parent)!r} of the caller is not on {socket.gethostname()!r}: "
                    "workers write into one folder that all nodes share. Name one on a shared file system, or render "
                    "with --shard on each machine and merge copies of the shards"
                )
            return Opened(self._work.open(), machine())

        return _caught(prepare)

    def run(self, task: int) -> Outcome:
        """Do a task."""

        def do() -> None:
            self._work.run(task, self._check)

        return _caught(do)

    def _check(self) -> None:
        """Raise RunStopped if the caller has ended the run."""
        if time.monotonic() - self._checked_at > CHECK_INTERVAL:
            self._checked_at = time.monotonic()
            if not self._run_file.exists():
                raise RunStopped


def _caught(do: Callable[[], Opened | None]) -> Outcome:
    """Return the result, the error and the warnings of a function."""
    error, opened = "", None
    with warnings.catch_warnings(record=True) as recorded:
        warnings.simplefilter("always", StageWarning)
        try:
            opened = do()
        except RunStopped:
            error = "stopped"
        except TisceneError as mistake:
            error = str(mistake)
        except Exception as mistake:
            lines = traceback.format_exception(mistake, limit=-3)
            error = "".join(lines).strip()
    texts = [str(each.message) for each in recorded if issubclass(each.category, StageWarning)]
    return Outcome(opened, error, tuple(dict.fromkeys(texts)))
