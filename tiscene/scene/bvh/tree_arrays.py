# SPDX-License-Identifier: Apache-2.0
"""TreeArrays: the device arrays that hold the nodes and triangles of all trees, and grow."""

from __future__ import annotations

from typing import Any

import taichi as ti

from tiscene.device.kernel_types import float4, float8
from tiscene.device.memory import copy_rows, device_array, nbytes
from tiscene.scene.bvh.workspace import BVH8, Layout


class TreeArrays:
    """Arrays of nodes and leaf blocks, see `layout_kernels`. Each is replaced by a larger one when it grows.

    An object of its own, so that it can be kept where the trees are deleted: in Python 3.13, whoever keeps the dict of
    an object that is part of a cycle of references does not keep what is in it.

    Args:
        layout: The shape of the trees.
        nodes: Number of nodes there is room for.
        leaf_blocks: Number of leaf blocks there is room for.

    Attributes:
        nodes: Device array of nodes.
        leaf_blocks: Device array of triangles.
    """

    def __init__(self, layout: Layout, nodes: int, leaf_blocks: int) -> None:
        self._layout = layout
        self.nodes, self.leaf_blocks = self._new_nodes(nodes), self._new_leaf_blocks(leaf_blocks)

    @property
    def nbytes(self) -> int:
        """The memory of the arrays, bytes."""
        return nbytes(self.nodes, self.leaf_blocks)

    @property
    def node_capacity(self) -> int:
        """Number of nodes there is room for."""
        return int(self.nodes.shape[0]) // self._layout.unit

    def reserve_nodes(self, count: int) -> bool:
        """Make room for this number of nodes. Return whether the array has been replaced."""
        if count <= self.node_capacity:
            return False
        self.nodes = _grown(self.nodes, self._new_nodes(count + count // 4))
        return True

    def reserve_leaf_blocks(self, count: int) -> None:
        """Make room for this number of leaf blocks."""
        if count > int(self.leaf_blocks.shape[0]) // self._layout.block_rows:
            self.leaf_blocks = _grown(self.leaf_blocks, self._new_leaf_blocks(count + count // 4))

    def _new_nodes(self, count: int) -> Any:
        rows = self._layout.unit * count
        return device_array(float8, rows) if self._layout is BVH8 else device_array(ti.f32, (rows, 16))

    def _new_leaf_blocks(self, count: int) -> Any:
        rows = self._layout.block_rows * count
        return device_array(float4, rows) if self._layout is BVH8 else device_array(ti.f32, (rows, 12))


def _grown(old: Any, new: Any) -> Any:
    """Copy the values of an array to the beginning of a larger one, and return that."""
    copy_rows(old, new, old.shape[0])
    return new
