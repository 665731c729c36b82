# SPDX-License-Identifier: Apache-2.0
"""Arrays that give small memory back for later arrays of the same type and shape.

Taichi 1.7.4 forgets no allocation on the CPU: each array that was ever made leaves about 75 bytes in the process, after
it was deleted too. A restart of a stream makes dozens of small arrays, so that these are used again.
"""

from __future__ import annotations

import _thread
import ctypes
import sys
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Hashable
from typing import Any

import taichi as ti
from taichi.lang import impl
from taichi.lang._ndarray import ScalarNdarray
from taichi.lang.matrix import MatrixType, VectorNdarray
from taichi.lang.util import cook_dtype

MAX_ARRAY = 1 << 20  # bytes of the largest array that is kept
MAX_KEPT = 1 << 25  # bytes of all arrays that are kept
_POLL = 0.001  # s, between looks whether the deletion of an array has ended


class ArrayPool:
    """The memory of deleted arrays, kept for arrays of the same type and shape, on CPUs only.

    Python may delete arrays at any time and in any thread: `give` only puts them into a queue.
    """

    def __init__(self) -> None:
        self._queue: deque[tuple[Hashable, dict[str, Any], Any]] = deque()
        self._program: Any = None  # in which the kept arrays were made
        self._kept: OrderedDict[Hashable, list[dict[str, Any]]] = OrderedDict()  # the key longest unused is first
        self._nbytes = 0

    @property
    def nbytes(self) -> int:
        """The memory that is kept, bytes."""
        self._sort_queue()
        return self._nbytes

    def take(self, key: Hashable) -> dict[str, Any] | None:
        """Return the attributes of a deleted array, whose memory is all zeros; None if there is none.

        Args:
            key: What `give` was called with.
        """
        self._sort_queue()
        same = self._kept.get(key)
        if not same:  # Ctrl-C leaves an empty list
            return None
        state = same.pop()
        if not same:
            del self._kept[key]
        size = byte_count(state["arr"])
        self._nbytes -= size
        ctypes.memset(self._program.get_ndarray_data_ptr_as_int(state["arr"]), 0, size)
        return state

    def give(self, key: Hashable, state: dict[str, Any], program: Any) -> None:
        """Keep the memory of a deleted array if it is small, else free it.

        Args:
            key: Equal for arrays of the same type and shape.
            state: The attributes of the array.
            program: Taichi's program in which it was made. If another one runs, the memory was freed already.
        """
        if impl.get_runtime() is None or impl.get_runtime().prog is not program:
            return
        if byte_count(state["arr"]) <= MAX_ARRAY and ti.cfg.arch in (ti.x64, ti.arm64):
            self._queue.append((key, {**state, "host_accessor": None}, program))
        else:
            program.delete_ndarray(state["arr"])

    def _sort_queue(self) -> None:
        """Keep the arrays of the queue, and free those longest unused as long as there are too many."""
        present = impl.get_runtime().prog
        if self._program is not present:
            self._program, self._nbytes = present, 0
            self._kept.clear()
        while self._queue:
            key, state, program = self._queue.popleft()
            if program is present:
                self._kept.setdefault(key, []).append(state)
                self._kept.move_to_end(key)
                self._nbytes += byte_count(state["arr"])
        while self._nbytes > MAX_KEPT and self._kept:
            oldest, same = next(iter(self._kept.items()))
            if not same:
                del self._kept[oldest]
                continue
            memory = same.pop()["arr"]
            self._nbytes -= byte_count(memory)
            present.delete_ndarray(memory)


POOL = ArrayPool()


class _Pooled:
    """Gives the memory of an array to POOL when Python deletes the array.

    Attributes:
        key: See `ArrayPool.give`.
        made_in: Taichi's program in which it was made.
    """

    def __init__(self, key: Hashable, *arguments: Any) -> None:
        self.key, self.made_in = key, impl.get_runtime().prog
        super().__init__(*arguments)

    def __del__(self, python_ends: Callable[[], bool] = sys.is_finalizing) -> None:
        # Names of modules may be None as Python ends; Ctrl-C inside of __init__ leaves an array without memory.
        try:
            if not python_ends() and self.__dict__.get("arr") is not None:
                POOL.give(self.key, self.__dict__, self.made_in)
        except KeyboardInterrupt:
            # Python would print it here and go on, so that another thread raises it again after this method has ended.
            # The memory may be lost: to free it twice would be worse.
            state = {"ended": False}
            _thread.start_new_thread(_interrupt_when_ended, (state,))
            state["ended"] = True


def _interrupt_when_ended(state: dict[str, bool]) -> None:
    while not state["ended"]:
        time.sleep(_POLL)
    _thread.interrupt_main()


class PooledScalars(_Pooled, ScalarNdarray):  # type: ignore[misc]
    """An array of scalars."""


class PooledVectors(_Pooled, VectorNdarray):  # type: ignore[misc]
    """An array of vectors, which Taichi 1.7.4 itself would keep until the process ends."""


def byte_count(memory: Any) -> int:
    """Return the size of Taichi's native array, bytes."""
    return int(memory.nelement() * memory.element_size())


def new_array(dtype: Any, shape: tuple[int, ...]) -> Any:
    """Return a Taichi array of zeros, in memory of a deleted one if there is any. One thread at a time calls this.

    Args:
        dtype: A Taichi scalar or vector type.
        shape: Lengths of the axes.
    """
    length = dtype.n if isinstance(dtype, MatrixType) else 0
    key = cook_dtype(dtype.dtype if length else dtype).to_string(), length, shape
    state = POOL.take(key)
    if state is None:
        return PooledVectors(key, length, dtype.dtype, shape) if length else PooledScalars(key, dtype, shape)
    kind = PooledVectors if length else PooledScalars
    array = kind.__new__(kind)
    array.__dict__.update(state)
    return array
