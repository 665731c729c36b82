# SPDX-License-Identifier: Apache-2.0
"""Progress bars and notes on stderr, so that stdout has nothing but a command's result."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

LINE_EVERY = 60.0  # s between lines of progress, where stderr is no terminal


@contextmanager
def progress(task: str, total: int) -> Iterator[Callable[..., None]]:
    """Show a progress bar. Where stderr is no terminal, as in a log file, print a line each minute instead.

    Args:
        task: The text beside the bar.
        total: The number of steps; 0: unknown.

    Yields:
        `step(advance=1, task=None)`, to be called after each step; `task` replaces the text.
    """
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    bar = Progress(*columns, console=console, transient=True)
    with bar if console.is_terminal else nullcontext():  # rich before 14.3 ends even a disabled bar with an empty line
        bar_task = bar.add_task(task, total=total or None)
        next_line = time.monotonic() + LINE_EVERY

        def step(advance: int = 1, task: str | None = None) -> None:
            nonlocal next_line
            bar.update(bar_task, advance=advance, description=task)
            if not console.is_terminal and time.monotonic() >= next_line:
                shown = bar.tasks[0]
                count = f"{shown.completed:g} of {shown.total:g}" if shown.total else f"{shown.completed:g}"
                note(f"{shown.description}: {count}")
                next_line = time.monotonic() + LINE_EVERY

        yield step


def task_shown(step: Callable[..., None]) -> Callable[[str, float], None]:
    """Return the `progress` of a Stream that shows its tasks beside a progress bar.

    Args:
        step: That of the bar.
    """
    return lambda task, fraction: step(0, task=f"{task}: {fraction:.0%}")


def total_shown(step: Callable[..., None]) -> Callable[..., None]:
    """Return a function that sets a progress bar to a number of steps, `show(count, task=None)`.

    Args:
        step: That of the bar.
    """
    shown = 0

    def show(count: int, task: str | None = None) -> None:
        nonlocal shown
        step(max(0, count - shown), task=task)
        shown = max(shown, count)

    return show


def note(text: str) -> None:
    """Print a line to stderr."""
    Console(stderr=True, highlight=False, soft_wrap=True).print(text, markup=False)
