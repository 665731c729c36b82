# SPDX-License-Identifier: Apache-2.0
"""Labeled pixels of a course with their surroundings: classification data for libraries that know no frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics import argument_checks
from tiscene.errors import ArgumentError
from tiscene.learning.answers import Answer, Pending
from tiscene.learning.course import Course, check_course
from tiscene.learning.supervision import Supervision
from tiscene.learning.teaching_policies import OnePixelPerMovingObject, Policy, chosen_pixels


@dataclass(frozen=True, eq=False)
class LabeledPatch:
    """A labeled pixel and its surroundings.

    Attributes:
        patch: uint8 [size, size, 3], the pixel in its middle; black beyond the image's edges.
        category_id: its label, as the teacher said it.
        category: its name; "" for the background.
        frame: index of its frame in the course.
        pixel: row and column.
        phase: number of the frame's phase.
        arrives: index of the frame at which the label arrives.
    """

    patch: NDArray[np.uint8]
    category_id: int
    category: str
    frame: int
    pixel: tuple[int, int]
    phase: int
    arrives: int


def labeled_patches(course: Course, size: int = 33) -> Iterator[LabeledPatch]:
    """Yield what the teacher of a course labels unasked, in the order of the frames.

    Args:
        course: phases with `supervision=`; the buffer rgb is rendered. Phases that evaluate are left out.
        size: side of the patches, px, odd.
    """
    _check(course, size)
    teacher = Supervision(course)
    waiting: dict[tuple[int, tuple[int, int]], tuple[NDArray[np.uint8], int]] = {}
    for index in range(len(course)):
        number, _ = course.phase_at(index)
        if course.phases[number].evaluate:
            continue
        frame = course[index]
        for pixel, answer in teacher.offers(frame):
            patch = patch_around(frame.rgb, pixel, size)
            if isinstance(answer, Pending):
                waiting[index, pixel] = patch, number
            else:
                yield _patch(patch, answer, number, index)
        for answer in teacher.arrived(index):
            patch, number = waiting.pop((answer.frame, answer.pixel))
            yield _patch(patch, answer, number, index)


def patches_of_tests(course: Course, size: int = 33, policy: Policy | None = None) -> Iterator[LabeledPatch]:
    """Yield labeled patches of the tests of a course; `phase` is the number of the test.

    Args:
        course: a course with tests.
        size: side of the patches, px, odd.
        policy: which pixels are tested; None: one of each moving object in each frame.
    """
    _check(course, size)
    tests = course.tests
    if tests is None:
        raise ArgumentError("the course has no tests: Course(phases, tests=...)")
    chosen = policy or OnePixelPerMovingObject()
    for index in range(len(tests)):
        frame, at = tests[index], tests.rules_at(index)
        rng = np.random.default_rng((0x7E57, index))
        for y, x in chosen_pixels(chosen, frame, at.moment(rng, frame.moving)):
            patch, label = patch_around(frame.rgb, (y, x), size), int(frame.semantic[y, x])
            yield LabeledPatch(patch, label, frame.categories[label], index, (y, x), at.phase, index)


def patch_around(rgb: NDArray[np.uint8], pixel: tuple[int, int], size: int) -> NDArray[np.uint8]:
    """Return the square of `size` px around a pixel, black beyond the image's edges."""
    half = size // 2
    padded = np.pad(rgb, ((half, half), (half, half), (0, 0)))
    y, x = pixel
    patch: NDArray[np.uint8] = padded[y : y + size, x : x + size].copy()
    return patch


def _patch(patch: NDArray[np.uint8], answer: Answer, phase: int, arrives: int) -> LabeledPatch:
    return LabeledPatch(patch, answer.category_id, answer.category, answer.frame, answer.pixel, phase, arrives)


def _check(course: Course, size: int) -> None:
    check_course(course)
    if argument_checks.integer(size, "size", 1) % 2 == 0:
        raise ArgumentError(f"size={size}: must be an odd number of pixels")
    if "rgb" not in course.settings["buffers"]:
        raise ArgumentError("patches need the buffer rgb: Course(..., buffers=('rgb', ...))")
