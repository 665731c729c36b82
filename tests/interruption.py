# SPDX-License-Identifier: Apache-2.0
"""KeyboardInterrupt at a given line of an action, as Ctrl-C raises it."""

import inspect
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("tiscene", "dynamics")
# Python prints and drops exceptions of these.
FINALIZERS = ("__del__", "give", "byte_count", "keep_arrays", "_keep_larger")


def interrupted(action, line: int, packages: tuple[str, ...] = PACKAGES) -> bool:
    """Run something, with KeyboardInterrupt at the n-th line of some folders that it executes.

    Returns:
        Whether it executes so many.
    """
    left, folders = line, tuple(f"{ROOT / name}/" for name in packages)

    def count(frame, event, argument):
        nonlocal left
        if event == "line":
            left -= 1
            if left == 0:
                raise KeyboardInterrupt
        return count

    def enter(frame, event, argument):
        code = frame.f_code  # an exception of a trace function in a generator that C calls confuses Python 3.11
        is_generator, is_finalizer = code.co_flags & inspect.CO_GENERATOR, code.co_name in FINALIZERS
        return count if code.co_filename.startswith(folders) and not is_generator and not is_finalizer else None

    before = sys.gettrace()
    sys.settrace(enter)
    try:
        action()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False
