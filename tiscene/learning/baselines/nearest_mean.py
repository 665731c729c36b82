# SPDX-License-Identifier: Apache-2.0
"""NearestMean: nearest class mean on fixed features (Mensink et al., "Distance-Based Image Classification", 2013).

The features need no training: color and its spread in windows of several sizes. Means are updated label by label, so
nothing is forgotten.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import requires_extra
from tiscene.learning.answers import Answer
from tiscene.learning.baselines.pixel_network import answers_with_picture, keep_recent, one_thread
from tiscene.learning.phase import CourseFrame

with requires_extra("torch"):
    import torch
    from torch.nn.functional import avg_pool2d

WINDOWS = (1, 5, 11)  # px


class NearestMean:
    """Nearest class mean.

    Args:
        categories: names by category id.
        seed: unused: nothing is drawn.
    """

    def __init__(self, categories: Mapping[int, str], seed: int = 0) -> None:
        self.count = max(categories) + 1
        dimensions = 3 * (2 * len(WINDOWS) - 1)
        self.sums: NDArray[np.float64] = np.zeros((self.count, dimensions))
        self.squares: NDArray[np.float64] = np.zeros(dimensions)
        self.labels: NDArray[np.int64] = np.zeros(self.count, np.int64)
        self.recent: dict[int, NDArray[np.uint8]] = {}

    def predict(self, frame: CourseFrame) -> NDArray[np.int64]:
        """Return the category whose mean is nearest, in units of the features' deviations."""
        features = fixed_features(frame.rgb)
        known = np.flatnonzero(self.labels)
        if not len(known):
            return np.zeros(features.shape[:2], np.int64)
        means = self.sums[known] / self.labels[known, None]
        total = self.labels.sum()
        deviation = np.sqrt(np.maximum(self.squares / total - (self.sums.sum(axis=0) / total) ** 2, 1e-6))
        distance = np.square((features[:, :, None] - means) / deviation).sum(axis=-1)
        result: NDArray[np.int64] = known[np.argmin(distance, axis=-1)]
        return result

    def learn(self, frame: CourseFrame, answers: Sequence[Answer]) -> None:
        """Add the labels that have arrived to their means."""
        keep_recent(self.recent, frame)
        known = answers_with_picture(answers, self.recent)
        features = {index: fixed_features(self.recent[index]) for index in {each.frame for each in known}}
        for each in known:
            feature = features[each.frame][each.pixel]
            self.sums[each.category_id] += feature
            self.squares += feature**2
            self.labels[each.category_id] += 1

    def stored_bytes(self) -> int:
        """Return the memory of the means."""
        return self.sums.nbytes + self.squares.nbytes + self.labels.nbytes

    def state_dict(self) -> dict[str, Any]:
        """Return the whole state, for checkpoints."""
        return {name: value.copy() for name, value in vars(self).items() if name != "count"}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue where `state_dict` was taken."""
        vars(self).update({name: value.copy() for name, value in state.items()})


@one_thread()
def fixed_features(rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return mean and deviation of the color in windows around each pixel: float64 [h, w, n]."""
    picture = torch.from_numpy(rgb).permute(2, 0, 1)[None].double() / 255.0
    found = []
    for window in WINDOWS:
        mean = avg_pool2d(picture, window, stride=1, padding=window // 2, count_include_pad=False)
        found.append(mean)
        if window > 1:
            square = avg_pool2d(picture**2, window, stride=1, padding=window // 2, count_include_pad=False)
            found.append((square - mean**2).clamp(min=0.0).sqrt())
    result: NDArray[np.float64] = torch.cat(found, dim=1)[0].permute(1, 2, 0).numpy()
    return result
