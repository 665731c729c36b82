# SPDX-License-Identifier: Apache-2.0
"""MovedTrees: trees of meshes that were built once, with the bytes that a build in another place would give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.bvh.blas import Blas
from tiscene.scene.bvh.workspace import BVH8

NODE_ROWS, BLOCK_ROWS = BVH8.unit, BVH8.block_rows  # of a node and of a leaf block
REFERENCES, NUMBERS = 6, 9  # the rows of them with the references of children, and with the scene's triangles


@dataclass(frozen=True, eq=False)
class MovedTrees:
    """Trees of consecutive meshes in the layout "bvh8", as if they were the first in a scene.

    Attributes:
        nodes: float32 [n, 8, 8], rows of `Bvh.nodes`; references count from its first node and leaf block.
        leaf_blocks: float32 [m, 10, 4], rows of `Bvh.leaf_blocks`; triangles count from its first one.
        blas: The tree of each mesh, likewise.
    """

    nodes: NDArray[np.float32]
    leaf_blocks: NDArray[np.float32]
    blas: tuple[Blas, ...]

    def moved(self, node: int, leaf_block: int, triangle: int) -> MovedTrees:
        """Return the trees with other first rows.

        Args:
            node: Added to the number of each node.
            leaf_block: Added to the number of each leaf block.
            triangle: Added to the row of each triangle.
        """
        nodes, leaf_blocks = self.nodes.copy(), self.leaf_blocks.copy()
        references = nodes.view(np.int32)[:, REFERENCES]
        exists = nodes[:, NODE_ROWS - 1] != -1.0
        references[exists] += np.where(references >= 0, NODE_ROWS * node, -BLOCK_ROWS * leaf_block)[exists]
        numbers = leaf_blocks.view(np.int32)[:, NUMBERS]
        numbers[numbers >= 0] += triangle
        return MovedTrees(nodes, leaf_blocks, tuple(_moved(each, node, leaf_block) for each in self.blas))

    @classmethod
    def of(
        cls,
        nodes: NDArray[np.float32],
        leaf_blocks: NDArray[np.float32],
        blas: Sequence[Blas],
        first: tuple[int, int, int],
    ) -> MovedTrees:
        """Return trees that were built in a scene.

        Args:
            nodes: Their rows of `Bvh.nodes`.
            leaf_blocks: Their rows of `Bvh.leaf_blocks`.
            blas: The tree of each mesh.
            first: Numbers of their first node and leaf block, row of their first triangle.
        """
        present = cls(nodes.reshape(-1, NODE_ROWS, 8), leaf_blocks.reshape(-1, BLOCK_ROWS, 4), tuple(blas))
        node, leaf_block, triangle = first
        return present.moved(-node, -leaf_block, -triangle)


def _moved(blas: Blas, node: int, leaf_block: int) -> Blas:
    """Return a tree whose nodes and leaf blocks have other numbers; an empty one is the same everywhere."""
    if not len(blas.nodes):
        return blas
    nodes = range(blas.nodes.start + node, blas.nodes.stop + node)
    blocks = range(blas.leaf_blocks.start + leaf_block, blas.leaf_blocks.stop + leaf_block)
    entry = blas.entry + NODE_ROWS * node if blas.entry >= 0 else blas.entry - BLOCK_ROWS * leaf_block
    return replace(blas, root=blas.root + NODE_ROWS * node, entry=entry, nodes=nodes, leaf_blocks=blocks)
