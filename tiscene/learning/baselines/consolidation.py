# SPDX-License-Identifier: Apache-2.0
"""ConsolidatingLearner: a learner that protects what it has learned, at boundaries or after a number of steps."""

from __future__ import annotations

from collections.abc import Mapping

from tiscene.learning.baselines.pixel_network import LabeledPicture, PixelLearner


class ConsolidatingLearner(PixelLearner):
    """A learner with a point at which it consolidates: the end of each phase if it is shown, and every `every` steps.

    Args:
        categories: names by category id.
        seed: of all draws.
        rate: learning rate.
        strength: weight of the penalty.
        every: steps between consolidations where boundaries are hidden.
    """

    def __init__(
        self, categories: Mapping[int, str], seed: int = 0, rate: float = 2e-3, strength: float = 1.0, every: int = 200
    ) -> None:
        self.strength, self.every, self.steps = strength, every, 0
        super().__init__(categories, seed, rate)

    def consolidate(self) -> None:
        """Protect what has been learned so far."""
        raise NotImplementedError

    def step(self, batch: list[LabeledPicture]) -> None:
        super().step(batch)
        self.steps += 1
        if self.steps >= self.every:
            self.end_of_phase()

    def end_of_phase(self) -> None:
        """Consolidate. Called by the evaluation where boundaries are shown."""
        self.consolidate()
        self.steps = 0
