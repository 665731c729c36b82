# SPDX-License-Identifier: Apache-2.0
"""WholeChanges: a class with methods that an exception must not leave half done (`as_a_whole`)."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class WholeChanges:
    """Base class of objects with methods that are decorated by `as_a_whole`.

    Attributes:
        is_unfinished: whether an exception has ended one of them: what they change has to be made anew.
    """

    is_unfinished = False


def as_a_whole(change: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorate a method of WholeChanges so that `is_unfinished` tells of an exception that has ended it.

    KeyboardInterrupt, or the exception of a signal handler, can do so at any line.
    """

    @functools.wraps(change)
    def whole(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        try:
            return change(*args, **kwargs)
        except BaseException:
            changed: Any = args[0]
            changed.is_unfinished = True
            raise

    return whole
