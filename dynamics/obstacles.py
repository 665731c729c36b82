# SPDX-License-Identifier: Apache-2.0
"""Obstacles: static triangles in a two-level bounding volume hierarchy, which collision queries traverse.

The hierarchy is built elsewhere; tiscene shares that of its ray tracer. `Trees` states the layouts it may have.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from dynamics.errors import ArgumentError

# Columns of `Obstacles.instances`: the matrix, its inverse, meters per unit along each own axis, and a factor.
MATRIX, INVERSE, METERS_PER_UNIT, GAP_FACTOR, INSTANCE_COLUMNS = 0, 12, 24, 27, 28


class Trees(Protocol):
    """Bounding volume hierarchies over meshes and over their instances, in Taichi arrays that may be reallocated.

    bvh2:
        nodes: f32 [n, 16], the boxes of two children (lower x, y, z, upper x, y, z) and, in columns 12 and 13, their
            references as bits of int32: the row of a node, or -1 - (4 * first + count - 1) for a leaf. `first` is a row
            of `leaf_blocks`, or in the upper tree the row of an instance.
        leaf_blocks: f32 [m, 12], vertices in columns 0, 4 and 8, in the mesh's own space; other columns are unused.
    bvh8:
        nodes: vec8 [8 n], eight rows per node: lower x, y, z, upper x, y, z, references, unused; a lane per child. A
            reference is the first row of a node, or -1 - row for a leaf, a row of `leaf_blocks` or in the upper tree of
            an instance.
        leaf_blocks: vec4 [10 m], nine rows with the coordinates of vertices 0, 1 and 2, then bits of int32, negative in
            lanes without a triangle.

    No query hits the box of a missing child.
    """

    @property
    def nodes(self) -> Any: ...

    @property
    def leaf_blocks(self) -> Any: ...


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Static instances of meshes in a two-level hierarchy.

    Attributes:
        trees: The hierarchy.
        is_bvh8: Whether its layout is bvh8; otherwise bvh2.
        instances: f32 [i, INSTANCE_COLUMNS], see `instance_rows`.
        roots: i32 [i], reference of the first node of each instance's mesh.
        root: Reference of the first node of the upper tree.
    """

    trees: Trees
    is_bvh8: bool
    instances: Any
    roots: Any
    root: int

    def arguments(self) -> tuple[Any, ...]:
        """Return the arguments of kernels, in their order."""
        return self.is_bvh8, self.trees.nodes, self.trees.leaf_blocks, self.instances, self.roots, self.root

    @classmethod
    def empty(cls, is_bvh8: bool | None = None) -> Obstacles:
        """Return no obstacles. Taichi must be running.

        Args:
            is_bvh8: Whether the layout is bvh8. None: that of tiscene's scenes, so that kernels are compiled once.
        """
        if is_bvh8 is None:
            is_bvh8 = ti.cfg.arch != ti.cuda
        if is_bvh8:
            nodes, leaf_blocks = ti.Vector.ndarray(8, ti.f32, 8), ti.Vector.ndarray(4, ti.f32, 10)
            boxes = np.concatenate([np.full((6, 8), np.inf), np.zeros((2, 8))])
        else:
            nodes, leaf_blocks = ti.ndarray(ti.f32, (1, 16)), ti.ndarray(ti.f32, (1, 12))
            boxes = np.concatenate([np.full((1, 12), np.inf), np.zeros((1, 4))], axis=1)
        nodes.from_numpy(boxes.astype(np.float32))
        roots, instances = ti.ndarray(ti.i32, 1), ti.ndarray(ti.f32, (1, INSTANCE_COLUMNS))
        for array in (leaf_blocks, roots, instances):
            array.fill(0)
        return cls(_EmptyTrees(nodes, leaf_blocks), is_bvh8, instances, roots, 0)

    @classmethod
    def from_trees(
        cls, trees: Trees, is_bvh8: bool, roots: NDArray[np.int32], matrices: NDArray[np.float64], root: int
    ) -> Obstacles:
        """Return obstacles over an existing hierarchy. Taichi must be running.

        Args:
            trees: The hierarchy.
            is_bvh8: Whether its layout is bvh8; otherwise bvh2.
            roots: [i], reference of the first node of each instance's mesh; without any, there are no obstacles.
            matrices: [i, 3, 4], world from instance.
            root: Reference of the first node of the upper tree.
        """
        if not len(roots):
            return cls.empty(is_bvh8)
        instances = ti.ndarray(ti.f32, (len(roots), INSTANCE_COLUMNS))
        instances.from_numpy(instance_rows(matrices))
        mesh_roots = ti.ndarray(ti.i32, len(roots))
        mesh_roots.from_numpy(np.ascontiguousarray(roots, dtype=np.int32))
        return cls(trees, is_bvh8, instances, mesh_roots, root)


def instance_rows(world_from_instance: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the rows of `Obstacles.instances` for matrices [i, 3, 4].

    A row holds the matrix, its inverse, and the figures of a bound: a point that lies outside a box of the instance's
    space by gap_a along each axis a is at least sqrt(factor * sum((gap_a * meters_per_unit_a)^2)) meters from the box.
    The factor is 1 where the axes stay perpendicular in the world, else 1/3.

    Raises:
        ArgumentError: For a singular matrix.
    """
    count = len(world_from_instance)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3] = world_from_instance
    rows = np.zeros((count, INSTANCE_COLUMNS), dtype=np.float32)
    try:
        inverse = np.linalg.inv(matrices)[:, :3]
    except np.linalg.LinAlgError as error:
        row = int(np.abs(np.linalg.det(matrices)).argmin())
        raise ArgumentError(f"world_from_instance[{row}]: must be invertible") from error
    lengths = np.linalg.norm(inverse[:, :, :3], axis=2)
    unit = inverse[:, :, :3] / lengths[:, :, None]
    perpendicular = np.abs(unit @ unit.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0) < 1e-6
    rows[:, MATRIX:INVERSE] = matrices[:, :3].reshape(count, 12)
    rows[:, INVERSE:METERS_PER_UNIT] = inverse.reshape(count, 12)
    # Slightly smaller than exact, so that rounding cannot cull a box.
    rows[:, METERS_PER_UNIT:GAP_FACTOR] = (1.0 - 1e-5) / lengths
    rows[:, GAP_FACTOR] = np.where(perpendicular, 1.0, 1.0 / 3.0)
    return rows


@dataclass(frozen=True, eq=False)
class _EmptyTrees:
    nodes: Any
    leaf_blocks: Any
