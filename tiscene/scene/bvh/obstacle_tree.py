# SPDX-License-Identifier: Apache-2.0
"""The instances of a stage as obstacles: a tree over what stands still, above the trees that rays walk."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tiscene.device import runtime
from tiscene.scene.bvh.bvh import Blas, Bvh
from tiscene.scene.bvh.workspace import BVH8
from tiscene.scene.description import Instance, Mesh


class MeshTrees:
    """The trees over a stage's meshes, by the meshes' rows. bvh: holds them. blas: one for each mesh."""

    def __init__(self, bvh: Bvh, blas: Sequence[Blas]) -> None:
        self.bvh = bvh
        self.blas = blas

    @property
    def is_bvh8(self) -> bool:
        """Whether the layout is "bvh8"; else "bvh2"."""
        return self.bvh.layout is BVH8

    @classmethod
    def built(cls, meshes: Sequence[Mesh], layout: str | None = None) -> MeshTrees:
        """Trees of their own, where nobody renders the meshes. layout: None: what suits the device. Taichi must run."""
        bvh = Bvh(layout or ("bvh2" if runtime.running() == "cuda" else "bvh8"))
        positions = [np.ascontiguousarray(mesh.positions, np.float32) for mesh in meshes]
        triangles = [np.ascontiguousarray(mesh.triangles, np.int32) for mesh in meshes]
        return cls(bvh, bvh.add_meshes(positions, triangles, 0))


class ObstacleTree:
    """A tree over placed meshes, with what `dynamics.obstacles.Obstacles.from_trees` asks for.

    Instances that are squashed flat, and meshes without any area, are left out: rays do not meet them either; so are
    those that the stage says nothing collides with.
    rows: int64 [i], the instances of the tree as rows of what was given. matrices: float64 [i, 3, 4]. roots: int32 [i],
    the first node of each. root: where the tree begins.
    """

    def __init__(self, trees: MeshTrees, instances: Sequence[Instance], there: Sequence[bool] | None = None) -> None:
        """there: which of the instances are in the way; None: all. The others keep their rows."""
        roots, boxes, rows = [], [], []
        for row, instance in enumerate(instances):
            blas = trees.blas[instance.mesh]
            matrix = np.asarray(instance.world_from_object, np.float64)[:3]
            if blas.empty or not instance.collides or abs(np.linalg.det(matrix[:, :3])) < 1e-18:
                continue
            center = matrix[:, :3] @ blas.box.mean(axis=0) + matrix[:, 3]
            half = np.abs(matrix[:, :3]) @ (0.5 * (blas.box[1] - blas.box[0]))
            rows.append(row)
            roots.append(blas.root)
            boxes.append([*(center - half), *(center + half)])
        self.rows: NDArray[np.int64] = np.array(rows, np.int64)
        self.roots: NDArray[np.int32] = np.array(roots, np.int32)
        self.matrices = np.array([instances[row].world_from_object[:3] for row in rows], np.float64).reshape(-1, 3, 4)
        solid = np.array([there is None or there[row] for row in rows], np.bool_)
        standing = np.flatnonzero(solid).astype(np.int32)
        self.root = trees.bvh.place_for_good(np.array(boxes).reshape(-1, 6)[standing], standing)
