# SPDX-License-Identifier: Apache-2.0
"""FlowCoherence: features learned without labels, from optical flow alone; labels train only the last layer.

A point keeps its features while it moves, and differs from other points: the features of pixels and of where flow takes
them are pulled together, others are pushed apart (a contrastive loss along flow, in the spirit of Tiezzi et al.,
"Stochastic Coherence Over Attention Trajectory For Continuous Learning In Video Streams", IJCAI 2022, and Betti et al.,
"Learning visual features under motion invariance", 2020). Needs the observed buffers rgb and forward_flow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError, requires_extra
from tiscene.learning.answers import Answer
from tiscene.learning.baselines.pixel_network import LabeledPicture, PixelLearner, one_thread, pictures
from tiscene.learning.phase import CourseFrame

with requires_extra("torch"):
    import torch
    from torch.nn.functional import cross_entropy, normalize


class FlowCoherence(PixelLearner):
    """Contrastive features along flow, with a linear classifier on top.

    Args:
        categories: names by category id.
        seed: of all draws.
        rate: learning rate.
        points: pixels of each step, half of them where flow is largest.
        temperature: of the contrastive loss.
    """

    HEAD_RATE = 20.0  # the last layer learns that much faster than the features

    def __init__(
        self,
        categories: Mapping[int, str],
        seed: int = 0,
        rate: float = 2e-3,
        points: int = 96,
        temperature: float = 0.2,
    ) -> None:
        super().__init__(categories, seed, rate)
        self.points, self.temperature = points, temperature
        self.previous: tuple[int, NDArray[np.uint8], NDArray[np.float32]] | None = None

    def reset(self) -> None:
        super().reset()
        groups = [
            {"params": self.network.layers.parameters()},
            {"params": self.network.head.parameters(), "lr": self.HEAD_RATE * self.rate},
        ]
        self.optimizer = torch.optim.Adam(groups, lr=self.rate)

    def learn(self, frame: CourseFrame, answers: Sequence[Answer]) -> None:
        if "forward_flow" not in frame:
            raise ArgumentError("flow: needs the buffer forward_flow: Course(..., observed=('rgb', 'forward_flow'))")
        if self.previous is not None and self.previous[0] == frame.index - 1:
            self._cohere(*self.previous[1:], frame.rgb)
        self.previous = frame.index, frame.rgb, frame.forward_flow
        super().learn(frame, answers)

    @one_thread()
    def _cohere(self, before: NDArray[np.uint8], flow: NDArray[np.float32], after: NDArray[np.uint8]) -> None:
        """Take a step that makes features coherent along the flow between two frames."""
        start = self._drawn(flow)
        end = np.rint(start + flow[start[:, 0], start[:, 1]][:, ::-1]).astype(np.int64)
        height, width = flow.shape[:2]
        inside = (end >= 0).all(axis=1) & (end[:, 0] < height) & (end[:, 1] < width)
        start, end = start[inside], end[inside]
        if len(start) < 2:
            return
        features = normalize(self.network.features(pictures([before, after])), dim=1)
        first = features[0, :, start[:, 0], start[:, 1]].T
        second = features[1, :, end[:, 0], end[:, 1]].T
        self.descend(cross_entropy(first @ second.T / self.temperature, torch.arange(len(start))))

    def _drawn(self, flow: NDArray[np.float32]) -> NDArray[np.int64]:
        """Draw pixels (y, x), half of them in proportion to the length of their flow."""
        length = np.linalg.norm(np.nan_to_num(flow, posinf=0.0, neginf=0.0), axis=-1).ravel()
        anywhere = self.rng.choice(len(length), self.points // 2, replace=False)
        moving = anywhere[:0]
        if length.sum() > 0.0:
            count = min(self.points // 2, int((length > 0.0).sum()))
            moving = self.rng.choice(len(length), count, replace=False, p=length / length.sum())
        chosen = np.unique(np.concatenate([anywhere, moving]))
        return np.column_stack(np.divmod(chosen, flow.shape[1]))

    @one_thread()
    def step(self, batch: list[LabeledPicture]) -> None:
        """Train the last layer alone on labeled pictures."""
        with torch.no_grad():
            features = self.network.features(pictures([each.rgb for each in batch]))
        self.descend(self.loss(self.network.head(features), batch))

    def stored_bytes(self) -> int:
        return 0 if self.previous is None else self.previous[1].nbytes + self.previous[2].nbytes
