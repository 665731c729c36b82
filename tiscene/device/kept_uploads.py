# SPDX-License-Identifier: Apache-2.0
"""KeptUploads: device arrays for values that are new in every frame."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device.memory import empty_on_device


class KeptUploads:
    """Uploads a group of arrays; the device arrays are kept while their shapes stay the same.

    On a GPU, Taichi would allocate memory for each NumPy argument of a kernel, copy it there and back, and free it.
    """

    def __init__(self) -> None:
        self._arrays: list[Any] = []

    def upload(self, values: Sequence[NDArray[np.float32]]) -> list[Any]:
        """Return device arrays with the shapes and values of NumPy arrays, float32; the next call overwrites them."""
        if [each.shape for each in self._arrays] != [each.shape for each in values]:
            self._arrays = [empty_on_device(each.shape, np.float32) for each in values]
        for array, each in zip(self._arrays, values, strict=True):
            array.from_numpy(each)
        return list(self._arrays)
