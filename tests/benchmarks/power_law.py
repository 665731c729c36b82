# SPDX-License-Identifier: Apache-2.0
"""Time to equal error: error and time follow a power law between the measured samples and beyond them."""

from collections.abc import Iterable

import numpy as np


def time_for(error: float, measured: Iterable[tuple[float, float]]) -> float:
    """Return the time that a renderer needs for an error, s.

    Args:
        error: the error to reach.
        measured: pairs of error and time in s, at least two; the two nearest determine the power law.
    """
    logs = np.log(np.array(sorted(measured)))
    at = int(np.clip(np.searchsorted(logs[:, 0], np.log(error)), 1, len(logs) - 1))
    (x0, y0), (x1, y1) = logs[at - 1], logs[at]
    slope = min((y1 - y0) / max(x1 - x0, 1e-6), 0.0)
    return float(np.exp(y0 + slope * (np.log(error) - x0)))
