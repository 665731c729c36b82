# SPDX-License-Identifier: Apache-2.0
"""Values of functions of one object, kept as long as the object exists."""

from __future__ import annotations

import functools
import weakref
from collections.abc import Callable
from typing import TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")


def weakly_cached(function: Callable[[Key], Value]) -> Callable[[Key], Value]:
    """Compute the value of a function for an object once, and keep it as long as the object exists.

    Args:
        function: The function. Objects are told apart as keys of a dictionary, and its values must not refer to them.
    """
    known: weakref.WeakKeyDictionary[Key, Value] = weakref.WeakKeyDictionary()

    @functools.wraps(function)
    def cached(key: Key) -> Value:
        if key not in known:
            known[key] = function(key)
        return known[key]

    return cached
