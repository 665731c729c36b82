# SPDX-License-Identifier: Apache-2.0
"""Bounding boxes around groups of movers, against which rays are culled before they are traced."""

import numpy as np
from numpy.typing import NDArray

BOXES = 8  # tested at once, see `mover_culling`
EMPTY_BOUND = 1e30


def cluster_boxes(boxes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return BOXES boxes that together contain all given boxes, slightly enlarged.

    Each contains neighbors along the axis on which the centers are spread most. Unused boxes are empty.

    Args:
        boxes: float64 [n, 6], minimum and maximum x, y, z.

    Returns:
        float32 [BOXES, 6].
    """
    result = np.repeat(np.array([[EMPTY_BOUND] * 3 + [-EMPTY_BOUND] * 3], np.float32), BOXES, axis=0)
    if len(boxes):
        centers = 0.5 * (boxes[:, :3] + boxes[:, 3:])
        axis = int(np.argmax(np.ptp(centers, axis=0)))
        order = np.argsort(centers[:, axis], kind="stable")
        margin = 1e-5 * np.abs(boxes).max() + 1e-6
        for row, group in enumerate(np.array_split(order, min(BOXES, len(boxes)))):
            result[row, :3] = boxes[group, :3].min(axis=0) - margin
            result[row, 3:] = boxes[group, 3:].max(axis=0) + margin
    return result
