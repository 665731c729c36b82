# SPDX-License-Identifier: Apache-2.0
"""Shuffled: the labels of all phases so far in random order, as if they were independent and identically distributed.

An upper bound: it keeps everything and sees the end of each phase. Until then it predicts with the network of the phase
before, so its online accuracy means nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tiscene.learning.answers import Answer
from tiscene.learning.baselines.pixel_network import LabeledPicture, PixelLearner
from tiscene.learning.phase import CourseFrame


class Shuffled(PixelLearner):
    """Training from the start, at the end of each phase, on all labels so far in random order.

    Args:
        categories: names by category id.
        seed: of all draws.
        rate: learning rate of the first step; it falls to 0 along the steps.
        batch: pictures of each step.
        passes: steps for each labeled picture, so each is drawn `passes * batch` times on average.
    """

    sees_phases = True

    def __init__(
        self, categories: Mapping[int, str], seed: int = 0, rate: float = 2e-3, batch: int = 5, passes: int = 2
    ) -> None:
        super().__init__(categories, seed, rate)
        self.batch, self.passes = batch, passes
        self.stored: list[LabeledPicture] = []

    def learn(self, frame: CourseFrame, answers: Sequence[Answer]) -> None:
        self.recent[frame.index] = frame.rgb
        self.stored += self._arrived(answers)

    def end_of_phase(self) -> None:
        """Train anew."""
        self.reset()
        steps = self.passes * len(self.stored)
        for number in range(steps):
            for group in self.optimizer.param_groups:
                group["lr"] = self.rate * (1.0 - number / steps)
            rows = self.rng.choice(len(self.stored), min(self.batch, len(self.stored)), replace=False)
            self.step([self.stored[row] for row in rows.tolist()])

    def stored_bytes(self) -> int:
        return sum(each.nbytes for each in self.stored)
