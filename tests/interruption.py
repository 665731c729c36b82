# SPDX-License-Identifier: Apache-2.0
"""KeyboardInterrupt at a given line of an action, as Ctrl-C raises it."""

import dis
import functools
import inspect
import sys
import threading
from pathlib import Path

from tiscene.device import runtime

ROOT = Path(__file__).parents[1]
PACKAGES = ("tiscene", "dynamics")
# Python prints and drops exceptions of these.
FINALIZERS = ("__del__", "give", "byte_count", "keep_arrays", "_keep_larger")


def interrupted(action, line: int, packages: tuple[str, ...] = PACKAGES) -> bool:
    """Run something, with KeyboardInterrupt at the n-th line of some folders that it executes.

    Ctrl-C cannot come between the last statement in a `with` and its end, but a trace function's exception can, and
    would leave the lock of all threads locked.

    Returns:
        Whether it executes so many.
    """
    left, folders = line, tuple(f"{ROOT / name}/" for name in packages)

    def count(frame, event, argument):
        nonlocal left
        if event == "line" and frame.f_lasti not in _ends_of_with(frame.f_code):
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
        assert _is_free(runtime.ONE_THREAD), "no other thread would ever go on"
    return False


@functools.cache
def _ends_of_with(code) -> frozenset[int]:
    """Return the offsets of instructions that begin the line of a `with` again, as those which call `__exit__` do."""
    entered = {each.positions.lineno for each in dis.get_instructions(code) if each.opname == "BEFORE_WITH"}
    starts = list(dis.findlinestarts(code))
    first = {line: offset for offset, line in reversed(starts)}
    return frozenset(offset for offset, line in starts if line in entered and offset != first[line])


def _is_free(lock) -> bool:
    """Return whether another thread gets a lock."""
    free = []

    def take() -> None:
        if lock.acquire(timeout=5.0):
            lock.release()
            free.append(True)

    thread = threading.Thread(target=take)
    thread.start()
    thread.join()
    return bool(free)
