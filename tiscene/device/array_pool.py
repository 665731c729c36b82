# SPDX-License-Identifier: Apache-2.0
"""Arrays that give small memory back for later arrays of the same type and shape.

Taichi 1.7.4 forgets no allocation on the CPU: each array that was ever made leaves about 75 bytes in the process, after
it was deleted too. A restart of a stream makes dozens of small arrays, so that these are used again.
"""

from __future__ import annotations

import ctypes
import weakref
from collections import OrderedDict, deque
from collections.abc import Hashable
from typing import Any

import taichi as ti
from taichi.lang import impl
from taichi.lang._ndarray import ScalarNdarray
from taichi.lang.matrix import MatrixType, VectorNdarray
from taichi.lang.util import cook_dtype

MAX_ARRAY = 1 << 20  # bytes of the largest array that is kept
MAX_KEPT = 1 << 25  # bytes of all arrays that are kept


class _Memory(weakref.ref[Any]):
    """What is left of an array when Python deletes it.

    Attributes:
        key: Equal for arrays of the same type and shape.
        attributes: Those of the array. `arr` is missing where Ctrl-C came before the array had memory.
        program: Taichi's program in which it was made.
    """

    __slots__ = ("attributes", "key", "program")
    key: Hashable
    attributes: dict[str, Any]
    program: Any


class ArrayPool:
    """The memory of deleted arrays, kept for arrays of the same type and shape, on CPUs only.

    Python may delete arrays at any time and in any thread. Their weak references then put themselves into a queue, by a
    function of C: Ctrl-C would be lost in one of Python. Memory that is not kept is freed by `collect`.
    """

    def __init__(self) -> None:
        self._alive: dict[int, _Memory] = {}  # by `id`: a weak reference must exist to be put into the queue
        self._deleted: deque[_Memory] = deque()
        self._program: Any = None  # in which the kept arrays were made
        self._kept: OrderedDict[Hashable, list[dict[str, Any]]] = OrderedDict()  # the key longest unused is first
        self._nbytes = 0

    @property
    def nbytes(self) -> int:
        """The memory that is kept, bytes."""
        self.collect()
        return self._nbytes

    def take(self, key: Hashable) -> dict[str, Any] | None:
        """Return the attributes of a deleted array, whose memory is all zeros; None if there is none.

        Args:
            key: What `watch` was called with.
        """
        self.collect()
        same = self._kept.get(key)
        if not same:  # Ctrl-C leaves an empty list
            return None
        attributes = same.pop()
        if not same:
            del self._kept[key]
        size = byte_count(attributes["arr"])
        self._nbytes -= size
        ctypes.memset(self._program.get_ndarray_data_ptr_as_int(attributes["arr"]), 0, size)
        return attributes

    def watch(self, array: Any, key: Hashable) -> None:
        """Take over the memory of an array when Python deletes it.

        Args:
            array: It need not have memory yet.
            key: Equal for arrays of the same type and shape.
        """
        memory = _Memory(array, self._deleted.append)
        memory.key, memory.attributes, memory.program = key, vars(array), impl.get_runtime().prog
        self._alive[id(memory)] = memory

    def collect(self) -> None:
        """Keep the memory of deleted arrays if it is small, else free it; and free what has been kept for longest."""
        present = impl.get_runtime().prog
        if self._program is not present:
            self._program, self._nbytes = present, 0
            self._kept.clear()
        while self._deleted:
            memory = self._deleted.popleft()
            del self._alive[id(memory)]
            native = memory.attributes.get("arr")
            if native is None or memory.program is not present:  # which freed it as it ended
                continue
            if byte_count(native) <= MAX_ARRAY and ti.cfg.arch in (ti.x64, ti.arm64):
                self._kept.setdefault(memory.key, []).append({**memory.attributes, "host_accessor": None})
                self._kept.move_to_end(memory.key)
                self._nbytes += byte_count(native)
            else:
                present.delete_ndarray(native)
        while self._nbytes > MAX_KEPT and self._kept:
            oldest, same = next(iter(self._kept.items()))
            if not same:
                del self._kept[oldest]
                continue
            native = same.pop()["arr"]
            self._nbytes -= byte_count(native)
            present.delete_ndarray(native)


POOL = ArrayPool()


class PooledScalars(ScalarNdarray):  # type: ignore[misc]
    """An array of scalars, whose memory POOL takes over."""

    __del__ = staticmethod(bool)  # in place of Taichi's, which frees the memory: a function of C that does nothing


class PooledVectors(VectorNdarray):  # type: ignore[misc]
    """An array of vectors, whose memory POOL takes over. Taichi 1.7.4 itself would keep it until the process ends."""


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
    attributes = POOL.take(key)
    kind: Any = PooledVectors if length else PooledScalars
    array = kind.__new__(kind)
    POOL.watch(array, key)
    if attributes is not None:
        vars(array).update(attributes)
    elif length:
        array.__init__(length, dtype.dtype, shape)
    else:
        array.__init__(dtype, shape)
    return array
