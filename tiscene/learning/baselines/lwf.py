# SPDX-License-Identifier: Apache-2.0
"""Learning without forgetting (Li and Hoiem, "Learning without Forgetting", 2016): distillation from the network as it
was at the last consolidation, on the pictures of the present.
"""

from __future__ import annotations

import copy

from tiscene.errors import requires_extra
from tiscene.learning.baselines.consolidation import ConsolidatingLearner
from tiscene.learning.baselines.pixel_network import PixelNetwork

with requires_extra("torch"):
    import torch
    from torch import nn

TEMPERATURE = 2.0


class LearningWithoutForgetting(ConsolidatingLearner):
    """LwF. Every pixel of the pictures of a step is distilled, labeled or not; `strength` is the weight of that."""

    def reset(self) -> None:
        super().reset()
        self.old: PixelNetwork | None = None

    def penalty(self, inputs: torch.Tensor) -> torch.Tensor | float:
        if self.old is None:
            return 0.0
        with torch.no_grad():
            wanted = nn.functional.softmax(self.old(inputs) / TEMPERATURE, dim=1)
        # The second pass through the network keeps `step` as it is; it costs a quarter of the step.
        found = nn.functional.log_softmax(self.network(inputs) / TEMPERATURE, dim=1)
        return -self.strength * TEMPERATURE**2 * (wanted * found).sum(dim=1).mean()

    def consolidate(self) -> None:
        self.old = copy.deepcopy(self.network)

    def stored_bytes(self) -> int:
        return 0 if self.old is None else sum(w.nbytes for w in self.old.parameters())
