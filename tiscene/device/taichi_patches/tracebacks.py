# SPDX-License-Identifier: Apache-2.0
"""Make arrays without the text of the call stack.

Taichi 1.7.4 formats the whole stack for each array, which takes longer than a small array: the text is shown if
memory is not enough. Arrays of the packages that `fence` names do without; all others are made as before.
"""

from __future__ import annotations

import sys
from typing import Any

from taichi.lang import _ndarray, matrix

from tiscene.device.taichi_patches import fence

# Frames from `get_traceback` up: the array's class, `ti.ndarray`, its decorator, and who calls that; or for
# `array_pool` the array's class, `new_array`, `device_array`, and its decorator.
_CALLER = 4


def install() -> None:
    """Replace the functions that return the text."""
    for module in (_ndarray, matrix):
        module.get_traceback = _replacing(module.get_traceback)


def _replacing(original: Any) -> Any:
    def get_traceback(stacklevel: int = 1) -> str:
        try:
            caller = sys._getframe(_CALLER).f_globals.get("__name__")
        except ValueError:  # the stack is not that deep
            caller = None
        return "" if fence.is_inside(caller) else str(original(stacklevel + 1))

    return get_traceback
