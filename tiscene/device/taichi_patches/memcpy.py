# SPDX-License-Identifier: Apache-2.0
"""On a CPU, copy values between NumPy arrays and Taichi arrays in memory.

Taichi 1.7.4 launches a kernel for it, one for each element type and number of axes: ten more kernels to compile before
a first frame. `to_numpy`, `from_numpy` and `fill` of Taichi's arrays are replaced; the replacements act on calls from
the packages that `fence` names, and pass all other calls on to Taichi's own methods.
"""

from __future__ import annotations

import ctypes
import sys
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray
from taichi.lang import impl
from taichi.lang._ndarray import Ndarray, ScalarNdarray
from taichi.lang.matrix import MatrixNdarray, VectorNdarray
from taichi.lang.util import to_numpy_type

from tiscene.device import restart
from tiscene.device.taichi_patches import fence

_METHODS = [
    (kind, name) for kind in (ScalarNdarray, VectorNdarray, MatrixNdarray) for name in ("to_numpy", "from_numpy")
]


def install() -> None:
    """Replace the methods."""
    for owner, name in (*_METHODS, (Ndarray, "fill")):
        replacement = {"to_numpy": _to_numpy, "from_numpy": _from_numpy, "fill": _fill}[name]
        setattr(owner, name, _dispatching(getattr(owner, name), replacement))


def _dispatching(original: Any, replacement: Any) -> Any:
    """Return a method that calls `replacement` for this project's code on a CPU, else `original`."""

    def method(self: Any, *args: Any, **kwargs: Any) -> Any:
        is_ours = fence.is_inside(sys._getframe(1).f_globals.get("__name__"))
        chosen = replacement if is_ours and ti.cfg.arch in (ti.x64, ti.arm64) else original
        return chosen(self, *args, **kwargs)

    method.__name__, method.__doc__, method.__wrapped__ = original.__name__, original.__doc__, original  # type: ignore[attr-defined]
    return method


def is_shared() -> bool:
    """Return whether the memory of arrays is the host's, so that `values` can be used."""
    return fence.enabled() and ti.cfg.arch in (ti.x64, ti.arm64)


def values(array: Any) -> NDArray[Any]:
    """Return a NumPy view of a Taichi array's memory, valid as long as the Taichi array lives."""
    restart.check_array(array)
    impl.get_runtime().materialize()
    shape, dtype = tuple(array.arr.total_shape()), np.dtype(to_numpy_type(array.dtype))
    address = impl.get_runtime().prog.get_ndarray_data_ptr_as_int(array.arr)
    memory = (ctypes.c_byte * (dtype.itemsize * int(np.prod(shape)))).from_address(address)
    return np.frombuffer(memory, dtype).reshape(shape)


def _to_numpy(self: Any) -> NDArray[Any]:
    return values(self).copy()


def _from_numpy(self: Any, arr: NDArray[Any]) -> None:
    if not isinstance(arr, np.ndarray):
        raise TypeError(f"{np.ndarray} expected, but {type(arr)} provided")
    present = values(self)
    if present.shape != arr.shape:
        raise ValueError(f"Mismatch shape: {present.shape} expected, but {arr.shape} provided")
    np.copyto(present, arr, casting="unsafe")


def _fill(self: Any, val: float) -> None:
    values(self).fill(val)
