# SPDX-License-Identifier: Apache-2.0
"""Courses for Avalanche: an experience for each phase, in the order of the course.

Avalanche classifies pictures, so each label becomes a patch around its pixel. Its experiences are finite and are
shuffled within by default: for the order of the stream, pass `shuffle=False` to `strategy.train`, and to
`split_online_stream`, which divides an experience into small ones.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tiscene.errors import ArgumentError, requires_extra
from tiscene.learning.adapters.labeled_patches import LabeledPatch, labeled_patches, patches_of_tests
from tiscene.learning.course import Course
from tiscene.learning.teaching_policies import Policy


def avalanche_benchmark(course: Course, *, size: int = 33, policy: Policy | None = None) -> Any:
    """Return an Avalanche benchmark of a course: an experience for each phase with labels, and one for each test.

    The course is rendered once; patches of 3 * size^2 bytes are kept.

    Args:
        course: phases with `supervision=`, and tests. Delayed labels stand where they arrive.
        size: side of the patches, px, odd.
        policy: which pixels of the tests are classified; None: one of each moving object in each frame.

    Returns:
        A `CLScenario` with `train_stream` and `test_stream`. Pictures are float32 [3, size, size], 0..1; classes are
        category ids; the phases' numbers are in `experience.origin_stream` order.

    Raises:
        MissingExtra: Avalanche is not installed.
        ArgumentError: the course has no labels or no tests.
    """
    with requires_extra("avalanche"):
        import torch
        from avalanche.benchmarks import benchmark_from_datasets
        from avalanche.benchmarks.utils import as_classification_dataset

    def dataset(patches: list[LabeledPatch]) -> Any:
        stacked = torch.from_numpy(np.stack([each.patch for each in patches])).permute(0, 3, 1, 2).contiguous()
        targets = torch.tensor([each.category_id for each in patches])
        return as_classification_dataset(_Pictures(stacked, targets))

    class _Pictures(torch.utils.data.Dataset):  # type: ignore[misc]  # torch is not read
        """Pictures of bytes, as floats."""

        def __init__(self, pictures: Any, targets: Any) -> None:
            self.pictures, self.targets = pictures, targets.tolist()

        def __len__(self) -> int:
            return len(self.pictures)

        def __getitem__(self, index: int) -> Any:
            return self.pictures[index].float() / 255.0, self.targets[index]

    train = _by_phase(list(labeled_patches(course, size)))
    test = _by_phase(list(patches_of_tests(course, size, policy)))
    if not train:
        raise ArgumentError("no phase of the course has labels: Phase(..., supervision=RandomPixels(4))")
    return benchmark_from_datasets(train=[dataset(each) for each in train], test=[dataset(each) for each in test])


def _by_phase(patches: list[LabeledPatch]) -> list[list[LabeledPatch]]:
    numbers = sorted({each.phase for each in patches})
    return [[each for each in patches if each.phase == number] for number in numbers]
