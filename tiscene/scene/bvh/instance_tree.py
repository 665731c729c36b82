# SPDX-License-Identifier: Apache-2.0
"""Trees over instances in the layout "bvh2", built on the host.

The kernels of `build_kernels` build a tree over a few hundred instances in one thread, which a GPU takes tens of
milliseconds for, at every frame. Here all trees of a frame are built together, level by level, with NumPy: each range
of instances is halved at the median of its centers along the axis in which they extend most. Rays find the same hits
in any tree.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NODE_COLUMNS = 16


def median_trees(
    boxes: NDArray[np.float32], rows: NDArray[np.int32], starts: NDArray[np.int64], first_nodes: NDArray[np.int64]
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Build binary trees, each over the boxes from one of `starts` to the next.

    Args:
        boxes: float32 [n, 6], world boxes, m.
        rows: int32 [n], names of the instances in the leaves.
        starts: int64 [t], first box of each tree; no tree is empty.
        first_nodes: int64 [t], number of each tree's root; its other nodes follow, depth first.

    Returns:
        The nodes as `binary_trees.numbered_nodes` describes them, float32 [m, 16], and their numbers, int64 [m].
    """
    begin, end = starts, np.append(starts[1:], len(rows))
    sizes = end - begin
    order = np.arange(len(rows))
    centers = boxes[:, :3] + boxes[:, 3:]
    bits = centers.view(np.int32)
    keys = np.where(bits < 0, bits ^ 0x7FFFFFFF, bits).astype(np.int64)  # integers in the order of the numbers
    nodes, numbers = [], []
    single = sizes == 1
    if single.any():
        leaves = empty_nodes(int(single.sum()))
        leaves[:, :6], leaves[:, 12] = boxes[begin[single]], as_bits(_leaf(rows[begin[single]]))
        nodes.append(leaves)
        numbers.append(first_nodes[single])
    begin, end, number = begin[~single], end[~single], first_nodes[~single]
    while len(begin):
        sizes = end - begin
        offsets = np.cumsum(sizes) - sizes
        owner = np.repeat(np.arange(len(begin)), sizes)
        places = np.arange(len(owner)) + (begin - offsets)[owner]
        here = order[places]
        center = centers[here]
        extent = np.maximum.reduceat(center, offsets) - np.minimum.reduceat(center, offsets)
        here = here[np.argsort((owner << 32) + keys[here, extent.argmax(axis=1)[owner]])]
        order[places] = here
        middle = (begin + end) // 2
        halves = np.stack([offsets, offsets + middle - begin], axis=1).ravel()
        low = np.minimum.reduceat(boxes[here, :3], halves)
        high = np.maximum.reduceat(boxes[here, 3:], halves)
        left, right = number + 1, number + middle - begin
        found = empty_nodes(len(begin))
        found[:, :12] = np.concatenate([low, high], axis=1).reshape(-1, 12)
        is_leaf = np.stack([middle - begin == 1, end - middle == 1], axis=1)
        names = _leaf(rows[order[np.stack([begin, middle], axis=1)]])
        found[:, 12:14] = as_bits(np.where(is_leaf, names, np.stack([left, right], axis=1)))
        nodes.append(found)
        numbers.append(number)
        inner = ~is_leaf.T
        begin, end, number = (
            np.concatenate([a[inner[0]], b[inner[1]]]) for a, b in ((begin, middle), (middle, end), (left, right))
        )
    return np.concatenate([empty_nodes(0), *nodes]), np.concatenate([np.zeros(0, np.int64), *numbers])


def node_count(instances: int) -> int:
    """Return the number of nodes of a tree over a number of instances."""
    return max(instances - 1, 1) if instances else 0


def empty_nodes(count: int) -> NDArray[np.float32]:
    """Return nodes without children: boxes that no ray hits, in any direction."""
    nodes = np.zeros((count, NODE_COLUMNS), np.float32)
    nodes[:, :12] = np.inf
    return nodes


def _leaf(rows: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the references of leaves with one instance each."""
    return -1 - 4 * rows


def as_bits(references: NDArray[np.integer]) -> NDArray[np.float32]:
    return np.ascontiguousarray(references, np.int32).view(np.float32)
