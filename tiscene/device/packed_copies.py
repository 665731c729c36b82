# SPDX-License-Identifier: Apache-2.0
"""Copies of several arrays between host and device that travel as one.

On a GPU, Taichi allocates memory for each NumPy argument of a kernel, copies it there and back, and frees it. On a CPU
such arguments cost nothing: kernels there read and write the NumPy arrays themselves.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Bytes, Floats, Ints, Ints1, Template
from tiscene.device.memory import device_array

MAX_SIZES = 4  # of groups, whose memory is kept
_DTYPES = {np.dtype(np.float32): ti.f32, np.dtype(np.int32): ti.i32, np.dtype(np.uint8): ti.u8}


def empty_on_device(shape: tuple[int, ...], dtype: Any) -> Any:
    """Return a device array for values of a NumPy dtype: float32, int32, or one of a byte, as uint8."""
    dtype = np.dtype(dtype)
    return device_array(_DTYPES[np.dtype(np.uint8) if dtype.itemsize == 1 else dtype], shape)


class PackedCopies:
    """Moves groups of arrays; the memory that this takes is kept while their sizes stay the same."""

    def __init__(self) -> None:
        self._words: dict[int, Any] = {}  # by length
        self._uploaded: list[Any] = []

    def upload(self, values: Sequence[NDArray[np.float32]]) -> list[Any]:
        """Return device arrays with the shapes and values of NumPy arrays, float32; the next call overwrites them."""
        if [each.shape for each in self._uploaded] != [each.shape for each in values]:
            self._uploaded = [empty_on_device(each.shape, np.float32) for each in values]
        packed = np.concatenate([np.ascontiguousarray(each, np.float32).view(np.int32).ravel() for each in values])
        words = self._of_length(len(packed))
        words.from_numpy(packed)
        first = 0
        for each in self._uploaded:
            unpack_floats(words, first, each)
            first += math.prod(each.shape)
        return list(self._uploaded)

    def download(self, arrays: Sequence[Any], dtypes: Sequence[Any]) -> list[NDArray[Any]]:
        """Return new NumPy arrays with the values of device arrays.

        Args:
            arrays: Device arrays of `empty_on_device`.
            dtypes: NumPy dtype of each.
        """
        sizes = [math.prod(each.shape) for each in arrays]
        words = self._of_length(sum(sizes))
        first = 0
        for array, size, dtype in zip(arrays, sizes, dtypes, strict=True):
            kind = np.dtype(dtype)
            pack = pack_bytes if kind.itemsize == 1 else pack_floats if kind.kind == "f" else pack_ints
            pack(array, first, words)
            first += size
        packed: NDArray[np.int32] = words.to_numpy()
        result = []
        for array, part, dtype in zip(arrays, np.split(packed[:first], np.cumsum(sizes)[:-1]), dtypes, strict=True):
            kind = np.dtype(dtype)
            values = part.astype(kind) if kind.itemsize == 1 else part.view(kind).copy()
            result.append(values.reshape(array.shape))
        return result

    def _of_length(self, length: int) -> Any:
        """Return memory in between, of exactly this length, since all of it is copied."""
        if length not in self._words:
            if len(self._words) == MAX_SIZES:
                self._words.clear()
            self._words[length] = device_array(ti.i32, (length,))
        return self._words[length]


@ti.func
def place_of(index: Template, array: Template) -> ti.i32:
    """Return the position of an element in row-major order."""
    place = 0
    for axis in ti.static(range(len(array.shape))):
        place = place * array.shape[axis] + index[axis]
    return place


@ti.kernel
def unpack_floats(words: Ints1, first: ti.i32, array: Floats):
    """Write an array from the bits that begin at words[first]."""
    for index in ti.grouped(array):
        array[index] = ti.bit_cast(words[first + place_of(index, array)], ti.f32)


@ti.kernel
def pack_floats(array: Floats, first: ti.i32, words: Ints1):
    """Write the bits of an array to words[first ..]."""
    for index in ti.grouped(array):
        words[first + place_of(index, array)] = ti.bit_cast(array[index], ti.i32)


@ti.kernel
def pack_ints(array: Ints, first: ti.i32, words: Ints1):
    """Write an array to words[first ..]."""
    for index in ti.grouped(array):
        words[first + place_of(index, array)] = array[index]


@ti.kernel
def pack_bytes(array: Bytes, first: ti.i32, words: Ints1):
    """Write an array of bytes to words[first ..], one in each."""
    for index in ti.grouped(array):
        words[first + place_of(index, array)] = ti.cast(array[index], ti.i32)
