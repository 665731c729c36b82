# SPDX-License-Identifier: Apache-2.0
"""BvhCopy: the mesh trees of a Bvh without its instances, from which further scenes begin."""

from __future__ import annotations

import weakref

from tiscene.device.memory import copy_rows
from tiscene.scene.bvh.bvh import Bvh
from tiscene.scene.bvh.tree_arrays import TreeArrays


class BvhCopy(Bvh):
    """Trees of another Bvh, to which more can be added.

    The arrays of a copy have no free rows: what is added goes into larger arrays, so that a copy of all rows of a copy
    shares its arrays.

    Args:
        source: The other Bvh.
        rows: Its `used_rows` when the trees were complete; None: all, of a BvhCopy to which nothing was added.
    """

    def __init__(self, source: Bvh, rows: tuple[int, int] | None = None) -> None:
        super().__init__(source.layout.name)
        # Of a copy that has grown and ended: larger arrays whose first rows are those of this one.
        self.spare: TreeArrays | None = None
        nodes, blocks = source.used_rows if rows is None else rows
        self._used_nodes = nodes // self.layout.unit
        self._used_leaf_blocks = blocks // self.layout.block_rows
        if rows is not None:
            self._arrays = TreeArrays(self.layout, self._used_nodes, max(self._used_leaf_blocks, 1))
            copy_rows(source.nodes, self._arrays.nodes, nodes)
            copy_rows(source.leaf_blocks, self._arrays.leaf_blocks, blocks)
        elif isinstance(source, BvhCopy) and source.spare:
            self._arrays, source.spare = source.spare, None
        else:
            self._arrays.nodes = source.nodes
            if blocks:
                self._arrays.leaf_blocks = source.leaf_blocks
        # Not `__del__`: where a copy and its arrays are deleted together, as parts of a cycle of references, Python
        # calls that of an array first or last, and arrays that were handed on would have freed their memory.
        weakref.finalize(self, _keep_larger, weakref.ref(source), self._arrays).atexit = False

    @property
    def nbytes(self) -> int:
        """The memory of the trees on the device, and of larger arrays that are kept for the next copy, bytes."""
        return super().nbytes + (self.spare.nbytes if self.spare else 0)


def _keep_larger(source: weakref.ref[Bvh], arrays: TreeArrays) -> None:
    """Give the arrays of a copy that has grown and ended to the copy that it was made of."""
    there = source()
    if isinstance(there, BvhCopy):
        kept = there._arrays
        if arrays.nodes is not kept.nodes and arrays.leaf_blocks is not kept.leaf_blocks:
            there.spare = arrays
