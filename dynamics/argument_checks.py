# SPDX-License-Identifier: Apache-2.0
"""Checks of what users pass in: the wrong kind is a TypeError, the wrong value a ValueError, both name the argument."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable
from numbers import Real
from typing import Any


def number(value: Any, name: str) -> float:
    """`value` as a finite float."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"{name}={value!r}: must be a number")
    try:
        result = float(value)
    except OverflowError:  # of whole numbers and fractions
        result = math.inf
    if not math.isfinite(result):
        raise ValueError(f"{name}={value!r}: must be finite")
    return result


def whole(value: Any, name: str) -> int:
    """`value` as an int; any kind of whole number will do."""
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise TypeError(f"{name}={value!r}: must be a whole number")
    return operator.index(value)


def positive(value: Any, name: str) -> float:
    """`value` as a finite float above 0."""
    result = number(value, name)
    if result <= 0.0:
        raise ValueError(f"{name}={value!r}: must be greater than 0")
    return result


def not_negative(value: Any, name: str) -> float:
    """`value` as a finite float of 0 or more."""
    result = number(value, name)
    if result < 0.0:
        raise ValueError(f"{name}={value!r}: must not be negative")
    return result


def numbers(value: Any, name: str, *counts: int) -> tuple[float, ...]:
    """`value` as a tuple of finite floats, as many as one of `counts`, or any if there are no counts."""
    wanted = f"{' or '.join(map(str, counts))} numbers" if counts else "numbers"
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise TypeError(f"{name}={value!r}: must be {wanted}")
    result = tuple(number(item, f"{name}[{index}]") for index, item in enumerate(value))
    if counts and len(result) not in counts:
        raise ValueError(f"{name}={value!r}: must be {wanted}, not {len(result)}")
    return result


def vector(value: Any, name: str) -> tuple[float, float, float]:
    """`value` as three finite floats."""
    x, y, z = numbers(value, name, 3)
    return (x, y, z)


def vectors(value: Any, name: str) -> tuple[tuple[float, float, float], ...]:
    """`value` as a tuple of vectors, any number of them."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise TypeError(f"{name}={value!r}: must be a sequence of 3 numbers each")
    return tuple(vector(item, f"{name}[{index}]") for index, item in enumerate(value))


def direction(value: Any, name: str) -> tuple[float, float, float]:
    """`value` as three finite floats, not all zero."""
    result = vector(value, name)
    if math.hypot(*result) < 1e-9:
        raise ValueError(f"{name}={value!r}: must have a direction, not be zero")
    return result


def rotation(value: Any, name: str) -> tuple[float, ...]:
    """`value` as Euler angles (x, y, z) in degrees or as a quaternion (w, x, y, z) that is not zero."""
    result = numbers(value, name, 3, 4)
    if len(result) == 4 and math.hypot(*result) < 1e-9:
        raise ValueError(f"{name}={value!r}: a quaternion (w, x, y, z) must not be zero")
    return result


def text(value: Any, name: str) -> str:
    """`value`, a text that is not empty, and that a file can hold."""
    if not isinstance(value, str):
        raise TypeError(f"{name}={value!r}: must be a text")
    if not value or value.encode(errors="ignore").decode() != value:  # half a surrogate pair, say
        raise ValueError(f"{name}={value!r}: must be a text that is not empty, of whole characters")
    return value


def choice(value: Any, name: str, allowed: tuple[str, ...]) -> str:
    """`value`, one of the words `allowed`."""
    if value not in allowed:
        raise ValueError(f"{name}={value!r}: must be one of {', '.join(map(repr, allowed))}")
    return str(value)


def flag(value: Any, name: str) -> bool:
    """`value`, True or False."""
    if not isinstance(value, bool):
        raise TypeError(f"{name}={value!r}: must be True or False")
    return value
