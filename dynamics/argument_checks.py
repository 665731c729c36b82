# SPDX-License-Identifier: Apache-2.0
"""Validation of constructor arguments.

Checks take a value and the name of the argument, and return the value as a plain Python type. They raise
ArgumentTypeError for a wrong type and ArgumentError for a wrong value. Messages read "name=value: must be ...".
A frozen dataclass lists those of its fields: ``set_checked(self, frame=index, position=optional(vector))``.
"""

from __future__ import annotations

import math
import operator
import sys
from collections.abc import Callable, Iterable, Mapping, Set
from numbers import Real
from typing import Any, TypeVar, cast

from dynamics.errors import ArgumentError, ArgumentTypeError, did_you_mean

Value = TypeVar("Value")
Check = Callable[[Any, str], Value]
MAX_BRIEF = 80  # characters of a value in a message
LARGEST = 3.4e38  # of a coordinate: scenes are rendered in single precision
MAX_POSITION = 1e9  # m, of what moves: kernels of collisions fail on much larger ones


def set_checked(instance: Any, **checks: Check[Any]) -> None:
    """Replace fields of a frozen dataclass, in its `__post_init__`, by what their checks return."""
    for name, check in checks.items():
        object.__setattr__(instance, name, check(getattr(instance, name), name))


def optional(check: Check[Value]) -> Check[Value | None]:
    """Return a check that takes None too."""
    return lambda value, name: None if value is None else check(value, name)


def number(value: Any, name: str) -> float:
    """Return `value` as a finite float."""
    if not is_number(value):
        raise ArgumentTypeError(f"{name}={brief(value)}: must be a number")
    try:
        result = float(value)
    except OverflowError:  # an int or Fraction beyond the range of floats
        result = math.inf
    if not math.isfinite(result):
        raise ArgumentError(f"{name}={brief(value)}: must be finite")
    return result


def whole(value: Any, name: str) -> int:
    """Return `value`, of any integer type, as an int."""
    try:
        if not isinstance(value, bool):
            return operator.index(value)
    except TypeError:  # also of an array, which has `__index__`
        pass
    raise ArgumentTypeError(f"{name}={brief(value)}: must be a whole number")


def integer(value: Any, name: str, low: int, high: int = sys.maxsize) -> int:
    """Return `value` as an int from `low` to `high`, both included; `sys.maxsize` stands for no upper limit."""
    result = whole(value, name)
    if not low <= result <= high:
        expected = f"at least {low}" if high == sys.maxsize and result < low else f"from {low} to {high}"
        raise ArgumentError(f"{name}={value}: must be {expected}")
    return result


def index(value: Any, name: str) -> int:
    """Return `value` as an int of 0 or more."""
    return integer(value, name, 0)


def positive(value: Any, name: str) -> float:
    """Return `value` as a finite float above 0."""
    result = number(value, name)
    if result <= 0.0:
        raise ArgumentError(f"{name}={brief(value)}: must be greater than 0")
    return result


def not_negative(value: Any, name: str) -> float:
    """Return `value` as a finite float of 0 or more."""
    result = number(value, name)
    if result < 0.0:
        raise ArgumentError(f"{name}={brief(value)}: must not be negative")
    return result


def is_number(value: Any) -> bool:
    """Return whether a value is a number, and not True or False."""
    return isinstance(value, Real) and not isinstance(value, bool)


def is_series(value: Any) -> bool:
    """Return whether `value` can be iterated over and its order has a meaning; text and bytes are no series."""
    return isinstance(value, Iterable) and not isinstance(value, str | bytes | bytearray | Set | Mapping)


def numbers(value: Any, name: str, *counts: int) -> tuple[float, ...]:
    """Return `value` as a tuple of finite floats.

    Args:
        value: An iterable of numbers in an order: no set, mapping or bytes.
        name: Name of the argument, for error messages.
        *counts: Allowed lengths; none for any length.
    """
    expected = f"{' or '.join(map(str, counts))} numbers" if counts else "numbers"
    if not is_series(value):
        raise ArgumentTypeError(f"{name}={brief(value)}: must be {expected}")
    result = tuple(number(item, f"{name}[{index}]") for index, item in enumerate(value))
    if counts and len(result) not in counts:
        raise ArgumentError(f"{name}={brief(value)}: must be {expected}, not {len(result)}")
    # A tuple of floats is kept as it is: of a long log of edits, defaults then take no memory.
    return value if type(value) is tuple and all(type(item) is float for item in value) else result


