# SPDX-License-Identifier: Apache-2.0
"""Sphere proxies: the spheres that stand for a body's surface in collisions.

Every point of the surface lies in a sphere, so that a surface whose spheres touch nothing touches nothing. `cover`
places the spheres; its kernels are in `dynamics.sphere_cover_kernels`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynamics.errors import ArgumentError

Array = NDArray[np.float64]

MAX_SPHERES = 256
MAX_SAMPLES = 4096  # surface points that are compared where coverage does not depend on it
GROUP = 8  # spheres per group, on average
FINEST = 0.004  # m: smallest radius aimed at
DEPTHS = (0.5, 1.0, 2.0, 3.0, 4.0)  # depths below the surface tried for centers, in radii
ROUNDING = 1.0 + 1e-6  # of radii to float32


@dataclass(frozen=True, eq=False)
class Shape:
    """A body's surface as spheres in its own axes.

    Attributes:
        spheres: float32 [n, 4], center and radius in meters, group after group.
        groups: float32 [g, 4], bounding sphere of each group.
        first: int32 [g + 1], rows of `spheres` at which the groups begin.
        reach: Radius of a sphere about the body's origin that holds all spheres, meters.
    """

    spheres: NDArray[np.float32]
    groups: NDArray[np.float32]
    first: NDArray[np.int32]
    reach: float


def cover(corners: ArrayLike, max_spheres: int = MAX_SPHERES) -> Shape:
    """Cover a surface with spheres.

    Centers are chosen by farthest-point sampling (Gonzalez, "Clustering to Minimize the Maximum Intercluster Distance",
    1985) and moved to the centers of the triangles nearest to them. In closed solids they sink below the surface, where
    a larger sphere covers the same triangles and protrudes less. Taichi must be running.

    Args:
        corners: [n, 3, 3], corners of triangles in the body's axes, meters; counter-clockwise seen from outside.
        max_spheres: Maximum number of spheres.

    Raises:
        ArgumentError: For no triangles, or corners that are not finite.
    """
    triangles = np.asarray(corners, dtype=np.float64)
    if triangles.ndim != 3 or triangles.shape[1:] != (3, 3) or not len(triangles):
        raise ArgumentError(f"corners has shape {triangles.shape}: must be [n, 3, 3] with one triangle or more")
    if not np.isfinite(triangles).all():
        raise ArgumentError("corners: must be finite numbers")
    area = 0.5 * np.linalg.norm(_normals(triangles), axis=1).sum()
    extent = float(np.linalg.norm(np.ptp(triangles.reshape(-1, 3), axis=0)))
    # `max_spheres` disks of this radius cover a flat surface of this area; the pieces are smaller than that.
    radius = max(np.sqrt(area / (2.6 * max_spheres)), extent / max_spheres, FINEST)
    pieces = _subdivided(triangles, 0.7 * radius)
    middles = pieces.mean(axis=1)
    samples = middles[:: 1 + len(middles) // MAX_SAMPLES]
    centers = samples[_farthest_points(samples, max_spheres, min_distance=0.7 * radius)]
    for _ in range(2):
        owner = _nearest(middles, centers)
        centers = _centered(pieces, owner)
    owner = _nearest(middles, centers)
    radii = np.zeros(len(centers))
    # A sphere that holds the corners of a triangle holds the triangle.
    np.maximum.at(radii, owner, np.linalg.norm(pieces - centers[owner][:, None], axis=2).max(axis=1))
    used = np.bincount(owner, minlength=len(centers)) > 0
    if _is_closed(triangles):
        centers, radii = _sunk(pieces, owner, centers, radii)
    return _grouped(centers[used], radii[used] * ROUNDING + 1e-7)


def _normals(triangles: Array) -> Array:
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def _squares(vectors: Array) -> Array:
    result: Array = np.einsum("ij,ij->i", vectors, vectors)
    return result


def _subdivided(triangles: Array, max_edge: float) -> Array:
    """Return the same surface in triangles whose edges are at most `max_edge` meters."""
    done = []
    while len(triangles):
        edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        worst = edges.argmax(axis=1)
        small = edges.max(axis=1) <= max_edge
        done.append(triangles[small])
        # Halve the longest edge of the others: corner `worst`, the next one, and the third.
        rest, worst = triangles[~small], worst[~small]
        rows = np.arange(len(rest))
        a, b, c = (rest[rows, (worst + step) % 3] for step in range(3))
        middle = 0.5 * (a + b)
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)


def _farthest_points(points: Array, max_count: int, min_distance: float) -> NDArray[np.intp]:
    """Return rows of up to `max_count` points, each farthest from those before, and at least `min_distance`."""
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())]
    distance = np.full(len(points), np.inf)
    while len(chosen) < max_count:
        distance = np.minimum(distance, _squares(points - points[chosen[-1]]))
        farthest = int(distance.argmax())
        if distance[farthest] <= min_distance * min_distance:
            break
        chosen.append(farthest)
    return np.array(chosen, dtype=np.intp)


def _nearest(points: Array, centers: Array) -> NDArray[np.int32]:
    """Return the row of the nearest center for each point."""
    from dynamics.sphere_cover_kernels import find_nearest_centers

    owner = np.zeros(len(points), dtype=np.int32)
    find_nearest_centers(np.ascontiguousarray(points), np.ascontiguousarray(centers), owner)
    return owner


@dataclass(frozen=True)
class _Owned:
    """Corners of triangles sorted by owner; owners without triangles are left out.

    Attributes:
        corners: [n, 3].
        first: Rows of `corners` at which each owner's begin.
        rows: The owners.
    """

    corners: Array
    first: NDArray[np.int32]
    rows: NDArray[np.int32]

    @classmethod
    def by(cls, pieces: Array, owner: NDArray[np.int32]) -> _Owned:
        order = np.argsort(owner, kind="stable")
        begins = np.flatnonzero(np.diff(owner[order], prepend=-1))
        first = (3 * np.append(begins, len(owner))).astype(np.int32)
        return cls(np.ascontiguousarray(pieces[order].reshape(-1, 3)), first, owner[order][begins])


def _centered(pieces: Array, owner: NDArray[np.int32]) -> Array:
    """Return the approximate center of the smallest ball around the pieces of each owner."""
    from dynamics.sphere_cover_kernels import find_ball_centers

    owned = _Owned.by(pieces, owner)
    centers = np.zeros((len(owned.rows), 3))
    find_ball_centers(owned.corners, owned.first, centers)
    return centers


def _is_closed(triangles: Array) -> bool:
    """Return whether each edge occurs once in each direction, and the triangles face outwards."""
    if np.einsum("ij,ij->", triangles[:, 0], _normals(triangles)) <= 0.0:
        return False
    _, corner = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    rows = corner.reshape(-1, 3).astype(np.int64)
    rows = rows[(rows != np.roll(rows, -1, axis=1)).all(axis=1)]
    start, end = rows.ravel(), np.roll(rows, -1, axis=1).ravel()
    count = len(triangles) * 3
    there, back = np.sort(start * count + end), np.sort(end * count + start)
    return bool(np.array_equal(there, back))


def _sunk(pieces: Array, owner: NDArray[np.int32], centers: Array, radii: Array) -> tuple[Array, Array]:
    """Return centers and radii that cover the same pieces from inside of a closed surface, and protrude least."""
    from dynamics.sphere_cover_kernels import sink_centers

    normals = _normals(pieces)
    outward = np.zeros_like(centers)
    np.add.at(outward, owner, normals)
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    sampled = slice(None, None, 1 + len(pieces) // MAX_SAMPLES)
    owned = _Owned.by(pieces, owner)
    below, larger = centers[owned.rows], radii[owned.rows]
    middles, normals = pieces[sampled].mean(axis=1), np.ascontiguousarray(normals[sampled])
    sink_centers(owned.corners, owned.first, outward[owned.rows], middles, normals, np.array(DEPTHS), below, larger)
    centers, radii = centers.copy(), radii.copy()
    centers[owned.rows], radii[owned.rows] = below, larger
    return centers, radii


def _grouped(centers: Array, radii: Array) -> Shape:
    """Sort spheres into groups of neighbors, each with a bounding sphere."""
    count = max(1, round(len(centers) / GROUP))
    seeds = centers[_farthest_points(centers, count, min_distance=0.0)]
    owner = _nearest(centers, seeds)
    order = np.argsort(owner, kind="stable")
    centers, radii, owner = centers[order], radii[order], owner[order]
    rows = [np.flatnonzero(owner == group) for group in range(len(seeds))]
    rows = [row for row in rows if len(row)]
    groups = np.zeros((len(rows), 4))
    for group, row in enumerate(rows):
        groups[group, :3] = 0.5 * (centers[row].min(axis=0) + centers[row].max(axis=0))
        groups[group, 3] = (np.linalg.norm(centers[row] - groups[group, :3], axis=1) + radii[row]).max() * ROUNDING
    return Shape(
        spheres=np.column_stack([centers, radii]).astype(np.float32),
        groups=groups.astype(np.float32),
        first=np.cumsum([0, *(len(row) for row in rows)]).astype(np.int32),
        reach=float((np.linalg.norm(centers, axis=1) + radii).max() * ROUNDING),
    )
