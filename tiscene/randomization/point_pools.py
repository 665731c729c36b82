# SPDX-License-Identifier: Apache-2.0
"""PointPools: random free points of a scene, by whether the camera sees them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tiscene.randomization.draws import Draws
from tiscene.randomization.free_space import FreeSpace
from tiscene.randomization.ranges import ScenarioRanges

Array = NDArray[np.float64]

VISIBLE, HIDDEN, OUT_OF_VIEW = "visible", "hidden", "out of view"
BATCH = 4096  # points drawn at once
BATCHES = 16  # at most
ENOUGH = 64  # points after which no more are drawn
DECIMALS = 4  # of positions (m) and angles (degrees), so that files stay readable
_SMALLEST = 0.02  # m: points nearer to a surface are left out
_SPARE = 2.0  # distances are measured up to this many times what is asked for


class PointPools:
    """Random points of one object. All its templates share them.

    Visible and hidden points are uniform in the volume of the view within the ranges `region` and `depth`; points out
    of view in the scene's bounds.

    Args:
        space: free space of the scene.
        ranges: the ranges.
        draws: random numbers of the object.
    """

    def __init__(self, space: FreeSpace, ranges: ScenarioRanges, draws: Draws) -> None:
        self._space = space
        self._ranges = ranges
        self._draws = draws
        empty = np.zeros((0, 3)), np.zeros(0), np.zeros(0)
        # By kind: points, distances up to a limit, and depths.
        self._pools: dict[str, tuple[Array, Array, Array]] = dict.fromkeys((VISIBLE, HIDDEN, OUT_OF_VIEW), empty)
        self._limits: dict[str, float] = dict.fromkeys(self._pools, 0.0)
        self._batches: dict[str, int] = dict.fromkeys(self._pools, 0)

    def points(self, wanted: str, radius: float, far: float) -> Array:
        """Return points [n, 3]; none if there are none, or if they are too rare to be found.

        Args:
            wanted: VISIBLE, HIDDEN or OUT_OF_VIEW.
            radius: radius of the free ball about each point, m.
            far: largest depth of points in view, m.
        """
        if radius >= self._limits[wanted]:
            self._limits[wanted] = _SPARE * max(radius, _SMALLEST)
            points, _, depth = self._pools[wanted]
            self._pools[wanted] = points, self._space.distances(points, self._limits[wanted]), depth
        while True:
            points, distance, depth = self._pools[wanted]
            fits = distance > radius
            if wanted != OUT_OF_VIEW:
                fits &= depth <= far
            if fits.sum() >= ENOUGH or self._batches[wanted] == BATCHES:
                return points[fits]
            self._pools[wanted] = _joined(self._pools[wanted], self._batch(wanted, self._batches[wanted]))
            self._batches[wanted] += 1

    def _batch(self, wanted: str, batch: int) -> tuple[Array, Array, Array]:
        """Return free points [n, 3], their distances to the nearest surface, and their depths."""
        purpose = "outside" if wanted == OUT_OF_VIEW else "place"
        numbers = self._draws.uniform(purpose, batch, 3 * BATCH).reshape(BATCH, 3)
        points = np.round(self._outside(numbers) if wanted == OUT_OF_VIEW else self._inside(numbers), DECIMALS)
        in_view = self._space.in_view(points)
        points = points[~in_view if wanted == OUT_OF_VIEW else in_view]
        if wanted != OUT_OF_VIEW:
            points = points[self._space.hidden(points) == (wanted == HIDDEN)]
        distance = self._space.distances(points, self._limits[wanted])
        points, distance = points[distance > _SMALLEST], distance[distance > _SMALLEST]
        reachable = self._space.is_reachable(points)
        points, distance = points[reachable], distance[reachable]
        return points, distance, self._space.project(points)[2]

    def _inside(self, numbers: Array) -> Array:
        """Map uniform numbers [n, 3] to points that are uniform in the volume of the view within the ranges."""
        near, far = self._ranges.depth
        near = min(max(near, self._space.camera.near), far)
        left, top, right, bottom = self._ranges.region
        if self._space.camera.orthographic_height is None:
            depth = np.cbrt(near**3 + numbers[:, 2] * (far**3 - near**3))
        else:
            depth = near + numbers[:, 2] * (far - near)
        x, y = left + numbers[:, 0] * (right - left), top + numbers[:, 1] * (bottom - top)
        return self._space.points(x, y, depth)

    def _outside(self, numbers: Array) -> Array:
        """Map uniform numbers [n, 3] to points of the scene's bounds, or around the camera of an empty scene."""
        low, high = self._space.bounds
        if not np.any(high > low):  # an empty scene
            low, high = (np.asarray(self._space.camera.position) + side * self._ranges.depth[1] for side in (-1.0, 1.0))
        points: Array = low + numbers * (high - low)
        return points


def _joined(a: tuple[Array, Array, Array], b: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
    return np.concatenate([a[0], b[0]]), np.concatenate([a[1], b[1]]), np.concatenate([a[2], b[2]])
