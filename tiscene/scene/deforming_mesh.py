# SPDX-License-Identifier: Apache-2.0
"""A mesh that deforms, on the device: its vertices and its tree at the frames before, at and after the present one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.animation import Deformation, between
from tiscene.scene.bvh import refit_kernels
from tiscene.scene.bvh.bvh import Blas, Bvh
from tiscene.scene.description import Mesh
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS

TIMES = (PREVIOUS, CURRENT, NEXT)
# Its vertices stand in the scene's rows once for each of these times, one block behind the other.
BLOCKS = (CURRENT, NEXT, PREVIOUS)


class DeformingMesh:
    """blas: its trees, by time. boxes: [3, 2, 3], around it at each time, m."""

    def __init__(self, mesh: Mesh, deformation: Deformation, blas: Sequence[Blas]) -> None:
        self.blas = blas
        self.boxes = np.zeros((3, 2, 3))
        self._count = len(mesh.positions)
        self._deformation = deformation
        self._shown: dict[int, tuple[int, float]] = {}  # by time: the sample, and how far beyond it
        self._fitted: dict[int, tuple[int, float]] = {}

    def forget(self) -> None:
        """The scene's rows have been written anew."""
        self._shown.clear()
        self._fitted.clear()

    def move(self, seconds: NDArray[np.float64], first: int, vertex_position: Any, vertex_normal: Any) -> None:
        """Write the vertices of three times to the scene's rows from `first` on."""
        for block, time in enumerate(BLOCKS):
            wanted = between(self._deformation.times, seconds[time])
            if self._shown.get(time) != wanted:
                positions, normals = self._deformation.at(seconds[time])
                refit_kernels.write_vertices(
                    np.ascontiguousarray(positions, np.float32),
                    np.ascontiguousarray(positions if normals is None else normals, np.float32),
                    int(normals is not None),
                    first + block * self._count,
                    vertex_position,
                    vertex_normal,
                )
                self.boxes[time] = box_of(positions)
                self._shown[time] = wanted

    def refit(self, time: int, bvh: Bvh, vertex_position: Any, triangle_vertices: Any) -> None:
        """Fit the tree of a time to the vertices that were written last."""
        if self._fitted.get(time) != self._shown[time]:
            bvh.refit(self.blas[time], vertex_position, triangle_vertices, BLOCKS.index(time) * self._count)
            self._fitted[time] = self._shown[time]


def box_of(positions: NDArray[np.float32]) -> NDArray[np.float64]:
    """Least and greatest corner [2, 3] around points, and as much more as rounding takes."""
    low, high = positions.min(axis=0).astype(np.float64), positions.max(axis=0).astype(np.float64)
    margin = max(4e-7 * float(np.abs([low, high]).max()), 1e-12)
    return np.stack([low - margin, high + margin])
