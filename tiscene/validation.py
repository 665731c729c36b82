# SPDX-License-Identifier: Apache-2.0
"""Checks of what a stream is asked for. All raise ArgumentError, which names the argument."""

from __future__ import annotations

import math
import operator
import sys
from numbers import Real
from typing import Any

from tiscene.errors import ArgumentError


def integer(name: str, value: Any, low: int, high: int) -> int:
    """A whole number within bounds, both included."""
    try:
        number = operator.index(value)
    except TypeError:
        raise ArgumentError(f"{name}={value!r}: must be a whole number") from None
    if not low <= number <= high:
        raise ArgumentError(
            f"{name}={value}: must be from {low} to {high}"
            if high < sys.maxsize
            else f"{name}={value}: must be at least {low}"
        )
    return number


def number(name: str, value: Any) -> float:
    """A finite number."""
    try:
        result = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise ArgumentError(f"{name}={value!r}: must be a finite number")
    return result


def positive(name: str, value: Any) -> float:
    """A finite number above 0."""
    result = number(name, value)
    if result <= 0.0:
        raise ArgumentError(f"{name}={value!r}: must be greater than 0")
    return result


def shutter_times(value: Any) -> tuple[float, float]:
    """When a shutter opens and closes, frames."""
    try:
        opens, closes = map(float, value)
    except (TypeError, ValueError):
        raise ArgumentError(f"shutter={value!r}: must be two numbers of frames, such as (0, 0.5)") from None
    if not -1.0 <= opens <= closes <= 1.0:
        raise ArgumentError(f"shutter={value!r}: must be -1 <= open <= close <= 1 frames")
    return opens, closes
