# SPDX-License-Identifier: Apache-2.0
"""`PolygonMesh` and the operations that shapes are made with: transforms, merging, grids, smooth normals.

Lengths are in meters; axes are right-handed with +y up; faces are counter-clockwise seen from outside. Texture
coordinates are in meters, too: the material's tile size scales them to texture space when a mesh is written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class PolygonMesh:
    """A mesh of polygons with one normal and one uv per vertex.

    Attributes:
        points: [n, 3], m.
        normals: [n, 3], unit length.
        uv: [n, 2], m.
        counts: corners of each face, [faces].
        indices: the vertex of each corner, face after face, [corners].
    """

    points: Array
    normals: Array
    uv: Array
    counts: Indices
    indices: Indices

    @property
    def triangles(self) -> int:
        """Number of triangles that the faces are split into."""
        return int((self.counts - 2).sum())

    @property
    def bounds(self) -> Array:
        """Lower and upper corner of the bounding box, [2, 3], m."""
        return np.array([self.points.min(axis=0), self.points.max(axis=0)])

    def translated(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> PolygonMesh:
        """Return the mesh moved by (x, y, z), m."""
        return replace(self, points=self.points + np.array([x, y, z]))

    def rotated(self, axis: str, degrees: float) -> PolygonMesh:
        """Return the mesh rotated about "x", "y" or "z" through the origin, counter-clockwise seen against the axis."""
        return self.transformed(rotation(axis, degrees))

    def transformed(self, matrix: ArrayLike) -> PolygonMesh:
        """Return the mesh under a 3x3 linear map; after a mirroring one, faces still point outward."""
        linear = np.asarray(matrix, dtype=np.float64)
        normals = normalized(self.normals @ np.linalg.inv(linear))
        mesh = replace(self, points=self.points @ linear.T, normals=normals)
        return mesh.reversed(keep_normals=True) if np.linalg.det(linear) < 0.0 else mesh

    def scaled(self, x: float, y: float, z: float) -> PolygonMesh:
        """Return the mesh scaled along each axis."""
        return self.transformed(np.diag([x, y, z]))

    def reversed(self, keep_normals: bool = False) -> PolygonMesh:
        """Return the mesh turned inside out: reversed winding and, unless `keep_normals`, negated normals."""
        starts = np.cumsum(self.counts) - self.counts
        face = np.repeat(np.arange(len(self.counts)), self.counts)
        corner = np.arange(len(self.indices)) - starts[face]
        indices = self.indices[starts[face] + self.counts[face] - 1 - corner]
        return replace(self, indices=indices, normals=self.normals if keep_normals else -self.normals)

    def deformed(self, function: Callable[[Array], Array], weld: bool = True) -> PolygonMesh:
        """Return the mesh with its points [n, 3] mapped by `function` and new smooth normals."""
        return with_smooth_normals(replace(self, points=function(self.points)), weld=weld)

    def with_uv(self, u: float = 0.0, v: float = 0.0, scale: float = 1.0, swap: bool = False) -> PolygonMesh:
        """Return the mesh with texture coordinates scaled, then shifted by (u, v), m; `swap` exchanges them first."""
        uv = self.uv[:, ::-1] if swap else self.uv
        return replace(self, uv=uv * scale + (u, v))


def rotation(axis: str, degrees: float) -> Array:
    """Return the 3x3 rotation about "x", "y" or "z"."""
    angle = np.radians(degrees)
    cosine, sine = np.cos(angle), np.sin(angle)
    matrix = np.eye(3)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix[i, i] = matrix[j, j] = cosine
    matrix[i, j], matrix[j, i] = -sine, sine
    return matrix


def normalized(vectors: Array) -> Array:
    """Normalize vectors over the last axis; zero vectors stay."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 1e-12, length, 1.0)


def merged(meshes: Iterable[PolygonMesh]) -> PolygonMesh:
    """Concatenate meshes."""
    parts = list(meshes)
    starts = np.cumsum([0] + [len(part.points) for part in parts[:-1]])
    return PolygonMesh(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.uv for part in parts]),
        np.concatenate([part.counts for part in parts]),
        np.concatenate([part.indices + start for part, start in zip(parts, starts, strict=True)]).astype(np.int32),
    )


def grid(points: Array, uv: Array, *, closed: bool = False) -> PolygonMesh:
    """Build quads over points [rows, columns, 3] with uv [rows, columns, 2]; the front faces along columns × rows.

    Args:
        points: [rows, columns, 3].
        uv: [rows, columns, 2].
        closed: whether the last column coincides with the first, with its own uv; normals then agree across the seam.
    """
    rows, columns = points.shape[:2]
    at = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    quads = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=-1).reshape(-1, 4)
    flat = points.reshape(-1, 3)
    mesh = PolygonMesh(
        flat,
        np.zeros_like(flat),
        uv.reshape(-1, 2),
        np.full(len(quads), 4, dtype=np.int32),
        quads.reshape(-1).astype(np.int32),
    )
    return without_degenerate_faces(with_smooth_normals(mesh, weld=closed))


def without_degenerate_faces(mesh: PolygonMesh) -> PolygonMesh:
    """Turn quads with two coincident corners, as at a pole, into triangles; drop faces without area."""
    quads = mesh.indices.reshape(-1, 4)
    points = mesh.points[quads]
    same = np.linalg.norm(points - np.roll(points, -1, axis=1), axis=-1) < 1e-9
    counts, indices = [], []
    for quad, collapsed in zip(quads, same, strict=True):
        corners = quad[~collapsed]
        if len(corners) >= 3:
            counts.append(len(corners))
            indices.append(corners)
    return replace(mesh, counts=np.array(counts, dtype=np.int32), indices=np.concatenate(indices).astype(np.int32))


def with_smooth_normals(mesh: PolygonMesh, weld: bool = True) -> PolygonMesh:
    """Return the mesh with area-weighted smooth normals, so that large flat faces stay flat beside their bevels.

    Args:
        mesh: a mesh.
        weld: whether vertices at the same place share a normal, whatever their uv.
    """
    starts = np.cumsum(mesh.counts) - mesh.counts
    faces = np.repeat(np.arange(len(mesh.counts)), mesh.counts)
    following = mesh.indices[starts[faces] + (np.arange(len(mesh.indices)) - starts[faces] + 1) % mesh.counts[faces]]
    origin = mesh.points[mesh.indices[starts]][faces]
    doubled_areas = np.zeros((len(mesh.counts), 3))
    np.add.at(doubled_areas, faces, np.cross(mesh.points[mesh.indices] - origin, mesh.points[following] - origin))
    if weld:
        keys = np.round(mesh.points / 1e-6).astype(np.int64)
        _, group = np.unique(keys, axis=0, return_inverse=True)
        group = group.reshape(-1)
    else:
        group = np.arange(len(mesh.points))
    sums = np.zeros((group.max() + 1, 3))
    np.add.at(sums, group[mesh.indices], doubled_areas[faces])
    return replace(mesh, normals=normalized(sums)[group])


def polygon(points: ArrayLike, normal: Sequence[float], uv: ArrayLike) -> PolygonMesh:
    """Return a mesh of one flat face."""
    corners = np.asarray(points, dtype=np.float64)
    count = len(corners)
    return PolygonMesh(
        corners,
        np.tile(np.asarray(normal, dtype=np.float64), (count, 1)),
        np.asarray(uv, dtype=np.float64),
        np.array([count], dtype=np.int32),
        np.arange(count, dtype=np.int32),
    )
