# SPDX-License-Identifier: Apache-2.0
"""Polygon triangulation: fans for convex faces, ear clipping for concave ones.

Faces of equal vertex count are processed together as arrays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.floating]
Indices = NDArray[np.int64]


def cross(a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the cross product over the last axis; several times faster than np.cross on long arrays."""
    result = np.empty(np.broadcast_shapes(a.shape, b.shape), dtype=np.result_type(a, b))
    result[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    result[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    result[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return result


def triangulate(points: Points, counts: NDArray[np.integer], indices: NDArray[np.integer]) -> tuple[Indices, Indices]:
    """Split faces into triangles of the same winding.

    Args:
        points: [n, 3].
        counts: [faces], vertices of each face; faces of fewer than 3 make no triangle.
        indices: [corners], the points of the faces, face after face.

    Returns:
        corners: int64 [m, 3], corners of each triangle as positions in `indices`.
        face: int64 [m], the face that each triangle is part of.
    """
    counts = counts.astype(np.int64)
    starts = np.cumsum(counts) - counts
    triangle_counts = np.maximum(counts - 2, 0)
    triangle_start = np.cumsum(triangle_counts) - triangle_counts
    corners = np.empty((int(triangle_counts.sum()), 3), dtype=np.int64)
    for size in np.unique(counts[counts >= 3]).tolist():
        faces = np.flatnonzero(counts == size)
        local = _split_batch(points, indices, starts[faces], size)
        rows = triangle_start[faces][:, None] + np.arange(size - 2)
        corners[rows] = starts[faces][:, None, None] + local
    return corners, np.repeat(np.arange(len(counts)), triangle_counts)


def _split_batch(points: Points, indices: NDArray[np.integer], starts: Indices, size: int) -> Indices:
    """Triangulate faces that all have `size` vertices: [faces, size - 2, 3], as positions 0..size-1."""
    step = np.arange(size - 2)
    fan = np.stack([np.zeros_like(step), step + 1, step + 2], axis=-1)
    result = np.broadcast_to(fan, (len(starts), *fan.shape))
    if size == 3:
        return result
    p = points[indices[starts[:, None] + np.arange(size)]].astype(np.float64)
    p -= p[:, :1]
    if size == 4:
        # Along the other diagonal the two triangles of a concave one would face opposite ways.
        first, second = cross(p[:, 1], p[:, 2]), cross(p[:, 2], p[:, 3])
        is_concave = np.einsum("fk,fk->f", first, second) < 0.0
        return np.asarray((result + is_concave[:, None, None]) % 4)
    following, preceding = np.arange(1, size + 1) % size, np.arange(-1, size - 1)
    after = p[:, following]
    normal = cross(p, after).sum(axis=1)  # Newell's method: twice the area vector, also of concave faces
    into, out = p - p[:, preceding], after - p
    turn = np.einsum("fvk,fk->fv", cross(into, out), normal)
    area_squared = np.einsum("fk,fk->f", normal, normal)
    reflex = turn < -1e-9 * area_squared[:, None]
    along = np.einsum("fvk,fvk->fv", into, out)
    angle = np.arctan2(turn, along * np.sqrt(area_squared)[:, None]).sum(axis=1)
    concave = np.flatnonzero(
        reflex.any(axis=1) | (angle > 3.0 * np.pi)
    )  # total turning 4 pi: a star polygon, convex at each corner
    if len(concave):
        result = result.copy()
        result[concave] = ear_clip(_flatten(p[concave], normal[concave]))
    return result


def _flatten(p: Points, normal: Points) -> Points:
    """Project polygons [f, n, 3] along the main axis of their normals: [f, n, 2], counter-clockwise."""
    drop = np.argmax(np.abs(normal), axis=1)
    rows = np.arange(len(p))
    u, v = p[rows, :, (drop + 1) % 3], p[rows, :, (drop + 2) % 3]
    flip = normal[rows, drop] < 0.0
    return np.stack([np.where(flip[:, None], v, u), np.where(flip[:, None], u, v)], axis=-1)


def ear_clip(xy: Points) -> Indices:
    """Triangulate simple counter-clockwise polygons [f, n, 2] by ear clipping.

    All polygons lose one ear in each step, the best-shaped first. A self-intersecting polygon has no proper
    triangulation; its triangles are arbitrary.

    Returns:
        int64 [f, n - 2, 3], as positions 0..n-1.
    """
    faces, size = xy.shape[:2]
    rows = np.arange(faces)
    before = np.tile((np.arange(size) - 1) % size, (faces, 1))
    after = np.tile((np.arange(size) + 1) % size, (faces, 1))
    alive = np.ones((faces, size), dtype=bool)
    score = np.empty((faces, size))
    for vertex in range(size):
        score[:, vertex] = _ear_score(xy, before, after, alive, np.full(faces, vertex))
    result = np.empty((faces, size - 2, 3), dtype=np.int64)
    for step in range(size - 2):
        ear = np.argmax(score, axis=1)
        a, b = before[rows, ear], after[rows, ear]
        result[:, step] = np.stack([a, ear, b], axis=-1)
        alive[rows, ear] = False
        score[rows, ear] = -np.inf
        after[rows, a], before[rows, b] = b, a
        score[rows, a] = _ear_score(xy, before, after, alive, a)
        score[rows, b] = _ear_score(xy, before, after, alive, b)
    return result


def _ear_score(xy: Points, before: Indices, after: Indices, alive: NDArray[np.bool_], vertex: Indices) -> Points:
    """Rate `vertex` [f] of each polygon as an ear: 0..1 by shape, -1 if it contains another vertex, -2 if reflex."""
    rows = np.arange(len(xy))
    a, b, c = (xy[rows, i][:, None] for i in (before[rows, vertex], vertex, after[rows, vertex]))
    area = _cross2(b - a, c - b)[:, 0]
    inside = (_cross2(b - a, xy - a) >= 0) & (_cross2(c - b, xy - b) >= 0) & (_cross2(a - c, xy - c) >= 0)
    corner = (xy == a).all(-1) | (xy == b).all(-1) | (xy == c).all(-1)
    blocked = (inside & ~corner & alive).any(axis=1)
    longest = np.maximum.reduce([((q - p) ** 2).sum(-1)[:, 0] for p, q in ((a, b), (b, c), (c, a))])
    shape = area / np.maximum(longest, np.finfo(np.float64).tiny)
    return np.where(area < 0.0, -2.0, np.where(blocked & (area > 0.0), -1.0, shape))


def _cross2(a: Points, b: Points) -> Points:
    """Return the 2D cross product over the last axis."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
