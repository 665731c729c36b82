# SPDX-License-Identifier: Apache-2.0
"""one_at_a_time: a decorator of edits, which wait for frames and edits of other threads."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def one_at_a_time(edit: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorate an edit, a method of a world, so that it waits for frames and edits of other threads.

    An edit that came in the middle of a frame would be in the log at that frame, but not in its pixels.
    """

    @functools.wraps(edit)
    def locked(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        world: Any = args[0]
        with world.edit_lock:
            return edit(*args, **kwargs)

    return locked
