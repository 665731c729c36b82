# SPDX-License-Identifier: Apache-2.0
"""Brute-force ray casting: every ray against every triangle, in float64."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import Mesh
from tiscene.scene.placement import CURRENT, Placement


class Hits(NamedTuple):
    """Closest hits of rays.

    Attributes:
        t: [n], distance; inf without a hit.
        instance: [n], row; -1 without a hit.
        triangle: [n], row among the triangles of all meshes; -1 without a hit.
    """

    t: NDArray[np.float64]
    instance: NDArray[np.int64]
    triangle: NDArray[np.int64]


def cast(meshes: tuple[Mesh, ...], placement: Placement, rays: NDArray[np.float32], time: int = CURRENT) -> Hits:
    """Return the closest hits of rays [n, 8] (the kernels' format) on meshes as they are placed at `time`."""
    first = np.cumsum([0] + [len(mesh.triangles) for mesh in meshes])
    best = Hits(np.full(len(rays), np.inf), np.full(len(rays), -1), np.full(len(rays), -1))
    for instance in np.flatnonzero(placement.present[time]):
        row = placement.mesh[instance]
        matrix = placement.world_from_object[time, instance]
        corners = (meshes[row].positions.astype(np.float64) @ matrix[:, :3].T + matrix[:, 3])[meshes[row].triangles]
        for triangle, (a, b, c) in enumerate(corners):
            t = distance(a, b, c, rays)
            closer = t < best.t  # of equal distances the first counts
            best.t[closer] = t[closer]
            best.instance[closer] = instance
            best.triangle[closer] = first[row] + triangle
    return best


def distance(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], rays: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return the distances at which rays hit one triangle, inf where they miss."""
    origin, direction, t_max = rays[:, :3].astype(np.float64), rays[:, 4:7].astype(np.float64), rays[:, 7]
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((a - origin) @ normal) / (direction @ normal)
        point = origin + t[:, None] * direction
    inside = np.isfinite(t) & (t > 0.0) & (t < t_max)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= np.cross(end - start, np.where(inside[:, None], point, 0.0) - start) @ normal >= 0.0
    return np.where(inside, t, np.inf)
