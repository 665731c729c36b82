# SPDX-License-Identifier: Apache-2.0
"""Validation of the arguments of streams, worlds and render settings.

All functions raise ArgumentError with the argument's name, its value and what is expected. The checks that need no
range are those of `dynamics.argument_checks`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any

from dynamics import argument_checks
from tiscene.errors import ArgumentError


def integer(name: str, value: Any, low: int, high: int) -> int:
    """Return `value` as an int from `low` to `high`, both included; `sys.maxsize` stands for no upper limit."""
    result = argument_checks.whole(value, name)
    if not low <= result <= high:
        expected = f"from {low} to {high}" if high < sys.maxsize else f"at least {low}"
        raise ArgumentError(f"{name}={value}: must be {expected}")
    return result


def number(name: str, value: Any) -> float:
    """Return `value` as a finite float."""
    return argument_checks.number(value, name)


def positive(name: str, value: Any) -> float:
    """Return `value` as a finite float above 0."""
    return argument_checks.positive(value, name)


def distinct_names(name: str, value: Any) -> tuple[str, ...]:
    """Return `value`, a sequence of one or more different and non-empty strings, as a tuple."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise ArgumentError(f"{name}={value!r}: must be a sequence of names, such as ('chair', 'ball')")
    result = tuple(value)
    if not result or not all(isinstance(each, str) and each for each in result):
        raise ArgumentError(f"{name}={result!r}: must be one or more names, none of them empty")
    repeated = [each for index, each in enumerate(result) if each in result[:index]]
    if repeated:
        raise ArgumentError(f"{name}: {repeated[0]!r} is named twice; name each once")
    return result


def shutter_times(value: Any) -> tuple[float, float]:
    """Return the times at which a shutter opens and closes, in frames."""
    try:
        opens, closes = map(float, value)
    except (TypeError, ValueError):
        raise ArgumentError(f"shutter={value!r}: must be two numbers of frames, such as (0, 0.5)") from None
    if not -1.0 <= opens <= closes <= 1.0:
        raise ArgumentError(f"shutter={value!r}: must be -1 <= open <= close <= 1 frames")
    return opens, closes
