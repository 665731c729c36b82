# SPDX-License-Identifier: Apache-2.0
"""Arc length of cubic curves by Gauss-Legendre quadrature.

The kernel in `dynamics.trajectory_kernel` uses the same nodes, so that it agrees with the table of lengths.
"""

from __future__ import annotations

import numpy as np

from dynamics.dynamic import LENGTH_STEPS, Array

# [2, 5]: nodes in 0..1, and weights that sum to 1.
GAUSS: Array = np.stack(np.polynomial.legendre.leggauss(5)) * 0.5 + [[0.5], [0.0]]


def curve_lengths(cubics: Array) -> Array:
    """Return the arc length from the start of the curve to t = 0, 1/16, ... 1 of every segment.

    Args:
        cubics: [n, 12], coefficients of t^0 .. t^3, three components each.

    Returns:
        float64 [n, LENGTH_STEPS + 1].
    """
    _, first, second, third = np.moveaxis(cubics.reshape(-1, 4, 3), 1, 0)[:, :, None, None, :]
    steps = np.arange(LENGTH_STEPS) / LENGTH_STEPS
    t = (steps[:, None] + GAUSS[0] / LENGTH_STEPS)[:, :, None]
    speeds = np.linalg.norm(first + t * (2.0 * second + t * (3.0 * third)), axis=-1)
    pieces = (speeds * GAUSS[1]).sum(axis=-1) / LENGTH_STEPS
    ends = np.cumsum(pieces.reshape(-1)).reshape(pieces.shape)
    starts = np.concatenate([[0.0], ends[:-1, -1]])
    return np.concatenate([starts[:, None], ends], axis=1)
