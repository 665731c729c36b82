# SPDX-License-Identifier: Apache-2.0
"""SAILenv's drawing of optical flow as a color image."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def draw_flow_map(optical_flow: NDArray[Any]) -> NDArray[np.uint8]:
    """Draw optical flow: the hue is the direction (red: +x), the value is the length.

    Args:
        optical_flow: [h, w, 2].

    Returns:
        uint8 [h, w, 3], BGR as OpenCV displays it. The longest vector has full value, the shortest is black.
    """
    x, y = np.moveaxis(np.asarray(optical_flow, np.float64), -1, 0)
    length, hue = np.hypot(x, y), np.arctan2(y, x) * (3.0 / np.pi) % 6.0
    span = length.max() - length.min()
    value = (length - length.min()) / (span if span > 0.0 else 1.0)
    channels = [(sector + hue) % 6.0 for sector in (1.0, 3.0, 5.0)]  # blue, green, red
    bgr = [value * (1.0 - np.clip(np.minimum(k, 4.0 - k), 0.0, 1.0)) for k in channels]
    return np.rint(np.stack(bgr, axis=-1) * 255.0).astype(np.uint8)
