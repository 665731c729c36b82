# SPDX-License-Identifier: Apache-2.0
"""SupervisionRules: what a teacher may say; RulesAt: those that hold at a frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from dynamics import argument_checks
from tiscene.errors import ArgumentError
from tiscene.learning.teaching_policies import Asked, Moment, Policy, check_policy


@dataclass(frozen=True)
class SupervisionRules:
    """What a teacher may say.

    Attributes:
        policy: which pixels it labels unasked, and when it is silent.
        budget: number of labels that it gives in all; None: unlimited.
        rate: labels per frame, which accumulate while they are not used: at frame k of the phase at most rate * (k + 1)
            labels have been given. None: unlimited.
        per_category: number of labels per category, 0 for the background included; None: unlimited.
        every: least number of frames from one frame with labels to the next.
        delay: number of frames until a label arrives. Labels that would arrive after the end count, but never arrive.
        within: how far from the present frame a label may be asked for, frames; None: any distance.
        noise: fraction of labels whose category is replaced by another one, 0..1: of a stream, by that of another
            object in the scene at that frame; of a course, by any other one of the course.
        seed: of the policy's and the noise's random numbers.

    Raises:
        ArgumentError: a value is out of range.
    """

    policy: Policy = field(default_factory=Asked)
    budget: int | None = None
    rate: float | None = None
    per_category: int | None = None
    every: int = 1
    delay: int = 0
    within: int | None = None
    noise: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        check_policy(self.policy, "policy")
        for name, low in (("budget", 0), ("per_category", 0), ("within", 0), ("every", 1), ("delay", 0), ("seed", 0)):
            value = getattr(self, name)
            if value is not None or name not in ("budget", "per_category", "within"):
                argument_checks.integer(value, name, low)
        if self.rate is not None:
            argument_checks.not_negative(self.rate, "rate")
        if not 0.0 <= argument_checks.number(self.noise, "noise") <= 1.0:
            raise ArgumentError(f"noise={self.noise!r}: must be a fraction from 0 to 1")


class RulesAt(NamedTuple):
    """The rules that hold at a frame.

    Attributes:
        rules: the rules.
        phase: number of the frame's phase.
        phase_index: the frame's number in its phase.
        length: number of frames of the phase; None: endless.
    """

    rules: SupervisionRules
    phase: int
    phase_index: int
    length: int | None

    def moment(self, rng: np.random.Generator, moving: frozenset[int]) -> Moment:
        """Return what policies are told of the frame; see `Moment`."""
        return Moment(self.phase_index, self.length, rng, moving)


class _Silent(Policy):
    def is_silent(self, moment: Moment) -> bool:
        return True


SILENCE = SupervisionRules(_Silent(), budget=0)  # of phases without supervision
