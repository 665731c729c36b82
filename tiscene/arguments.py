"""Checks of what a stream is asked for."""

from __future__ import annotations

import operator
import sys
from collections.abc import Sequence
from typing import Any

from tiscene.errors import ArgumentError, BufferNotFound
from tiscene.render.aovs import AOVS


def integer(name: str, value: Any, low: int, high: int) -> int:
    """A whole number within bounds. Raises ArgumentError."""
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


def shutter_times(value: Any) -> tuple[float, float]:
    """When a shutter opens and closes, frames. Raises ArgumentError."""
    try:
        opens, closes = map(float, value)
    except (TypeError, ValueError):
        raise ArgumentError(f"shutter={value!r}: must be two numbers of frames, such as (0, 0.5)") from None
    if not -1.0 <= opens <= closes <= 1.0:
        raise ArgumentError(f"shutter={value!r}: must be -1 <= open <= close <= 1 frames")
    return opens, closes


def buffer_names(names: Sequence[str]) -> tuple[str, ...]:
    """Names of buffers, each once. Raises ArgumentError, BufferNotFound."""
    if isinstance(names, str):
        raise ArgumentError(f"buffers={names!r}: must be a sequence of names, such as ({names!r},)")
    for name in names:
        if name not in AOVS:
            raise BufferNotFound("buffer", str(name), AOVS)
    if not names:
        raise ArgumentError("buffers=(): ask for one at least")
    return tuple(dict.fromkeys(names))
