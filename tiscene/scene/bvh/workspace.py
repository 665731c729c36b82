# SPDX-License-Identifier: Apache-2.0
"""Layouts of trees, and the arrays of a build in progress."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.memory import device_array, read_rows, upload
from tiscene.scene.bvh import binary_trees, build_kernels, layout_kernels

Boxes = NDArray[np.float32]


@dataclass(frozen=True)
class Layout:
    """The shape of trees.

    Attributes:
        name: "bvh8" or "bvh2".
        unit: Rows of a node; a reference is the node's number times this.
        block: Triangles that are tested at once.
        block_rows: Rows of the triangles of a leaf block.
        node_cost: Cost of visiting a node, in units of testing one block.
        blas_stack: Stack entries that a traversal of a BLAS may need.
        tlas_stack: Stack entries that a traversal of a TLAS may need.
    """

    name: str
    unit: int
    block: int
    block_rows: int
    node_cost: float
    blas_stack: int
    tlas_stack: int


BVH8 = Layout("bvh8", 8, 4, layout_kernels.BLOCK_ROWS, 0.5, 56, 56)
BVH2 = Layout("bvh2", 1, 1, 1, 1.0, 48, 24)
LAYOUTS = {layout.name: layout for layout in (BVH8, BVH2)}
MAX_KEPT_CAPACITY = 1 << 18  # primitives; a larger workspace is freed after the build
SERIAL_BUILD = 4096  # primitives up to which one thread builds the whole tree


class Workspace:
    """Arrays of a build in progress, which grow and are reused.

    Attributes:
        order: Primitives in the order of the leaves, of the last build.
        nodes: Nodes of the layout "bvh2" after `collapse`, with references from 0 on.
    """

    def __init__(self) -> None:
        self._allocate(64)
        self.children.fill(-1)

    def _allocate(self, capacity: int) -> None:
        self.capacity = capacity
        self.node_box = device_array(ti.f32, (2 * capacity, 6))
        self.node_link = device_array(ti.i32, (2 * capacity, 4))
        self.children = device_array(ti.i32, (capacity, 8))
        self.stack = device_array(ti.i32, (capacity, 2))

    def grow(
        self,
        boxes: Boxes,
        order: NDArray[np.int32],
        tasks: NDArray[np.int32],
        sah_depth: int,
        layout: Layout,
        leaf_size: int,
        block: int,
    ) -> None:
        """Build binary trees, one for each task (`build_kernels.grow`)."""
        count, trees = len(order), len(tasks)
        if count > self.capacity:
            self._allocate(max(count, 2 * min(self.capacity, MAX_KEPT_CAPACITY)))
        if layout.name == BVH2.name:
            primitives, tasks = binary_trees.split_large(
                boxes, order, tasks, self.node_box, self.node_link, sah_depth, block
            )
            self.order = primitives.order
            arrays = *primitives, self.node_box, self.node_link, upload(tasks)
            build_kernels.grow(*arrays, 0, len(tasks), 0, sah_depth, leaf_size, block, layout.node_cost)
            return
        serial_until = 0 if count <= SERIAL_BUILD or trees > 1 else max(SERIAL_BUILD // 4, count // 64)
        boxes, self.order = boxes.copy(), order.copy()  # they are sorted in place
        self.tasks = np.concatenate([tasks, np.zeros((count + 1 - trees, 4), np.int32)])
        arrays = boxes, self.order, self.node_box, self.node_link, self.tasks

        def run(first: int, tasks: int, stop: int) -> int:
            return int(build_kernels.grow(*arrays, first, tasks, stop, sah_depth, leaf_size, block, layout.node_cost))

        subtrees = run(0, trees, serial_until)
        if subtrees:
            run(1, subtrees, 0)

    def collapse(
        self, starts: NDArray[np.int64], layout: Layout, *, of_instances: bool, by_count: bool
    ) -> NDArray[np.int32]:
        """Merge and number the nodes of trees over the primitives from one of `starts` to the next.

        Returns:
            int32 [trees, 3], see `layout_kernels.collapse`.
        """
        if layout.name == BVH2.name:
            used = 2 * self.order.shape[0]
            boxes, links = read_rows(self.node_box, used), read_rows(self.node_link, used)
            self.nodes, found = binary_trees.numbered_nodes(boxes, links, 2 * starts)
            return found
        found = np.zeros((len(starts), 3), np.int32)
        arrays = (self.order, self.node_box, self.node_link, self.children, self.stack, self.tasks, found)
        layout_kernels.collapse(*arrays, int(of_instances), int(by_count))
        return found


def widened(boxes: NDArray[np.floating]) -> Boxes:
    """Return boxes [n, 6] enlarged by rounding errors, so that rays within a face of a flat box hit it."""
    margin = np.maximum(build_kernels.MARGIN * np.abs(boxes).max(axis=1, keepdims=True), 1e-12)
    result: Boxes = np.empty(boxes.shape, np.float32)
    np.subtract(boxes[:, :3], margin, out=result[:, :3], casting="same_kind")
    np.add(boxes[:, 3:], margin, out=result[:, 3:], casting="same_kind")
    return result
