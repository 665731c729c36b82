# SPDX-License-Identifier: Apache-2.0
"""ImportedMesh: triangles of one material from a model file, at rest and over time; normals of files without them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiscene.usd.geometry.triangulate import cross
from tiscene.usd.geometry.vertex_weld import unique_rows
from tiscene.usd.importers.materials import ImportedMaterial

CREASE_ANGLE = np.radians(40.0)  # faces that meet at more get separate normals, if the file has none
MAPS_WITHOUT_COORDINATES = "textures whose coordinates the mesh lacks"  # not imported, which is said by this


@dataclass(frozen=True, eq=False)
class ShapeSamples:
    """A mesh over time.

    Attributes:
        times: float64 [s], s.
        points: float64 [s, n, 3].
        normals: float64 [s, m, 3, 3], of triangle corners.
    """

    times: NDArray[np.float64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ImportedMesh:
    """Triangles of one material, in the file's units and axes.

    Attributes:
        name: name of the material.
        points: float64 [n, 3].
        triangles: int64 [m, 3].
        normals: float64 [m, 3, 3], one for each triangle corner.
        uv: float64 [n, 2], or None.
        colors: float64 [n, 3], or [n, 4] with opacity, linear, or None.
        material: the material; colors take precedence where it reads no primvars of vertices.
        second_uv: float64 [n, 2], or None.
        samples: its shape over time; None: constant.
    """

    name: str
    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float64]
    uv: NDArray[np.float64] | None
    colors: NDArray[np.float64] | None
    material: ImportedMaterial
    second_uv: NDArray[np.float64] | None = None
    samples: ShapeSamples | None = None


def corner_normals(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return normals [m, 3, 3] of corners: area-weighted means over faces at the point within CREASE_ANGLE."""
    _, point = unique_rows([points.astype(np.float32)])
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    area = cross(b - a, c - a)
    facing = unit(area)
    corner_point = point[triangles.reshape(-1)]
    face = np.repeat(np.arange(len(triangles)), 3)
    order = np.argsort(corner_point, kind="stable")
    count = np.bincount(corner_point)
    start = np.cumsum(count) - count
    total = np.zeros((len(face), 3))
    for step in range(int(count.max(initial=0))):  # step k adds the k-th corner at the same point to each corner
        with_another = np.flatnonzero(count[corner_point] > step)
        other = face[order[start[corner_point[with_another]] + step]]
        near = np.einsum("ij,ij->i", facing[face[with_another]], facing[other]) > np.cos(CREASE_ANGLE)
        total[with_another[near]] += area[other[near]]
    flat = np.linalg.norm(total, axis=1) < 1e-300
    total[flat] = facing[face[flat]]
    return unit(total).reshape(-1, 3, 3)


def unit(vectors: NDArray[np.floating]) -> NDArray[np.float64]:
    """Normalize vectors over the last axis; zero vectors become +z."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(np.where(length > 0.0, vectors / np.maximum(length, 1e-300), (0.0, 0.0, 1.0)))
