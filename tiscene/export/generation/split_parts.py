# SPDX-License-Identifier: Apache-2.0
"""Reading what the scenarios of a split have, to join it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

from tiscene.errors import ExportError, TisceneError

DAMAGE = OSError, EOFError, ValueError, KeyError, IndexError, TypeError  # what reading a damaged file raises


@contextlib.contextmanager
def reading(folder: Path, file: Path) -> Iterator[None]:
    """Convert errors while a file of a scenario is read to one that says how to make it again.

    Args:
        folder: Of the data set.
        file: `<split>/000012/...` in it.

    Raises:
        ExportError: The file is missing or damaged.
    """
    try:
        yield
    except TisceneError:
        raise
    except DAMAGE as error:
        scenario = str(folder.joinpath(*file.relative_to(folder).parts[:2]))
        raise ExportError(f"{str(file)!r} is missing or damaged: delete {scenario!r}, and generate again") from error


def counter(task: str, total: int, progress: Callable[[str, float], None] | None) -> Callable[[], None]:
    """Return a function that reports one step more of a task.

    Args:
        task: The task.
        total: Number of its steps.
        progress: Called with the task and the fraction of it that is done; None: nothing is reported.
    """
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(task, done / total)

    return step
