# SPDX-License-Identifier: Apache-2.0
"""Metrics of a learner while it learns: each counts predictions that were made before the label was known."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dynamics import argument_checks
from tiscene.errors import ArgumentError
from tiscene.learning.course import Course
from tiscene.learning.drift import SCENARIO
from tiscene.learning.phase import CourseFrame
from tiscene.learning.pixel_counts import PixelCounts, check_pixels, selected_pixels
from tiscene.learning.teaching_policies import FollowMovingObjects, Policy, check_policy, chosen_pixels

_FOCUS = 0x60C
Key = TypeVar("Key", int, str)


class Metric(ABC):
    """A metric of the predictions of one learner on one course.

    A metric is made once per evaluation: `begin` sets it to zero.

    Attributes:
        name: key of its values in the score.
        gap: number of frames by which a prediction is ahead of learning; 0: the prediction of the next frame.
        every: it is updated at every `every`-th frame.
    """

    name = ""
    gap = 0
    every = 1

    @abstractmethod
    def begin(self, course: Course) -> None:
        """Set all counts to zero."""

    @abstractmethod
    def update(self, frame: CourseFrame, prediction: NDArray[Any]) -> None:
        """Count a prediction of a frame, [height, width]."""

    @abstractmethod
    def result(self) -> dict[str, Any]:
        """Return the values as JSON-ready values."""

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """Return the counts as JSON-ready values."""

    @abstractmethod
    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take the counts of `state_dict`."""


