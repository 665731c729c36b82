# SPDX-License-Identifier: Apache-2.0
"""Meshes as the few boxes, cylinders and spheres that they are closest to: the elementary scenes of the paper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usd_scenes.author.polygon_mesh import Array, Indices, PolygonMesh

MOST_PIECES = 24
ROUND = 1.10  # how far beyond the round a piece may reach and still be one
EQUAL = 0.10


@dataclass(frozen=True)
class Gprim:
    """A Cube, Cylinder (about y), Cone (about y), Sphere or Ellipsoid of `size` (m, along its own axes).

    axes: [3, 3], its x, y and z as columns, a rotation. center: m.
    """

    kind: str
    size: tuple[float, float, float]
    axes: Array
    center: tuple[float, float, float]


def fit(*meshes: PolygonMesh) -> list[Gprim]:
    """One for each connected piece of a mesh that does not lie in another's box; for the whole if there are many."""
    pieces = [piece for mesh in meshes for piece in _pieces(mesh)]
    if len(pieces) > MOST_PIECES:
        return [_fitted(np.concatenate(pieces), turned=False)]
    gprims = [_fitted(points) for points in pieces]
    return [
        gprim
        for i, (gprim, points) in enumerate(zip(gprims, pieces, strict=True))
        if not any(_holds(other, points) and i != j for j, other in enumerate(gprims))
    ]


def _holds(gprim: Gprim, points: Array) -> bool:
    """Whether the points lie in the gprim's box or stand out of it by little, and fill no more than half of it."""
    size = np.array(gprim.size)
    local = np.abs((points - np.array(gprim.center)) @ gprim.axes)
    smaller = np.ptp(points, axis=0).prod() < 0.5 * size.prod()
    return bool(smaller and (local.max(axis=0) < 0.53 * size + 0.002).all())


def _pieces(mesh: PolygonMesh) -> list[Array]:
    """The points of each connected piece."""
    piece_of = _labels(mesh)
    used = np.zeros(len(mesh.points), dtype=bool)
    used[mesh.indices] = True
    return [mesh.points[used & (piece_of == piece)] for piece in np.unique(piece_of[used])]


def _labels(mesh: PolygonMesh) -> Indices:
    """The connected piece that each point belongs to, by least labels; points at one place are one."""
    _, place = np.unique(np.round(mesh.points / 1e-5).astype(np.int64), axis=0, return_inverse=True)
    place = place.reshape(-1)
    starts = np.cumsum(mesh.counts) - mesh.counts
    corners = place[mesh.indices]
    first = corners[np.repeat(starts, mesh.counts)]
    label = np.arange(place.max() + 1)
    while True:
        least = np.minimum(label[corners], label[first])
        following = label.copy()
        np.minimum.at(following, corners, least)
        np.minimum.at(following, first, least)
        following = following[following]
        if (following == label).all():
            return np.unique(label[place], return_inverse=True)[1].reshape(-1).astype(np.int32)
        label = following


def _fitted(points: Array, turned: bool = True) -> Gprim:
    """In a box along the axes, or (turned) along the piece's own where that is much the smaller one."""
    axes = np.eye(3)
    size, middle, kind, axis = _boxed(points, axes)
    if turned:
        spread = points - points.mean(axis=0)
        own = _ordered(np.linalg.eigh(spread.T @ spread)[1])
        along = _boxed(points, own)
        gain = np.prod(along[0] + 1e-4) / np.prod(size + 1e-4)
        if gain < 0.85 or (gain < 1.02 and kind == "Cube" != along[2]):
            axes, (size, middle, kind, axis) = own, along
    if axis != 1:  # the round's axis becomes y
        order = [2, 0, 1] if axis == 0 else [1, 2, 0]
        axes, size, middle = axes[:, order], size[order], middle[order]
    return Gprim(kind, tuple(np.round(size, 5).tolist()), axes, tuple(np.round(axes @ middle, 5).tolist()))


def _boxed(points: Array, axes: Array) -> tuple[Array, Array, str, int]:
    """Size, middle, kind and its axis in a box along `axes`."""
    local = points @ axes
    low, high = local.min(axis=0), local.max(axis=0)
    size, middle = np.maximum(high - low, 1e-4), (low + high) / 2.0
    return (size, middle, *_kind((local - middle) / (size / 2.0), size))


def _ordered(vectors: Array) -> Array:
    """Axes as near as can be to x, y and z, so that they do not depend on how they were found."""
    rows = [int(np.argmax(np.abs(vectors[:, column]))) for column in range(3)]
    if sorted(rows) != [0, 1, 2]:
        return np.eye(3)
    axes = np.zeros((3, 3))
    for column, row in enumerate(rows):
        axes[:, row] = vectors[:, column] * np.sign(vectors[row, column])
    return axes if np.linalg.det(axes) > 0.0 else np.eye(3)


def _kind(q: Array, size: Array) -> tuple[str, int]:
    """The kind of points `q` in a box of -1..1, and its axis."""
    if np.linalg.norm(q, axis=1).max() < 1.12:
        return ("Sphere" if np.ptp(size) < EQUAL * size.max() else "Ellipsoid"), 1
    for axis in (1, 0, 2):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        if abs(size[a] - size[b]) > EQUAL * max(size[a], size[b]):
            continue
        reach = np.hypot(q[:, a], q[:, b])
        if reach.max() > ROUND:
            continue
        top, foot = reach[q[:, axis] > 0.9].max(initial=0.0), reach[q[:, axis] < -0.9].max(initial=0.0)
        return ("Cone" if top < 0.35 and foot > 0.8 and axis == 1 else "Cylinder"), axis
    return "Cube", 1
