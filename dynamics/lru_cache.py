# SPDX-License-Identifier: Apache-2.0
"""A cache of a bounded number of values."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from contextlib import suppress
from typing import Any, Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")
_MISSING: Any = object()


class LRUCache(Generic[Key, Value]):
    """The values used last, by key: `functools.lru_cache` where the key is not the arguments.

    Args:
        maxsize: Number of values that are kept; the least recently used one is dropped first.
    """

    def __init__(self, maxsize: int) -> None:
        self._maxsize = maxsize
        # The least recently used first. Threads share it without a lock: each call of the dictionary is atomic, a loop
        # over it is not.
        self._values: OrderedDict[Key, Value] = OrderedDict()

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, key: Key) -> bool:
        return key in self._values

    def get(self, key: Key, make: Callable[[], Value]) -> Value:
        """Return the value of a key, which `make` returns where it is not kept.

        Room is made first, so that no more than `maxsize` values need memory at a time. Where threads ask for one key
        at a time, each may make the value.
        """
        value: Value = self._values.pop(key, _MISSING)
        if value is _MISSING:
            with suppress(KeyError):  # another thread has emptied it
                while len(self._values) >= self._maxsize:
                    self._values.popitem(last=False)
            value = make()
        self._values[key] = value
        return value

    def drop(self, outdated: Callable[[Key], bool]) -> None:
        """Drop the values of all keys for which `outdated` returns True."""
        for key in list(self._values):
            if outdated(key):
                self._values.pop(key, None)
