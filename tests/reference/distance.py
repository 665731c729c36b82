# SPDX-License-Identifier: Apache-2.0
"""Distances between points and triangles in plain numpy, by another algorithm than the kernels'."""

from __future__ import annotations

import numpy as np


def point_triangle(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the distances [n, m] of points [n, 3] to triangles [m, 3, 3]."""
    p = np.asarray(points, np.float64)[:, None]
    a, b, c = np.moveaxis(np.asarray(triangles, np.float64), 1, 0)
    result = np.full((len(points), len(triangles)), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        t = np.clip(((p - start) * edge).sum(-1) / np.maximum((edge * edge).sum(-1), 1e-300), 0.0, 1.0)
        result = np.minimum(result, np.linalg.norm(p - (start + t[..., None] * edge), axis=-1))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=-1)
    normal = normal / np.maximum(length, 1e-300)[:, None]
    above = np.ones_like(result, dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        above &= (np.cross(end - start, p - start) * normal).sum(-1) >= 0.0
    height = np.abs(((p - a) * normal).sum(-1))
    return np.where(above & (length > 1e-14), np.minimum(height, result), result)


def sphere_gap(centers: np.ndarray, radii: np.ndarray, triangles: np.ndarray) -> float:
    """Return the smallest gap between any of the spheres and any of the triangles; negative where they overlap."""
    return float((point_triangle(centers, triangles).min(axis=1) - radii).min())
