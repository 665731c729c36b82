# SPDX-License-Identifier: Apache-2.0
"""Values of cells in 16 bits, two to a word, since resampling waits for memory.

A value has a sign, an exponent of 6 bits and a mantissa of 9 bits: the upper half of a float32 whose exponent has lost
its two highest bits. From 1e-9 to 8.6e9, values are rounded by at most a thousandth of themselves; half precision
would end at 65504, which is less than the radiance of the sun.
"""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import Floats2, Ints2, Template

FORMAT = "s1e6m9"  # in the keys of files
UNIT = 2.0**96  # of the values that `unpacked` returns
_DROPPED = 14  # bits of a float32's mantissa
_LARGEST = 0x7FFF  # a packed value without its sign
_KEPT = ~0x60003FFF  # bits of a float32 that has lost the upper bits of its exponent and the lower ones of its mantissa


def words(columns: int) -> int:
    """Return how many words a cell has."""
    return -(-columns // 2)


def pack(values: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return values in 16 bits, rounded to nearest, ties to even; what is larger than the largest value becomes it.

    Args:
        values: float32 [..., columns].

    Returns:
        int32 [..., words(columns)], the first value in the lower half.
    """
    rows = np.ascontiguousarray(values, np.float32).reshape(-1, values.shape[-1])
    result = np.empty((len(rows), words(values.shape[-1])), np.int32)
    _pack(rows, result)
    return result.reshape(*values.shape[:-1], result.shape[-1])


@ti.kernel
def _pack(values: Floats2, result: Ints2):
    for row, word in ti.ndrange(result.shape[0], result.shape[1]):
        bits = packed(values[row, 2 * word])
        if 2 * word + 1 < values.shape[1]:
            bits |= packed(values[row, 2 * word + 1]) << 16
        result[row, word] = bits


@ti.func
def packed(value: ti.f32) -> ti.i32:
    """Return a value in the lower 16 bits."""
    bits = ti.bit_cast(value * ti.f32(1.0 / UNIT), ti.i32)
    magnitude = bits & 0x7FFFFFFF
    rounded = (magnitude + ((1 << (_DROPPED - 1)) - 1) + (magnitude >> _DROPPED & 1)) >> _DROPPED
    return ti.min(rounded, _LARGEST) | (bits >> 16 & 0x8000)


@ti.func
def unpacked(word: ti.i32, column: Template) -> ti.f32:
    """Return the value of a column from its word, in UNITs: whoever adds many multiplies once."""
    bits = word
    if ti.static(column % 2 == 0):
        bits = word << 16
    # The sign fills the two bits of the exponent that are missing, and is taken from there again.
    return ti.bit_cast(bits >> 2 & _KEPT, ti.f32)
