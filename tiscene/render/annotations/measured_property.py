# SPDX-License-Identifier: Apache-2.0
"""Measured: a property that is computed once, while no other thread renders."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

from tiscene.device import runtime

Value = TypeVar("Value")


class Measured(Generic[Value]):
    """A property that is computed at its first access, while no other thread renders: the scene is placed for it.

    `functools.cached_property` of Python 3.11 computes under a lock of its own, for which a thread that renders, and
    reads the property, could wait for ever.
    """

    def __init__(self, function: Callable[[Any], Value]) -> None:
        self._function = function
        self.__doc__ = function.__doc__

    def __get__(self, instance: Any, owner: type | None = None) -> Value:
        return self._value(instance)  # called until the instance has the value itself

    @runtime.one_thread_at_a_time
    def _value(self, instance: Any) -> Value:
        values: dict[str, Any] = instance.__dict__
        name = self._function.__name__
        if name not in values:
            values[name] = self._function(instance)
        value: Value = values[name]
        return value
