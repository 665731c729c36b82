# SPDX-License-Identifier: Apache-2.0
"""Bvh: a two-level bounding volume hierarchy, with one tree for each mesh (BLAS) and one over instances a time (TLAS).

All trees share one array of nodes, so that a ray goes from a TLAS into a BLAS without changing arrays. There are two
layouts: "bvh8", with 8 children a node and leaf blocks of 4 triangles, for the vector units of a CPU; and "bvh2", for
GPUs. Builds are deterministic: the same input gives the same bytes, for any number of threads.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device.memory import upload, write_rows
from tiscene.errors import ArgumentError
from tiscene.scene.bvh import layout_kernels, refit_kernels
from tiscene.scene.bvh.binary_trees import placed_nodes
from tiscene.scene.bvh.blas import EMPTY_NODE, Blas, TreeRoom, levels_below
from tiscene.scene.bvh.instance_tree import NODE_COLUMNS, InstanceTrees, empty_nodes, median_trees, node_count
from tiscene.scene.bvh.moved_trees import MovedTrees
from tiscene.scene.bvh.rebraid import SplitInstances, root_children
from tiscene.scene.bvh.tree_arrays import TreeArrays
from tiscene.scene.bvh.workspace import BVH8, LAYOUTS, MAX_KEPT_CAPACITY, Boxes, Workspace, widened

TLAS_COUNT = 4  # one for each time, one over the dynamic objects
LEAF_SIZE = 4
# Depths below which ranges are halved instead of split by SAH. A tree too deep for the stack is built with the next.
SAH_DEPTHS = (40, 20, 10, 0)
SPARE = 4  # the part of the rows that a room has more than its tree needs
BATCH_TRIANGLES = 1 << 16  # small meshes are built together, up to this number of triangles


class Bvh:
    """The nodes and triangles of all trees on the device, and the roots of the trees.

    Args:
        layout: "bvh8" or "bvh2".

    Attributes:
        layout: The shape of the trees.

    Raises:
        ArgumentError: The layout is unknown.
    """

    def __init__(self, layout: str) -> None:
        if layout not in LAYOUTS:
            raise ArgumentError(f"traversal={layout!r}: must be one of {', '.join(LAYOUTS)}")
        self.layout = LAYOUTS[layout]
        self._work = Workspace()
        self._used_leaf_blocks = 0
        self._instance_capacity = 0
        self._roots: dict[Hashable, int] = {}
        # Boxes and rows of the instances of each TLAS that exists, by root, the least recently used first.
        self._cached: dict[int, tuple[NDArray[np.float64], NDArray[np.int32]]] = {}
        # Of the layout "bvh2": root, boxes and rows of each TLAS that is not written yet.
        self._unwritten: dict[int, tuple[Boxes, NDArray[np.int32]]] = {}
        self._instance_trees = InstanceTrees()
        self._regions = TLAS_COUNT
        self._levels: dict[int, tuple[Any, list[int]]] = {}  # of deforming meshes, by first node
        self._used_nodes = 2  # the empty node and the guard node
        self._arrays = TreeArrays(self.layout, self._used_nodes, 1)
        if self.layout is BVH8:
            self._write_nodes(self._used_nodes, EMPTY_NODE)
            layout_kernels.write_guard(self._arrays.nodes)
        else:
            write_rows(self._arrays.nodes, EMPTY_NODE, empty_nodes(self._used_nodes))

    @property
    def nodes(self) -> Any:
        """Device array of nodes (`layout_kernels`), replaced when it grows."""
        numbers, values = self.take_unwritten()
        if len(numbers):
            layout_kernels.write_rows(numbers, values, self._arrays.nodes)
        return self._arrays.nodes

    @property
    def leaf_blocks(self) -> Any:
        """Device array of triangles (`layout_kernels`), replaced when it grows."""
        return self._arrays.leaf_blocks

    def take_unwritten(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Return nodes of TLAS that the caller writes into `nodes`, so that they travel with its other data.

        Returns:
            int32 [n], the rows of `nodes`; int32 [n, 16], their bits. Only the layout "bvh2" has such nodes.
        """
        roots, trees = list(self._unwritten), list(self._unwritten.values())
        if not trees:
            return np.zeros(0, np.int32), np.zeros((0, NODE_COLUMNS), np.int32)
        self._unwritten.clear()
        values, numbers = self._instance_trees.build(trees, roots)
        return numbers.astype(np.int32), values.view(np.int32)

    def reserve_trees(self, count: int) -> None:
        """Make room for this number of TLAS at the same time, with names other than PREVIOUS, CURRENT, NEXT, MOVERS."""
        if count + TLAS_COUNT > self._regions:
            self._regions = count + TLAS_COUNT
            self._reserve(0, 0)
            self._drop_instances()

    @property
    def nbytes(self) -> int:
        """The memory of the trees on the device, bytes."""
        return self._arrays.nbytes

    @property
    def used_rows(self) -> tuple[int, int]:
        """Rows of `nodes` and of `leaf_blocks` that hold BLAS and static instances; the others change or are free."""
        return self._used_nodes * self.layout.unit, self._used_leaf_blocks * self.layout.block_rows

    def root(self, time: Hashable) -> int:
        """Return the reference of the TLAS at a time, or of MOVERS. Raise ArgumentError if it was not placed."""
        if time not in self._roots:
            raise ArgumentError(f"time={time}: no instances are placed there; name it in place(..., times=...)")
        return self._roots[time]

    def add_mesh(
        self,
        positions: Boxes,
        triangles: NDArray[np.int32],
        first_triangle: int,
        *,
        deforms: bool = False,
        room: TreeRoom | None = None,
    ) -> Blas:
        """Build the tree of a mesh.

        Triangles with two corners at one point are left out, unless the mesh deforms. Thin triangles stay: without them
        there would be gaps between their neighbors.

        Args:
            positions: float32 [n, 3], m.
            triangles: int32 [m, 3].
            first_triangle: The scene's row of the first triangle.
            deforms: Whether the vertices change later (`refit`).
            room: Where to write the tree, in place of another one. None: behind all others.
        """
        return self._add([positions], [triangles], first_triangle, deforms, room)[0]

    def add_meshes(
        self, positions: Sequence[Boxes], triangles: Sequence[NDArray[np.int32]], first_triangle: int
    ) -> list[Blas]:
        """Build the trees of consecutive meshes, with the result of `add_mesh`; small meshes are built in parallel."""
        result: list[Blas] = []
        begin = 0
        while begin < len(triangles):
            end, size = begin + 1, len(triangles[begin])
            while end < len(triangles) and size + len(triangles[end]) <= BATCH_TRIANGLES:
                size += len(triangles[end])
                end += 1
            result += self._add(positions[begin:end], triangles[begin:end], first_triangle)
            first_triangle += size
            begin = end
        return result

    def add_moved(self, trees: MovedTrees, first_triangle: int) -> list[Blas]:
        """Add trees that were built before, with the result of `add_meshes`, in the layout "bvh8"."""
        first, first_block = self._rows_for(len(trees.nodes), len(trees.leaf_blocks))
        here = trees.moved(first, first_block, first_triangle)
        write_rows(self._arrays.nodes, first * self.layout.unit, here.nodes.reshape(-1, 8))
        write_rows(self.leaf_blocks, first_block * self.layout.block_rows, here.leaf_blocks.reshape(-1, 4))
        return list(here.blas)

    def _add(
        self,
        positions: Sequence[Boxes],
        triangles: Sequence[NDArray[np.int32]],
        first_triangle: int,
        deforms: bool = False,
        room: TreeRoom | None = None,
    ) -> list[Blas]:
        points = np.concatenate(positions)
        sizes = np.array([len(each) for each in triangles])
        begin = np.cumsum([0, *(len(each) for each in positions)])
        faces = np.concatenate([each + first for each, first in zip(triangles, begin, strict=False)]).astype(np.int32)
        corners = [points[faces[:, k]] for k in range(3)]
        distinct = [(corners[k] != corners[k - 1]).any(axis=1) for k in range(3)]
        solid = np.flatnonzero(distinct[0] & distinct[1] & distinct[2] | deforms).astype(np.int32)
        result = [Blas(EMPTY_NODE, EMPTY_NODE, np.zeros((2, 3)))] * len(sizes)
        if not len(solid):
            return result
        a, b, c = (corner[solid] for corner in corners)
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        boxes = widened(np.concatenate([low, high], axis=1))
        owner = np.repeat(np.arange(len(sizes)), sizes)[solid]
        counts = np.bincount(owner, minlength=len(sizes))
        meshes = np.flatnonzero(counts)
        ends = np.cumsum(counts[meshes])
        starts = ends - counts[meshes]
        found = self._build(boxes, solid, starts)
        if found is None:  # one of them is too deep for the stack
            if len(sizes) == 1:
                raise self._too_many(len(solid), "triangles in one mesh")
            firsts = (first_triangle + np.cumsum(sizes) - sizes).tolist()
            return [self.add_mesh(*each) for each in zip(positions, triangles, firsts, strict=True)]
        nodes, leaf_blocks, _ = found[-1].tolist()
        first, first_block = self._rows_for(nodes, leaf_blocks, room)
        self._write_nodes(nodes, first, first_block)
        source = points, faces, self._work.order
        target = self.leaf_blocks, first_block, first_triangle
        if self.layout is BVH8:
            layout_kernels.write_leaf_blocks(*source, self._work.node_link, self._work.children, nodes, *target)
        else:
            layout_kernels.write_triangles(*source, leaf_blocks, *target)
        if self._work.capacity > MAX_KEPT_CAPACITY:
            self._work = Workspace()
        node_ends, block_ends = first + found[:, 0], first_block + found[:, 1]
        rows = np.stack([[first, *node_ends[:-1]], node_ends, [first_block, *block_ends[:-1]], block_ends], axis=1)
        bounds = np.minimum.reduceat(boxes[:, :3], starts), np.maximum.reduceat(boxes[:, 3:], starts)
        for mesh, row, box in zip(meshes.tolist(), rows.tolist(), np.stack(bounds, axis=1), strict=True):
            root = row[0] * self.layout.unit
            entry = -1 - self.layout.block_rows * row[2] if self.layout is BVH8 and row[3] - row[2] == 1 else root
            result[mesh] = Blas(root, entry, box.astype(np.float64), range(row[0], row[1]), range(row[2], row[3]))
        return result

    def _rows_for(self, nodes: int, leaf_blocks: int, room: TreeRoom | None = None) -> tuple[int, int]:
        """Return the first node and leaf block for a tree: in a room, if it is large enough, else behind all others.

        A room that is too small gets new rows, with some to spare.
        """
        if room and nodes <= len(room.nodes) and leaf_blocks <= len(room.leaf_blocks):
            return room.nodes.start, room.leaf_blocks.start
        if room:
            nodes, leaf_blocks = nodes + nodes // SPARE, leaf_blocks + leaf_blocks // SPARE
        self._reserve(nodes, leaf_blocks)
        first, first_block = self._used_nodes, self._used_leaf_blocks
        self._used_nodes, self._used_leaf_blocks = first + nodes, first_block + leaf_blocks
        if room:
            room.nodes, room.leaf_blocks = range(first, self._used_nodes), range(first_block, self._used_leaf_blocks)
        return first, first_block

    def parts(self, meshes: Sequence[Blas]) -> SplitInstances:
        """Return the children of the meshes' roots; none for a mesh of one leaf block, none in the layout "bvh2"."""
        if self.layout is not BVH8:
            return root_children(np.zeros((len(meshes), 8, 8), np.float32))
        roots = np.array([blas.root if blas.entry == blas.root else EMPTY_NODE for blas in meshes], np.int64)
        return root_children(self._arrays.nodes.to_numpy().reshape(-1, 8, 8)[roots // self.layout.unit])

    def refit(self, blas: Blas, vertex_position: Any, triangle_vertices: Any, offset: int) -> None:
        """Fit the boxes and triangles of a deforming mesh's tree to its present vertices.

        Args:
            blas: The tree.
            vertex_position: The scene's device array.
            triangle_vertices: The scene's device array.
            offset: Added to each row of `triangle_vertices`.
        """
        nodes, leaf_blocks = blas.nodes, blas.leaf_blocks
        source = vertex_position, triangle_vertices, offset
        if self.layout is BVH8:
            refit_kernels.refit_leaf_blocks(self.leaf_blocks, leaf_blocks.start, len(leaf_blocks), *source)
            refit_kernels.refit_bvh8(self._arrays.nodes, nodes.start, len(nodes), self.leaf_blocks)
        else:
            refit_kernels.refit_triangles(self.leaf_blocks, leaf_blocks.start, len(leaf_blocks), *source)
            for order, first, count in self._levels_of(nodes):
                refit_kernels.refit_bvh2(self._arrays.nodes, order, first, count, self.leaf_blocks)

    def _levels_of(self, rows: range) -> Iterator[tuple[Any, int, int]]:
        """Yield the levels of a tree of the layout "bvh2", deepest first: a device array of nodes, its first and count.

        A GPU would refit all nodes in one thread otherwise. The levels are found once.
        """
        if rows.start not in self._levels:
            nodes = self._arrays.nodes.to_numpy()[rows.start : rows.stop]
            levels = levels_below(rows.start, nodes[:, 12:14].view(np.int32))
            self._levels[rows.start] = upload(np.concatenate(levels)), [len(level) for level in levels]
        order, sizes = self._levels[rows.start]
        end = sum(sizes)
        for size in reversed(sizes):
            end -= size
            yield order, end, size

    def placed(self) -> set[Hashable]:
        """Return the times at which `place` was called since `clear_instances`."""
        return set(self._roots)

    def clear_instances(self) -> None:
        """Make all times unplaced."""
        self._roots.clear()

    def place(self, time: Hashable, boxes: NDArray[np.float64], rows: NDArray[np.int32], capacity: int) -> None:
        """Build the TLAS at a time, unless an existing one is over the same instances.

        Args:
            time: PREVIOUS, CURRENT, NEXT or MOVERS, or another name (`reserve_trees`).
            boxes: float64 [n, 6], world boxes of the instances, m.
            rows: int32 [n], names of the instances in the leaves.
            capacity: Upper limit of n, for all times.
        """
        if capacity > self._instance_capacity:
            self._instance_capacity = max(64, 1 << (capacity - 1).bit_length())
            self._reserve(0, 0)
            self._drop_instances()
        self._roots.pop(time, None)
        if not len(rows):
            self._roots[time] = EMPTY_NODE
            return
        first = self._tlas_region(boxes, rows)
        if first not in self._cached and self.layout is not BVH8:
            self._unwritten[first] = widened(boxes), rows
        elif first not in self._cached:
            nodes = self._build_instances(boxes, rows)
            self._write_nodes(nodes, first // self.layout.unit)
        self._cached[first] = self._cached.pop(first, (boxes, rows))  # the least recently used comes first
        self._roots[time] = first  # last: an exception before leaves the time unplaced

    def _tlas_region(self, boxes: NDArray[np.float64], rows: NDArray[np.int32]) -> int:
        """Return the root of the TLAS over these instances, if there is one, else of a region that is free.

        The tree of NEXT at one frame is that of CURRENT at the following one.
        """
        for root, (cached_boxes, cached_rows) in self._cached.items():
            if np.array_equal(cached_rows, rows) and np.array_equal(cached_boxes, boxes):
                return root
        end = self._arrays.node_capacity
        regions = range(end - self._regions * self._instance_capacity, end, self._instance_capacity)
        roots = [first * self.layout.unit for first in regions if first * self.layout.unit not in self._cached]
        free = next(root for root in (*roots, *self._cached) if root not in self._roots.values())
        self._cached.pop(free, None)
        return free

    def _drop_instances(self) -> None:
        """Drop all TLAS, since their regions move."""
        self._roots.clear()
        self._cached.clear()
        self._unwritten.clear()

    def add_static_instances(
        self, boxes: NDArray[np.float64], rows: NDArray[np.int32], room: TreeRoom | None = None
    ) -> int:
        """Build a tree that `place` does not replace, and return its root. room: as of `add_mesh`."""
        if not len(rows):
            return EMPTY_NODE
        on_host = self.layout is not BVH8
        nodes = node_count(len(rows)) if on_host else self._build_instances(boxes, rows)
        first, _ = self._rows_for(nodes, 0, room)
        if on_host:
            values, numbers = median_trees(widened(boxes), rows, np.zeros(1, np.int64), np.array([first]))
            layout_kernels.write_rows(numbers.astype(np.int32), values.view(np.int32), self._arrays.nodes)
        else:
            self._write_nodes(nodes, first)
        return first * self.layout.unit

    def _build(
        self, boxes: Boxes, order: NDArray[np.int32], starts: NDArray[np.int64], *, of_instances: bool = False
    ) -> NDArray[np.int32] | None:
        """Build trees in the workspace, each over the boxes from one of `starts` to the next.

        Returns:
            For each tree: the totals of nodes and leaf blocks up to it, and the stack that it needs. None: a tree needs
            more stack than there is.
        """
        leaf_size, block, budget = LEAF_SIZE, self.layout.block, self.layout.blas_stack
        if of_instances:
            leaf_size, block, budget = 1, 1, self.layout.tlas_stack
        ends = np.append(starts[1:], len(order))
        tasks = np.stack([2 * starts, starts, ends, np.zeros_like(starts)], axis=1).astype(np.int32)
        for sah_depth in SAH_DEPTHS if len(starts) == 1 else SAH_DEPTHS[:1]:
            self._work.grow(boxes, order, tasks, sah_depth, self.layout, leaf_size, block)
            found = self._work.collapse(starts, self.layout, of_instances=of_instances, by_count=sah_depth == 0)
            if found[:, 2].max() <= budget:
                return found
        return None

    def _build_instances(self, boxes: NDArray[np.float64], rows: NDArray[np.int32]) -> int:
        """Build a tree over instances in the workspace; return its number of nodes."""
        found = self._build(widened(boxes), rows, np.zeros(1, np.int64), of_instances=True)
        if found is None:
            raise self._too_many(len(rows), "instances")
        return int(found[0, 0])

    def _too_many(self, count: int, what: str) -> ArgumentError:
        return ArgumentError(f"{count} {what} are more than the {self.layout.name} traversal supports")

    def _write_nodes(self, count: int, first: int, first_block: int | None = None) -> None:
        """Write the nodes in the workspace. first_block: of the leaves' blocks; None: leaves are instances."""
        work = self._work
        if self.layout is BVH8:
            rows = 1 if first_block is None else self.layout.block_rows
            layout_kernels.write_bvh8_nodes(
                work.node_box, work.node_link, work.children, count, self._arrays.nodes, first, first_block or 0, rows
            )
        else:
            write_rows(self._arrays.nodes, first, placed_nodes(work.nodes, first, first_block or 0))

    def _reserve(self, nodes: int, leaf_blocks: int) -> None:
        """Make room for more BLAS nodes and leaf blocks. The TLAS regions are at the end of the nodes."""
        needed = self._used_nodes + nodes + self._regions * self._instance_capacity
        if needed > layout_kernels.MAX_NODES and self.layout is BVH8:
            raise self._too_many(needed, "nodes of trees")
        if self._arrays.reserve_nodes(needed):
            self._drop_instances()
        self._arrays.reserve_leaf_blocks(self._used_leaf_blocks + leaf_blocks)