class OnlineAccuracy(Metric):
    """Prequential accuracy: each frame is predicted, then learned (Gama et al., "On evaluating stream learning
    algorithms", 2013).

    Args:
        pixels: the pixels that count: "objects" (of the scenario), "moving" (objects), or "frame"; None: those of the
            course. Its values are then called "online", else "online_" with the name of the pixels.
        window: frames of a point of the curve.

    Values: `accuracy` (of all pixels), `class_accuracy` (mean over categories), `by_category`, `by_phase`, `by_factor`,
    and `curve`: pairs (first frame of the window, accuracy).
    """

    key = "online"

    def __init__(self, pixels: str | None = None, window: int = 25) -> None:
        self.chosen = None if pixels is None else check_pixels(pixels)
        argument_checks.integer(window, "window", 1)
        self.window = window
        self.name = self.key if pixels is None else f"{self.key}_{pixels}"

    def begin(self, course: Course) -> None:
        self._course = course
        self.pixels = self.chosen or course.pixels
        self._counts = PixelCounts(len(course.categories))
        self.hits: list[tuple[int, int, int]] = []  # frame, correct pixels, all pixels

    def update(self, frame: CourseFrame, prediction: NDArray[Any]) -> None:
        selected = selected_pixels(frame, self.pixels)
        self.hits.append((frame.index, *self._counts.add(frame.semantic[selected], prediction[selected])))

    def result(self) -> dict[str, Any]:
        return {
            "pixels": self.pixels,
            **self._counts.scores(self._course.categories),
            "by_phase": self._grouped(lambda index: self._course.phases[self._course.phase_at(index)[0]].name),
            "by_factor": {factors: value for factors, value in self._grouped(self._factors).items() if factors},
            "curve": self.curve(),
        }

    def _factors(self, index: int) -> str:
        """Return the drifting factors of a frame with their values; of scenarios their position; "" for none."""
        number, k = self._course.phase_at(index)
        phase = self._course.phases[number]
        shown = []
        for each, position in zip(phase.drift, phase.positions(k), strict=True):
            value = position if each.factor == SCENARIO else each.at(position)
            shown.append(f"{each.factor} {value:.4g}" if isinstance(value, int | float) else f"{each.factor} {value}")
        return ", ".join(shown)

    def _grouped(self, key: Callable[[int], Key]) -> dict[Key, float]:
        """Return the accuracy of groups of frames, by a key of their index; groups without pixels are left out."""
        sums: dict[Key, list[int]] = {}
        for index, correct, total in self.hits:
            group = sums.setdefault(key(index), [0, 0])
            group[0] += correct
            group[1] += total
        return {name: correct / total for name, (correct, total) in sums.items() if total}

    def curve(self) -> list[tuple[int, float]]:
        """Return pairs (first frame of a window, accuracy); windows without pixels are left out."""
        return sorted(self._grouped(lambda index: index // self.window * self.window).items())

    def state_dict(self) -> dict[str, Any]:
        return {"counts": self._counts.to_json(), "hits": [list(row) for row in self.hits]}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self._counts.load(state["counts"])
        self.hits = [(index, correct, total) for index, correct, total in state["hits"]]


class NearFutureAccuracy(OnlineAccuracy):
    """Accuracy of frame k + gap after learning up to frame k (Hammoud et al., "Rapid Adaptation in Online Continual
    Learning: Are We Evaluating It Right?", ICCV 2023).

    Learners that only repeat the labels of the last frames win online accuracy where labels repeat. With a gap that is
    longer than labels repeat for, they do not.

    Args:
        gap: frames.
        every: frames between two predictions.
        pixels: the pixels that count; None: those of the course.
        window: frames of a point of the curve.
    """

    key = "near_future"

    def __init__(self, gap: int = 50, every: int = 5, pixels: str | None = None, window: int = 25) -> None:
        super().__init__(pixels, window)
        for name, value in (("gap", gap), ("every", every)):
            argument_checks.integer(value, name, 1)
        self.gap, self.every = gap, every

    def result(self) -> dict[str, Any]:
        return {"gap": self.gap} | super().result()


class FocusAccuracy(Metric):
    """Accuracy at the pixels of a focus of attention.

    Args:
        focus: a policy whose pixels are the fixations, such as FocusOfAttention(fixations).
    """

    name = "focus"

    def __init__(self, focus: Policy | None = None) -> None:
        self.focus = check_policy(focus or FollowMovingObjects(), "focus")

    def begin(self, course: Course) -> None:
        self._course = course
        self._counts = PixelCounts(len(course.categories))

    def update(self, frame: CourseFrame, prediction: NDArray[Any]) -> None:
        rng = np.random.default_rng((_FOCUS, frame.index))
        pixels = chosen_pixels(self.focus, frame, self._course.rules_at(frame.index).moment(rng, frame.moving))
        if pixels:
            rows, columns = np.array(pixels).T
            self._counts.add(frame.semantic[rows, columns], prediction[rows, columns])

    def result(self) -> dict[str, Any]:
        return self._counts.scores(self._course.categories)

    def state_dict(self) -> dict[str, Any]:
        return {"counts": self._counts.to_json()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self._counts.load(state["counts"])


class Adaptation(OnlineAccuracy):
    """How a learner answers drift: the loss of accuracy, and the frames until it is made up for.

    With a(f) the accuracy of the `window` frames from f on, for a drift that begins at frame e:

    - `before`: a(e - window); `drop`: `before` minus the lowest a(f) until the next drift.
    - `recovery`: the first f - e with a(f) >= level * before; None: not before the next drift.
    - `adaptation`: the first f - e with a(f) >= level * a of the last window before the next drift.

    Args:
        window: frames.
        level: fraction of the accuracy that has to be reached again, 0..1.
        pixels: the pixels that count; None: those of the course.
    """

    key = "adaptation"

    def __init__(self, window: int = 25, level: float = 0.9, pixels: str | None = None) -> None:
        super().__init__(pixels, window)
        if not 0.0 < argument_checks.number(level, "level") <= 1.0:
            raise ArgumentError(f"level={level!r}: must be above 0 and at most 1")
        self.level = level

    def result(self) -> dict[str, Any]:
        frames = {index: (correct, total) for index, correct, total in self.hits}
        events = self._course.events()
        spans = itertools.pairwise([*events, len(self._course)])
        rows = [self._answer(frames, at, end) | {"change": events[at]} for at, end in spans]
        recoveries = [row["recovery"] for row in rows]
        done = [value for value in recoveries if value is not None]
        return {
            "pixels": self.pixels,
            "events": rows,
            "mean_recovery": float(np.mean(done)) if done else None,
            "recovered": len(done),
        }

    def _answer(self, frames: Mapping[int, tuple[int, int]], at: int, end: int) -> dict[str, Any]:
        def accuracy(first: int) -> float:
            pairs = [frames[index] for index in range(first, first + self.window) if index in frames]
            correct, total = (sum(column) for column in zip(*pairs, strict=True)) if pairs else (0, 0)
            return correct / total if total else math.nan

        starts = range(at, max(end - self.window, at) + 1)
        after = [accuracy(first) for first in starts]
        before, final = accuracy(at - self.window), after[-1]
        known = [value for value in after if not math.isnan(value)]

        def reached(level: float) -> int | None:
            return next((number for number, value in enumerate(after) if value >= level), None)

        return {
            "frame": at,
            "before": None if math.isnan(before) else before,
            "drop": None if math.isnan(before) or not known else before - min(known),
            "recovery": None if math.isnan(before) else reached(self.level * before),
            "adaptation": None if math.isnan(final) else reached(self.level * final),
        }
