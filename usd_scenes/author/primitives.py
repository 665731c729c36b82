# SPDX-License-Identifier: Apache-2.0
"""Approximation of meshes by boxes, cylinders, cones, spheres and ellipsoids, for the appearance "primitives".

Each connected piece of a mesh gets the gprim that fits it best in its tightest box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usd_scenes.author.polygon_mesh import Array, Indices, PolygonMesh

MAX_PIECES = 24  # a mesh of more pieces gets one gprim for the whole
MAX_ROUND_REACH = 1.10  # a piece may extend this far beyond a unit circle and still count as round
MAX_SIZE_DIFFERENCE = 0.10  # relative difference of two sizes that count as equal


@dataclass(frozen=True)
class Gprim:
    """A primitive.

    Attributes:
        kind: "Cube", "Cylinder" (about y), "Cone" (about y), "Sphere" or "Ellipsoid".
        size: along its own axes, m.
        axes: its x, y and z axes as columns of a rotation, [3, 3].
        center: m.
    """

    kind: str
    size: tuple[float, float, float]
    axes: Array
    center: tuple[float, float, float]


def fit(*meshes: PolygonMesh) -> list[Gprim]:
    """Return a gprim for each connected piece outside other gprims' boxes; one for all if there are many pieces."""
    pieces = [piece for mesh in meshes for piece in _pieces(mesh)]
    if len(pieces) > MAX_PIECES:
        return [_fit_piece(np.concatenate(pieces), may_rotate=False)]
    gprims = [_fit_piece(points) for points in pieces]
    return [
        gprim
        for i, (gprim, points) in enumerate(zip(gprims, pieces, strict=True))
        if not any(_contains(other, points) and i != j for j, other in enumerate(gprims))
    ]


def _contains(gprim: Gprim, points: Array) -> bool:
    """Return whether points lie almost within a gprim's box and fill at most half of it."""
    size = np.array(gprim.size)
    local = np.abs((points - np.array(gprim.center)) @ gprim.axes)
    smaller = np.ptp(points, axis=0).prod() < 0.5 * size.prod()
    return bool(smaller and (local.max(axis=0) < 0.53 * size + 0.002).all())


def _pieces(mesh: PolygonMesh) -> list[Array]:
    """Return the points of each connected piece."""
    piece_of = _labels(mesh)
    used = np.zeros(len(mesh.points), dtype=bool)
    used[mesh.indices] = True
    return [mesh.points[used & (piece_of == piece)] for piece in np.unique(piece_of[used])]


def _labels(mesh: PolygonMesh) -> Indices:
    """Return the connected component of each point by label propagation; coincident points are joined."""
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


def _fit_piece(points: Array, may_rotate: bool = True) -> Gprim:
    """Fit a gprim in a box along x, y, z, or, if allowed, along the principal axes where that is clearly smaller."""
    axes = np.eye(3)
    size, middle, kind, axis = _fit_box(points, axes)
    if may_rotate:
        spread = points - points.mean(axis=0)
        own = _sort_axes(np.linalg.eigh(spread.T @ spread)[1])
        along = _fit_box(points, own)
        gain = np.prod(along[0] + 1e-4) / np.prod(size + 1e-4)
        if gain < 0.85 or (gain < 1.02 and kind == "Cube" != along[2]):
            axes, (size, middle, kind, axis) = own, along
    if axis != 1:  # make the axis of revolution y
        order = [2, 0, 1] if axis == 0 else [1, 2, 0]
        axes, size, middle = axes[:, order], size[order], middle[order]
    return Gprim(kind, tuple(np.round(size, 5).tolist()), axes, tuple(np.round(axes @ middle, 5).tolist()))


def _fit_box(points: Array, axes: Array) -> tuple[Array, Array, str, int]:
    """Return size, middle, kind and main axis of a piece in a box along `axes`."""
    local = points @ axes
    low, high = local.min(axis=0), local.max(axis=0)
    size, middle = np.maximum(high - low, 1e-4), (low + high) / 2.0
    return (size, middle, *_kind((local - middle) / (size / 2.0), size))


def _sort_axes(vectors: Array) -> Array:
    """Return axes ordered and signed to be closest to x, y and z, independent of how they were computed."""
    rows = [int(np.argmax(np.abs(vectors[:, column]))) for column in range(3)]
    if sorted(rows) != [0, 1, 2]:
        return np.eye(3)
    axes = np.zeros((3, 3))
    for column, row in enumerate(rows):
        axes[:, row] = vectors[:, column] * np.sign(vectors[row, column])
    return axes if np.linalg.det(axes) > 0.0 else np.eye(3)


def _kind(q: Array, size: Array) -> tuple[str, int]:
    """Return the kind of points `q` in a box of -1..1, and its axis."""
    if np.linalg.norm(q, axis=1).max() < 1.12:
        return ("Sphere" if np.ptp(size) < MAX_SIZE_DIFFERENCE * size.max() else "Ellipsoid"), 1
    for axis in (1, 0, 2):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        if abs(size[a] - size[b]) > MAX_SIZE_DIFFERENCE * max(size[a], size[b]):
            continue
        reach = np.hypot(q[:, a], q[:, b])
        if reach.max() > MAX_ROUND_REACH:
            continue
        top, foot = reach[q[:, axis] > 0.9].max(initial=0.0), reach[q[:, axis] < -0.9].max(initial=0.0)
        return ("Cone" if top < 0.35 and foot > 0.8 and axis == 1 else "Cylinder"), axis
    return "Cube", 1
