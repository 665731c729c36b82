# SPDX-License-Identifier: Apache-2.0
"""Surfaces as convex parts, for contacts.

Each connected piece of a surface whose convex hull is within a tolerance of it is one part. Others are halved, across
their longest side, until their pieces are. So a table has a part for its top and one for each leg, and a bowl is made
of many thin parts along its wall, with its inside free. A piece that covers a flat side of its hull only in part, such
as a wall with a doorway, is divided into its sides first. The result depends on the triangles alone.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.world.physics.part_shapes import PartShape, shape_of

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

Array = NDArray[np.float64]
MAX_DEPTH = 9  # halvings of a piece
MANY = 300  # of more points only those count that lie farthest in one of DIRECTIONS directions
DIRECTIONS = 230
TESTED = 1000  # most points whose distance from the hull is measured
FINE = 1000  # triangles of a piece from which on it is made coarser
_WELD = 1e-5  # m: corners closer than this are the same point
_GAP = 0.1  # m2: smallest gap in a side of a piece that was divided, which ends where it was cut
_FLAT = 1e-4  # m: how far corners may be off the plane of a hull's side


def convex_parts(triangles: Array, tolerance: float, thickness: float) -> list[PartShape]:
    """Return convex parts that cover a surface.

    Args:
        triangles: [m, 3, 3], counter-clockwise from outside, m.
        tolerance: How far a part may reach from the surface, m.
        thickness: Least thickness of a part, m; a thinner one grows at the back of its triangles.
    """
    area = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    triangles = triangles[np.linalg.norm(area, axis=1) > 1e-12]
    if not len(triangles):
        return []
    parts = []
    for piece in _connected(triangles):
        points, corners = _unique_rows(_coarser(piece, 0.5 * tolerance).reshape(-1, 3))
        for hull in _pieces(points, corners.reshape(-1, 3), tolerance, thickness):
            parts.append(shape_of(hull, 0.25 * tolerance))
    return parts


def _coarser(triangles: Array, size: float) -> Array:
    """Return a fine piece with one point for each cell of a grid, which is the first in it; others are unchanged."""
    if len(triangles) <= FINE:
        return triangles
    points = triangles.reshape(-1, 3)
    cells = np.floor(points / size).astype(np.int64)
    cells -= cells.min(axis=0)
    code = (cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1]) * (cells[:, 2].max() + 1) + cells[:, 2]
    _, first, cell = np.unique(code, return_index=True, return_inverse=True)
    corners = cell.reshape(-1, 3)
    kept = (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]) & (corners[:, 0] != corners[:, 2])
    _, rows = np.unique(np.sort(corners[kept], axis=1), axis=0, return_index=True)
    return points[first][corners[kept][np.sort(rows)]] if kept.any() else triangles[:1]


def _connected(triangles: Array) -> list[Array]:
    """Return the pieces of a surface that share no corner, in the order of their first triangle."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    cells = np.round(triangles.reshape(-1, 3) / _WELD).astype(np.int64)
    _, point = _unique_rows(cells)
    point = point.reshape(-1, 3)
    rows, columns = point[:, [0, 1]].ravel(), point[:, [1, 2]].ravel()
    count = int(point.max()) + 1
    _, label = connected_components(coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), (count, count)), False)
    own = label[point[:, 0]]
    _, first, group = np.unique(own, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))[group]
    sorting = np.argsort(order, kind="stable")
    bounds = np.searchsorted(order[sorting], np.arange(len(first)))
    return [triangles[rows] for rows in np.split(sorting, bounds[1:])]


