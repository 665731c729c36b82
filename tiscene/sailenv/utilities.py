# SPDX-License-Identifier: Apache-2.0
"""SAILenv's drawing of optical flow as a color image."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.frame.visualize import direction_picture


def draw_flow_map(optical_flow: NDArray[Any]) -> NDArray[np.uint8]:
    """Draw optical flow: the hue is the direction (red: +x), the value is the length.

    Args:
        optical_flow: [h, w, 2].

    Returns:
        uint8 [h, w, 3], BGR as OpenCV displays it. The longest vector has full value, the shortest is black.
    """
    return direction_picture(optical_flow)[..., ::-1]
