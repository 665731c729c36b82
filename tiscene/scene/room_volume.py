# SPDX-License-Identifier: Apache-2.0
"""RoomVolume: the space of a room; `rooms_at` finds the rooms that points are in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

MARGIN = 0.5  # m; walls, windows and doorways are beyond the interior of their room


@dataclass(frozen=True, eq=False)
class RoomVolume:
    """A box that is part of a room. Several boxes may have the same name.

    Attributes:
        name: of the room.
        world_from_box: float64 4x4, m, from the cube -1..1 to the box.
    """

    name: str
    world_from_box: NDArray[np.float64]

    def distances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distances of points [n, 3] to the box, m: float64 [n]; 0 inside."""
        lengths = np.linalg.norm(self.world_from_box[:3, :3], axis=0)
        axes = self.world_from_box[:3, :3] / np.maximum(lengths, 1e-12)
        local = (points - self.world_from_box[:3, 3]) @ axes
        return np.asarray(np.linalg.norm(np.maximum(np.abs(local) - lengths, 0.0), axis=1))

    @property
    def size(self) -> float:
        """Its volume, m³."""
        return float(8.0 * abs(np.linalg.det(self.world_from_box[:3, :3])))


def rooms_at(volumes: Sequence[RoomVolume], points: ArrayLike) -> list[str]:
    """Return the name of the room that each point is in.

    It is that of the smallest volume that contains the point, else that of the nearest one up to `MARGIN` away, else
    "".

    Args:
        volumes: the volumes.
        points: [n, 3], m.
    """
    places = np.asarray(points, np.float64).reshape(-1, 3)
    if not volumes or not len(places):
        return [""] * len(places)
    order = sorted(volumes, key=lambda each: each.size)  # stable
    distances = np.array([each.distances(places) for each in order])
    nearest = distances.argmin(axis=0)
    reached = distances.min(axis=0) <= MARGIN
    return [order[row].name if near else "" for row, near in zip(nearest.tolist(), reached.tolist(), strict=True)]
