# SPDX-License-Identifier: Apache-2.0
"""Blind: predicts from past labels alone and never looks at a picture.

Each pixel gets the category of the recent label that is nearest in the image and in time. Where labels repeat from
frame to frame, its online accuracy is high; its near-future accuracy shows that nothing was learned (Hammoud et al.,
"Rapid Adaptation in Online Continual Learning: Are We Evaluating It Right?", ICCV 2023).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.learning.answers import Answer
from tiscene.learning.phase import CourseFrame


class Blind:
    """The category of the nearest recent label.

    Args:
        categories: names by category id.
        seed: unused: nothing is drawn.
        memory: number of labels that are kept.
        speed: px per frame: a label that is one frame older counts as that much farther away.
    """

    def __init__(self, categories: Mapping[int, str], seed: int = 0, memory: int = 60, speed: float = 1.0) -> None:
        self.memory, self.speed = memory, speed
        self.labels: list[tuple[int, int, int, int]] = []  # frame, y, x, category

    def predict(self, frame: CourseFrame) -> NDArray[np.int64]:
        """Return the category of the nearest label at each pixel; 0 before the first label."""
        height, width = frame.camera.height, frame.camera.width
        if not self.labels:
            return np.zeros((height, width), np.int64)
        age, y, x, category = np.array(self.labels).T
        rows, columns = np.mgrid[:height, :width]
        distance = (rows[..., None] - y) ** 2 + (columns[..., None] - x) ** 2
        distance = distance + (self.speed * (age.max() - age)) ** 2
        result: NDArray[np.int64] = category[np.argmin(distance, axis=-1)]
        return result

    def learn(self, frame: CourseFrame, answers: Sequence[Answer]) -> None:
        """Keep the labels that have arrived."""
        self.labels = [*self.labels, *((each.frame, *each.pixel, each.category_id) for each in answers)][-self.memory :]

    def state_dict(self) -> dict[str, Any]:
        """Return the whole state, for checkpoints."""
        return {"labels": list(self.labels)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue where `state_dict` was taken."""
        self.labels = list(state["labels"])
