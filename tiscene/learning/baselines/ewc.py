# SPDX-License-Identifier: Apache-2.0
"""Elastic weight consolidation, online (Kirkpatrick et al., "Overcoming catastrophic forgetting in neural networks",
2017; Schwarz et al., "Progress & Compress", 2018).

The penalty is strength / 2 * sum F (w - w*)^2, with the diagonal of the Fisher information estimated from the squared
gradients of the examples since the last consolidation, one by one, and decayed at each consolidation.
"""

from __future__ import annotations

from collections.abc import Mapping

from tiscene.errors import requires_extra
from tiscene.learning.baselines.consolidation import ConsolidatingLearner
from tiscene.learning.baselines.pixel_network import LabeledPicture, one_thread, pictures

with requires_extra("torch"):
    import torch

SAMPLES = 64  # examples of which the Fisher information is estimated


class ElasticWeightConsolidation(ConsolidatingLearner):
    """EWC. Arguments are those of ConsolidatingLearner, and the factor of the old Fisher information, `decay`."""

    def __init__(
        self,
        categories: Mapping[int, str],
        seed: int = 0,
        rate: float = 2e-3,
        strength: float = 300.0,
        every: int = 200,
        decay: float = 0.9,
    ) -> None:
        super().__init__(categories, seed, rate, strength, every)
        self.decay = decay
        self.fisher: list[torch.Tensor] = []
        self.anchor: list[torch.Tensor] = []
        self.last: list[LabeledPicture] = []

    def keep(self, arrived: list[LabeledPicture]) -> None:
        self.last = [*self.last, *arrived][-SAMPLES:]

    def penalty(self, inputs: torch.Tensor) -> torch.Tensor | float:
        rows = zip(self.fisher, self.network.parameters(), self.anchor, strict=False)
        return 0.5 * self.strength * sum((F * (w - old).square()).sum() for F, w, old in rows)

    @one_thread()
    def consolidate(self) -> None:
        weights = list(self.network.parameters())
        squares = [torch.zeros_like(w) for w in weights]
        for each in self.last:
            self.network.zero_grad()
            self.loss(self.network(pictures([each.rgb])), [each]).backward()
            for square, w in zip(squares, weights, strict=True):
                square += w.grad.square() / len(self.last)
        old = self.fisher or [torch.zeros_like(w) for w in weights]
        self.fisher = [self.decay * before + now for before, now in zip(old, squares, strict=True)]
        self.anchor = [w.detach().clone() for w in weights]
        self.last = []

    def stored_bytes(self) -> int:
        tensors: int = sum(each.nbytes for each in (*self.fisher, *self.anchor))
        return tensors + sum(each.nbytes for each in self.last)
