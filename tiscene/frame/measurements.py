# SPDX-License-Identifier: Apache-2.0
"""Measurements of the objects of a frame: boxes, amodal masks, numbers of pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import matrix_from_quaternion
from tiscene.scene.camera import Quaternion, Vector3


@dataclass(frozen=True)
class OrientedBox:
    """A box in the axes of its object.

    Attributes:
        center: m, world.
        size: lengths along its axes, m.
        rotation: unit quaternion (w, x, y, z) from its axes to the world.
    """

    center: Vector3
    size: Vector3
    rotation: Quaternion

    def corners(self) -> NDArray[np.float64]:
        """Return its corners: float64 [8, 3], m, world; corner i is at the high end of axis a if bit a of i is set."""
        signs = np.array([[(corner >> axis & 1) - 0.5 for axis in range(3)] for corner in range(8)])
        axes = matrix_from_quaternion(self.rotation)
        corners: NDArray[np.float64] = np.asarray(self.center) + (signs * self.size) @ axes.T
        return corners


@dataclass(frozen=True, eq=False)
class AmodalMask:
    """The pixels that an object would cover without occluders.

    Attributes:
        inside: number of them in the image.
        outside: number of them beyond the image's edges.
        shape: of the image.
        window: x, y, width and height of the box around those in the image.
        bits: their mask in the window, packed, row by row.
    """

    inside: int
    outside: int
    shape: tuple[int, int]
    window: tuple[int, int, int, int]
    bits: NDArray[np.uint8]

    def mask(self) -> NDArray[np.bool_]:
        """Return the pixels in the image: bool [h, w], a new array."""
        x, y, width, height = self.window
        mask = np.zeros(self.shape, bool)
        mask[y : y + height, x : x + width] = np.unpackbits(self.bits, count=width * height).reshape(height, width)
        return mask


class ObjectMeasurements(Protocol):
    """Measurements of all objects of a frame, by row, computed on demand (`tiscene.render.annotations`)."""

    @property
    def visible_pixels(self) -> NDArray[np.int64]: ...
    @property
    def visible_box(self) -> NDArray[np.float64]: ...
    @property
    def amodal_box(self) -> NDArray[np.float64]: ...
    @property
    def world_bounds(self) -> NDArray[np.float64]: ...
    @property
    def box_3d(self) -> list[OrientedBox]: ...
    @property
    def amodal_pixels(self) -> NDArray[np.int64]: ...
    @property
    def pixels_in_frame(self) -> NDArray[np.int64]: ...
    def amodal_counts(self, rows: Sequence[int]) -> NDArray[np.int64]:
        """Return `pixels_in_frame` and `amodal_pixels` of some rows: int64 [n, 2]; others need not be measured."""
        ...

    def amodal_mask(self, row: int) -> NDArray[np.bool_]: ...


@dataclass(frozen=True, eq=False)
class StoredMeasurements:
    """Measurements as plain arrays: what a pickle holds."""

    visible_pixels: NDArray[np.int64]
    visible_box: NDArray[np.float64]
    amodal_box: NDArray[np.float64]
    world_bounds: NDArray[np.float64]
    box_3d: list[OrientedBox]
    amodal_pixels: NDArray[np.int64]
    pixels_in_frame: NDArray[np.int64]
    amodal_masks: list[AmodalMask]

    def amodal_counts(self, rows: Sequence[int]) -> NDArray[np.int64]:
        """Return `pixels_in_frame` and `amodal_pixels` of some rows: int64 [n, 2]."""
        return np.stack([self.pixels_in_frame[rows], self.amodal_pixels[rows]], axis=1)

    def amodal_mask(self, row: int) -> NDArray[np.bool_]:
        """Return the pixels in the image that an object would cover without occluders: bool [h, w]."""
        return self.amodal_masks[row].mask()


_NO_COUNTS: NDArray[np.int64] = np.zeros(0, np.int64)
NO_MEASUREMENTS = StoredMeasurements(
    _NO_COUNTS, np.zeros((0, 4)), np.zeros((0, 4)), np.zeros((0, 2, 3)), [], _NO_COUNTS, _NO_COUNTS, []
)
