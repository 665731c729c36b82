# SPDX-License-Identifier: Apache-2.0
"""Default progress bar of streams (stderr, terminals only)."""

from __future__ import annotations

import sys
import time

DELAY = 2.0  # s; shorter preparations show no bar
WIDTH = 24  # characters of a full bar


class ProgressBar:
    """A progress callback that draws a bar on a terminal and erases it when the work is done."""

    def __init__(self) -> None:
        self._task = ""
        self._start = 0.0
        self._visible = False

    def __call__(self, task: str, done: float) -> None:
        """Report progress.

        Args:
            task: what is being prepared.
            done: fraction of it, 0..1.
        """
        if task != self._task or done == 0.0:
            self._task, self._start = task, time.monotonic()
        if done >= 1.0:
            self._erase()
        elif time.monotonic() - self._start >= DELAY and sys.stderr.isatty():
            full = round(WIDTH * done)
            self._write(f"\rtiscene: {task} [{'#' * full}{' ' * (WIDTH - full)}]")
            self._visible = True

    def _erase(self) -> None:
        self._task = ""
        if self._visible:
            self._write("\r\033[K")
            self._visible = False

    def _write(self, text: str) -> None:
        sys.stderr.write(text)
        sys.stderr.flush()
