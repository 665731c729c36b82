# SPDX-License-Identifier: Apache-2.0
"""Blas: the bottom-level tree of one mesh, as rows of the shared arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

EMPTY_NODE = 0  # reference of a node without children: the root of an empty mesh and of an empty TLAS


@dataclass(frozen=True)
class Blas:
    """The tree of a mesh.

    Attributes:
        root: Reference of its first node.
        entry: Reference where rays enter it: a leaf if the mesh is one leaf block, else the root.
        box: float64 [2, 3], lowest and highest corner, m.
        nodes: Its rows of `Bvh.nodes`, in nodes.
        leaf_blocks: Its rows of `Bvh.leaf_blocks`, in leaf blocks.
    """

    root: int
    entry: int
    box: NDArray[np.float64]
    nodes: range = range(0)
    leaf_blocks: range = range(0)

    @property
    def empty(self) -> bool:
        """Whether no triangle of the mesh can be hit."""
        return self.root == EMPTY_NODE


@dataclass(eq=False)
class TreeRoom:
    """Rows of a Bvh's arrays that one tree after another uses; replaced by more rows where a tree does not fit.

    Attributes:
        nodes: Rows of `Bvh.nodes`, in nodes.
        leaf_blocks: Rows of `Bvh.leaf_blocks`, in leaf blocks.
    """

    nodes: range = range(0)
    leaf_blocks: range = range(0)


def levels_below(root: int, references: NDArray[np.int32]) -> list[NDArray[np.int32]]:
    """Return the inner nodes of a tree, level by level from its root.

    Args:
        root: Number of the first node.
        references: int32 [n, k], references of the children of this node and the following ones; 0 for none.
    """
    levels = [np.array([root], np.int32)]
    while True:
        children = references[levels[-1] - root]
        children = children[children > 0]
        if not len(children):
            return levels
        levels.append(children)
