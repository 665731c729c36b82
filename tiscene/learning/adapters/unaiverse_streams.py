# SPDX-License-Identifier: Apache-2.0
"""UNaIVERSE: a course as two streams of an agent, pictures for its `stdin` and targets for its `stdtar`."""

from __future__ import annotations

from typing import Any

import numpy as np
from PIL import Image

from tiscene.errors import ArgumentError, requires_extra
from tiscene.learning.course import Course, check_course
from tiscene.learning.phase import CourseFrame
from tiscene.learning.supervision import Supervision
from tiscene.learning.supervision_rules import SupervisionRules

UNLABELED = -100  # torch.nn.functional.cross_entropy ignores it


def unaiverse_streams(course: Course, *, group: str = "tiscene", public: bool = False) -> tuple[Any, Any]:
    """Return a course as two streams of UNaIVERSE. Each cycle of its clock shows the next frame, rendered then.

    Both streams give a frame the same tag, its index in the course. After the last frame they give nothing. An
    interaction reads the course from its first frame on, with a teacher of its own.

    Args:
        course: phases; the buffer rgb is rendered. Labels without delay.
        group: name of the streams' group.
        public: whether the streams belong to the public network.

    Returns:
        pictures: PIL images.
        targets: int64 tensors [1, height, width]: category ids where the teacher labels unasked, -100 elsewhere.

    Raises:
        MissingExtra: UNaIVERSE is not installed.
        ArgumentError: the course has delayed labels, or no colors.
    """
    with requires_extra("unaiverse"):
        import torch
        from unaiverse.streams import BufferedStream, DataProps

    if "rgb" not in check_course(course).settings["buffers"]:
        raise ArgumentError("pictures need the buffer rgb: Course(..., buffers=('rgb', ...))")
    for phase in course.phases:
        if isinstance(phase.supervision, SupervisionRules) and phase.supervision.delay:
            raise ArgumentError(f"phase {phase.name!r}: a stream of targets has the labels of its frame; set delay=0")
    lesson = _Lesson(course)

    class CourseStream(BufferedStream):  # type: ignore[misc]  # UNaIVERSE is not read
        """Frames of a course, by index."""

        def __init__(self, name: str, description: str, value: Any, **properties: Any) -> None:
            named = {"name": f"{name}@{group}", "group": group, "data_desc": description, "public": public}
            super().__init__(DataProps(**named, **properties))
            self.is_read_only, self._value = True, value

        def __len__(self) -> int:
            return len(course)

        def __getitem__(self, index_and_interaction: tuple[int, str | None]) -> tuple[Any, int]:
            index, interaction = index_and_interaction
            return (self._value(index, interaction), index) if 0 <= index < len(course) else (None, -1)

    def picture(index: int, _: str | None) -> Any:
        return Image.fromarray(lesson.frame(index).rgb)

    def target(index: int, interaction: str | None) -> Any:
        labels = np.full((1, course.height, course.width), UNLABELED, np.int64)
        for (y, x), category_id in lesson.labels(index, interaction):
            labels[0, y, x] = category_id
        return torch.from_numpy(labels)

    shape = {"tensor_shape": (1, course.height, course.width), "tensor_dtype": torch.long}
    names = ", ".join(f"{number} {name}" for number, name in course.categories.items() if name)
    pictures = CourseStream("pictures", "frames of a course", picture, data_type="img")
    targets = CourseStream("targets", f"labeled pixels: {names}", target, data_type="tensor", **shape)
    return pictures, targets


class _Lesson:
    """The frames of a course and the labels that its teacher gives unasked, for several readers."""

    def __init__(self, course: Course) -> None:
        self._course = course
        self._last: CourseFrame | None = None
        self._teachers: dict[str | None, tuple[Supervision, int]] = {}  # by reader, with its next frame

    def frame(self, index: int) -> CourseFrame:
        if self._last is None or self._last.index != index:
            self._last = self._course[index]
        return self._last

    def labels(self, index: int, reader: str | None) -> list[tuple[tuple[int, int], int]]:
        """Return pixels and category ids of a frame. A budget is spent from the first frame on."""
        teacher, start = self._teachers.get(reader, (Supervision(self._course), 0))
        if index < start:
            teacher, start = Supervision(self._course), 0
        found: list[tuple[tuple[int, int], int]] = []
        for k in range(start, index + 1):
            found = [(pixel, answer.category_id) for pixel, answer in self._offers(teacher, k)]
        self._teachers[reader] = teacher, index + 1
        return found

    def _offers(self, teacher: Supervision, index: int) -> list[tuple[tuple[int, int], Any]]:
        number, _ = self._course.phase_at(index)
        return [] if self._course.phases[number].evaluate else list(teacher.offers(self.frame(index)))
