# SPDX-License-Identifier: Apache-2.0
"""Cut polygons by a box: what is inside is removed, faces across its sides are split.

Each plane of the box in turn cuts off the part of a polygon beyond it, which is kept (Sutherland and Hodgman, 1974).
What remains after the six planes is inside.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.usd.geometry.triangulate import triangulate

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_TOUCHING = 1e-6  # of the box's half side: faces on its surface are outside


@dataclass(frozen=True, eq=False)
class CutFaces:
    """The faces that a cut leaves.

    Attributes:
        counts: int64 [faces], corners of each face.
        face: int64 [faces], the old face that each is part of.
        corners: int64 [n, 3], old corners that each new corner lies between.
        weights: float64 [n, 3], their weights; (1, 0, 0) for an old corner.
    """

    counts: Ints
    face: Ints
    corners: Ints
    weights: Floats

    @property
    def is_new(self) -> NDArray[np.bool_]:
        """Whether each corner was made by the cut: bool [n]."""
        return np.asarray(self.weights[:, 0] < 1.0)

    def blend(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return values of the new corners, of those of the old corners [old, ...]; only floats are interpolated."""
        if not np.issubdtype(values.dtype, np.floating):
            return values[self.corners[:, 0]]
        parts = values[self.corners]
        weights = self.weights.reshape(*self.weights.shape, *[1] * (parts.ndim - 2))
        return np.asarray((parts * weights).sum(axis=1), values.dtype)


def cut_box(points: Floats, counts: Ints, indices: Ints) -> CutFaces | None:
    """Cut the cube -1..1 out of a mesh.

    Args:
        points: [n, 3], in the axes of the cube.
        counts: [faces], corners of each face.
        indices: [corners], the point of each corner, face after face.

    Returns:
        What is left; None if no face meets the cube.
    """
    starts = np.cumsum(counts) - counts
    face_of = np.repeat(np.arange(len(counts)), counts)
    low, high = np.full((len(counts), 3), np.inf), np.full((len(counts), 3), -np.inf)
    np.minimum.at(low, face_of, points[indices])
    np.maximum.at(high, face_of, points[indices])
    inner = 1.0 - _TOUCHING
    met: NDArray[np.bool_] = np.asarray(((low < inner) & (high > -inner)).all(axis=1))
    if not met.any():
        return None
    chosen = np.flatnonzero(met)
    triangles, owner = triangulate(points, counts[chosen], indices[np.isin(face_of, chosen)])
    to_corner = np.concatenate([starts[face] + np.arange(counts[face]) for face in chosen])
    new_counts, new_faces, new_corners, new_weights = [], [], [], []
    for triangle, face in zip(to_corner[triangles], chosen[owner], strict=True):
        for weights in _outside(points[indices[triangle]]):
            new_counts.append(len(weights))
            new_faces.append(face)
            order = np.argsort(-weights, axis=1, kind="stable")
            new_corners.append(triangle[order])
            new_weights.append(np.take_along_axis(weights, order, axis=1))
    kept = np.flatnonzero(~met)
    old = np.flatnonzero(~met[face_of])
    one = np.tile([1.0, 0.0, 0.0], (len(old), 1))
    return CutFaces(
        np.concatenate([counts[kept], np.array(new_counts, np.int64)]),
        np.concatenate([kept, np.array(new_faces, np.int64)]),
        np.concatenate([np.repeat(old[:, None], 3, axis=1), *new_corners]),
        np.concatenate([one, *new_weights]),
    )


def _outside(triangle: Floats) -> list[Floats]:
    """Return the parts of a triangle [3, 3] outside the cube, each as weights of its corners [k, 3]."""
    parts, inside = [], np.eye(3)
    for axis in range(3):
        for side in (1.0, -1.0):
            height = side * (inside @ triangle)[:, axis] - 1.0
            beyond = _half(inside, height)
            if len(beyond):
                parts.append(beyond)
            inside = _half(inside, -height)
            if not len(inside):
                return parts
    return parts


def _half(polygon: Floats, height: Floats) -> Floats:
    """Return the part of a convex polygon, given as weights [k, 3], where its heights [k] are positive."""
    if not (height > _TOUCHING).any():
        return np.zeros((0, 3))
    result = []
    for index in range(len(polygon)):
        following = (index + 1) % len(polygon)
        a, b = height[index], height[following]
        if a >= 0.0:
            result.append(polygon[index])
        if (a > 0.0 > b) or (a < 0.0 < b):
            t = a / (a - b)
            weights = polygon[index] + t * (polygon[following] - polygon[index])
            result.append(weights / weights.sum())
    return np.array(result) if len(result) >= 3 else np.zeros((0, 3))
