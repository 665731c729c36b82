# SPDX-License-Identifier: Apache-2.0
"""Test for paths on which no collision is possible, so that nothing needs to be simulated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from dynamics.bodies import Body
from dynamics.clocks import exact
from dynamics.colliding_bodies import Mover
from dynamics.contact import MAX_TOUCHES, TOUCH_COLUMNS
from dynamics.dynamic import ClosedForm
from dynamics.obstacles import Obstacles
from dynamics.simulation import Simulation
from dynamics.sweep_obstacles import obstacle_distances

SAMPLES = 64  # positions per loop
MARGIN = 0.005  # m


def all_free(movers: Sequence[Mover], obstacles: Obstacles, walled: bool) -> bool:
    """Return whether no mover can ever touch an obstacle, another mover or a wall, wherever in its loop each is.

    The test is conservative: bodies count as spheres about their origins. It may return False for paths that are free.

    Args:
        movers: The movers.
        obstacles: Static triangles.
        walled: Whether there are walls for movers that are `limited`.
    """
    solid = [mover for mover in movers if mover.shape is not None]
    boxes = []
    for mover in solid:
        path = _path(mover.body)
        if path is None or (walled and mover.limited):
            return False
        # Between two samples a path deviates by less than their distance.
        advance = float(np.linalg.norm(np.diff(path, axis=0), axis=1).max(initial=0.0))
        size = (mover.shape.reach if mover.shape else 0.0) + advance + MARGIN
        if len(path) > 1 and _nearest(path, 2.0 * size, obstacles) < size:
            return False
        boxes.append((path.min(axis=0) - size, path.max(axis=0) + size, len(path) > 1))
    for row, (low, high, moves) in enumerate(boxes):
        for other_low, other_high, other_moves in boxes[:row]:
            if (moves or other_moves) and (low <= other_high).all() and (other_low <= high).all():
                return False
    return True


def _path(body: Body) -> NDArray[np.float64] | None:
    """Return positions [n, 3] along a body's loop: one for a static body; None for a dynamic without a loop."""
    dynamic = body.dynamic
    if not isinstance(dynamic, ClosedForm) or math.isinf(dynamic.loop_time):
        return None
    alone = Simulation([Body(dynamic, body.position, body.rotation)])
    if dynamic.loop_time == 0.0:
        return alone.poses(0)[:, :3]
    loop = exact(dynamic.loop_time)
    return np.concatenate([alone.poses(loop * Fraction(i, SAMPLES))[:, :3] for i in range(SAMPLES + 1)])


def _nearest(path: NDArray[np.float64], limit: float, obstacles: Obstacles) -> float:
    """Return the smallest distance of `path` [n, 3] to an obstacle, meters; `limit` if none is nearer."""
    points = np.zeros((len(path), 4), dtype=np.float32)
    points[:, :3] = path
    touches = np.zeros((MAX_TOUCHES, TOUCH_COLUMNS), dtype=np.float32)
    obstacle_distances(points, limit, touches, *obstacles.arguments())
    return float(points[:, 3].min())
