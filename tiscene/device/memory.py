# SPDX-License-Identifier: Apache-2.0
"""Host arrays to Taichi ndarrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray


def upload(values: NDArray[Any]) -> Any:
    """A ti.ndarray of the same shape and values: float32 or int32. An axis of length 0 becomes one row of zeros.

    (A Taichi array cannot be empty; kernels are told the true count.)
    """
    dtype = np.dtype(np.int32) if np.issubdtype(values.dtype, np.integer) else np.dtype(np.float32)
    if values.size == 0:
        values = np.zeros([max(length, 1) for length in values.shape], dtype)
    array = ti.ndarray(ti.i32 if dtype == np.int32 else ti.f32, values.shape)
    array.from_numpy(np.ascontiguousarray(values, dtype))
    return array


def upload_vectors(values: NDArray[np.float32]) -> Any:
    """Rows, float32 [n, k], as a ti.ndarray of n vectors: a kernel then knows that their numbers stand together."""
    count, length = values.shape
    array = ti.ndarray(ti.types.vector(length, ti.f32), count)
    array.from_numpy(np.ascontiguousarray(values, np.float32))
    return array