def vector(value: Any, name: str) -> tuple[float, float, float]:
    """Return `value` as three floats that single precision can hold."""
    result = numbers(value, name, 3)
    if max(map(abs, result)) > LARGEST:
        raise ArgumentError(f"{name}={brief(value)}: must be numbers of at most {LARGEST:g}")
    return cast("tuple[float, float, float]", result)


def position(value: Any, name: str) -> tuple[float, float, float]:
    """Return `value` as three floats that bodies can be placed at, m."""
    result = vector(value, name)
    if max(map(abs, result)) > MAX_POSITION:
        raise ArgumentError(f"{name}={brief(value)}: must be numbers from -{MAX_POSITION:g} to {MAX_POSITION:g} m")
    return result


def vectors(value: Any, name: str) -> tuple[tuple[float, float, float], ...]:
    """Return `value` as a tuple of vectors, of any length."""
    if not is_series(value):
        raise ArgumentTypeError(f"{name}={brief(value)}: must be a sequence of 3 numbers each")
    return tuple(vector(item, f"{name}[{index}]") for index, item in enumerate(value))


def direction(value: Any, name: str) -> tuple[float, float, float]:
    """Return `value` as three finite floats that are not all zero."""
    result = vector(value, name)
    if math.hypot(*result) < 1e-9:
        raise ArgumentError(f"{name}={brief(value)}: must have a direction, not be zero")
    return result


def rotation(value: Any, name: str) -> tuple[float, ...]:
    """Return `value` as Euler angles (x, y, z) in degrees, or as a quaternion (w, x, y, z) that can be normalized."""
    result = numbers(value, name, 3, 4)
    if len(result) == 4 and not 1e-9 <= math.hypot(*result) <= LARGEST:
        raise ArgumentError(
            f"{name}={brief(value)}: a quaternion (w, x, y, z) must not be zero, nor longer than {LARGEST:g}"
        )
    return result


def is_unicode(value: str) -> bool:
    """Return whether a string has no lone surrogates, so that it can be encoded."""
    return value.encode(errors="ignore").decode() == value


def text(value: Any, name: str) -> str:
    """Return `value`, a non-empty string that can be encoded as UTF-8 and does not end early in C."""
    if not isinstance(value, str):
        raise ArgumentTypeError(f"{name}={brief(value)}: must be a string")
    if not value or "\0" in value or not is_unicode(value):
        raise ArgumentError(
            f"{name}={brief(value)}: must be a string of one character or more, without lone surrogates and NUL"
        )
    return value


def choice(value: Any, name: str, allowed: tuple[str, ...]) -> str:
    """Return `value`, one of the strings `allowed`."""
    if value not in allowed:
        raise ArgumentError(f"{name}={brief(value)}: must be one of {', '.join(map(repr, allowed))}")
    return str(value)


def known_names(names: Iterable[str], known: Iterable[str], owner: str) -> None:
    """Check the names of keyword arguments that are passed on.

    Args:
        names: The names that were given.
        known: Those that there are.
        owner: What takes them, for error messages.
    """
    known = list(known)
    for name in names:
        if name not in known:
            hint = did_you_mean(name, known) or f"; there are {', '.join(known)}"
            raise ArgumentTypeError(f"{name}: {owner} has no such argument{hint}")


def brief(value: Any) -> str:
    """Return the representation of a value for an error message, shortened to a line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= MAX_BRIEF else f"{text[:MAX_BRIEF]}..."


def flag(value: Any, name: str) -> bool:
    """Return `value`, True or False, as a bool."""
    is_numpys = getattr(value, "shape", None) == () and value.dtype == bool
    if not isinstance(value, bool) and not is_numpys:
        raise ArgumentTypeError(f"{name}={brief(value)}: must be True or False")
    return bool(value)


def distinct_names(value: Any, name: str) -> tuple[str, ...]:
    """Return `value`, a sequence of one or more different and non-empty strings, as a tuple."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise ArgumentError(f"{name}={brief(value)}: must be a sequence of names, such as ('chair', 'ball')")
    result = tuple(value)
    if not result or not all(isinstance(each, str) and each for each in result):
        raise ArgumentError(f"{name}={brief(result)}: must be one or more names, none of them empty")
    repeated = [each for index, each in enumerate(result) if each in result[:index]]
    if repeated:
        raise ArgumentError(f"{name}: {repeated[0]!r} is named twice; name each once")
    return result
