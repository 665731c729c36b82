# SPDX-License-Identifier: Apache-2.0
"""Copy values between NumPy arrays and Taichi arrays in memory: on a CPU by NumPy, on a CUDA card by its driver.

Taichi 1.7.4 launches a kernel for it, one for each element type and number of axes: ten more kernels to compile before
a first frame. `to_numpy`, `from_numpy` and, on a CPU, `fill` of Taichi's arrays are replaced; the replacements act on
calls from the packages that `fence` names, and pass all other calls on to Taichi's own methods.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray
from taichi.lang import impl
from taichi.lang._ndarray import Ndarray, ScalarNdarray
from taichi.lang.matrix import MatrixNdarray, VectorNdarray
from taichi.lang.util import to_numpy_type

from tiscene.device import restart
from tiscene.device.taichi_patches import cuda_memory, fence

_METHODS = [
    (kind, name) for kind in (ScalarNdarray, VectorNdarray, MatrixNdarray) for name in ("to_numpy", "from_numpy")
]


def install() -> None:
    """Replace the methods."""
    for owner, name in _METHODS:
        replacement = {"to_numpy": read, "from_numpy": write}[name]
        setattr(owner, name, _dispatching(getattr(owner, name), replacement, is_direct))
    Ndarray.fill = _dispatching(Ndarray.fill, _fill, is_shared)


def _dispatching(original: Any, replacement: Any, applies: Callable[[], bool]) -> Any:
    """Return a method that calls `replacement` for this project's code where it applies, else `original`."""

    def method(self: Any, *args: Any, **kwargs: Any) -> Any:
        is_ours = fence.is_inside(sys._getframe(1).f_globals.get("__name__"))
        return (replacement if is_ours and applies() else original)(self, *args, **kwargs)

    method.__name__, method.__doc__, method.__wrapped__ = original.__name__, original.__doc__, original  # type: ignore[attr-defined]
    return method


def is_shared() -> bool:
    """Return whether the memory of arrays is the host's, so that `values` can be used."""
    return fence.enabled() and ti.cfg.arch in (ti.x64, ti.arm64)


def is_direct() -> bool:
    """Return whether `read`, `write` and those of rows can be used."""
    return is_shared() or (fence.enabled() and ti.cfg.arch == ti.cuda and _driver_reads())


@restart.cached_on_device(maxsize=1)
def _driver_reads() -> bool:
    """Return whether the CUDA driver reads from a Taichi array what Taichi has written to it."""
    driver, runtime, expected = cuda_memory.driver(), impl.get_runtime(), np.arange(1, 5, dtype=np.int32)
    if driver is None:
        return False
    array = ScalarNdarray(ti.i32, expected.shape)
    ScalarNdarray.from_numpy.__wrapped__(array, expected)  # Taichi's own
    runtime.sync()
    return driver.reads(runtime.prog.get_ndarray_data_ptr_as_int(array.arr), expected)


def values(array: Any) -> NDArray[Any]:
    """Return a NumPy view of a Taichi array's memory on a CPU, valid as long as the Taichi array lives."""
    address, shape, dtype = _memory(array)
    memory: Any = (ctypes.c_byte * (dtype.itemsize * int(np.prod(shape)))).from_address(address)
    result: NDArray[Any] = np.frombuffer(memory, dtype).reshape(shape)
    return result


def read(array: Any) -> NDArray[Any]:
    """Return the values of a Taichi array."""
    return read_rows(array, int(array.shape[0]))


def read_rows(array: Any, count: int) -> NDArray[Any]:
    """Return the first rows of a Taichi array."""
    if is_shared():
        return values(array)[:count].copy()
    address, shape, dtype = _memory(array)
    result = np.empty((min(count, shape[0]), *shape[1:]), dtype)
    _driver().read(address, result)
    return result


def write(array: Any, arr: NDArray[Any]) -> None:
    """Set the values of a Taichi array.

    Args:
        array: The array.
        arr: Values of the same shape and any type.

    Raises:
        TypeError: `arr` is not a NumPy array.
        ValueError: It has another shape.
    """
    if not isinstance(arr, np.ndarray):
        raise TypeError(f"{np.ndarray} expected, but {type(arr)} provided")
    shape = _memory(array)[1]
    if shape != arr.shape:
        raise ValueError(f"Mismatch shape: {shape} expected, but {arr.shape} provided")
    write_rows(array, 0, arr)


def write_rows(array: Any, first: int, rows: NDArray[Any]) -> None:
    """Set rows of a Taichi array, from a row on."""
    if is_shared():
        np.copyto(values(array)[first : first + len(rows)], rows, casting="unsafe")
        return
    address, shape, dtype = _memory(array)
    if first + len(rows) > shape[0]:
        raise ValueError(f"rows {first} to {first + len(rows)} of an array of {shape[0]}")
    size = dtype.itemsize * int(np.prod(shape[1:]))
    _driver().write(address + first * size, np.ascontiguousarray(rows, dtype))


def copy_rows(source: Any, target: Any, count: int) -> None:
    """Copy the first rows of a Taichi array to those of another one of the same type."""
    if is_shared():
        values(target)[:count] = values(source)[:count]
        return
    address, shape, dtype = _memory(source)
    _driver().copy(address, _memory(target)[0], count * dtype.itemsize * int(np.prod(shape[1:])))


def _memory(array: Any) -> tuple[int, tuple[int, ...], np.dtype[Any]]:
    """Return the address, shape and type of a Taichi array's memory."""
    restart.check_array(array)
    impl.get_runtime().materialize()
    address = impl.get_runtime().prog.get_ndarray_data_ptr_as_int(array.arr)
    return address, tuple(array.arr.total_shape()), np.dtype(to_numpy_type(array.dtype))


def _driver() -> cuda_memory.CudaDriver:
    found = cuda_memory.driver()
    assert found is not None
    return found


def _fill(self: Any, val: float) -> None:
    values(self).fill(val)
