# SPDX-License-Identifier: Apache-2.0
"""Colors of float arrays of any shape: the sRGB transfer function (IEC 61966-2-1), and luminance."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

LUMINANCE: NDArray[np.float64] = np.array([0.2126, 0.7152, 0.0722])  # of linear Rec. 709 red, green and blue


def encode_srgb(linear: NDArray[Any]) -> NDArray[Any]:
    """Return display values of linear values, 0..1; negative values are scaled linearly."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0) ** (1.0 / 2.4) - 0.055)


def decode_srgb(display: NDArray[Any]) -> NDArray[Any]:
    """Return linear values of display values, 0..1; negative values are scaled linearly."""
    return np.where(display <= 0.04045, display / 12.92, ((np.maximum(display, 0.0) + 0.055) / 1.055) ** 2.4)
