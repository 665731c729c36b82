# SPDX-License-Identifier: Apache-2.0
"""The accuracy matrix R of continual learning, and the scores that are made of it.

R[i, j] is the accuracy on test j after i phases; row 0 is the untrained learner. Test j belongs to the phase
`learned[j]` (counted from 1), in which what it tests is learned; None: to no phase. A test without pixels that count
has nan in its column; means leave it out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
Learned = Sequence[int | None]


def average_accuracy(R: Matrix, learned: Learned) -> float | None:
    """Return ACC: the mean over learned tests of the accuracy after the last phase (Lopez-Paz and Ranzato, 2017)."""
    return _mean([R[-1, j] for j, phase in enumerate(learned) if phase is not None])


def backward_transfer(R: Matrix, learned: Learned) -> float | None:
    """Return BWT: the mean of R[T, j] - R[learned[j], j] over tests learned before the last phase T.

    Lopez-Paz and Ranzato, "Gradient Episodic Memory for Continual Learning", 2017. Negative: forgetting.
    """
    last = len(R) - 1
    return _mean([R[-1, j] - R[phase, j] for j, phase in enumerate(learned) if phase is not None and phase < last])


def forward_transfer(R: Matrix, learned: Learned) -> float | None:
    """Return FWT: the mean of R[learned[j] - 1, j] - R[0, j] over tests learned after the first phase.

    Lopez-Paz and Ranzato, 2017: accuracy just before a task is learned, against the untrained learner.
    """
    return _mean([R[phase - 1, j] - R[0, j] for j, phase in enumerate(learned) if phase is not None and phase > 1])


def forgetting(R: Matrix, learned: Learned) -> float | None:
    """Return the mean of max over 1 <= i < T of R[i, j], minus R[T, j], over tests learned before the last phase T.

    Chaudhry et al., "Riemannian Walk for Incremental Learning", 2018.
    """
    last = len(R) - 1
    values = [R[1:last, j].max() - R[-1, j] for j, phase in enumerate(learned) if phase is not None and phase < last]
    return _mean(values)


def held_out_accuracy(R: Matrix, learned: Learned) -> float | None:
    """Return the mean over tests that belong to no phase of the accuracy after the last phase."""
    return _mean([R[-1, j] for j, phase in enumerate(learned) if phase is None])


def _mean(values: Sequence[float]) -> float | None:
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else None
