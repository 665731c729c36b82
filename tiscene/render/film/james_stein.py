# SPDX-License-Identifier: Apache-2.0
"""The positive-part James-Stein estimate of noisy colors (James and Stein 1961)."""

import numpy as np
from numpy.typing import NDArray

FloatImage = NDArray[np.float32]


def james_stein(colors: FloatImage, expected: FloatImage, variance: FloatImage) -> FloatImage:
    """Return colors moved towards expected ones, as far as noise could explain how they differ.

    Args:
        colors: Noisy colors, float32 [..., 3].
        expected: What they are moved to, float32 [..., 3].
        variance: Of the noisy colors, the sum over red, green and blue, float32 [..., 1].

    Returns:
        float32 [..., 3], a new array.
    """
    difference = colors - expected
    distance = np.maximum((difference**2).sum(axis=-1, keepdims=True), np.float32(1e-12))
    result: FloatImage = expected + np.maximum(1.0 - variance / distance, 0.0) * difference
    return result
