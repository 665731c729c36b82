# SPDX-License-Identifier: Apache-2.0
"""Checkpoints: states from which later ones are computed again, in bounded memory."""

from __future__ import annotations

from typing import TypeVar

State = TypeVar("State")


class Checkpoints(dict[int, State]):
    """States by number, at intervals that double whenever there are too many states.

    Args:
        interval: Initial number of steps between two states.
        limit: Largest number of states.

    Attributes:
        interval: Present number of steps between two states.
    """

    def __init__(self, interval: int, limit: int) -> None:
        super().__init__()
        self.interval, self._limit = interval, limit

    def add(self, number: int, state: State, *, always: bool = False) -> None:
        """Keep a state if its number is a multiple of the interval, or `always`. One that is kept stays."""
        if number in self or (number % self.interval and not always):
            return
        self[number] = state
        if len(self) > self._limit:
            self.interval *= 2
            for each in [each for each in self if each % self.interval]:
                del self[each]
