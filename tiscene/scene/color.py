# SPDX-License-Identifier: Apache-2.0
"""The transfer function of sRGB (IEC 61966-2-1), of arrays of any shape and of any kind of float."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def encode_srgb(linear: NDArray[Any]) -> NDArray[Any]:
    """Display values, 0..1, of linear ones; what is below 0 stays in proportion."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0) ** (1.0 / 2.4) - 0.055)


def decode_srgb(display: NDArray[Any]) -> NDArray[Any]:
    """Linear values of display ones, 0..1; what is below 0 stays in proportion."""
    return np.where(display <= 0.04045, display / 12.92, ((np.maximum(display, 0.0) + 0.055) / 1.055) ** 2.4)
