# SPDX-License-Identifier: Apache-2.0
"""PartArray: a device array of parts, one after another, that copies only parts which it does not hold yet."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.memory import copy_rows, device_array, nbytes, write_rows

SPARE = 8  # the part of the rows that is added when an array with some of the parts grows


class ArrayPart(NamedTuple):
    """Rows of a PartArray.

    Attributes:
        source: What the rows are made from. It must not change while an array holds them.
        number: What they depend on besides.
        length: Number of rows.
        rows: Makes the rows, called when they are copied.
    """

    source: Any
    number: int
    length: int
    rows: Callable[[], NDArray[Any]]


class PartArray:
    """A device array [n] or [n, width] that scenes with the same first parts use one after another.

    Args:
        dtype: np.int32 or np.float32.
        width: Length of the second axis; None: there is none.

    Attributes:
        array: The device array, at least one row; those beyond the parts have any value. Replaced when it grows.
    """

    def __init__(self, dtype: type[np.generic], width: int | None = None) -> None:
        self._dtype, self._width = dtype, width
        self.array = self._new(1)
        self._held: list[tuple[Any, int, int]] = []

    @property
    def nbytes(self) -> int:
        """The memory of the array, bytes."""
        return nbytes(self.array)

    def write(self, parts: Sequence[ArrayPart]) -> Any:
        """Make the array hold parts, in this order; without any, it stays as it is. Return the array."""
        if not parts:
            return self.array
        same = sum(
            1
            for _ in itertools.takewhile(
                lambda pair: pair[0][0] is pair[1].source and pair[0][1:] == pair[1][1:3],
                zip(self._held, parts, strict=False),
            )
        )
        count, first = sum(part.length for part in parts), sum(part.length for part in parts[:same])
        if count > self.array.shape[0]:
            larger = self._new(count + count // SPARE if first else count)
            copy_rows(self.array, larger, first)
            self.array = larger
        del self._held[same:]  # an interruption leaves them half written
        for part in filter(lambda part: part.length, parts[same:]):
            write_rows(self.array, first, np.asarray(part.rows(), self._dtype))
            first += part.length
        self._held = [(part.source, part.number, part.length) for part in parts]
        return self.array

    def _shape(self, count: int) -> tuple[int, ...]:
        return (count,) if self._width is None else (count, self._width)

    def _new(self, count: int) -> Any:
        return device_array(ti.i32 if self._dtype is np.int32 else ti.f32, self._shape(count))
