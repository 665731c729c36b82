# SPDX-License-Identifier: Apache-2.0
"""Two-level bounding volume hierarchy: one tree for each mesh (BLAS), one over the instances for each time (TLAS).

All trees share one array of nodes, so that a ray goes from a TLAS into a BLAS without changing arrays. Two layouts:
"bvh8", 8 children a node and leaf blocks of 4 triangles, for the vector units of a CPU; "bvh2", for a GPU.
Building is deterministic: the same input gives the same bytes, for any number of threads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.kernel_types import float4, float8
from tiscene.errors import ArgumentError
from tiscene.scene.bvh import layout_kernels, refit_kernels
from tiscene.scene.bvh.rebraid import SplitInstances, parts_of
from tiscene.scene.bvh.workspace import BVH8, KEPT_WORKSPACE, LAYOUTS, Boxes, Workspace

TREES = 4  # over instances: one for each time, one over the movers
EMPTY_NODE = 0  # a node without children: the root of an empty mesh and of an empty TLAS
LEAF_SIZE = 4
SAH_DEPTHS = (40, 20, 10, 0)  # a tree that is too deep for the stack is built again, halving ranges from higher up on
SIDE_BY_SIDE = 1 << 16  # triangles of small meshes that are built at once


@dataclass(frozen=True)
class Blas:
    """A mesh in the hierarchy.

    root: reference of its first node. entry: where rays enter it, which is a leaf where there is but one pack.
    box: least and greatest corner, [2, 3], m. nodes, leaf_blocks: the rows that are its own, for a refit.
    """

    root: int
    entry: int
    box: NDArray[np.float64]
    nodes: range = range(0)
    leaf_blocks: range = range(0)

    @property
    def empty(self) -> bool:
        """No triangle of the mesh can be hit."""
        return self.root == EMPTY_NODE


class Bvh:
    """The nodes and packed triangles on the device, and the roots of the trees in them.

    nodes, leaf_blocks: Taichi arrays whose rows bvh_write.py describes. They are replaced when they grow.
    """

    def __init__(self, layout: str) -> None:
        if layout not in LAYOUTS:
            raise ArgumentError(f"traversal={layout!r}: must be one of {', '.join(LAYOUTS)}")
        self.layout = LAYOUTS[layout]
        self._work = Workspace()
        self._used_nodes = 0
        self._used_leaf_blocks = 0
        self._instance_capacity = 0
        self._roots: dict[int, int] = {}
        self._kept: dict[int, tuple[NDArray[np.float64], NDArray[np.int32]]] = {}  # by root, what the tree is over
        self._used_nodes = 2  # the empty one and the guard, which is empty too
        self.nodes = self._new_nodes(self._used_nodes)
        self.leaf_blocks = self._new_leaf_blocks(1)
        self._write_nodes(self._used_nodes, EMPTY_NODE, 0, layout_kernels.NAME)
        if self.layout is BVH8:
            layout_kernels.write_guard(self.nodes)

    def root(self, time: int) -> int:
        """The reference where rays enter the instances at PREVIOUS, CURRENT or NEXT, or the MOVERS."""
        if time not in self._roots:
            raise ArgumentError(f"time={time}: no instances are placed there; name it in place(..., times=...)")
        return self._roots[time]

    def add_mesh(
        self, positions: Boxes, triangles: NDArray[np.int32], first_triangle: int, *, deforms: bool = False
    ) -> Blas:
        """Build the tree of a mesh whose triangles are rows `first_triangle` and on of the scene.

        Triangles with two corners at one point are left out, unless the mesh deforms. Thin ones stay: without them
        their neighbors would gape.
        """
        return self._add([positions], [triangles], first_triangle, deforms)[0]

    def add_meshes(
        self, positions: Sequence[Boxes], triangles: Sequence[NDArray[np.int32]], first_triangle: int
    ) -> list[Blas]:
        """The same of many meshes, one after another; small ones are built side by side."""
        result: list[Blas] = []
        begin = 0
        while begin < len(triangles):
            end, size = begin + 1, len(triangles[begin])
            while end < len(triangles) and size + len(triangles[end]) <= SIDE_BY_SIDE:
                size += len(triangles[end])
                end += 1
            result += self._add(positions[begin:end], triangles[begin:end], first_triangle)
            first_triangle += size
            begin = end
        return result

    def _add(
        self,
        positions: Sequence[Boxes],
        triangles: Sequence[NDArray[np.int32]],
        first_triangle: int,
        deforms: bool = False,
    ) -> list[Blas]:
        points = np.concatenate(positions)
        sizes = np.array([len(each) for each in triangles])
        begin = np.cumsum([0, *(len(each) for each in positions)])
        faces = np.concatenate([each + first for each, first in zip(triangles, begin, strict=False)]).astype(np.int32)
        corners = [points[faces[:, k]] for k in range(3)]
        apart = [(corners[k] != corners[k - 1]).any(axis=1) for k in range(3)]
        solid = np.flatnonzero(apart[0] & apart[1] & apart[2] | deforms).astype(np.int32)
        result = [Blas(EMPTY_NODE, EMPTY_NODE, np.zeros((2, 3)))] * len(sizes)
        if not len(solid):
            return result
        a, b, c = (corner[solid] for corner in corners)
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        boxes = _widened(np.concatenate([low, high], axis=1))
        owner = np.repeat(np.arange(len(sizes)), sizes)[solid]
        counts = np.bincount(owner, minlength=len(sizes))
        meshes = np.flatnonzero(counts)
        ends = np.cumsum(counts[meshes])
        starts = ends - counts[meshes]
        kind = self.layout.leaf_kind
        found = self._build(boxes, solid, starts, LEAF_SIZE, self.layout.block, kind)
        if found is None:  # too deep for the stack, one of them
            if len(sizes) == 1:
                raise self._too_many(len(solid), "triangles in one mesh")
            firsts = (first_triangle + np.cumsum(sizes) - sizes).tolist()
            return [self.add_mesh(*each) for each in zip(positions, triangles, firsts, strict=True)]
        nodes, leaf_blocks = int(found[-1, 0]), int(found[-1, 1]) if kind == layout_kernels.LEAF_BLOCK else len(solid)
        self._reserve(nodes, leaf_blocks)
        first, first_block = self._used_nodes, self._used_leaf_blocks
        self._write_nodes(nodes, first, first_block, kind)
        source = points, faces, self._work.order
        target = self.leaf_blocks, first_block, first_triangle
        if self.layout is BVH8:
            layout_kernels.write_leaf_blocks(*source, self._work.node_link, self._work.children, nodes, *target)
        else:
            layout_kernels.write_triangles(*source, leaf_blocks, *target)
        self._used_nodes += nodes
        self._used_leaf_blocks += leaf_blocks
        if self._work.capacity > KEPT_WORKSPACE:
            self._work = Workspace()
        node_ends = first + found[:, 0]
        block_ends = first_block + (found[:, 1] if kind == layout_kernels.LEAF_BLOCK else ends)
        rows = np.stack([[first, *node_ends[:-1]], node_ends, [first_block, *block_ends[:-1]], block_ends], axis=1)
        around = np.minimum.reduceat(boxes[:, :3], starts), np.maximum.reduceat(boxes[:, 3:], starts)
        for mesh, row, box in zip(meshes.tolist(), rows.tolist(), np.stack(around, axis=1), strict=True):
            root = row[0] * self.layout.unit
            entry = -1 - 10 * row[2] if self.layout is BVH8 and row[3] - row[2] == 1 else root
            result[mesh] = Blas(root, entry, box.astype(np.float64), range(row[0], row[1]), range(row[2], row[3]))
        return result

    def parts(self, meshes: Sequence[Blas]) -> SplitInstances:
        """The children of the meshes' roots; none of a mesh of one pack, and none in the binary layout."""
        if self.layout is not BVH8:
            return parts_of(np.zeros((len(meshes), 8, 8), np.float32))
        roots = np.array([blas.root if blas.entry == blas.root else EMPTY_NODE for blas in meshes], np.int64)
        return parts_of(self.nodes.to_numpy().reshape(-1, 8, 8)[roots // self.layout.unit])

    def refit(self, blas: Blas, vertex_position: Any, triangle_vertices: Any, moved: int) -> None:
        """Fit the tree of a mesh that deforms to where its vertices are now.

        vertex_position, triangle_vertices: as a DeviceScene has them. moved: how many rows behind the one that
        `triangle_vertices` names a vertex is read.
        """
        nodes, leaf_blocks = blas.nodes, blas.leaf_blocks
        source = vertex_position, triangle_vertices, moved
        if self.layout is BVH8:
            refit_kernels.refit_leaf_blocks(self.leaf_blocks, leaf_blocks.start, len(leaf_blocks), *source)
            refit_kernels.refit_wide(self.nodes, nodes.start, len(nodes), self.leaf_blocks)
        else:
            refit_kernels.refit_triangles(self.leaf_blocks, leaf_blocks.start, len(leaf_blocks), *source)
            refit_kernels.refit_binary(self.nodes, nodes.start, len(nodes), self.leaf_blocks)

    def placed(self) -> set[int]:
        """The times at which something, or nothing, is placed."""
        return set(self._roots)

    def clear_instances(self) -> None:
        """Let nothing be placed."""
        self._roots.clear()

    def place(self, time: int, boxes: NDArray[np.float64], rows: NDArray[np.int32], capacity: int) -> None:
        """Build the tree over the instances `rows` with world boxes [n, 6]. capacity: how many instances there are."""
        if capacity > self._instance_capacity:
            self._instance_capacity = max(64, 1 << (capacity - 1).bit_length())
            self._reserve(0, 0)
            self._forget()
        self._roots.pop(time, None)
        if not len(rows):
            self._roots[time] = EMPTY_NODE
            return
        self._roots[time] = first = self._kept_tree(boxes, rows)
        if first not in self._kept:
            nodes = self._build_instances(boxes, rows)
            self._write_nodes(nodes, first // self.layout.unit, 0, layout_kernels.NAME)
        self._kept[first] = self._kept.pop(first, (boxes, rows))  # the one that was not used for longest is first

    def _kept_tree(self, boxes: NDArray[np.float64], rows: NDArray[np.int32]) -> int:
        """The root of a tree over the same instances, or one where nothing is that is needed: what comes at one frame
        is there at the next."""
        for root, (kept_boxes, kept_rows) in self._kept.items():
            if np.array_equal(kept_rows, rows) and np.array_equal(kept_boxes, boxes):
                return root
        end = self._node_capacity()
        regions = range(end - TREES * self._instance_capacity, end, self._instance_capacity)
        roots = [first * self.layout.unit for first in regions if first * self.layout.unit not in self._kept]
        free = next(root for root in (*roots, *self._kept) if root not in self._roots.values())
        self._kept.pop(free, None)
        return free

    def _forget(self) -> None:
        """Forget the trees over instances: they are to be elsewhere."""
        self._roots.clear()
        self._kept.clear()

    def place_for_good(self, boxes: NDArray[np.float64], rows: NDArray[np.int32]) -> int:
        """Build a tree over instances that stays, whatever is placed later; returns the reference of its first node."""
        if not len(rows):
            return EMPTY_NODE
        nodes = self._build_instances(boxes, rows)
        self._reserve(nodes, 0)
        first = self._used_nodes
        self._write_nodes(nodes, first, 0, layout_kernels.NAME)
        self._used_nodes += nodes
        return first * self.layout.unit

    def _build(
        self,
        boxes: Boxes,
        order: NDArray[np.int32],
        starts: NDArray[np.int64],
        leaf_size: int,
        block: int,
        leaf_kind: int,
    ) -> NDArray[np.int32] | None:
        """Build trees into the workspace, of the boxes from each of `starts` on.

        Returns the totals of nodes and leaf_blocks after each tree, and its stack; None if a stack is too small.
        """
        budget = self.layout.tlas_stack if leaf_kind == layout_kernels.NAME else self.layout.blas_stack
        ends = np.append(starts[1:], len(order))
        tasks = np.stack([2 * starts, starts, ends, np.zeros_like(starts)], axis=1).astype(np.int32)
        for sah_depth in SAH_DEPTHS if len(starts) == 1 else SAH_DEPTHS[:1]:
            self._work.grow(boxes, order, tasks, sah_depth, self.layout, leaf_size, block)
            found = self._work.collapse(len(starts), self.layout.width, leaf_kind, by_count=sah_depth == 0)
            if found[:, 2].max() <= budget:
                return found
        return None

    def _build_instances(self, boxes: NDArray[np.float64], rows: NDArray[np.int32]) -> int:
        """Build a tree over instances into the workspace; returns its number of nodes."""
        found = self._build(_widened(boxes), rows, np.zeros(1, np.int64), 1, 1, layout_kernels.NAME)
        if found is None:
            raise self._too_many(len(rows), "instances")
        return int(found[0, 0])

    def _too_many(self, count: int, what: str) -> ArgumentError:
        return ArgumentError(f"{count} {what} are more than the {self.layout.name} traversal can take")

    def _write_nodes(self, count: int, first: int, first_block: int, leaf_kind: int) -> None:
        work = self._work
        if self.layout is BVH8:
            rows = 10 if leaf_kind == layout_kernels.LEAF_BLOCK else 1
            layout_kernels.write_wide_nodes(
                work.node_box, work.node_link, work.children, count, self.nodes, first, first_block, rows
            )
        else:
            layout_kernels.write_binary_nodes(
                work.node_box, work.node_link, work.children, count, self.nodes, first, first_block
            )

    def _reserve(self, nodes: int, leaf_blocks: int) -> None:
        """Make room for more BLAS nodes and leaf_blocks, the TLAS regions included, which lie at the end."""
        needed = self._used_nodes + nodes + TREES * self._instance_capacity
        if needed > layout_kernels.MOST_NODES and self.layout is BVH8:
            raise self._too_many(needed, "nodes of trees")
        if needed > self._node_capacity():
            self.nodes = _grown(self.nodes, self._new_nodes(max(needed, 2 * self._node_capacity())))
            self._forget()
        if self._used_leaf_blocks + leaf_blocks > self._leaf_block_capacity():
            needed = self._used_leaf_blocks + leaf_blocks
            self.leaf_blocks = _grown(
                self.leaf_blocks, self._new_leaf_blocks(max(needed, 2 * self._leaf_block_capacity()))
            )

    def _new_nodes(self, count: int) -> Any:
        return ti.ndarray(float8, 8 * count) if self.layout is BVH8 else ti.ndarray(ti.f32, (count, 16))

    def _new_leaf_blocks(self, count: int) -> Any:
        return ti.ndarray(float4, 10 * count) if self.layout is BVH8 else ti.ndarray(ti.f32, (count, 12))

    def _node_capacity(self) -> int:
        return int(self.nodes.shape[0]) // self.layout.unit

    def _leaf_block_capacity(self) -> int:
        return int(self.leaf_blocks.shape[0]) // (10 if self.layout is BVH8 else 1)


def _grown(old: Any, new: Any) -> Any:
    """The larger array `new` with the values of `old` at its beginning."""
    values = old.to_numpy()
    filled = np.zeros((new.shape[0], *values.shape[1:]), np.float32)
    filled[: len(values)] = values
    new.from_numpy(filled)
    return new


def _widened(boxes: NDArray[np.floating]) -> Boxes:
    """Boxes [n, 6] that still contain what they should after rounding, and that a ray within a face of them enters."""
    margin = np.maximum(4e-7 * np.abs(boxes).max(axis=1, keepdims=True), 1e-12)
    result: Boxes = np.empty(boxes.shape, np.float32)
    np.subtract(boxes[:, :3], margin, out=result[:, :3], casting="same_kind")
    np.add(boxes[:, 3:], margin, out=result[:, 3:], casting="same_kind")
    return result
