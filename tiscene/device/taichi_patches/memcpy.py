# SPDX-License-Identifier: Apache-2.0
"""On a CPU, values go between numpy's arrays and Taichi's by a copy of memory.

Taichi 1.7.4 has a kernel copy them, one for each type and number of axes: ten more kernels before a first frame.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray
from taichi.lang import impl
from taichi.lang._ndarray import Ndarray, ScalarNdarray
from taichi.lang.matrix import MatrixNdarray, VectorNdarray
from taichi.lang.util import to_numpy_type


def use() -> None:
    """Copy so in this process, if Taichi runs on a CPU."""
    if ti.cfg.arch in (ti.x64, ti.arm64):
        for kind in (ScalarNdarray, VectorNdarray, MatrixNdarray):
            kind.to_numpy = _to_numpy
            kind.from_numpy = _from_numpy
        Ndarray.fill = _fill


def _values(array: Any) -> NDArray[Any]:
    """The values themselves, as long as the Taichi array lives."""
    impl.get_runtime().materialize()
    shape, dtype = tuple(array.arr.total_shape()), np.dtype(to_numpy_type(array.dtype))
    address = impl.get_runtime().prog.get_ndarray_data_ptr_as_int(array.arr)
    memory = (ctypes.c_byte * (dtype.itemsize * int(np.prod(shape)))).from_address(address)
    return np.frombuffer(memory, dtype).reshape(shape)


def _to_numpy(self: Any) -> NDArray[Any]:
    return _values(self).copy()


def _from_numpy(self: Any, arr: NDArray[Any]) -> None:
    if not isinstance(arr, np.ndarray):
        raise TypeError(f"{np.ndarray} expected, but {type(arr)} provided")
    values = _values(self)
    if values.shape != arr.shape:
        raise ValueError(f"Mismatch shape: {values.shape} expected, but {arr.shape} provided")
    np.copyto(values, arr, casting="unsafe")


def _fill(self: Any, val: float) -> None:
    _values(self).fill(val)
