# SPDX-License-Identifier: Apache-2.0
"""A cache of a bounded number of values."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


class LRUCache(Generic[Key, Value]):
    """The values used last, by key: `functools.lru_cache` where the key is not the arguments.

    Args:
        maxsize: Number of values that are kept; the least recently used one is dropped first.
    """

    def __init__(self, maxsize: int) -> None:
        self._maxsize = maxsize
        self._values: dict[Key, Value] = {}  # the least recently used first

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, key: Key) -> bool:
        return key in self._values

    def get(self, key: Key, make: Callable[[], Value]) -> Value:
        """Return the value of a key, which `make` returns where it is not kept.

        Room is made first, so that no more than `maxsize` values need memory at a time.
        """
        if key in self._values:
            value = self._values[key] = self._values.pop(key)
            return value
        while len(self._values) >= self._maxsize:
            del self._values[next(iter(self._values))]
        value = self._values[key] = make()
        return value

    def drop(self, outdated: Callable[[Key], bool]) -> None:
        """Drop the values of all keys for which `outdated` returns True."""
        self._values = {key: value for key, value in self._values.items() if not outdated(key)}
