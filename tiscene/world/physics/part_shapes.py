# SPDX-License-Identifier: Apache-2.0
"""Shapes of convex parts: a box, sphere, cylinder or capsule where the points are one, else their convex hull."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ROUND = 24  # least number of points of a shape that is round
UPRIGHT = 1


@dataclass(frozen=True, eq=False)
class PartShape:
    """A convex shape in the axes of its object.

    Attributes:
        kind: What it is.
        center: m.
        half: Half its size along x, y and z, m; of a sphere the radius, thrice.
        points: [n, 3], corners of its hull, m.
        axis: 0, 1 or 2, the axis of a cylinder or capsule.
    """

    kind: Literal["box", "sphere", "cylinder", "capsule", "hull"]
    center: Array
    half: Array
    points: Array
    axis: int = UPRIGHT


def shape_of(points: Array, tolerance: float) -> PartShape:
    """Return the shape of the corners of a convex hull.

    Args:
        points: [n, 3], m.
        tolerance: By how much the points may be off a box, sphere, cylinder or capsule, m.
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
        for axis in (UPRIGHT, 0, 2):
            one, other = (each for each in range(3) if each != axis)
            radius, height = half[one], half[axis]
            across, along = np.hypot(points[:, one] - center[one], points[:, other] - center[other]), offset[:, axis]
            if abs(radius - half[other]) > tolerance:
                continue
            if max(np.abs(across - radius).max(), np.abs(along - height).max()) <= tolerance:
                return PartShape("cylinder", center, half, points, axis)
            beyond = np.maximum(along - (height - radius), 0.0)
            if height > radius and np.abs(np.hypot(across, beyond) - radius).max() <= tolerance:
                return PartShape("capsule", center, half, points, axis)
    return PartShape("hull", center, half, points)


def _covers_corners(offset: Array) -> bool:
    """Return whether points have all eight combinations of signs."""
    return len({tuple(row) for row in (offset > 0.0).tolist()}) == 8