def _unique_rows(rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Return the distinct rows [n, c] in order, and which of them each row is: `np.unique` takes four times as long."""
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    is_new = np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))
    which = np.empty(len(rows), np.int64)
    which[order] = np.cumsum(is_new) - 1
    return ordered[is_new], which


def _pieces(
    points: Array,
    corners: NDArray[np.integer],
    tolerance: float,
    thickness: float,
    depth: int = 0,
    is_open: bool = False,
) -> list[Array]:
    """Return the corners of the hulls of a piece, divided where its hull is too far from it.

    Args:
        points: [n, 3], m.
        corners: [m, 3], rows of `points`; others are not part of the piece.
        tolerance: As of `convex_parts`.
        thickness: As of `convex_parts`.
        depth: Divisions so far.
        is_open: Whether the surface has a gap; then a piece must cover half of its hull.
    """
    triangles = points[corners]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    result, hull, is_close = _hull(points[np.unique(corners)], triangles, normals, tolerance, thickness)
    if hull is not None and is_open:
        is_close &= bool(np.linalg.norm(normals, axis=1).sum() >= hull.area)
    if depth == MAX_DEPTH or len(triangles) == 1:
        return [result]
    if not is_close:
        divided = _halves(triangles)
    elif hull is not None:
        divided = _sides_with_gap(hull, triangles, normals, tolerance, _GAP if depth else 0.0)
        is_open = True
    else:
        divided = []
    if not divided:
        return [result]
    return [
        each for rows in divided for each in _pieces(points, corners[rows], tolerance, thickness, depth + 1, is_open)
    ]


def _halves(triangles: Array) -> list[NDArray[np.integer]]:
    """Return the rows of two halves of a piece, across its longest side."""
    centers = triangles.mean(axis=1)
    axis = int(np.argmax(np.ptp(centers, axis=0)))
    order = np.argsort(centers[:, axis], kind="stable")
    middle = 0.5 * (centers[:, axis].min() + centers[:, axis].max())
    cut = int(np.clip(np.searchsorted(centers[order, axis], middle), 1, len(order) - 1))
    return [order[:cut], order[cut:]]


def _hull(
    points: Array, triangles: Array, normals: Array, tolerance: float, thickness: float
) -> tuple[Array, ConvexHull | None, bool]:
    """Return the corners of the hull of a piece, the hull (None of a plate), and whether the piece is close to it."""
    from scipy.spatial import ConvexHull

    back = _thin_direction(points, normals.sum(axis=0))
    reach = (points - points.mean(axis=0)) @ back
    if np.ptp(reach) >= thickness:
        if len(points) > MANY:
            points = points[np.unique((points @ _directions().T).argmax(axis=0))]
        hull = ConvexHull(points)
        tested = np.concatenate([triangles.reshape(-1, 3), triangles.mean(axis=1)])
        tested = tested[:: -(-len(tested) // TESTED)]
        is_close = all(_reach(hull.equations, part) <= tolerance for part in (tested[:: len(tested) // 16 + 1], tested))
        return points[hull.vertices], hull, is_close
    # A plate: its outline counts, then it gets its thickness at the back.
    if len(points) == 3:
        corners, is_close = points, True
    else:
        outline = _outline(points, back)
        covered = 0.5 * np.linalg.norm(normals, axis=1).sum()
        is_close = bool(outline.volume - covered <= tolerance * outline.area) or len(triangles) == 1
        corners = points[outline.vertices]
    return np.concatenate([corners, corners + (thickness - np.ptp(reach)) * back]), None, is_close


def _reach(planes: Array, points: Array) -> float:
    """Return how far points lie inside of the planes [k, 4] of a hull, at most, m."""
    return float((-np.max(points @ planes[:, :3].T + planes[:, 3], axis=1)).max())


def _sides_with_gap(
    hull: ConvexHull, triangles: Array, normals: Array, tolerance: float, least: float
) -> list[NDArray[np.integer]]:
    """Return the rows of triangles on each flat side of a hull, and of all others, if one side is covered only in part.

    A wall from which a doorway is cut has such sides. A side without any triangle, such as the open end of a cup
    without a bottom, counts as closed, and so does one with a gap of at most `least`, m2.
    """
    planes, plane_of = _unique_rows(hull.equations.round(6))
    a, b, c = np.moveaxis(hull.points[hull.simplices], 1, 0)
    sizes = np.bincount(plane_of, 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))
    areas = 0.5 * np.linalg.norm(normals, axis=1)
    corners = hull.points[hull.vertices]
    sides, has_gap = [], False
    for plane, size in zip(planes, sizes, strict=True):
        allowed = least + tolerance * 2.0 * math.sqrt(math.pi * size)  # with the length around a circle, the shortest
        if size <= allowed:
            continue
        facing = normals @ plane[:3] > (2.0 - 2e-6) * areas
        on_side = facing & (np.abs(triangles @ plane[:3] + plane[3]) < _FLAT).all(axis=1)
        if not on_side.any():
            continue
        sides.append(on_side)
        if size - areas[on_side].sum() > allowed:
            outline = _outline(corners[np.abs(corners @ plane[:3] + plane[3]) < _FLAT], plane[:3])
            has_gap |= bool(outline.volume - areas[on_side].sum() > least + tolerance * outline.area)
    if not has_gap:
        return []
    return [np.flatnonzero(rows) for rows in (*sides, ~np.any(sides, axis=0)) if rows.any()]


def _outline(points: Array, normal: Array) -> ConvexHull:
    """Return the convex hull of points in a plane; its `volume` is the area, its `area` the length around it."""
    from scipy.spatial import ConvexHull

    return ConvexHull(points @ np.linalg.svd(np.eye(3) - np.outer(normal, normal))[0][:, :2])


@functools.cache
def _directions() -> Array:
    """Return unit vectors [n, 3] all around: along the axes, their diagonals, and a Fibonacci lattice."""
    axes = np.array(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3)).reshape(3, -1).T
    axes = axes[np.abs(axes).sum(axis=1) > 0.0]
    step = np.arange(DIRECTIONS - len(axes)) + 0.5
    height = 1.0 - 2.0 * step / len(step)
    turn = np.pi * (1.0 + math.sqrt(5.0)) * step
    width = np.sqrt(1.0 - height**2)
    lattice = np.stack([width * np.cos(turn), height, width * np.sin(turn)], axis=1)
    return np.concatenate([axes / np.linalg.norm(axes, axis=1, keepdims=True), lattice])


def _thin_direction(points: Array, normal: Array) -> Array:
    """Return the direction in which points extend least, towards the back of the triangles."""
    offset = points - points.mean(axis=0)
    direction = np.linalg.svd(offset.T @ offset)[0][:, 2]
    return np.asarray(-direction if direction @ normal > 0.0 else direction)
