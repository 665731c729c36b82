# SPDX-License-Identifier: Apache-2.0
"""How commands tell a person what they are doing: on stderr, so that stdout holds only what was asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn


@contextmanager
def progress(doing: str, total: int) -> Iterator[Callable[..., None]]:
    """A progress bar, on a terminal; call what it yields after each step, with `doing=` to change the text."""
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(doing, total=total)

        def step(advance: int = 1, doing: str | None = None) -> None:
            bar.update(task, advance=advance, description=doing)

        yield step


def note(text: str) -> None:
    """One line for the person who waits."""
    Console(stderr=True, highlight=False, soft_wrap=True).print(text, markup=False)
