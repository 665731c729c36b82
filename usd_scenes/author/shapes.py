# SPDX-License-Identifier: Apache-2.0
"""Basic shapes with rounded edges: boxes, surfaces of revolution, sweeps, moldings, curves and profiles.

Real objects have no perfectly sharp edges, and the highlights on their bevels make renderings look real.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid, merged, normalized, polygon


def rounded_box(
    size: Sequence[float],
    radius: float = 0.003,
    segments: int = 1,
    divisions: tuple[int, int, int] = (1, 1, 1),
    grain: int | None = None,
) -> PolygonMesh:
    """Build a box about the origin whose edges are quarter circles.

    Args:
        size: along x, y, z, m.
        radius: of the edges, m.
        segments: of each half edge, up to its 45 degree line.
        divisions: of the flat part along x, y, z, for later deformation.
        grain: axis that u follows where possible; None for the longest.
    """
    half = np.asarray(size, dtype=np.float64) / 2.0
    radius = min(radius, float(half.min()) * 0.999)
    inner = half - radius
    along = int(np.argmax(half)) if grain is None else grain
    arc = np.tan(np.linspace(np.pi / 4.0, 0.0, segments + 1)) * radius
    knots = [
        np.concatenate(
            [-(inner[a] + arc), np.linspace(-inner[a], inner[a], divisions[a] + 1)[1:-1], (inner[a] + arc)[::-1]]
        )
        for a in range(3)
    ]
    faces = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for sign in (1.0, -1.0):
            a, b = (first, second) if sign > 0.0 else (second, first)
            q = np.zeros((len(knots[b]), len(knots[a]), 3))
            q[..., axis] = sign * half[axis]
            q[..., a] = knots[a][None, :]
            q[..., b] = knots[b][:, None]
            core = np.clip(q, -inner, inner)
            normals = normalized(q - core)
            u, v = (b, a) if along == b else (a, b)
            mesh = grid(core + radius * normals, np.stack([q[..., u], q[..., v] * (1 if u == a else -1)], axis=-1))
            faces.append(PolygonMesh(mesh.points, normals.reshape(-1, 3), mesh.uv, mesh.counts, mesh.indices))
    return merged(faces)


def fillet(points: ArrayLike, radius: float | Sequence[float], segments: int = 3, closed: bool = False) -> Array:
    """Return a polyline in the plane with rounded corners.

    Args:
        points: [n, 2], m.
        radius: m, one for all corners or one for each.
        segments: of each round corner.
        closed: whether the last point is connected to the first.
    """
    corners = np.asarray(points, dtype=np.float64)
    radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), len(corners))
    result: list[Array] = []
    for index, corner in enumerate(corners):
        if (not closed and index in (0, len(corners) - 1)) or radii[index] <= 0.0:
            result.append(corner[None])
            continue
        back = corners[index - 1] - corner
        ahead = corners[(index + 1) % len(corners)] - corner
        back_length, ahead_length = np.linalg.norm(back), np.linalg.norm(ahead)
        back, ahead = back / back_length, ahead / ahead_length
        half = 0.5 * np.arccos(np.clip(back @ ahead, -1.0, 1.0))
        if half > np.pi / 2.0 - 0.01:
            result.append(corner[None])
            continue
        cut = min(radii[index] / np.tan(half), 0.49 * back_length, 0.49 * ahead_length)
        actual = cut * np.tan(half)
        center = corner + normalized(back + ahead) * actual / np.sin(half)
        start, end = corner + back * cut - center, corner + ahead * cut - center
        sweep = np.pi - 2.0 * half
        t = np.linspace(0.0, 1.0, segments + 1)[:, None]
        result.append(center + (np.sin((1.0 - t) * sweep) * start + np.sin(t * sweep) * end) / np.sin(sweep))
    return np.concatenate(result)


def lathe(profile: ArrayLike, segments: int = 48) -> PolygonMesh:
    """Build a surface of revolution about y from a profile of (radius, height) [n, 2], bottom to top on the outside."""
    outline = np.asarray(profile, dtype=np.float64)
    angle = np.linspace(0.0, 2.0 * np.pi, segments + 1)
    circle = np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    circle[-1] = circle[0]
    points = np.zeros((len(outline), segments + 1, 3))
    points[..., 0] = outline[:, :1] * circle[:, 0]
    points[..., 1] = outline[:, 1:]
    points[..., 2] = outline[:, :1] * circle[:, 1]
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))])
    girth = 2.0 * np.pi * outline[:, 0].max()
    uv = np.stack(np.broadcast_arrays(angle[None] / (2.0 * np.pi) * girth, lengths[:, None]), axis=-1)
    return grid(points, uv, closed=True)


def curve(points: ArrayLike, count: int = 24, closed: bool = False) -> Array:
    """Return a Catmull-Rom spline through points [n, d], at `count` places evenly in its parameter."""
    knots = np.asarray(points, dtype=np.float64)
    if closed:
        knots = np.concatenate([knots[-1:], knots, knots[:2]])
    else:
        knots = np.concatenate([2.0 * knots[:1] - knots[1:2], knots, 2.0 * knots[-1:] - knots[-2:-1]])
    spans = len(knots) - 3
    at = np.linspace(0.0, spans, count, endpoint=not closed)
    i = np.minimum(at.astype(int), spans - 1)
    t = (at - i)[:, None]
    p0, p1, p2, p3 = knots[i], knots[i + 1], knots[i + 2], knots[i + 3]
    cubic = (3.0 * (p1 - p2) + p3 - p0) * t**3 + (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3) * t**2
    return np.asarray(0.5 * (cubic + (p2 - p0) * t + 2.0 * p1))


def circle(radius: float, sides: int = 12) -> Array:
    """Return a closed section, counter-clockwise."""
    angle = np.arange(sides) * (2.0 * np.pi / sides)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def rectangle(width: float, height: float, radius: float = 0.003, segments: int = 2) -> Array:
    """Return a closed section with round corners, counter-clockwise."""
    x, y = width / 2.0, height / 2.0
    return fillet([[x, -y], [x, y], [-x, y], [-x, -y]], radius, segments, closed=True)


def sweep(
    path: ArrayLike,
    section: Array,
    scale: ArrayLike = 1.0,
    up: Sequence[float] = (0.0, 1.0, 0.0),
    closed: bool = False,
    bevel: float = 0.002,
) -> PolygonMesh:
    """Sweep a closed section along a path, with beveled ends.

    Args:
        path: [n, 3], m.
        section: closed polyline [m, 2], counter-clockwise, m; its second axis stays close to `up`.
        scale: scale of the section: one number, one for each path point, or [n, 2].
        up: direction that orients the section.
        closed: whether the path is closed.
        bevel: width of the bevel at open ends, m.
    """
    line = np.asarray(path, dtype=np.float64)
    section = section[::-1]
    scales = np.asarray(scale, dtype=np.float64)
    scales = np.broadcast_to(scales[:, None] if scales.ndim == 1 else scales, (len(line), 2)).copy()
    if closed:
        tangents = normalized(np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0))
    else:
        tangents = normalized(np.gradient(line, axis=0))
    if not closed and bevel > 0.0:
        reach = np.abs(section).max()
        inset = np.maximum(1.0 - bevel / (reach * scales[[0, -1]]), 0.3)
        start, end = line[:1] + tangents[:1] * bevel, line[-1:] - tangents[-1:] * bevel
        line = np.concatenate([line[:1], start, line[1:-1], end, line[-1:]])
        tangents = np.concatenate([tangents[:1], tangents, tangents[-1:]])
        scales = np.concatenate([scales[:1] * inset[:1], scales, scales[-1:] * inset[1:]])
    side = normalized(np.cross(tangents, np.asarray(up, dtype=np.float64)))
    lift = np.cross(side, tangents)
    ring = np.concatenate([section, section[:1]])
    x, y = ring[None, :, :1] * scales[:, None, :1], ring[None, :, 1:] * scales[:, None, 1:]
    points = line[:, None] + x * side[:, None] + y * lift[:, None]
    girth = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1))])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    if closed:
        points = np.concatenate([points, points[:1]])
        length = np.append(length, length[-1] + np.linalg.norm(line[0] - line[-1]))
    uv = np.stack(np.broadcast_arrays(length[:, None], girth[None]), axis=-1)
    parts = [grid(points, uv, closed=True)]
    if not closed:
        parts.append(polygon(points[0, -2::-1], -tangents[0], section[::-1]))
        parts.append(polygon(points[-1, :-1], tangents[-1], section))
    return merged(parts)


def leg(top: ArrayLike, foot: ArrayLike, section: Array, taper: float = 0.65) -> PolygonMesh:
    """Build a straight leg from `top` down to `foot`, where its section is scaled by `taper`."""
    return sweep(np.array([top, foot]), section, [1.0, taper], up=(0.0, 0.0, 1.0))


def four_legs(top: Sequence[float], foot: Sequence[float], section: Array, taper: float = 0.65) -> list[PolygonMesh]:
    """Build a leg from `top` to `foot` and its mirror images in x and z."""
    mirrors = [np.array([x, 1.0, z]) for x in (-1.0, 1.0) for z in (-1.0, 1.0)]
    return [leg(mirror * top, mirror * foot, section, taper) for mirror in mirrors]


def molding(
    path: ArrayLike, profile: ArrayLike, up: Sequence[float] = (0.0, 1.0, 0.0), closed: bool = False
) -> PolygonMesh:
    """Build a profile along straight runs with mitered corners, such as skirtings and frames; its ends are open.

    Args:
        path: [n, 3], m.
        profile: points (out, up), m; `out` is to the right of the path seen against `up`, the outside on the right.
        up: vertical direction.
        closed: whether the path is closed.
    """
    line = np.asarray(path, dtype=np.float64)
    outline = np.asarray(profile, dtype=np.float64)
    vertical = np.asarray(up, dtype=np.float64)
    count = len(line)
    runs = count if closed else count - 1
    directions = normalized(np.roll(line, -1, axis=0) - line)[:runs]
    outs = np.cross(directions, vertical)
    girth = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))])
    parts, traveled = [], 0.0
    for run in range(runs):
        ends = []
        for corner, neighbor in ((run, run - 1), ((run + 1) % count, run + 1)):
            has_neighbor = closed or 0 <= neighbor < runs
            out = outs[run]
            if has_neighbor:
                middle = normalized(outs[run] + outs[neighbor % runs])
                out = middle / (middle @ outs[run])
            ends.append(line[corner] + outline[:, :1] * out + outline[:, 1:] * vertical)
        points = np.stack(ends, axis=1)
        u = traveled + (points - line[run]) @ directions[run]
        traveled += float(np.linalg.norm(line[(run + 1) % count] - line[run]))
        uv = np.stack([u, np.broadcast_to(girth[:, None], u.shape)], axis=-1)
        parts.append(grid(points, uv))
    return merged(parts)


def molding_boxes(path: ArrayLike, width: float, low: float, high: float) -> list[PolygonMesh]:
    """Return boxes that approximate a molding along floor points (x, z): `width` to the right, from low to high, m."""
    line = np.asarray(path, dtype=np.float64)
    boxes = []
    for a, b in itertools.pairwise(line):
        (x, z), (dx, dz), length = (a + b) / 2.0, b - a, float(np.linalg.norm(b - a))
        box = rounded_box((length, high - low, width)).translated(0.0, (low + high) / 2.0, width / 2.0)
        boxes.append(box.rotated("y", float(np.degrees(np.arctan2(-dz, dx)))).translated(x, 0.0, z))
    return boxes


def cylinder(radius: float, height: float, bevel: float = 0.003, segments: int = 32) -> PolygonMesh:
    """Build an upright cylinder about the origin."""
    h = height / 2.0
    return lathe(fillet([[0.0, -h], [radius, -h], [radius, h], [0.0, h]], bevel, 3), segments)


def sphere(radius: float, segments: int = 48) -> PolygonMesh:
    """Build a sphere about the origin."""
    angle = np.linspace(-np.pi / 2.0, np.pi / 2.0, segments // 2 + 1)
    return lathe(np.stack([radius * np.cos(angle).clip(0.0), radius * np.sin(angle)], axis=-1), segments)
