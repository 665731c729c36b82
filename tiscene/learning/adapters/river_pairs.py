# SPDX-License-Identifier: Apache-2.0
"""Courses for river: pairs (features, category), in the order of the course.

`river.evaluate.progressive_val_score(pairs, model, metric)` predicts each pair, then learns it, as `ts.evaluate` does.
With `moment="frame"` and `delay=d` it learns a label d frames later, as a teacher with `delay=d` does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from tiscene.learning.adapters.labeled_patches import labeled_patches
from tiscene.learning.course import Course

Features = dict[str, float]
WINDOWS = (1, 5, 11)  # px


def river_pairs(
    course: Course,
    features: Callable[[NDArray[np.uint8]], Features] | None = None,
    *,
    size: int = 33,
    frame: bool = False,
) -> Iterator[tuple[Features, str]]:
    """Yield a pair (features, category) for each label that the teacher gives unasked.

    Args:
        course: phases with `supervision=`, without delay.
        features: of a patch, uint8 [size, size, 3], by name; None: `color_features`.
        size: side of the patches, px, odd.
        frame: whether the features have the frame's index as "frame", as the `moment` of river's evaluation.
    """
    compute = features or color_features
    for each in labeled_patches(course, size):
        found = compute(each.patch)
        yield (found | {"frame": each.frame} if frame else found), each.category or "background"


def color_features(patch: NDArray[np.uint8]) -> Features:
    """Return mean and standard deviation of the color, 0..1, in windows around the middle of a patch."""
    middle, found = len(patch) // 2, {}
    for window in WINDOWS:
        half = min(window // 2, middle)
        inside = patch[middle - half : middle + half + 1, middle - half : middle + half + 1].reshape(-1, 3) / 255.0
        for channel, name in enumerate(("red", "green", "blue")):
            found[f"{name}_{window}"] = float(inside[:, channel].mean())
            if window > 1:
                found[f"{name}_{window}_deviation"] = float(inside[:, channel].std())
    return found
