# SPDX-License-Identifier: Apache-2.0
"""PixelCounts: a confusion matrix of pixels, and the sets of pixels that are counted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError
from tiscene.learning.phase import CourseFrame
from tiscene.randomization.object_factors import DISTRACTOR

PIXELS = ("frame", "objects", "moving")


def selected_pixels(frame: CourseFrame, pixels: str) -> NDArray[np.bool_]:
    """Return which pixels of a frame count: bool [height, width].

    Args:
        frame: a frame with the buffer `instance`.
        pixels: "frame": all; "objects": those of the scenario's objects without distractors; "moving": those of objects
            that move.
    """
    if pixels == "frame":
        return np.ones(frame.instance.shape, np.bool_)
    objects = {row.id for row in frame.objects if row.template and not row.name.startswith(DISTRACTOR)}
    selected: NDArray[np.bool_] = np.isin(frame.instance, list(frame.moving if pixels == "moving" else objects))
    return selected


def check_pixels(value: str) -> str:
    """Return `value`, the name of a set of pixels."""
    if value not in PIXELS:
        raise ArgumentError(f"pixels={value!r}: must be one of {', '.join(PIXELS)}")
    return value


class PixelCounts:
    """Counts of pixels by true and predicted category.

    Args:
        categories: number of ids, the background included.

    Attributes:
        matrix: int64 [n, n + 1], rows by true id, columns by predicted id; the last one counts ids out of range.
    """

    def __init__(self, categories: int) -> None:
        self.matrix: NDArray[np.int64] = np.zeros((categories, categories + 1), np.int64)

    def add(self, truth: NDArray[Any], predicted: NDArray[Any]) -> tuple[int, int]:
        """Add pixels. Returns the number of correct ones and of all."""
        count = len(self.matrix)
        columns = np.where((predicted >= 0) & (predicted < count), predicted, count).astype(np.int64)
        cells = truth.astype(np.int64) * (count + 1) + columns
        self.matrix += np.bincount(cells, minlength=count * (count + 1)).reshape(self.matrix.shape)
        return int((columns == truth).sum()), len(truth)

    @property
    def total(self) -> int:
        """Number of pixels."""
        return int(self.matrix.sum())

    def accuracy(self) -> float | None:
        """Return the fraction of correct pixels; None: there are no pixels."""
        return float(np.trace(self.matrix) / self.total) if self.total else None

    def class_accuracy(self) -> float | None:
        """Return the mean over the categories that occur of the fraction of their pixels that are correct."""
        values = self.by_category()
        return float(np.mean(list(values.values()))) if values else None

    def by_category(self) -> dict[int, float]:
        """Return the fraction of correct pixels of each category id that occurs."""
        sums = self.matrix.sum(axis=1)
        return {int(row): float(self.matrix[row, row] / sums[row]) for row in np.flatnonzero(sums)}

    def scores(self, categories: Mapping[int, str]) -> dict[str, Any]:
        """Return all three as JSON-ready values; categories: names by id."""
        return {
            "accuracy": self.accuracy(),
            "class_accuracy": self.class_accuracy(),
            "by_category": named(self.by_category(), categories),
        }

    def to_json(self) -> list[list[int]]:
        """Return the cells that are not 0 as rows (true id, predicted id, number)."""
        return [[int(y), int(x), int(self.matrix[y, x])] for y, x in np.argwhere(self.matrix)]

    def load(self, cells: list[list[int]]) -> None:
        """Take the cells of `to_json`."""
        self.matrix[:] = 0
        for y, x, number in cells:
            self.matrix[y, x] = number


def named(values: Mapping[int, float], categories: Mapping[int, str]) -> dict[str, float]:
    """Return values by category id as values by category name; 0 is "background"."""
    return {categories[number] or "background": value for number, value in values.items()}
