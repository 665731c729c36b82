# SPDX-License-Identifier: Apache-2.0
"""Exceptions of this package, and the base class of all of tiscene's.

They are defined here because `dynamics` imports nothing from `tiscene`; `tiscene.errors` re-exports them, so that each
exists once. `tiscene.errors` draws the whole tree.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any


class TisceneError(Exception):
    """Base class of all errors that tiscene and dynamics raise on purpose."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what pickle needs to copy the error, so that worker processes can pass it on.

        Exceptions are rebuilt without calling `__init__`, because subclasses take other arguments than `args`.
        """
        return _rebuild, (type(self), self.args, self.__dict__)


class ArgumentError(TisceneError, ValueError):
    """An argument outside its range or of the wrong type."""


class ArgumentTypeError(ArgumentError, TypeError):
    """An argument of the wrong type."""


def _rebuild(kind: type[TisceneError], args: tuple[Any, ...], attributes: dict[str, Any]) -> TisceneError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(attributes)
    return error


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return "; did you mean 'x'?", the end of a message, with the nearest known name; "" if none is near."""
    nearest = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {nearest[0]!r}?" if nearest else ""


def counted(number: int, name: str, plural: str | None = None) -> str:
    """Return a number with the name of what is counted, such as "1 frame", "2,000 frames" and "2 meshes are".

    Args:
        number: The number.
        name: The name of one.
        plural: The name of several; None: `name` with an s.
    """
    return f"{number:,} {name if number == 1 else plural or f'{name}s'}"
