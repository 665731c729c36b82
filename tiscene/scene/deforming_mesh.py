# SPDX-License-Identifier: Apache-2.0
"""A deforming mesh on the device: its vertices and its BLAS at the frames k-1, k and k+1."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.animation import Deformation, between
from tiscene.scene.bvh import refit_kernels
from tiscene.scene.bvh.blas import Blas
from tiscene.scene.bvh.build_kernels import MARGIN
from tiscene.scene.bvh.bvh import Bvh
from tiscene.scene.description import Mesh
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS

TIMES = (PREVIOUS, CURRENT, NEXT)
# The scene's vertex arrays hold the mesh once for each of these times, in consecutive blocks.
BLOCKS = (CURRENT, NEXT, PREVIOUS)


class DeformingMesh:
    """A mesh whose vertices change from frame to frame.

    Attributes:
        blas: Its trees, by time.
        boxes: float64 [3, 2, 3], its bounding box at each time, object space, m.
    """

    def __init__(self, mesh: Mesh, deformation: Deformation, blas: Sequence[Blas]) -> None:
        self.blas = blas
        self.boxes = np.zeros((3, 2, 3))
        self._count = len(mesh.positions)
        self._deformation = deformation
        # By time, the sample and the position behind it that vertices and trees represent.
        self._written: dict[int, tuple[int, float]] = {}
        self._refitted: dict[int, tuple[int, float]] = {}

    def invalidate(self) -> None:
        """Write everything at the next use, since the scene's arrays were replaced."""
        self._written.clear()
        self._refitted.clear()

    def move(self, seconds: NDArray[np.float64], first: int, vertex_position: Any, vertex_normal: Any) -> None:
        """Write the vertices of three times.

        Args:
            seconds: [3], the times, s.
            first: Row of the scene's vertex arrays where the mesh begins.
            vertex_position: The scene's array.
            vertex_normal: The scene's array.
        """
        for block, time in enumerate(BLOCKS):
            sample = between(self._deformation.times, seconds[time])
            if self._written.get(time) != sample:
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
                self._written[time] = sample

    def refit(self, time: int, bvh: Bvh, vertex_position: Any, triangle_vertices: Any) -> None:
        """Refit the tree of a time to the vertices that `move` wrote."""
        if self._refitted.get(time) != self._written[time]:
            bvh.refit(self.blas[time], vertex_position, triangle_vertices, BLOCKS.index(time) * self._count)
            self._refitted[time] = self._written[time]


def box_of(positions: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the lowest and highest corner [2, 3] of points, with a margin for rounding errors."""
    low, high = positions.min(axis=0).astype(np.float64), positions.max(axis=0).astype(np.float64)
    margin = max(MARGIN * float(np.abs([low, high]).max()), 1e-12)
    return np.stack([low - margin, high + margin])
