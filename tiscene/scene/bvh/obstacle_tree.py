# SPDX-License-Identifier: Apache-2.0
"""Instances of a stage as obstacles of a simulation: a tree over them, above the same mesh trees that rays traverse."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tiscene.device import runtime
from tiscene.scene.affine_maps import inverted, transformed_boxes
from tiscene.scene.bvh.blas import Blas, TreeRoom
from tiscene.scene.bvh.bvh import Bvh
from tiscene.scene.bvh.bvh_copy import BvhCopy
from tiscene.scene.bvh.workspace import BVH8
from tiscene.scene.description import Instance, Mesh
from tiscene.scene.reused_arrays import ReusedArrays
from tiscene.scene.transient_meshes import resident_arrays


class MeshTrees:
    """The trees of a stage's meshes.

    Attributes:
        bvh: Holds their nodes and triangles.
        blas: The tree of each mesh, by row.
        arrays: Arrays of a scene that began with the stage and has ended; None: there are none.
    """

    def __init__(self, bvh: Bvh, blas: Sequence[Blas]) -> None:
        self.bvh = bvh
        self.blas = blas
        self.arrays: ReusedArrays | None = None

    def take_arrays(self) -> ReusedArrays | None:
        """Return `arrays`, which nobody else gets."""
        arrays, self.arrays = self.arrays, None
        return arrays

    def keep_arrays(self, arrays: ReusedArrays) -> None:
        """Keep the arrays of a scene that has ended as `arrays`."""
        self.arrays = arrays

    def drop_arrays(self) -> None:
        """Free everything but the trees."""
        self.arrays = None
        if isinstance(self.bvh, BvhCopy):
            self.bvh.spare = None

    @property
    def nbytes(self) -> int:
        """The memory that is kept on the device, bytes."""
        return self.bvh.nbytes + (self.arrays.nbytes if self.arrays else 0)

    @property
    def is_bvh8(self) -> bool:
        """Whether the layout is "bvh8"; else "bvh2"."""
        return self.bvh.layout is BVH8

    @classmethod
    def built(cls, meshes: Sequence[Mesh], layout: str | None = None) -> MeshTrees:
        """Build trees of meshes that are not rendered. Taichi must run.

        Args:
            meshes: The meshes.
            layout: "bvh8" or "bvh2". None: the layout for the device.
        """
        bvh = Bvh(layout or ("bvh2" if runtime.running() == "cuda" else "bvh8"))
        return cls(bvh, bvh.add_meshes(*resident_arrays(meshes), 0))


class ObstacleTree:
    """A tree over placed meshes, with the arrays that `dynamics.obstacles.Obstacles.from_trees` needs.

    Instances with a singular transform and meshes without area are left out, as rays cannot hit them; so are instances
    that the stage excludes from collisions.

    Args:
        trees: Trees of the meshes.
        instances: The instances.
        present: Whether each instance is in the tree. None: all are. Absent instances keep their rows.
        room: Where to write the tree, in place of another one. None: behind all others.

    Attributes:
        rows: int64 [i], the instances of the tree, as rows of `instances`.
        matrices: float64 [i, 3, 4], m.
        roots: int32 [i], reference of the first node of each.
        root: Reference of the tree's first node.
    """

    def __init__(
        self,
        trees: MeshTrees,
        instances: Sequence[Instance],
        present: Sequence[bool] | None = None,
        room: TreeRoom | None = None,
    ) -> None:
        blas = [trees.blas[each.mesh] for each in instances]
        solid = np.array([each.collides and not tree.empty for each, tree in zip(instances, blas, strict=True)], bool)
        matrices = np.array([each.world_from_object[:3] for each in instances], np.float64).reshape(-1, 3, 4)
        self.rows: NDArray[np.int64] = np.flatnonzero(solid & (np.abs(inverted(matrices)[1]) >= 1e-18))
        self.roots: NDArray[np.int32] = np.array([blas[row].root for row in self.rows], np.int32)
        self.matrices = matrices[self.rows]
        own = np.array([blas[row].box for row in self.rows]).reshape(-1, 2, 3)
        boxes = transformed_boxes(own[None], self.matrices[None])[0]
        included = np.array([present is None or present[row] for row in self.rows.tolist()], np.bool_)
        chosen = np.flatnonzero(included).astype(np.int32)
        self.root = trees.bvh.add_static_instances(boxes[chosen], chosen, room)
