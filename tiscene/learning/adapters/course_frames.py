# SPDX-License-Identifier: Apache-2.0
"""CourseFrames: a course as a source of data sets for PyTorch, Grain and Hugging Face, with workers and ranks."""

from __future__ import annotations

from typing import Any

from tiscene.learning.course import Course, check_course
from tiscene.learning.phase import CourseFrame
from tiscene.scenario.scenario import Scenario
from tiscene.stream.loaders.loader_methods import LoaderMethods


class CourseFrames(LoaderMethods):
    """The frames of a course, with the methods `torch`, `dataset` and `huggingface` of a stream.

    `transform=` gets frames that know their `phase`.

    Args:
        course: the course.
    """

    def __init__(self, course: Course) -> None:
        self.course = check_course(course)
        self.width, self.height, self.frames = course.width, course.height, course.frames
        self.buffers: tuple[str, ...] = course.settings["buffers"]

    @property
    def position(self) -> int:
        """The position of the course."""
        return self.course.position

    @property
    def scenario(self) -> Scenario:
        """The scenario of the first phase, whose cameras are those of all."""
        scenario = self.course.phases[0].scenario
        assert isinstance(scenario, Scenario)  # since Phase.__post_init__
        return scenario

    def settings(self) -> dict[str, Any]:
        """Return what a saved position belongs to."""
        return {"course": self.course.digest()}

    def __getitem__(self, index: int) -> CourseFrame:
        return self.course[index]
