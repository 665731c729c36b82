# SPDX-License-Identifier: Apache-2.0
"""Replay: fine-tuning on new labels together with stored ones.

Chaudhry et al., "On Tiny Episodic Memories in Continual Learning", 2019; reservoir sampling after Vitter, 1985.
"""

from __future__ import annotations

from collections.abc import Mapping

from tiscene.learning.baselines.pixel_network import LabeledPicture, PixelLearner


class Replay(PixelLearner):
    """Experience replay.

    Args:
        categories: names by category id.
        seed: of all draws.
        rate: learning rate.
        capacity: pictures in the reservoir.
        batch: stored pictures in each step.
    """

    def __init__(
        self, categories: Mapping[int, str], seed: int = 0, rate: float = 2e-3, capacity: int = 200, batch: int = 4
    ) -> None:
        super().__init__(categories, seed, rate)
        self.capacity, self.batch = capacity, batch
        self.reservoir: list[LabeledPicture] = []
        self.seen = 0

    def examples(self, arrived: list[LabeledPicture]) -> list[LabeledPicture]:
        chosen = self.rng.choice(len(self.reservoir), min(self.batch, len(self.reservoir)), replace=False)
        return arrived + [self.reservoir[row] for row in chosen.tolist()]

    def keep(self, arrived: list[LabeledPicture]) -> None:
        for each in arrived:
            self.seen += 1
            if len(self.reservoir) < self.capacity:
                self.reservoir.append(each)
            elif (row := int(self.rng.integers(self.seen))) < self.capacity:
                self.reservoir[row] = each

    def stored_bytes(self) -> int:
        return sum(each.nbytes for each in self.reservoir)
