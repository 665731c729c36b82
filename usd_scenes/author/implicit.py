# SPDX-License-Identifier: Apache-2.0
"""Implicit surfaces: signed distance fields for stuffed and molded shapes, polygonized by surface nets.

A field maps points [n, 3] to distances [n], negative inside.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from usd_scenes.author.polygon_mesh import Array, PolygonMesh, normalized

Field = Callable[[Array], Array]


def ellipsoid(center: ArrayLike, radii: ArrayLike, turn: Array | None = None) -> Field:
    """Return the field of an ellipsoid; `turn` [3, 3] rotates it about its center."""
    middle, reach = np.asarray(center, dtype=np.float64), np.asarray(radii, dtype=np.float64)
    axes = np.eye(3) if turn is None else turn

    def distance(points: Array) -> Array:
        local = (points - middle) @ axes / reach
        length = np.linalg.norm(local, axis=-1)
        slope = np.linalg.norm(local / reach, axis=-1)
        return np.asarray(length * (length - 1.0) / np.maximum(slope, 1e-9))

    return distance


def limb(start: ArrayLike, end: ArrayLike, first: float, last: float) -> Field:
    """Return the field of a rounded cone between two points, of radius `first` to `last`."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)

    def distance(points: Array) -> Array:
        along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        nearest = a + along[:, None] * (b - a)
        return np.asarray(np.linalg.norm(points - nearest, axis=-1) - (first + along * (last - first)))

    return distance


def union(fields: Sequence[Field], blend: float) -> Field:
    """Return the union of fields, smoothly blended over about `blend` m."""

    def distance(points: Array) -> Array:
        total = fields[0](points)
        for field in fields[1:]:
            other = field(points)
            overlap = np.maximum(blend - np.abs(total - other), 0.0) / blend
            total = np.minimum(total, other) - overlap**2 * blend / 4.0
        return np.asarray(total)

    return distance


def surface(field: Field, low: ArrayLike, high: ArrayLike, step: float) -> PolygonMesh:
    """Polygonize the zero set of a field by surface nets (Gibson 1998).

    Args:
        field: the signed distance.
        low: lower corner of the box to search, m.
        high: upper corner of the box, m.
        step: grid spacing and approximate side of the quads, m.

    Returns:
        A closed mesh with normals from the field and uv by `with_box_uv`.
    """
    corners = [
        np.arange(a - step, b + 2.0 * step, step) for a, b in zip(np.asarray(low), np.asarray(high), strict=True)
    ]
    places = np.stack(np.meshgrid(*corners, indexing="ij"), axis=-1)
    values = field(places.reshape(-1, 3)).reshape(places.shape[:3])
    inside = values < 0.0
    shape: list[int] = np.subtract(values.shape, 1).tolist()

    def shifted(array: Array, by: Sequence[int]) -> Array:
        return array[tuple(slice(b, b + n) for b, n in zip(by, shape, strict=True))]

    total, crossings = np.zeros((*shape, 3)), np.zeros(shape)
    for start in product((0, 1), repeat=3):
        for axis in range(3):
            if start[axis] == 1:
                continue
            end = tuple(1 if a == axis else s for a, s in enumerate(start))
            first, last = shifted(values, start), shifted(values, end)
            crossed = (first < 0.0) != (last < 0.0)
            t = np.where(crossed, first / np.where(crossed, first - last, 1.0), 0.0)
            point = np.array(start) + t[..., None] * np.eye(3)[axis]
            total += point * crossed[..., None]
            crossings += crossed
    cells = crossings > 0
    number = np.full(shape, -1, dtype=np.int64)
    number[cells] = np.arange(int(cells.sum()))
    origin = np.array([axis[0] for axis in corners])
    points = origin + step * (np.argwhere(cells) + total[cells] / crossings[cells][:, None])
    quads = []
    for axis in range(3):
        b, c = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
        ahead = np.roll(inside, -1, axis=axis)
        for out in (True, False):
            at = np.argwhere((inside == out) & (ahead != out))
            quad = np.stack([number[tuple((at - o).T)] for o in (b + c, c, 0 * b, b)], axis=-1)
            quads.append(quad if out else quad[:, ::-1])
    for _ in range(3):
        slope = gradient(field, points, 0.2 * step)
        points = points - (field(points) / np.maximum((slope**2).sum(axis=-1), 0.05))[:, None] * slope
    indices = np.concatenate(quads).reshape(-1).astype(np.int32)
    normals = normalized(gradient(field, points, 0.5 * step))
    counts = np.full(len(indices) // 4, 4, dtype=np.int32)
    return with_box_uv(PolygonMesh(points, normals, np.zeros((len(points), 2)), counts, indices))


def gradient(field: Field, points: Array, reach: float) -> Array:
    """Return central differences of a field over 2 `reach` m, [n, 3]."""
    axes = reach * np.eye(3)
    return np.stack([field(points + axis) - field(points - axis) for axis in axes], axis=-1) / (2.0 * reach)


def with_box_uv(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with box-projected uv: each face along its main axis, with seams where that changes."""
    starts = np.cumsum(mesh.counts) - mesh.counts
    a, b, c = (mesh.points[mesh.indices[starts + k]] for k in range(3))
    axis = np.repeat(np.argmax(np.abs(np.cross(b - a, c - a)), axis=1), mesh.counts)
    keys, indices = np.unique(mesh.indices.astype(np.int64) * 3 + axis, return_inverse=True)
    vertex, facing = keys // 3, keys % 3
    points = mesh.points[vertex]
    u, v = np.choose(facing, [2, 0, 0]), np.choose(facing, [1, 2, 1])
    row = np.arange(len(points))
    uv = np.stack([points[row, u], points[row, v]], axis=-1)
    return PolygonMesh(points, mesh.normals[vertex], uv, mesh.counts, indices.reshape(-1).astype(np.int32))
