# SPDX-License-Identifier: Apache-2.0
"""Synaptic intelligence (Zenke, Poole and Ganguli, "Continual Learning Through Synaptic Intelligence", 2017).

The importance of a weight is its share of the decrease of the loss along the path of learning, over the square of its
total change.
"""

from __future__ import annotations

from collections.abc import Mapping

from tiscene.errors import requires_extra
from tiscene.learning.baselines.consolidation import ConsolidatingLearner
from tiscene.learning.baselines.pixel_network import LabeledPicture, one_thread, pictures

with requires_extra("torch"):
    import torch

DAMPING = 1e-3  # keeps the importance of weights that hardly moved finite


class SynapticIntelligence(ConsolidatingLearner):
    """SI. Arguments are those of ConsolidatingLearner."""

    def __init__(
        self, categories: Mapping[int, str], seed: int = 0, rate: float = 2e-3, strength: float = 0.3, every: int = 200
    ) -> None:
        super().__init__(categories, seed, rate, strength, every)
        weights = list(self.network.parameters())
        self.path = [torch.zeros_like(w) for w in weights]
        self.importance = [torch.zeros_like(w) for w in weights]
        self.anchor = [w.detach().clone() for w in weights]

    def penalty(self, inputs: torch.Tensor) -> torch.Tensor | float:
        rows = zip(self.importance, self.network.parameters(), self.anchor, strict=True)
        return self.strength * sum((each * (w - old).square()).sum() for each, w, old in rows)

    @one_thread()
    def step(self, batch: list[LabeledPicture]) -> None:
        weights = list(self.network.parameters())
        before = [w.detach().clone() for w in weights]
        # The path integral is of the loss without the penalty.
        loss = self.loss(self.network(pictures([each.rgb for each in batch])), batch)
        slopes = torch.autograd.grad(loss, weights)
        super().step(batch)
        for path, slope, old, w in zip(self.path, slopes, before, weights, strict=True):
            path -= slope * (w.detach() - old)

    def consolidate(self) -> None:
        weights = list(self.network.parameters())
        for importance, path, old, w in zip(self.importance, self.path, self.anchor, weights, strict=True):
            importance += path.clamp(min=0.0) / ((w.detach() - old).square() + DAMPING)
            path.zero_()
        self.anchor = [w.detach().clone() for w in weights]

    def stored_bytes(self) -> int:
        return sum(each.nbytes for each in (*self.path, *self.importance, *self.anchor))
