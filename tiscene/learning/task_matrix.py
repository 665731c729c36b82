# SPDX-License-Identifier: Apache-2.0
"""TaskMatrix: counts of one learner on all tests after each phase."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.learning import accuracy_matrix
from tiscene.learning.course import Course
from tiscene.learning.phase import CourseFrame
from tiscene.learning.pixel_counts import PixelCounts, named

MEASURES = ("accuracy", "class_accuracy")


@dataclass(frozen=True, eq=False)
class Example:
    """A frame of a test with its true and its predicted categories, for people to look at.

    Attributes:
        test: name of the test.
        rgb: uint8 [h, w, 3], or None.
        truth: int [h, w].
        prediction: int [h, w].
        counted: bool [h, w], the pixels that count.
    """

    test: str
    rgb: NDArray[np.uint8] | None
    truth: NDArray[Any]
    prediction: NDArray[Any]
    counted: NDArray[np.bool_]


class TaskMatrix:
    """Counts of one learner on all tests: a row before the first phase, and one after each phase of learning.

    Args:
        course: the course, whose `pixels` count.
    """

    def __init__(self, course: Course) -> None:
        self.pixels = course.pixels
        self._course = course
        self._names = [phase.name for phase in course.test_phases]
        self._rows: list[tuple[int, str]] = []
        self._cells: list[list[PixelCounts]] = []
        self.examples: list[Example] = []

    def begin_row(self, phase: int, name: str) -> None:
        """Begin the row after a phase, counted from 1; 0: before the first."""
        self._rows.append((phase, name))
        self._cells.append([PixelCounts(len(self._course.categories)) for _ in self._names])
        self.examples = []

    def add(self, frame: CourseFrame, prediction: NDArray[Any], counted: NDArray[np.bool_]) -> None:
        """Count a prediction of a frame of a test."""
        number = self._names.index(frame.phase)
        self._cells[-1][number].add(frame.semantic[counted], prediction[counted])
        if frame.boundary:
            # A learner may return the same array again.
            self.examples.append(Example(frame.phase, frame.get("rgb"), frame.semantic, prediction.copy(), counted))

    def warn_of_empty_tests(self) -> None:
        """Warn of tests without pixels that count, which have no accuracy."""
        for name, cell in zip(self._names, self._cells[-1], strict=True):
            if not cell.total:
                cause = f"test {name!r}: none of its frames shows pixels that count (pixels={self.pixels!r})"
                warnings.warn(f"{cause}; means leave it out. Choose other frames: start=, frames=", stacklevel=2)

    def learned(self) -> list[int | None]:
        """Return for each test the row after the phase that it belongs to; None: it belongs to none."""
        rows = {name: row for row, (phase, name) in enumerate(self._rows) if phase}
        return [rows.get(name) for name in self._names]

    def result(self) -> dict[str, Any]:
        """Return R by measure with its scores, as JSON-ready values."""
        learned = self.learned()
        result: dict[str, Any] = {
            "pixels": self.pixels,
            "tests": self._names,
            "rows": [name for _, name in self._rows],
            "learned_after": learned,
        }
        for measure in MEASURES:
            values = [[getattr(cell, measure)() for cell in row] for row in self._cells]
            R = np.array(values, np.float64)  # None becomes nan
            result[measure] = {
                "R": [[None if np.isnan(value) else value for value in row] for row in R.tolist()],
                "ACC": accuracy_matrix.average_accuracy(R, learned),
                "BWT": accuracy_matrix.backward_transfer(R, learned),
                "FWT": accuracy_matrix.forward_transfer(R, learned),
                "forgetting": accuracy_matrix.forgetting(R, learned),
                "held_out": accuracy_matrix.held_out_accuracy(R, learned),
            }
        result["by_category"] = [
            named(cell.by_category(), self._course.categories) for cell in (self._cells or [[]])[-1]
        ]
        return result

    def state_dict(self) -> dict[str, Any]:
        """Return the counts as JSON-ready values."""
        return {
            "rows": [list(row) for row in self._rows],
            "cells": [[cell.to_json() for cell in row] for row in self._cells],
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take the counts of `state_dict`."""
        self._rows, self._cells = [], []
        for (phase, name), cells in zip(state["rows"], state["cells"], strict=True):
            self.begin_row(phase, name)
            for cell, counts in zip(self._cells[-1], cells, strict=True):
                cell.load(counts)
