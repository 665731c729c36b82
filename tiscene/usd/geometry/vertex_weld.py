# SPDX-License-Identifier: Apache-2.0
"""Triangles with one normal and one uv per vertex, from faces whose corners may disagree about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import FloatArray, IntArray
from tiscene.usd.geometry.triangulate import cross


@dataclass(frozen=True, eq=False)
class WeldedMesh:
    """A gprim's triangles in its own space, before materials.

    positions: float32 [n, 3], stage units. triangles: int32 [m, 3]. normals: float32 [n, 3] or None for flat.
    uv: float32 [n, 2] or None; or [n, 8], with a second one, color and opacity.
    face: int32 [m], the authored face that each triangle is part of.
    point, corner: [n], the authored ones that each vertex was made of.
    moved, moved_normals: float32 [s, n, 3], positions and normals at other `times` (time codes).
    """

    positions: FloatArray
    triangles: IntArray
    normals: FloatArray | None
    uv: FloatArray | None
    face: IntArray
    point: NDArray[np.integer] | None = None
    corner: NDArray[np.integer] | None = None
    moved: FloatArray | None = None
    moved_normals: FloatArray | None = None
    times: Sequence[float] = ()


@dataclass(frozen=True, eq=False)
class Attribute:
    """A vertex attribute: `values` [k, c], belonging to points (per_corner False) or to corners of faces (True)."""

    values: FloatArray
    per_corner: bool

    def at(self, points: NDArray[np.integer], corners: NDArray[np.integer]) -> FloatArray:
        """The values at some corners, given those corners' points."""
        values: FloatArray = self.values[corners if self.per_corner else points]
        return values


def weld(
    points: FloatArray,
    corner_point: NDArray[np.integer],
    triangles: NDArray[np.integer],
    face: NDArray[np.integer],
    normals: Attribute | None,
    uv: Attribute | None,
    apart: NDArray[np.integer] | None = None,
) -> WeldedMesh:
    """Make vertices: corners at the same point with equal attributes become one vertex.

    corner_point: the point of every corner. triangles: [m, 3] corners. face: [m] authored face of each triangle.
    apart: numbers of all corners; those with different ones stay apart, whatever their attributes.
    """
    used = triangles.reshape(-1)
    used_point = corner_point[used]
    split: list[NDArray[np.generic]] = [a.values[used] for a in (normals, uv) if a is not None and a.per_corner]
    split += [] if apart is None else [apart[used]]
    if split:
        first, vertex = unique_rows([used_point.astype(np.int64), *split])
        vertex_corner, vertex_point = used[first], used_point[first]
    else:
        referenced = np.zeros(len(points), dtype=bool)
        referenced[used_point] = True
        vertex_point = np.flatnonzero(referenced)
        vertex_corner = vertex_point  # not looked at: every attribute belongs to points
        vertex = (np.cumsum(referenced) - 1)[used_point]
    shape = vertex.reshape(-1, 3).astype(np.int32)
    return WeldedMesh(
        positions=np.ascontiguousarray(points[vertex_point], dtype=np.float32),
        triangles=shape,
        normals=None if normals is None else unit(normals.at(vertex_point, vertex_corner), points[vertex_point], shape),
        uv=None if uv is None else np.ascontiguousarray(uv.at(vertex_point, vertex_corner), dtype=np.float32),
        face=face.astype(np.int32),
        point=vertex_point,
        corner=vertex_corner,
    )


def with_moved(
    surface: WeldedMesh, points: NDArray[np.floating], normals: Sequence[Attribute] | None = None
) -> WeldedMesh:
    """A welded surface with its vertices at other times.

    points: [s, points, 3], of the authored ones. normals: of each time, if they change; else what they are stays.
    """
    assert surface.point is not None
    assert surface.corner is not None
    moved = np.ascontiguousarray(points[:, surface.point], dtype=np.float32)
    turned = None
    if normals is not None:
        own = [each.at(surface.point, surface.corner) for each in normals]
        turned = np.stack([unit(each, at, surface.triangles) for each, at in zip(own, moved, strict=True)])
    elif surface.normals is not None:
        turned = np.broadcast_to(surface.normals, moved.shape)
    return replace(surface, moved=moved, moved_normals=turned)


def unit(vectors: NDArray[np.floating], positions: NDArray[np.floating], triangles: IntArray) -> FloatArray:
    """Vectors of length one; where one is too short to have a direction, the normal of the triangles around it."""
    length = np.sqrt(np.einsum("ij,ij->i", vectors, vectors, dtype=np.float64))
    short = length < 1e-12
    if short.any():
        vectors = np.where(short[:, None], smooth_normals(positions, triangles), vectors)
        length = np.where(short, 1.0, length)
    return np.ascontiguousarray(vectors / length[:, None], dtype=np.float32)


def smooth_normals(positions: NDArray[np.floating], triangles: NDArray[np.integer]) -> FloatArray:
    """Unit vertex normals: the mean over the triangles around a vertex, weighted by area; +z where there is none."""
    a, b, c = (positions[triangles[:, k]].astype(np.float64) for k in range(3))
    facing = cross(b - a, c - a)
    total = sum_rows(triangles.reshape(-1), np.repeat(facing, 3, axis=0), len(positions))
    length = np.sqrt(np.einsum("ij,ij->i", total, total))
    total[length <= 0.0] = (0.0, 0.0, 1.0)
    length[length <= 0.0] = 1.0
    return np.asarray(total / length[:, None], dtype=np.float32)


def sum_rows(index: NDArray[np.integer], values: NDArray[np.floating], size: int) -> NDArray[np.float64]:
    """Sum the rows of `values` [k, c] that share an index: float64 [size, c]."""
    return np.stack([np.bincount(index, column, minlength=size) for column in values.T], axis=-1)


def unique_rows(columns: list[NDArray[np.generic]]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Distinct rows of the given arrays [k] or [k, c] side by side, in the order in which they first appear.

    Returns (first, row): where each distinct row first stands, and for each of the k rows which distinct one it is.
    """
    words = []
    for column in columns:
        if np.issubdtype(column.dtype, np.floating):
            column = (column.astype(np.float32) + np.float32(0.0)).view(np.int32)  # -0 and 0 are one value
        words += list(column.reshape(len(column), -1).T)
    mixed = np.zeros(len(columns[0]), dtype=np.uint64)
    for word in words:  # rows are compared by a 64-bit mix of them: many times faster than row by row
        mixed = (mixed ^ word.astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    _, first, row = np.unique(mixed, return_index=True, return_inverse=True)
    if any((word != word[first][row]).any() for word in words):  # two rows of one mix: practically never
        _, first, row = np.unique(np.stack(words, axis=-1), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[row.reshape(-1)]
