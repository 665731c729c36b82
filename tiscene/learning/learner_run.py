# SPDX-License-Identifier: Apache-2.0
"""LearnerRun: one learner on its way through a course, with its teacher, clock, metrics and counts."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from fractions import Fraction
from types import NoneType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import argument_checks
from tiscene.errors import ArgumentError
from tiscene.learning.answers import Answer
from tiscene.learning.clock import Clock
from tiscene.learning.course import Course
from tiscene.learning.learner import Learner, check_learner
from tiscene.learning.phase import CourseFrame
from tiscene.learning.resource_usage import ResourceUsage
from tiscene.learning.stream_metrics import Metric
from tiscene.learning.supervision import Supervision
from tiscene.learning.task_matrix import TaskMatrix
from tiscene.learning.teaching_policies import check_pixel_list


class LearnerRun:
    """One learner on its way through a course.

    Args:
        name: of the learner.
        learner: the learner.
        course: the course.
        metrics: as they were made; each learner has copies of its own.
        clock: the same.

    Attributes:
        teacher: answers this learner alone.
        usage: what its calls cost.
        matrix: its counts on the tests.
        waiting: labels that arrived while it was busy.
    """

    def __init__(self, name: str, learner: Learner, course: Course, metrics: Sequence[Metric], clock: Clock) -> None:
        self.name, self.course = argument_checks.text(name, "name"), course
        self.learner = check_learner(learner, name)
        self.metrics = copy.deepcopy(tuple(metrics))
        names = [each.name for each in self.metrics]
        if len(set(names)) < len(names):
            raise ArgumentError(f"metrics: {', '.join(names)}: two metrics share a name")
        self.clock = copy.deepcopy(clock)
        self.options = [_options(each) for each in (*self.metrics, self.clock)]
        for metric in self.metrics:
            metric.begin(course)
        self.teacher = Supervision(course)
        self.usage = ResourceUsage()
        self.matrix = TaskMatrix(course)
        self.waiting: list[Answer] = []

    @property
    def undelivered(self) -> int:
        """Number of labels that were given and have not reached the learner."""
        return len(self.waiting) + self.teacher.awaited

    def predict(self, observation: CourseFrame) -> NDArray[np.integer[Any]]:
        """Return the learner's prediction, category ids [height, width].

        Raises:
            ArgumentError: it is something else.
        """
        with self.usage.of("predict"):
            prediction = np.asarray(self.learner.predict(observation))
        shape = self.course.height, self.course.width
        if prediction.shape != shape or not np.issubdtype(prediction.dtype, np.integer):
            raise ArgumentError(
                f"{self.name}: predict returned {prediction.dtype} {list(prediction.shape)}; it must return category "
                f"ids, integers {list(shape)}"
            )
        count = len(self.course.categories)
        if prediction.min() < 0 or prediction.max() >= count:
            found = f"{prediction.min()} to {prediction.max()}"
            raise ArgumentError(f"{self.name}: predict returned ids from {found}; category ids are 0 to {count - 1}")
        return prediction

    def step(self, frame: CourseFrame) -> None:
        """Predict the next frame of the course, then learn from it."""
        observation = self.course.observation(frame)
        prediction = self.predict(observation)
        for metric in self.metrics:
            if not metric.gap and frame.index % metric.every == 0:
                metric.update(frame, prediction)
        number, _ = self.course.phase_at(frame.index)
        self.waiting += self.teacher.arrived(frame.index)
        if self.course.phases[number].evaluate or not self.clock.starts(frame.index):
            return
        answers, self.waiting = self.waiting, []
        answers += [answer for _, answer in self.teacher.offers(frame) if isinstance(answer, Answer)]
        if ask := getattr(self.learner, "ask", None):
            with self.usage.of("ask"):
                pixels = check_pixel_list(ask(observation), f"{self.name}: ask")
            given = [self.teacher.ask(y, x, frame) for y, x in pixels]
            answers += [answer for answer in given if isinstance(answer, Answer)]
        with self.usage.of("learn"):
            self.learner.learn(observation, answers)

    def foresee(self, metric: Metric, frame: CourseFrame) -> None:
        """Predict a frame of the future."""
        metric.update(frame, self.predict(self.course.observation(frame)))

    def end_phase(self) -> None:
        """Tell the learner that a phase is over, if it may know."""
        shown = self.course.boundaries == "shown" or getattr(self.learner, "sees_phases", False)
        if shown and (end := getattr(self.learner, "end_of_phase", None)):
            with self.usage.of("learn"):
                end()

    def state_dict(self) -> dict[str, Any]:
        """Return the state, to be pickled."""
        return {
            "options": self.options,
            "learner": self.learner.state_dict(),  # type: ignore[attr-defined]
            "metrics": [each.state_dict() for each in self.metrics],
            "clock": self.clock.state_dict(),
            "teacher": self.teacher.state_dict(),
            "usage": self.usage.state_dict(),
            "matrix": self.matrix.state_dict(),
            "waiting": self.waiting,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take the state of `state_dict`."""
        self.learner.load_state_dict(state["learner"])  # type: ignore[attr-defined]
        for metric, each in zip(self.metrics, state["metrics"], strict=True):
            metric.load_state_dict(each)
        self.clock.load_state_dict(state["clock"])
        self.teacher.load_state_dict(state["teacher"])
        self.usage.load_state_dict(state["usage"])
        self.matrix.load_state_dict(state["matrix"])
        self.waiting = state["waiting"]


def _options(part: object) -> tuple[str, dict[str, str]]:
    """Return the type of a metric or clock that has not begun, and its options, to be compared with a checkpoint's."""
    plain = (bool, int, float, str, Fraction, NoneType)
    options = {name: value for name, value in vars(part).items() if isinstance(value, plain) or is_dataclass(value)}
    return type(part).__qualname__, {name: repr(value) for name, value in options.items()}
