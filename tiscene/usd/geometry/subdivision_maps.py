# SPDX-License-Identifier: Apache-2.0
"""Catmull-Clark rules as sparse matrices, for control points that move at every frame.

`refine_map` and `limit_map` are the matrices of `catmull_clark.refine` and `limit`: the rules do not depend on the
positions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.skinned_deformation import LinearMap
from tiscene.usd.geometry.catmull_clark import Cage, Floats, Ints, distinct


@dataclass(frozen=True, eq=False)
class _Terms:
    """Terms of a matrix: weights at rows and columns, which add up where both are the same."""

    rows: Ints
    columns: Ints
    weights: Floats

    def scaled(self, factors: Floats) -> _Terms:
        """Return the matrix with each row multiplied; rows of factor 0 vanish."""
        weights = self.weights * factors[self.rows]
        kept = factors[self.rows] != 0.0
        return _Terms(self.rows[kept], self.columns[kept], weights[kept])

    def gathered(self, at: Ints, of: Ints, size: int) -> _Terms:
        """Return the matrix whose row `at[i]` is the sum of the rows `of[i]` of this one, which has `size` rows."""
        order = np.argsort(self.rows, kind="stable")
        counts = np.bincount(self.rows, minlength=size)
        starts = np.cumsum(counts) - counts
        lengths = counts[of]
        first = np.repeat(starts[of] - (np.cumsum(lengths) - lengths), lengths)
        picked = order[first + np.arange(int(lengths.sum()))]
        return _Terms(np.repeat(at, lengths), self.columns[picked], self.weights[picked])


def refine_map(cage: Cage) -> LinearMap:
    """Return the matrix of `catmull_clark.refine`."""
    points, faces = cage.points, len(cage.counts)
    own = np.arange(points)
    identity = _Terms(own, own, np.ones(points))
    face_point = _Terms(cage.face, cage.indices, 1.0 / cage.counts[cage.face])
    edges = len(cage.edge_points)
    ends = np.repeat(np.arange(edges), 2)
    middle = _Terms(ends, cage.edge_points.reshape(-1), np.full(2 * edges, 0.5))
    blend = np.clip(cage.sharpness, 0.0, 1.0)
    around = face_point.gathered(cage.edge, cage.face, faces)
    edge_point = _sum([middle.scaled(0.5 * (1.0 - blend) + blend), around.scaled(0.25 * (1.0 - blend))])

    at, other, edge = cage.incident
    valence = np.maximum(np.bincount(at, minlength=points), 1).astype(np.float64)
    uses = np.bincount(cage.indices, minlength=points)
    used = (uses > 0).astype(np.float64)
    smooth = _sum(
        [
            face_point.gathered(cage.indices, cage.face, faces).scaled(used / (np.maximum(uses, 1) * valence)),
            middle.gathered(at, edge, edges).scaled(used * 2.0 / valence**2),
            identity.scaled(np.where(uses > 0, (valence - 3.0) / valence, 1.0)),
        ]
    )

    def by_rule(edge_sharpness: Floats, point_sharpness: Floats) -> _Terms:
        sharp, corner, crease = cage.rules(edge_sharpness, point_sharpness)
        neighbors = _Terms(at[sharp], other[sharp], np.ones(int(sharp.sum())))
        return _sum(
            [
                smooth.scaled((~corner & ~crease).astype(np.float64)),
                identity.scaled(corner + 0.75 * crease),
                neighbors.scaled(0.125 * crease),
            ]
        )

    point = by_rule(cage.sharpness, cage.point_sharpness)
    weight = cage.level_weights()
    if weight is not None:
        later = by_rule(np.maximum(cage.sharpness - 1.0, 0.0), np.maximum(cage.point_sharpness - 1.0, 0.0))
        point = _sum([point.scaled(weight), later.scaled(1.0 - weight)])
    return _map([point, edge_point, face_point], [points, edges, faces], points)


def limit_map(cage: Cage, count: int | None = None) -> LinearMap:
    """Return the matrix of `catmull_clark.limit`, or its first `count` rows."""
    at, other, _ = cage.incident
    points = cage.points
    own = np.arange(points)
    identity = _Terms(own, own, np.ones(points))
    valence = np.bincount(at, minlength=points).astype(np.float64)
    sharp, corner, crease = cage.rules(cage.sharpness, cage.point_sharpness)
    corner |= valence == 0
    plain = ~corner & ~crease
    total = np.where(valence > 0, valence * (valence + 5.0), 1.0)
    neighbors = _Terms(at, other, np.ones(len(at)))
    diagonals = _Terms(cage.indices, cage.indices[cage.following[cage.following]], np.ones(len(cage.indices)))
    along = _Terms(at[sharp], other[sharp], np.ones(int(sharp.sum())))
    whole = _sum(
        [
            identity.scaled(corner + crease * 4.0 / 6.0 + plain * valence**2 / total),
            neighbors.scaled(plain * 4.0 / total),
            diagonals.scaled(plain / total),
            along.scaled(crease / 6.0),
        ]
    )
    if count is not None:
        kept = whole.rows < count
        whole, points = _Terms(whole.rows[kept], whole.columns[kept], whole.weights[kept]), count
    return _map([whole], [points], cage.points)


def _sum(parts: list[_Terms]) -> _Terms:
    rows, columns, weights = (
        np.concatenate([getattr(each, name) for each in parts]) for name in ("rows", "columns", "weights")
    )
    return _Terms(rows, columns, weights)


def _map(blocks: list[_Terms], sizes: list[int], columns: int) -> LinearMap:
    """Stack blocks of rows and add up the terms of each place. Every row has a term."""
    first = np.cumsum([0, *sizes])
    shifted = [
        _Terms(each.rows + start, each.columns, each.weights) for each, start in zip(blocks, first, strict=False)
    ]
    terms = _sum(shifted)
    keys, place = distinct(terms.rows * columns + terms.columns)
    weights: Any = np.bincount(place, terms.weights, minlength=len(keys))
    rows, column = np.divmod(keys, columns)
    starts: NDArray[np.int64] = np.searchsorted(rows, np.arange(int(first[-1])))
    return LinearMap(starts, column.astype(np.int32), weights)
