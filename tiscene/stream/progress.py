# SPDX-License-Identifier: Apache-2.0
"""What a library says of its own accord: how far a long preparation is, on stderr where that is a terminal."""

from __future__ import annotations

import sys
import time

PATIENCE = 2.0  # s; what is done by then is not worth a word
WIDTH = 24  # characters of a full bar


class ProgressBar:
    """A `report` for whoever gave none: a line with a bar, which is wiped off when the work is done."""

    def __init__(self) -> None:
        self._doing = ""
        self._began = 0.0
        self._shown = False

    def __call__(self, doing: str, done: float) -> None:
        """doing: what is being made. done: how much of it, 0..1."""
        if doing != self._doing or done == 0.0:
            self._doing, self._began = doing, time.monotonic()
        if done >= 1.0:
            self._wipe()
        elif time.monotonic() - self._began >= PATIENCE and sys.stderr.isatty():
            full = round(WIDTH * done)
            self._write(f"\rtiscene: {doing} [{'#' * full}{' ' * (WIDTH - full)}]")
            self._shown = True

    def _wipe(self) -> None:
        self._doing = ""
        if self._shown:
            self._write("\r\033[K")
            self._shown = False

    def _write(self, text: str) -> None:
        sys.stderr.write(text)
        sys.stderr.flush()
