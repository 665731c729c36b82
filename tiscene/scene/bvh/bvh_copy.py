# SPDX-License-Identifier: Apache-2.0
"""BvhCopy: the mesh trees of a Bvh without its instances, from which further scenes begin."""

from __future__ import annotations

import weakref
from typing import Any

from tiscene.device.memory import copy_rows
from tiscene.scene.bvh.bvh import Bvh


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
        self.spare: tuple[Any, ...] = ()
        nodes, blocks = source.used_rows if rows is None else rows
        self._used_nodes = nodes // self.layout.unit
        self._used_leaf_blocks = blocks // source.rows_of_block
        # Not `__del__`: where a copy and its arrays are deleted together, as parts of a cycle of references, Python
        # calls that of an array first or last, and arrays that were handed on would have freed their memory.
        weakref.finalize(self, _keep_larger, weakref.ref(source), vars(self)).atexit = False
        if rows is None and isinstance(source, BvhCopy) and source.spare:
            (self._nodes, self.leaf_blocks), source.spare = source.spare, ()
            return
        if rows is None:
            self._nodes = source.nodes
        else:
            self._nodes = self._new_nodes(self._used_nodes)
            copy_rows(source.nodes, self._nodes, nodes)
        if blocks and rows is None:
            self.leaf_blocks = source.leaf_blocks
        elif blocks:
            self.leaf_blocks = self._new_leaf_blocks(self._used_leaf_blocks)
            copy_rows(source.leaf_blocks, self.leaf_blocks, blocks)


def _keep_larger(source: weakref.ref[Bvh], copy: dict[str, Any]) -> None:
    """Give the arrays of a copy that has grown and ended to the copy that it was made of."""
    there = source()
    if isinstance(there, BvhCopy) and copy["_nodes"] is not there._nodes:
        if copy["leaf_blocks"] is not there.leaf_blocks:
            there.spare = copy["_nodes"], copy["leaf_blocks"]
