# SPDX-License-Identifier: Apache-2.0
"""Validation of the arguments of streams, worlds and render settings.

All functions raise ArgumentError with the argument's name, its value and what is expected. The checks that need no
range are those of `dynamics.argument_checks`.
"""

from __future__ import annotations

import sys
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


def shutter_times(value: Any) -> tuple[float, float]:
    """Return the times at which a shutter opens and closes, in frames."""
    try:
        opens, closes = map(float, value)
    except (TypeError, ValueError):
        raise ArgumentError(f"shutter={value!r}: must be two numbers of frames, such as (0, 0.5)") from None
    if not -1.0 <= opens <= closes <= 1.0:
        raise ArgumentError(f"shutter={value!r}: must be -1 <= open <= close <= 1 frames")
    return opens, closes
