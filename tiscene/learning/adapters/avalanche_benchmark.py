# SPDX-License-Identifier: Apache-2.0
"""Courses for Avalanche: an experience for each phase, in the order of the course.

Avalanche classifies pictures, so each label becomes a patch around its pixel. Its experiences are finite and are
shuffled within by default: for the order of the stream, pass `shuffle=False` to `strategy.train`, and to
`split_online_stream`, which divides an experience into small ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from dynamics import argument_checks
from tiscene.errors import ArgumentError, requires_extra
from tiscene.learning.adapters.labeled_patches import LabeledPatch, labeled_patches, patches_of_tests
from tiscene.learning.course import Course
from tiscene.learning.held_out_tests import SEPARATOR
from tiscene.learning.teaching_policies import Policy

CLASSES = ("classes_in_this_experience", "previous_classes", "classes_seen_so_far", "future_classes")


def avalanche_benchmark(
    course: Course, *, size: int = 33, policy: Policy | None = None, task_labels: bool = False
) -> Any:
    """Return an Avalanche benchmark of a course: an experience for each phase with labels, and one for each test.

    The course is rendered once; patches of 3 * size^2 bytes are kept.

    Args:
        course: phases with `supervision=`, and tests. Delayed labels stand where they arrive.
        size: side of the patches, px, odd.
        policy: which pixels of the tests are classified; None: one of each moving object in each frame.
        task_labels: True: task-incremental, for models with a head for each task. Each experience of training is a
            task, 0, 1, ...; a test is of the task of the phase that has its name, also with one factor changed. False:
            all are of task 0, since a course does not tell which phase it is in.

    Returns:
        A `CLScenario` with `train_stream` and `test_stream`, in the order of the course. Samples are (picture, class,
        task): pictures are float32 [3, size, size], 0..1, and classes are category ids. Experiences have
        `classes_in_this_experience` and the like.

    Raises:
        MissingExtra: Avalanche is not installed.
        ArgumentError: the course has no labels or no tests, the policy chooses no pixels of a test, or a test has no
            task.
    """
    argument_checks.flag(task_labels, "task_labels")
    with requires_extra("avalanche"):
        from avalanche.benchmarks import benchmark_from_datasets, with_classes_timeline, with_task_labels
        from avalanche.benchmarks.utils import (
            ConstantSequence,
            TaskAwareClassificationDataset,
            TaskLabels,
            as_classification_dataset,
        )

    def dataset(patches: Sequence[LabeledPatch], task: int) -> Any:
        pictures = as_classification_dataset(_Pictures(patches))
        return TaskAwareClassificationDataset(
            [pictures], data_attributes=[TaskLabels(ConstantSequence(task, len(patches)))]
        )

    train = _by_phase(labeled_patches(course, size))
    if not train:
        raise ArgumentError("no phase of the course has labels: Phase(..., supervision=RandomPixels(4))")
    tasks = {course.phases[number].name: task if task_labels else 0 for task, number in enumerate(train)}
    tests = [_task(phase.name, tasks) if task_labels else 0 for phase in course.test_phases]
    test = _by_phase(patches_of_tests(course, size, policy))
    for number, phase in enumerate(course.test_phases):
        if number not in test:  # the tests after it would take its number
            raise ArgumentError(f"test {phase.name!r}: the policy chooses no pixels of it: policy=RandomPixels(4)")
    benchmark = with_classes_timeline(
        benchmark_from_datasets(
            train=[dataset(*each) for each in zip(train.values(), tasks.values(), strict=True)],
            test=[dataset(*each) for each in zip(test.values(), tests, strict=True)],
        )
    )
    for experience in (*benchmark.train_stream, *benchmark.test_stream):
        for name in CLASSES:  # sets, of which Avalanche's heads make no indices
            setattr(experience, name, sorted(getattr(experience, name)))
    return with_task_labels(benchmark)


def _task(test: str, tasks: Mapping[str, int]) -> int:
    """Return the task of a test: that of the phase with its name, or of which it changes a factor."""
    for name in (test, test.rpartition(SEPARATOR)[0]):
        if name in tasks:
            return tasks[name]
    raise ArgumentError(
        f"test {test!r}: with task_labels=True, it needs the name of a phase that has labels: {', '.join(tasks)}"
    )


class _Pictures:
    """A map-style data set of pictures, which are kept as bytes and returned as floats."""

    def __init__(self, patches: Sequence[LabeledPatch]) -> None:
        import torch

        self.pictures = torch.from_numpy(np.stack([each.patch for each in patches])).permute(0, 3, 1, 2).contiguous()
        self.targets = [each.category_id for each in patches]

    def __len__(self) -> int:
        return len(self.targets)

    def __getitem__(self, index: int) -> tuple[Any, int]:
        return self.pictures[index].float() / 255.0, self.targets[index]


def _by_phase(patches: Iterable[LabeledPatch]) -> dict[int, list[LabeledPatch]]:
    """Return the patches of each phase that has any, by its number, in the order of the course."""
    found: dict[int, list[LabeledPatch]] = {}
    for each in patches:
        found.setdefault(each.phase, []).append(each)
    return dict(sorted(found.items()))
