# SPDX-License-Identifier: Apache-2.0
"""Plates cut from flat material and thin molded shells, with round edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from usd_scenes.author.polygon_mesh import Array, PolygonMesh, grid, merged, normalized, polygon


def plate(outline: ArrayLike, height: float, radius: float = 0.001, segments: int = 3) -> PolygonMesh:
    """Extrude a convex outline from y = 0 to `height`, with edges rounded by `radius`; uv is (x, -z) on the flat sides.

    Args:
        outline: [n, 2] of (x, z), m, counter-clockwise with x to the right and z up.
        height: m.
        radius: of the upper and lower edges, m.
        segments: of each edge.
    """
    line = np.asarray(outline, dtype=np.float64)
    edges = normalized(np.roll(line, -1, axis=0) - line)
    outs = np.stack([edges[:, 1], -edges[:, 0]], axis=-1)
    bisector = normalized(outs + np.roll(outs, 1, axis=0))
    mitre = bisector / np.maximum((bisector * outs).sum(axis=-1, keepdims=True), 0.3)
    radius = min(radius, height / 2.0)
    angle = np.linspace(0.0, np.pi / 2.0, segments + 1)
    inset = radius * (1.0 - np.sin(angle))
    level = radius * (1.0 - np.cos(angle))
    rings = [(i, y) for i, y in zip(inset, level, strict=True)]
    rings += [(i, height - y) for i, y in zip(inset[::-1], level[::-1], strict=True)]
    points = np.stack([np.insert(line - i * mitre, 1, y, axis=1) for i, y in rings])
    points = np.concatenate([points, points[:, :1]], axis=1)[:, ::-1]
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points[-1], axis=0), axis=1))])
    rise = np.array([y for _, y in rings])
    wall = grid(points, np.stack(np.broadcast_arrays(length[None], rise[:, None]), axis=-1), closed=True)
    flat = line - inset[0] * mitre
    top = polygon(np.insert(flat, 1, height, axis=1)[::-1], (0.0, 1.0, 0.0), (flat * (1.0, -1.0))[::-1])
    bottom = polygon(np.insert(flat, 1, 0.0, axis=1), (0.0, -1.0, 0.0), flat)
    return merged([wall, top, bottom])


def unit_uv(
    mesh: PolygonMesh, low: Sequence[float], high: Sequence[float], axes: tuple[int, int] = (0, 2)
) -> PolygonMesh:
    """Return the mesh with uv projected along two axes: 0..1 from the corner `low` to `high` (each [2], m)."""
    q = (mesh.points[:, list(axes)] - np.asarray(low)) / (np.asarray(high) - np.asarray(low))
    return replace(mesh, uv=q)


def shell(points: Array, uv: Array, thickness: float) -> PolygonMesh:
    """Build a solid sheet with a round rim; its front is `grid` over points [rows, columns, 3]."""
    front = grid(points, uv)
    normals = front.normals.reshape(points.shape)
    behind = points - thickness * normals
    back = grid(behind, uv).reversed()

    def border(array: Array) -> Array:
        return np.concatenate([array[0, :-1], array[:-1, -1], array[-1, :0:-1], array[:0:-1, 0]])

    edge, up = border(points), border(normals)
    along = normalized(np.roll(edge, -1, axis=0) - np.roll(edge, 1, axis=0))
    out = normalized(np.cross(along, up))
    turns = np.linspace(0.0, np.pi, 6)
    rings = [
        edge - up * thickness / 2.0 * (1.0 - np.cos(turn)) + out * thickness / 2.0 * np.sin(turn) for turn in turns
    ]
    rim = np.stack([np.concatenate([ring, ring[:1]]) for ring in rings[::-1]])
    return merged([front, back, grid(rim, rim[..., :2], closed=True)])
