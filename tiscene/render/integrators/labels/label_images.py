# SPDX-License-Identifier: Apache-2.0
"""LabelImages: the arrays that label kernels write.

On a CPU these are the NumPy arrays of the result. On a card they stay in its memory from frame to frame.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device.memory import empty_on_device
from tiscene.frame.buffers import BUFFERS
from tiscene.render.integrators.labels.surface_labels import FILTERED_ALBEDO

IMAGES = BUFFERS | {FILTERED_ALBEDO: BUFFERS["albedo"]}
Images = dict[str, Any]  # arrays by buffer, in NumPy or on the device


class LabelImages:
    """Makes arrays for label kernels, and results of them.

    Args:
        on_card: Whether the arrays are kept in the device's memory.
    """

    def __init__(self, on_card: bool) -> None:
        self.on_card = on_card
        self._kept: Images = {}
        self._placeholders: Images = {}

    def empty(self, names: Iterable[str], width: int, height: int, *, lasting: bool = False) -> Images:
        """Return arrays whose values are undefined.

        Args:
            names: Names of label buffers, or FILTERED_ALBEDO.
            width: Image width, px.
            height: Image height, px.
            lasting: On a card, too, the next call does not return the same arrays again.
        """
        if not self.on_card:
            return {name: IMAGES[name].empty(width, height) for name in names}
        found = {}
        for name in names:
            shape = IMAGES[name].shape(width, height)
            array = None if lasting else self._kept.get(name)
            if array is None or array.shape != shape:
                array = empty_on_device(shape, IMAGES[name].dtype)
            if not lasting:
                self._kept[name] = array
            found[name] = array
        return found

    def copied(self, images: Images, names: Iterable[str]) -> Images:
        """Return copies of some arrays."""
        if not self.on_card:
            return {name: images[name].copy() for name in names}
        height, width = next(iter(images.values())).shape[:2]
        found = self.empty(names, width, height)
        for name, array in found.items():
            array.copy_from(images[name])
        return found

    def results(self, images: Images) -> dict[str, NDArray[Any]]:
        """Return NumPy arrays of what the kernels have written."""
        if not self.on_card:
            return images
        return {name: array.to_numpy().view(IMAGES[name].dtype) for name, array in images.items()}

    def argument(self, images: Mapping[str, Any], name: str) -> Any:
        """Return the kernel argument for a buffer: its array, as bytes if of truth values; without one, a pixel."""
        array = images.get(name)
        if array is None:
            if name not in self._placeholders:
                pixel = empty_on_device if self.on_card else np.empty
                self._placeholders[name] = pixel(IMAGES[name].shape(1, 1), IMAGES[name].dtype)
            array = self._placeholders[name]
        return array.view(np.uint8) if isinstance(array, np.ndarray) and array.dtype == bool else array
