# SPDX-License-Identifier: Apache-2.0
"""Shapes of convex parts: a box, sphere or upright cylinder where the points are one, else their convex hull."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ROUND = 24  # least number of points of a sphere or a cylinder


@dataclass(frozen=True, eq=False)
class PartShape:
    """A convex shape in the axes of its object.

    Attributes:
        kind: What it is; a cylinder's axis is y.
        center: m.
        half: Half its size along x, y and z, m; of a sphere the radius, thrice.
        points: [n, 3], corners of its hull, m.
    """

    kind: Literal["box", "sphere", "cylinder", "hull"]
    center: Array
    half: Array
    points: Array


def shape_of(points: Array, tolerance: float) -> PartShape:
    """Return the shape of the corners of a convex hull.

    Args:
        points: [n, 3], m.
        tolerance: By how much the points may be off a box, sphere or cylinder, m.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    center, half = 0.5 * (low + high), 0.5 * (high - low)
    offset = np.abs(points - center)
    if (np.abs(offset - half) <= tolerance).all() and _covers_corners(points - center):
        return PartShape("box", center, half, points)
    if len(points) >= ROUND:
        distance = np.linalg.norm(points - center, axis=1)
        if np.ptp(half) <= tolerance and np.abs(distance - half.mean()).max() <= tolerance:
            return PartShape("sphere", center, np.full(3, half.mean()), points)
        across = np.hypot(points[:, 0] - center[0], points[:, 2] - center[2])
        round_side = abs(half[0] - half[2]) <= tolerance and np.abs(across - half[0]).max() <= tolerance
        if round_side and np.abs(offset[:, 1] - half[1]).max() <= tolerance:
            return PartShape("cylinder", center, half, points)
    return PartShape("hull", center, half, points)


def _covers_corners(offset: Array) -> bool:
    """Return whether points have all eight combinations of signs."""
    return len({tuple(row) for row in (offset > 0.0).tolist()}) == 8
