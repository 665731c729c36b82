# SPDX-License-Identifier: Apache-2.0
"""Cut polygons by a box: what is inside is removed, faces across its sides are split.

Each plane of the box in turn cuts off the part of a polygon beyond it, which is kept (Sutherland and Hodgman, 1974).
What remains after the six planes is inside.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.usd.geometry.triangulate import triangulate

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_PLANES = tuple(itertools.product(range(3), (1.0, -1.0)))  # axis and side
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
    face_of = np.repeat(np.arange(len(counts)), counts)
    low, high = np.full((len(counts), 3), np.inf), np.full((len(counts), 3), -np.inf)
    np.minimum.at(low, face_of, points[indices])
    np.maximum.at(high, face_of, points[indices])
    inner = 1.0 - _TOUCHING
    met: NDArray[np.bool_] = np.asarray(((low < inner) & (high > -inner)).all(axis=1))
    if not met.any():
        return None
    corners = np.flatnonzero(met[face_of])
    triangles, owner = triangulate(points, counts[met], indices[corners])
    triangles, face = corners[triangles], np.flatnonzero(met)[owner]
    part, weights = _outside(points[indices[triangles]])
    parts, new_counts = np.unique(part, return_counts=True)
    order = np.argsort(-weights, axis=1, kind="stable")
    kept = np.flatnonzero(~met)
    old = np.flatnonzero(~met[face_of])
    one = np.tile([1.0, 0.0, 0.0], (len(old), 1))
    return CutFaces(
        np.concatenate([counts[kept], new_counts]),
        np.concatenate([kept, face[parts // len(_PLANES)]]),
        np.concatenate([np.repeat(old[:, None], 3, axis=1), triangles[part[:, None] // len(_PLANES), order]]),
        np.concatenate([one, np.take_along_axis(weights, order, axis=1)]),
    )


def _outside(triangles: Floats) -> tuple[Ints, Floats]:
    """Cut triangles [n, 3, 3] and return the corners of their parts outside the cube.

    Returns:
        int64 [k], ascending, the part of each corner: what plane `p` cuts off triangle `t` is `6 t + p`.
        float64 [k, 3], the place of each corner in its triangle.
    """
    owner, weights = np.repeat(np.arange(len(triangles)), 3), np.tile(np.eye(3), (len(triangles), 1))
    parts, corners = [], []
    for plane, (axis, side) in enumerate(_PLANES):
        height = side * (weights * triangles[owner, :, axis]).sum(axis=1) - 1.0
        beyond, found = _half(owner, weights, height)
        parts.append(beyond * len(_PLANES) + plane)
        corners.append(found)
        owner, weights = _half(owner, weights, -height)
    part = np.concatenate(parts)
    order = np.argsort(part, kind="stable")
    return part[order], np.concatenate(corners)[order]


def _half(owner: Ints, weights: Floats, height: Floats) -> tuple[Ints, Floats]:
    """Cut convex polygons by a plane and return the corners of what is above it.

    Args:
        owner: int64 [n], ascending, the polygon of each corner.
        weights: [n, 3], the place of each corner in its triangle.
        height: [n], of each corner above the plane.

    Returns:
        `owner` and `weights` of the polygons that are left.
    """
    following = np.arange(1, len(owner) + 1)
    is_first = np.diff(owner, prepend=-1) > 0
    following[np.roll(is_first, -1)] = np.flatnonzero(is_first)
    crosses = np.sign(height) * np.sign(height[following]) < 0.0
    a, b = np.flatnonzero(crosses), following[crosses]
    step = height[a] / (height[a] - height[b])
    crossing = weights[a] + step[:, None] * (weights[b] - weights[a])
    corners = np.stack([weights, weights], axis=1)  # each corner, then the crossing behind it
    corners[a, 1] = crossing / crossing.sum(axis=1, keepdims=True)
    is_left = np.stack([height >= 0.0, crosses], axis=1)
    is_left &= np.isin(owner, owner[height > _TOUCHING])[:, None]
    return np.stack([owner, owner], axis=1)[is_left], corners[is_left]
