# SPDX-License-Identifier: Apache-2.0
"""ObjectPlacer: find a position, or a closed path, for an object of a given size.

A path is drawn as waypoints: as many visible, hidden and out of view as the ranges ask for. Waypoints are first
drawn from all of the view, then nearer and nearer to each other, because short paths fit between furniture where long
ones do not. Each path is then measured at points at most 2 cm apart, and drawn again until it fits.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics import CatmullWaypoints, LinearWaypoints
from tiscene.errors import counted
from tiscene.randomization.draws import Draws
from tiscene.randomization.free_space import FreeSpace
from tiscene.randomization.point_pools import HIDDEN, OUT_OF_VIEW, VISIBLE, PointPools
from tiscene.randomization.ranges import ScenarioRanges

Array = NDArray[np.float64]
LoopClass = type[LinearWaypoints] | type[CatmullWaypoints]

ATTEMPTS = 256  # paths, or positions, that are drawn of an object of one template, at most: the sum of BLOCKS
BLOCKS = (4, 4, 8, 16, *(32,) * 7)  # numbers of paths that are tested at once; most often one of the first fits
ENOUGH_ATTEMPTS = 32  # without any path of free points, after which none is expected
CLEARANCE = 0.01  # m between the object's ball and surfaces
SPACING = 0.02  # m: largest distance of the points at which a path is measured
COARSE, FINEST = 16, 1024  # points per segment: for the first test, and at most
_TOLERANCE = 1e-9


@dataclass(eq=False)
class ObjectPlacer:
    """Search for places for one object of one template.

    Attributes:
        space: free space of the scene.
        ranges: the ranges.
        draws: random numbers of the object.
        pools: free points of the object.
        radius: radius of the ball about its origin that encloses it, m.
        diameter: its size for `min_size`, m.
        occupied: center and radius of each object drawn before, at its start.
        reasons: number of rejected draws by reason.
    """

    space: FreeSpace
    ranges: ScenarioRanges
    draws: Draws
    pools: PointPools
    radius: float
    diameter: float
    occupied: Sequence[tuple[Array, float]]

    def __post_init__(self) -> None:
        self.reasons: Counter[str] = Counter()
        self._points: dict[str, Array] = {}
        self._far = farthest_depth(self.space, self.diameter, self.ranges.min_size)

    def position(self) -> Array | None:
        """Return a free position [3]; None if none was found."""
        for attempt in range(ATTEMPTS):
            points = self._waypoints(attempt, 1)
            if points is not None and not self._overlaps(points[0]):
                start: Array = points[0]
                return start
        return None

    def loop(self, cls: LoopClass) -> Array | None:
        """Return the waypoints [n, 3] of a closed path that fits the ranges; None if none was found."""
        found = False
        for first, end in itertools.pairwise(np.cumsum((0, *BLOCKS)).tolist()):
            candidates = []
            for attempt in range(first, end):
                count = self.draws.whole("waypoints", attempt, *self.ranges.waypoints)
                points = self._waypoints(attempt, count)
                if points is None or self._overlaps(points[0]):
                    continue
                if len(np.unique(points, axis=0)) < count:
                    self.reasons["two waypoints coincide"] += 1
                    continue
                candidates.append((points, segment_cubics(cls, points)))
            found = found or bool(candidates)
            if not found and end >= ENOUGH_ATTEMPTS:
                return None
            for points, cubics in self._collision_free(candidates):
                wrong = self._rejection(cubics)
                if not wrong:
                    return points
                self.reasons[wrong] += 1
        return None

    def _waypoints(self, attempt: int, count: int) -> Array | None:
        """Return `count` waypoints [n, 3] in random order; None without free points."""
        draws, ranges = self.draws, self.ranges
        needs_view = ranges.in_view[0] > 0.0 or ranges.occlusion[0] > 0.0
        in_view = max(round(count * draws.between("in view", attempt, *ranges.in_view)), int(needs_view))
        hidden = round(in_view * draws.between("occluded", attempt, *ranges.occlusion))
        hidden = max(hidden, int(ranges.occlusion[0] > 0.0 and count > 1))
        wanted = [HIDDEN] * hidden + [VISIBLE] * (in_view - hidden) + [OUT_OF_VIEW] * (count - in_view)
        # Each waypoint is the nearest to the first one of this many free points.
        choices = 1 << (6 * attempt // ATTEMPTS)
        numbers = draws.uniform("choices", attempt, count * choices).reshape(count, choices)
        points: list[Array] = []
        for kind, row in zip(wanted, numbers, strict=True):
            if kind not in self._points:
                self._points[kind] = self.pools.points(kind, self.radius + CLEARANCE, self._far)
            pool = self._points[kind]
            if not len(pool):
                too_small = kind != OUT_OF_VIEW and self._far < self.ranges.depth[0]
                self.reasons["it looks smaller than min_size" if too_small else f"no free point {kind}"] += 1
                return None
            near = pool[(row * len(pool)).astype(np.intp)]
            points.append(near[np.linalg.norm(near - points[0], axis=1).argmin()] if points else near[0])
        result: Array = np.array(points)[np.argsort(draws.uniform("order", attempt, count))]
        return result

    def _overlaps(self, start: Array) -> bool:
        """Return whether the object would start inside another one, and count it."""
        result = any(np.linalg.norm(start - center) < self.radius + size for center, size in self.occupied)
        if result:
            self.reasons["it would start inside another object"] += 1
        return result

    def _collision_free(self, candidates: list[tuple[Array, Array]]) -> list[tuple[Array, Array]]:
        """Return the candidates, waypoints and cubics, whose paths are free at some points of each segment."""
        if not candidates:
            return []
        paths = [path_points(cubics, COARSE)[0] for _, cubics in candidates]
        ends = np.cumsum([len(path) for path in paths])
        free = self.space.distances(np.concatenate(paths), 2.0 * self.radius) > self.radius
        kept = [each for each, part in zip(candidates, np.split(free, ends[:-1]), strict=True) if part.all()]
        if len(kept) < len(candidates):
            self.reasons["its path collides with the scene"] += len(candidates) - len(kept)
        return kept

    def _rejection(self, cubics: Array) -> str:
        """Return the reason why a path misses the ranges, "" if it fits them."""
        _, lengths = path_points(cubics, COARSE)
        longest = float(lengths.reshape(-1, COARSE).sum(axis=1).max())
        # The speed along a cubic varies.
        path, lengths = path_points(cubics, min(max(COARSE, int(2.0 * longest / SPACING)), FINEST))
        reach = self.radius + 0.5 * float(lengths.max())
        if not (self.space.distances(path, 2.0 * reach) > reach).all():
            return "its path collides with the scene"
        in_view, hidden = self.space.in_view(path), self.space.hidden(path)
        seen = float(lengths @ in_view)
        low, high = self.ranges.in_view
        if not low - _TOLERANCE <= seen / float(lengths.sum()) <= high + _TOLERANCE:
            return "in_view is missed"
        low, high = self.ranges.occlusion
        if not low - _TOLERANCE <= float(lengths @ hidden) / max(seen, _TOLERANCE) <= high + _TOLERANCE:
            return "occlusion is missed"
        if (self.space.project(path[in_view])[2] > self._far).any():
            return "it looks smaller than min_size"
        return ""


def tally(reasons: Counter[str]) -> str:
    """Return reasons for which draws were rejected with their numbers, for an error."""
    return ", ".join(f"{reason} ({counted(count, 'time')})" for reason, count in reasons.most_common())


def farthest_depth(space: FreeSpace, diameter: float, min_size: float) -> float:
    """Return the depth, m, at which an object's size falls below `min_size`; 0 for none, inf for no limit."""
    if min_size == 0.0:
        return np.inf
    if space.camera.orthographic_height is not None:
        return np.inf if diameter >= min_size * space.camera.orthographic_height else 0.0
    return diameter / (2.0 * min_size * space.camera.half_height(1.0))


def segment_cubics(cls: LoopClass, waypoints: Array) -> Array:
    """Return the coefficients [n, 4, 3] of the cubics, constant term first, of a loop through waypoints [n, 3]."""
    return cls.cubics(waypoints, np.zeros(3)).reshape(-1, 4, 3)


def path_points(cubics: Array, steps: int) -> tuple[Array, Array]:
    """Return points [n * steps, 3] in the middle of equal steps of each cubic, and the length of each step [n * steps].

    Args:
        cubics: [n, 4, 3].
        steps: number of steps per cubic.
    """
    nodes = np.einsum("tk,nkc->ntc", (np.arange(steps + 1) / steps)[:, None] ** np.arange(4), cubics)
    middles = np.einsum("tk,nkc->ntc", ((np.arange(steps) + 0.5) / steps)[:, None] ** np.arange(4), cubics)
    first = np.linalg.norm(middles - nodes[:, :-1], axis=2)
    second = np.linalg.norm(nodes[:, 1:] - middles, axis=2)
    return middles.reshape(-1, 3), (first + second).reshape(-1)
