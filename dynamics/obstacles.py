# SPDX-License-Identifier: Apache-2.0
"""Obstacles: triangles that do not move, as a two-level tree of bounding boxes that collisions are looked up in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from dynamics.errors import ArgumentError

# Columns of `Obstacles.instances`: the matrix, then how many meters a unit along each own axis is, then a factor.
MATRIX, METERS_PER_UNIT, GAP_FACTOR, INSTANCE_COLUMNS = 0, 24, 27, 28


class Trees(Protocol):
    """Trees over meshes, and over where they are placed, in Taichi arrays. They may be replaced by larger ones.

    bvh2: nodes f32 [n, 16], the boxes of two children (least x, y, z, greatest x, y, z) and, in columns 12 and 13,
    their references as bits of int32: a node, or -1 - (4 * first + count - 1) of a leaf, where `first` is a row of
    `leaf_blocks`, or above the meshes the row of an instance. leaf_blocks f32 [m, 12]: vertex 0, any number, vertex 1,
    any, vertex 2, any, in the mesh's own space.
    bvh8: nodes vec8 [8 n], rows of a node are least x, y, z, greatest x, y, z, references, any, with a lane for each
    child. A reference is the first row of a node, or -1 - row of a leaf, of `leaf_blocks` or above the meshes of an
    instance. leaf_blocks vec4 [10 m]: nine rows of vertices 0, 1 and 2, then bits of int32, negative in a lane without
    any.
    The box of a child that does not exist is met by nothing.
    """

    @property
    def nodes(self) -> Any: ...

    @property
    def leaf_blocks(self) -> Any: ...


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Instances of meshes in one tree of two levels.

    trees: where it is. is_bvh8: its layout. root: the reference of the first node above the instances.
    instances: f32 [i, INSTANCE_COLUMNS], see `instance_rows`. roots: i32 [i], reference of the first node of each
    instance's mesh.
    """

    trees: Trees
    is_bvh8: bool
    instances: Any
    roots: Any
    root: int

    def arguments(self) -> tuple[Any, ...]:
        """What kernels are given."""
        return self.is_bvh8, self.trees.nodes, self.trees.leaf_blocks, self.instances, self.roots, self.root


def instance_rows(world_from_instance: NDArray[np.float64]) -> NDArray[np.float32]:
    """What collisions need to know of matrices [i, 3, 4]: both directions of the map, and how it stretches.

    A box [c - h, c + h] in the instance's space is at least sqrt(factor * sum((gap_a * meters_a)^2)) meters from a
    point that is gap_a outside of it along axis a: the axes stay perpendicular (factor 1) or they do not (1/3).
    Raises ValueError for a matrix that cannot be inverted.
    """
    count = len(world_from_instance)
    rows = np.zeros((count, INSTANCE_COLUMNS), dtype=np.float32)
    for row, matrix in enumerate(np.asarray(world_from_instance, dtype=np.float64)):
        try:
            inverse = np.linalg.inv(np.vstack([matrix, [0.0, 0.0, 0.0, 1.0]]))[:3]
        except np.linalg.LinAlgError as error:
            raise ArgumentError(f"world_from_instance[{row}] cannot be inverted") from error
        lengths = np.linalg.norm(inverse[:, :3], axis=1)
        unit = inverse[:, :3] / lengths[:, None]
        perpendicular = np.abs(unit @ unit.T - np.eye(3)).max() < 1e-6
        rows[row, :12] = matrix.ravel()
        rows[row, 12:24] = inverse.ravel()
        # A little less than the truth, so that rounding cannot hide a box.
        rows[row, METERS_PER_UNIT:GAP_FACTOR] = (1.0 - 1e-5) / lengths
        rows[row, GAP_FACTOR] = 1.0 if perpendicular else 1.0 / 3.0
    return rows


@dataclass(frozen=True, eq=False)
class _Arrays:
    nodes: Any
    leaf_blocks: Any


def nothing() -> Obstacles:
    """No obstacle at all. Taichi must run."""
    nodes = ti.ndarray(ti.f32, (1, 16))
    nodes.from_numpy(np.concatenate([np.full(12, np.inf), np.zeros(4)]).astype(np.float32)[None])
    roots = ti.ndarray(ti.i32, 1)
    roots.fill(0)
    leaf_blocks, instances = ti.ndarray(ti.f32, (1, 12)), ti.ndarray(ti.f32, (1, INSTANCE_COLUMNS))
    leaf_blocks.fill(0.0)
    instances.fill(0.0)
    return Obstacles(_Arrays(nodes, leaf_blocks), False, instances, roots, 0)


def placed(
    trees: Trees, is_bvh8: bool, roots: NDArray[np.int32], matrices: NDArray[np.float64], root: int
) -> Obstacles:
    """Obstacles from trees that exist: of their instances the first nodes [i] and matrices [i, 3, 4].

    Without any instance there is nothing in the way.
    """
    if not len(roots):
        return nothing()
    instances = ti.ndarray(ti.f32, (len(roots), INSTANCE_COLUMNS))
    instances.from_numpy(instance_rows(matrices))
    firsts = ti.ndarray(ti.i32, len(roots))
    firsts.from_numpy(np.ascontiguousarray(roots, dtype=np.int32))
    return Obstacles(trees, is_bvh8, instances, firsts, root)
