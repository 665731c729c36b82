# SPDX-License-Identifier: Apache-2.0
"""Arc length of cubics, by Gauss-Legendre quadrature; the kernel uses the same nodes, so table and kernel agree."""

from __future__ import annotations

import numpy as np

from dynamics.dynamic import LENGTH_STEPS, Array

# Nodes on 0..1 and weights that sum to 1, [2, 5].
GAUSS: Array = np.stack(np.polynomial.legendre.leggauss(5)) * 0.5 + [[0.5], [0.0]]


def curve_lengths(cubics: Array) -> Array:
    """Arc length from the curve's start to t = 0, 1/16, ... 1 of every segment, [n, LENGTH_STEPS + 1].

    cubics: [n, 12], coefficients of t^0 .. t^3, three components each.
    """
    _, first, second, third = np.moveaxis(cubics.reshape(-1, 4, 3), 1, 0)[:, :, None, None, :]
    steps = np.arange(LENGTH_STEPS) / LENGTH_STEPS
    t = (steps[:, None] + GAUSS[0] / LENGTH_STEPS)[:, :, None]
    speeds = np.linalg.norm(first + t * (2.0 * second + t * (3.0 * third)), axis=-1)
    pieces = (speeds * GAUSS[1]).sum(axis=-1) / LENGTH_STEPS
    ends = np.cumsum(pieces.reshape(-1)).reshape(pieces.shape)
    starts = np.concatenate([[0.0], ends[:-1, -1]])
    return np.concatenate([starts[:, None], ends], axis=1)
