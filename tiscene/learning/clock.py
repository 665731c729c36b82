# SPDX-License-Identifier: Apache-2.0
"""Clock: a stream that does not wait. A learner that is slower than the stream misses frames, reproducibly.

The cost is declared, not measured, so that results do not depend on the machine: a learner of cost 2.5 needs the time
of 2.5 frames to learn from one. Frames that pass meanwhile are predicted, but neither learned nor supervised (as in
Ghunaim et al., "Real-Time Evaluation in Online Continual Learning", CVPR 2023).
"""

from __future__ import annotations

from fractions import Fraction

from dynamics import argument_checks
from dynamics.clocks import exact


class Clock:
    """Time of a learner, in frames.

    Args:
        cost: frames that pass while the learner learns from one; up to 1: it misses none.

    Attributes:
        skipped: number of frames that the learner has missed.
    """

    def __init__(self, cost: float = 0.0) -> None:
        argument_checks.not_negative(cost, "cost")
        self.cost = exact(cost)
        self.skipped = 0
        self._free = Fraction(0)

    def starts(self, index: int) -> bool:
        """Return whether the learner is free at a frame; it is busy with this frame then."""
        if self._free > index:
            self.skipped += 1
            return False
        self._free = index + self.cost
        return True

    def state_dict(self) -> dict[str, object]:
        """Return the state as JSON-ready values."""
        return {"free": [self._free.numerator, self._free.denominator], "skipped": self.skipped}

    def load_state_dict(self, state: dict[str, object]) -> None:
        """Continue where `state_dict` was taken."""
        self._free = Fraction(*state["free"])  # type: ignore[misc]
        self.skipped = int(state["skipped"])  # type: ignore[call-overload]
