"""Two-level bounding volume hierarchy: one tree for each mesh (BLAS), one over the instances for each time (TLAS).

All trees share one array of nodes, so that a ray goes from a TLAS into a BLAS without changing arrays. Two layouts:
"wide", 8 children a node and packs of 4 triangles, for the vector units of a CPU; "binary", for a GPU.
Building is deterministic: the same input gives the same bytes, for any number of threads.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.errors import ArgumentError
from tiscene.scene import bvh_build, bvh_refit, bvh_write

Boxes = NDArray[np.float32]
TREES = 4  # over instances: one for each time, one over the movers
EMPTY_NODE = 0  # a node without children: the root of an empty mesh and of an empty TLAS


@dataclass(frozen=True)
class Layout:
    """The shape of a tree. Stacks: entries that a traversal needs at most for a BLAS and a TLAS.

    unit: what one node adds to its number to refer to it. node_cost: in units of one block of triangles tested.
    """

    name: str
    width: int
    unit: int
    block: int
    leaf_kind: int
    node_cost: float
    blas_stack: int
    tlas_stack: int


WIDE = Layout("wide", 8, 8, 4, bvh_write.PACK, 0.5, 56, 56)
BINARY = Layout("binary", 2, 1, 1, bvh_write.ROWS, 1.0, 48, 24)
LAYOUTS = {layout.name: layout for layout in (WIDE, BINARY)}
LEAF_SIZE = 4
SAH_DEPTHS = (40, 20, 10, 0)  # a tree that is too deep for the stack is built again, halving ranges from higher up on
KEPT_WORKSPACE = 1 << 18  # primitives; the memory for building larger trees is given back
SERIAL_BUILD = 4096  # primitives up to which one thread builds the whole tree


@dataclass(frozen=True)
class Blas:
    """A mesh in the hierarchy.

    root: reference of its first node. entry: where rays enter it, which is a leaf where there is but one pack.
    box: least and greatest corner, [2, 3], m. nodes, packs: the rows that are its own, for a refit.
    """

    root: int
    entry: int
    box: NDArray[np.float64]
    nodes: range = range(0)
    packs: range = range(0)

    @property
    def empty(self) -> bool:
        """No triangle of the mesh can be hit."""
        return self.root == EMPTY_NODE


class Bvh:
    """The nodes and packed triangles on the device, and the roots of the trees in them.

    nodes, packs: Taichi arrays whose rows bvh_write.py describes. They are replaced when they grow.
    """

    def __init__(self, layout: str) -> None:
        if layout not in LAYOUTS:
            raise ArgumentError(f"traversal={layout!r}: must be one of {', '.join(LAYOUTS)}")
        self.layout = LAYOUTS[layout]
        self._work = _Workspace()
        self._used_nodes = 0
        self._used_packs = 0
        self._instance_capacity = 0
        self._roots: dict[int, int] = {}
        self._kept: dict[int, tuple[NDArray[np.float64], NDArray[np.int32]]] = {}  # by root, what the tree is over
        self.nodes = self._new_nodes(1)
        self.packs = self._new_packs(1)
        self._write_nodes(1, EMPTY_NODE, 0, bvh_write.NAME)
        self._used_nodes = 1

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
        their neighbours would gape.
        """
        corners = [positions[triangles[:, k]] for k in range(3)]
        apart = [(corners[k] != corners[k - 1]).any(axis=1) for k in range(3)]
        solid = np.flatnonzero(apart[0] & apart[1] & apart[2] | deforms).astype(np.int32)
        if not len(solid):
            return Blas(EMPTY_NODE, EMPTY_NODE, np.zeros((2, 3)))
        a, b, c = (corner[solid] for corner in corners)
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        boxes = _widened(np.concatenate([low, high], axis=1))
        nodes, packs = self._build(boxes, solid, LEAF_SIZE, self.layout.block, self.layout.leaf_kind)
        self._reserve(nodes, packs)
        first, first_pack = self._used_nodes, self._used_packs
        self._write_nodes(nodes, first, first_pack, self.layout.leaf_kind)
        source = positions, triangles, self._work.order
        target = self.packs, first_pack, first_triangle
        if self.layout is WIDE:
            bvh_write.write_packs(*source, self._work.node_link, self._work.children, nodes, *target)
        else:
            bvh_write.write_triangles(*source, packs, *target)
        self._used_nodes += nodes
        self._used_packs += packs
        if self._work.capacity > KEPT_WORKSPACE:
            self._work = _Workspace()
        box = np.stack([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])
        root = first * self.layout.unit
        entry = -1 - 10 * first_pack if self.layout is WIDE and packs == 1 else root
        rows = range(first, first + nodes), range(first_pack, first_pack + packs)
        return Blas(root, entry, box.astype(np.float64), *rows)

    def refit(self, blas: Blas, vertex_position: Any, triangle_vertices: Any, moved: int) -> None:
        """Fit the tree of a mesh that deforms to where its vertices are now.

        vertex_position, triangle_vertices: as a DeviceScene has them. moved: how many rows behind the one that
        `triangle_vertices` names a vertex is read.
        """
        nodes, packs = blas.nodes, blas.packs
        source = vertex_position, triangle_vertices, moved
        if self.layout is WIDE:
            bvh_refit.refit_packs(self.packs, packs.start, len(packs), *source)
            bvh_refit.refit_wide(self.nodes, nodes.start, len(nodes), self.packs)
        else:
            bvh_refit.refit_triangles(self.packs, packs.start, len(packs), *source)
            bvh_refit.refit_binary(self.nodes, nodes.start, len(nodes), self.packs)

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
            nodes, _ = self._build(_widened(boxes), rows, 1, 1, bvh_write.NAME)
            self._write_nodes(nodes, first // self.layout.unit, 0, bvh_write.NAME)
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
        nodes, _ = self._build(_widened(boxes), rows, 1, 1, bvh_write.NAME)
        self._reserve(nodes, 0)
        first = self._used_nodes
        self._write_nodes(nodes, first, 0, bvh_write.NAME)
        self._used_nodes += nodes
        return first * self.layout.unit

    def _build(
        self, boxes: Boxes, order: NDArray[np.int32], leaf_size: int, block: int, leaf_kind: int
    ) -> tuple[int, int]:
        """Build a tree into the workspace; returns its nodes and the rows of packs that its leaves need."""
        budget = self.layout.tlas_stack if leaf_kind == bvh_write.NAME else self.layout.blas_stack
        for sah_depth in SAH_DEPTHS:
            self._work.load(boxes, order)
            self._work.grow(len(order), sah_depth, self.layout, leaf_size, block)
            nodes, packs, stack = self._work.collapse(self.layout.width, leaf_kind, by_count=sah_depth == 0)
            if stack <= budget:
                return nodes, packs if leaf_kind == bvh_write.PACK else len(order)
        what = "instances" if leaf_kind == bvh_write.NAME else "triangles in one mesh"
        raise ArgumentError(f"{len(order)} {what} are more than the {self.layout.name} traversal can take")

    def _write_nodes(self, count: int, first: int, first_pack: int, leaf_kind: int) -> None:
        work = self._work
        if self.layout is WIDE:
            rows = 10 if leaf_kind == bvh_write.PACK else 1
            bvh_write.write_wide_nodes(
                work.node_box, work.node_link, work.children, count, self.nodes, first, first_pack, rows
            )
        else:
            bvh_write.write_binary_nodes(
                work.node_box, work.node_link, work.children, count, self.nodes, first, first_pack
            )

    def _reserve(self, nodes: int, packs: int) -> None:
        """Make room for more BLAS nodes and packs, the TLAS regions included, which lie at the end."""
        needed = self._used_nodes + nodes + TREES * self._instance_capacity
        if needed > self._node_capacity():
            self.nodes = _grown(self.nodes, self._new_nodes(max(needed, 2 * self._node_capacity())))
            self._forget()
        if self._used_packs + packs > self._pack_capacity():
            needed = self._used_packs + packs
            self.packs = _grown(self.packs, self._new_packs(max(needed, 2 * self._pack_capacity())))

    def _new_nodes(self, count: int) -> Any:
        return ti.ndarray(bvh_write.vec8, 8 * count) if self.layout is WIDE else ti.ndarray(ti.f32, (count, 16))

    def _new_packs(self, count: int) -> Any:
        return ti.ndarray(bvh_write.vec4, 10 * count) if self.layout is WIDE else ti.ndarray(ti.f32, (count, 12))

    def _node_capacity(self) -> int:
        return int(self.nodes.shape[0]) // self.layout.unit

    def _pack_capacity(self) -> int:
        return int(self.packs.shape[0]) // (10 if self.layout is WIDE else 1)


class _Workspace:
    """The arrays of a build in progress; they grow and stay."""

    def __init__(self) -> None:
        self._allocate(64)
        self._totals = np.zeros(3, np.int32)
        self.children.fill(-1)

    def _allocate(self, capacity: int) -> None:
        self.capacity = capacity
        self.boxes = ti.ndarray(ti.f32, (capacity, 6))
        self.order = ti.ndarray(ti.i32, capacity)
        self.tasks = ti.ndarray(ti.i32, (capacity + 1, 4))
        self.node_box = ti.ndarray(ti.f32, (2 * capacity, 6))
        self.node_link = ti.ndarray(ti.i32, (2 * capacity, 4))
        self.children = ti.ndarray(ti.i32, (capacity, 8))
        self.stack = ti.ndarray(ti.i32, (capacity, 2))

    def load(self, boxes: Boxes, order: NDArray[np.int32]) -> None:
        if len(order) > self.capacity:
            self._allocate(max(len(order), 2 * min(self.capacity, KEPT_WORKSPACE)))
        bvh_build.load(boxes, order, self.boxes, self.order, self.tasks)

    def grow(self, count: int, sah_depth: int, layout: Layout, leaf_size: int, block: int) -> None:
        """Split the loaded primitives into a binary tree."""
        serial_until = 0 if count <= SERIAL_BUILD else max(SERIAL_BUILD // 4, count // 64)

        def run(first: int, tasks: int, stop: int) -> int:
            arrays = (self.boxes, self.order, self.node_box, self.node_link, self.tasks)
            return int(bvh_build.grow(*arrays, first, tasks, stop, sah_depth, leaf_size, block, layout.node_cost))

        subtrees = run(0, 1, serial_until)
        if subtrees:
            run(1, subtrees, 0)

    def collapse(self, width: int, leaf_kind: int, by_count: bool) -> tuple[int, int, int]:
        """Merge binary nodes; returns how many nodes and packs there are and the stack that a traversal needs."""
        arrays = (self.order, self.node_box, self.node_link, self.children, self.stack, self._totals)
        bvh_write.collapse(*arrays, width, leaf_kind, int(by_count))
        nodes, packs, stack = self._totals.tolist()
        return nodes, packs, stack


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
