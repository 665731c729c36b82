# SPDX-License-Identifier: Apache-2.0
"""Allocate Taichi arrays, and copy NumPy arrays into them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device import runtime
from tiscene.device.array_pool import POOL, new_array
from tiscene.device.taichi_patches import memcpy


@runtime.one_thread_at_a_time
def device_array(dtype: Any, shape: int | tuple[int, ...]) -> Any:
    """Allocate a device array, which gives its memory back with the Python object.

    Args:
        dtype: A Taichi scalar or vector type.
        shape: Lengths of the axes, each at least 1.

    Returns:
        A ti.ndarray of zeros.
    """
    return new_array(dtype, (shape,) if isinstance(shape, int) else tuple(shape))


def free_deleted_arrays() -> None:
    """Free the memory of arrays that Python has deleted, as the next new array does."""
    if runtime.ONE_THREAD.acquire(blocking=False):  # else another thread makes an array, or held it before a fork
        try:
            POOL.collect()
        finally:
            runtime.ONE_THREAD.release()


def upload(values: NDArray[Any]) -> Any:
    """Return a device array with the shape and values of a NumPy array.

    Args:
        values: Integers become int32, everything else float32. Taichi arrays cannot be empty: an axis of length 0
            becomes one row of zeros, and kernels take the count as an argument.
    """
    dtype = np.dtype(np.int32) if np.issubdtype(values.dtype, np.integer) else np.dtype(np.float32)
    if values.size == 0:
        values = np.zeros([max(length, 1) for length in values.shape], dtype)
    array = device_array(ti.i32 if dtype == np.int32 else ti.f32, values.shape)
    array.from_numpy(np.ascontiguousarray(values, dtype))
    return array


def upload_vectors(values: NDArray[np.float32]) -> Any:
    """Return rows, float32 [n, k], as a device array of n vectors, which kernels load with one instruction."""
    count, length = values.shape
    array = device_array(ti.types.vector(length, ti.f32), count)
    array.from_numpy(np.ascontiguousarray(values, np.float32))
    return array


def empty_on_device(shape: tuple[int, ...], dtype: Any) -> Any:
    """Return a device array for values of a NumPy dtype: float32, int32, or one of a byte, as uint8."""
    kind = np.dtype(dtype)
    return device_array(ti.u8 if kind.itemsize == 1 else ti.f32 if kind.kind == "f" else ti.i32, shape)


def nbytes(*arrays: Any) -> int:
    """Return the memory of device arrays of numbers or vectors of 32 bits, bytes."""
    return sum(4 * math.prod((*array.shape, *array.element_shape)) for array in arrays)


def read_rows(array: Any, count: int) -> NDArray[Any]:
    """Return the first rows of a device array."""
    if memcpy.is_direct():
        return memcpy.read_rows(array, count)
    values: NDArray[Any] = array.to_numpy()[:count]
    return values


def copy_rows(source: Any, target: Any, count: int) -> None:
    """Copy the first rows of a device array to those of another one of the same type."""
    if memcpy.is_direct():
        memcpy.copy_rows(source, target, count)
    else:
        write_rows(target, 0, source.to_numpy()[:count])


def write_rows(target: Any, first: int, rows: NDArray[Any]) -> None:
    """Write rows of a device array from a row on; the others stay."""
    if memcpy.is_direct():
        memcpy.write_rows(target, first, rows)
        return
    values = target.to_numpy()
    values[first : first + len(rows)] = rows
    target.from_numpy(values)
