# SPDX-License-Identifier: Apache-2.0
"""Vertex welding: indexed triangles with one normal and one uv per vertex.

UsdGeomMesh may give every face corner its own normal and uv (faceVarying), so one point can have several. `weld` makes
one vertex for each distinct combination of point and per-corner attributes. The module also holds `WeldedMesh`, the
result of all geometry readers, area-weighted smooth normals, and two helpers for sums and distinct rows of arrays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import FloatArray, IntArray
from tiscene.scene.skinned_deformation import ControlledSurface, Skin
from tiscene.usd.geometry.triangulate import cross


@dataclass(frozen=True, eq=False)
class WeldedMesh:
    """A gprim's triangles in its object space, before materials are assigned.

    Attributes:
        positions: float32 [n, 3], in stage units.
        triangles: int32 [m, 3], vertices of each triangle, counter-clockwise seen from outside.
        normals: float32 [n, 3], unit length; None for flat shading.
        uv: float32 [n, 2]; [n, 8] with the columns that `primvar` names where a material reads more than one uv; None
            if the gprim has none of them.
        face: int32 [m], the authored face that each triangle is part of.
        point: [n], the authored point of each vertex; None if the vertices were generated.
        corner: [n], an authored face corner of each vertex; None if the vertices were generated.
        position_samples: float32 [s, n, 3], positions at `times`; None if the shape does not change.
        normal_samples: float32 [s, n, 3], normals at `times`; None if the shape does not change or has no normals.
        times: time codes of the samples, increasing.
        control: how control points decide the vertices; None if they do not move by a skin.
        skin: what moves the control points; None if the mesh does not play as a skin.
    """

    positions: FloatArray
    triangles: IntArray
    normals: FloatArray | None
    uv: FloatArray | None
    face: IntArray
    point: NDArray[np.integer] | None = None
    corner: NDArray[np.integer] | None = None
    position_samples: FloatArray | None = None
    normal_samples: FloatArray | None = None
    times: Sequence[float] = ()
    control: ControlledSurface | None = None
    skin: Skin | None = None

    def positions_at(self, time: float) -> FloatArray:
        """Return the positions [n, 3] at a time code, between samples as they are played. A skin is not applied."""
        if self.position_samples is None:
            return self.positions
        at = float(np.interp(time, self.times, np.arange(len(self.times))))
        before, after = self.position_samples[int(at)], self.position_samples[math.ceil(at)]
        return np.asarray(before + (after - before) * np.float32(at % 1.0))


@dataclass(frozen=True, eq=False)
class Attribute:
    """Values that belong to points or to face corners.

    Attributes:
        values: float [k, c], c components for each point or corner.
        per_corner: whether k counts face corners; otherwise it counts points.
        interpolation: of the primvar that they are read from; "" for none, and for several of different ones.
    """

    values: FloatArray
    per_corner: bool
    interpolation: str = ""

    def at(self, points: NDArray[np.integer], corners: NDArray[np.integer]) -> FloatArray:
        """Return the values [k, c] at face corners, given the corners and their points, both [k]."""
        values: FloatArray = self.values[corners if self.per_corner else points]
        return values


def weld(
    points: FloatArray,
    corner_point: NDArray[np.integer],
    triangles: NDArray[np.integer],
    face: NDArray[np.integer],
    normals: Attribute | None,
    uv: Attribute | None,
    split_by: NDArray[np.integer] | None = None,
) -> WeldedMesh:
    """Merge face corners at the same point with equal attributes into one vertex.

    Args:
        points: float [points, 3].
        corner_point: [corners], the point of each face corner.
        triangles: [m, 3], face corners of each triangle.
        face: [m], the authored face of each triangle.
        normals: normals of points or corners, any length; None for flat shading.
        uv: texture coordinates of points or corners, or None.
        split_by: [corners], integers; corners with different ones are never merged. None: no such restriction.
    """
    used = triangles.reshape(-1)
    used_point = corner_point[used]
    split: list[NDArray[np.generic]] = [a.values[used] for a in (normals, uv) if a is not None and a.per_corner]
    split += [] if split_by is None else [split_by[used]]
    if split:
        first, vertex = unique_rows([used_point.astype(np.int64), *split])
        vertex_corner, vertex_point = used[first], used_point[first]
    else:
        corner_of_point = np.full(len(points), -1, dtype=used.dtype)
        corner_of_point[used_point] = used
        referenced = corner_of_point >= 0
        vertex_point = np.flatnonzero(referenced)
        vertex_corner = corner_of_point[vertex_point]
        vertex = (np.cumsum(referenced) - 1)[used_point]
    shape = vertex.reshape(-1, 3).astype(np.int32)
    return WeldedMesh(
        positions=np.ascontiguousarray(points[vertex_point], dtype=np.float32),
        triangles=shape,
        normals=None
        if normals is None
        else unit_normals(normals.at(vertex_point, vertex_corner), points[vertex_point], shape),
        uv=None if uv is None else np.ascontiguousarray(uv.at(vertex_point, vertex_corner), dtype=np.float32),
        face=face.astype(np.int32),
        point=vertex_point,
        corner=vertex_corner,
    )


def with_position_samples(
    surface: WeldedMesh, points: NDArray[np.floating], normals: Sequence[Attribute] | None = None
) -> WeldedMesh:
    """Return the welded mesh with position and normal samples over time.

    Args:
        surface: a mesh made by `weld`.
        points: [s, points, 3], the authored points at each time.
        normals: the authored normals at each time; None if they stay those of `surface`.
    """
    assert surface.point is not None
    assert surface.corner is not None
    position_samples = np.ascontiguousarray(points[:, surface.point], dtype=np.float32)
    normal_samples = None
    if normals is not None:
        own = [each.at(surface.point, surface.corner) for each in normals]
        normal_samples = np.stack(
            [unit_normals(each, at, surface.triangles) for each, at in zip(own, position_samples, strict=True)]
        )
    elif surface.normals is not None:
        normal_samples = np.broadcast_to(surface.normals, position_samples.shape)
    return replace(surface, position_samples=position_samples, normal_samples=normal_samples)


def unit_normals(vectors: NDArray[np.floating], positions: NDArray[np.floating], triangles: IntArray) -> FloatArray:
    """Normalize normals [n, 3]; replace those of zero length by the smooth normal of the adjacent triangles."""
    length = np.sqrt(np.einsum("ij,ij->i", vectors, vectors, dtype=np.float64))
    short = length < 1e-12
    if short.any():
        vectors = np.where(short[:, None], smooth_normals(positions, triangles), vectors)
        length = np.where(short, 1.0, length)
    return np.ascontiguousarray(vectors / length[:, None], dtype=np.float32)


def smooth_normals(positions: NDArray[np.floating], triangles: NDArray[np.integer]) -> FloatArray:
    """Return unit vertex normals float32 [n, 3]: area-weighted means over adjacent triangles, +z where that is zero."""
    a, b, c = (positions[triangles[:, k]].astype(np.float64) for k in range(3))
    facing = cross(b - a, c - a)
    total = sum_rows(triangles.reshape(-1), np.repeat(facing, 3, axis=0), len(positions))
    length = np.sqrt(np.einsum("ij,ij->i", total, total))
    total[length <= 0.0] = (0.0, 0.0, 1.0)
    length[length <= 0.0] = 1.0
    return np.asarray(total / length[:, None], dtype=np.float32)


def sum_rows(index: NDArray[np.integer], values: NDArray[np.floating], size: int) -> NDArray[np.float64]:
    """Return the sums float64 [size, c] of the rows of `values` [k, c] that share an index [k]."""
    return np.stack([np.bincount(index, column, minlength=size) for column in values.T], axis=-1)


def unique_rows(columns: list[NDArray[np.generic]]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the distinct rows of arrays [k] or [k, c] taken side by side, in order of first appearance.

    Returns:
        first: the index of the first occurrence of each distinct row.
        row: int64 [k], the distinct row that each row equals.
    """
    words = []
    for column in columns:
        if np.issubdtype(column.dtype, np.floating):
            column = (column.astype(np.float32) + np.float32(0.0)).view(np.int32)  # -0 and 0 are one value
        words += list(column.reshape(len(column), math.prod(column.shape[1:])).T)
    hashes = np.zeros(len(columns[0]), dtype=np.uint64)
    for word in words:  # sorting 64-bit hashes is many times faster than sorting rows
        hashes = (hashes ^ word.astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        hashes ^= hashes >> np.uint64(29)
    _, first, row = np.unique(hashes, return_index=True, return_inverse=True)
    if any((word != word[first][row]).any() for word in words):  # hash collision: practically never
        _, first, row = np.unique(np.stack(words, axis=-1), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[row.reshape(-1)]
