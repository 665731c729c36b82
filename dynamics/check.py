"""Checks of what users pass in: the wrong kind is a TypeError, the wrong value a ValueError, both name the argument."""

from __future__ import annotations

import math
from collections.abc import Iterable
from numbers import Real
from typing import Any


def number(value: Any, name: str) -> float:
    """`value` as a finite float."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"{name}={value!r}: must be a number")
    result = float(value)
    if not math.isfinite(result):
        raise ValueError(f"{name}={value!r}: must be finite")
    return result


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
    """`value` as a tuple of finite floats, as many as one of `counts`."""
    wanted = " or ".join(str(count) for count in counts)
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise TypeError(f"{name}={value!r}: must be {wanted} numbers")
    result = tuple(number(item, f"{name}[{index}]") for index, item in enumerate(value))
    if len(result) not in counts:
        raise ValueError(f"{name}={value!r}: must be {wanted} numbers, not {len(result)}")
    return result


def vector(value: Any, name: str) -> tuple[float, float, float]:
    """`value` as three finite floats."""
    x, y, z = numbers(value, name, 3)
    return (x, y, z)


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
