"""The instances of a stage as obstacles: the tracer's own two-level tree, over what does not move."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.bvh import Bvh
from tiscene.scene.description import Instance, Mesh
from tiscene.scene.placement import CURRENT


class ObstacleTree:
    """A binary tree over placed meshes, with the arrays that `dynamics.Obstacles` reads.

    Instances that are squashed flat and meshes without any area are left out: rays do not meet them either.
    nodes, triangles: Taichi arrays, `scene.bvh_build.write_binary_nodes` and `write_triangles` describe them.
    rows: int64 [i], the instances of the tree as rows of what was given. matrices: float64 [i, 3, 4]. roots: int32 [i],
    the first node of each. root: where the tree begins.
    """

    def __init__(self, meshes: Sequence[Mesh], instances: Sequence[Instance]) -> None:
        """Needs Taichi to run."""
        bvh = Bvh("binary")
        roots, boxes, rows = [], [], []
        built = {}
        for row, instance in enumerate(instances):
            if instance.mesh not in built:
                mesh = meshes[instance.mesh]
                positions = np.ascontiguousarray(mesh.positions, np.float32)
                triangles = np.ascontiguousarray(mesh.triangles, np.int32)
                built[instance.mesh] = bvh.add_mesh(positions, triangles, 0)
            blas = built[instance.mesh]
            matrix = np.asarray(instance.world_from_object, np.float64)[:3]
            if blas.empty or abs(np.linalg.det(matrix[:, :3])) < 1e-18:
                continue
            centre = matrix[:, :3] @ blas.box.mean(axis=0) + matrix[:, 3]
            half = np.abs(matrix[:, :3]) @ (0.5 * (blas.box[1] - blas.box[0]))
            rows.append(row)
            roots.append(blas.root)
            boxes.append([*(centre - half), *(centre + half)])
        self.rows: NDArray[np.int64] = np.array(rows, np.int64)
        self.roots: NDArray[np.int32] = np.array(roots, np.int32)
        self.matrices = np.array([instances[row].world_from_object[:3] for row in rows], np.float64).reshape(-1, 3, 4)
        bvh.place(CURRENT, np.array(boxes).reshape(-1, 6), np.arange(len(rows), dtype=np.int32), max(1, len(rows)))
        self.root = bvh.root(CURRENT)
        self.nodes: Any = bvh.nodes
        self.triangles: Any = bvh.packs
