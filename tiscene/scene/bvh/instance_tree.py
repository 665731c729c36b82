# SPDX-License-Identifier: Apache-2.0
"""Trees over instances in the layout "bvh2", built on the host.

The kernels of `build_kernels` build a tree over a few hundred instances in one thread, which a GPU takes tens of
milliseconds for, at every frame. Here trees are built level by level, with NumPy: each range of instances is halved at
the median of its centers along the axis in which they extend most. Where few instances have moved since, a tree keeps
its topology and is refitted. Rays find the same hits in any tree.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynamics.lru_cache import LRUCache

NODE_COLUMNS = 16
TOPOLOGIES = 4  # that are kept; more trees at once, those of several frames, are built together
GROWTH = 1.1  # of the surface area of all boxes, up to which a tree keeps its topology


class InstanceTrees:
    """Builds trees over instances, or refits earlier trees over the same instances."""

    def __init__(self) -> None:
        self._topologies: LRUCache[bytes, TreeTopology] = LRUCache(TOPOLOGIES)  # by the names of the instances

    def build(
        self, trees: Sequence[tuple[NDArray[np.float32], NDArray[np.int32]]], roots: Sequence[int]
    ) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Return the nodes of trees, and their numbers, as `median_trees` does.

        Args:
            trees: Boxes and rows of the instances of each.
            roots: Number of each tree's root.
        """
        if len(trees) > TOPOLOGIES:
            sizes = np.array([len(rows) for _, rows in trees])
            boxes, rows = (np.concatenate(parts) for parts in zip(*trees, strict=True))
            return median_trees(boxes, rows, np.cumsum(sizes) - sizes, np.array(roots))
        nodes = [
            self._topologies.get(rows.tobytes(), TreeTopology).nodes(boxes, rows, root)
            for (boxes, rows), root in zip(trees, roots, strict=True)
        ]
        numbers = [root + np.arange(len(each)) for each, root in zip(nodes, roots, strict=True)]
        return np.concatenate(nodes), np.concatenate(numbers)


class TreeTopology:
    """Which nodes and leaves are below each node of a tree over some instances."""

    def __init__(self) -> None:
        self._area = -np.inf  # of the boxes of all nodes when they were built, m²

    def nodes(self, boxes: NDArray[np.float32], rows: NDArray[np.int32], root: int) -> NDArray[np.float32]:
        """Return the nodes of a tree in the order of their numbers, float32 [m, 16].

        Args:
            boxes: float32 [n, 6], world boxes, m.
            rows: int32 [n], names of the instances, each another one; the same in every call.
            root: Number of the root.
        """
        if self._area >= 0.0:
            pairs, area = self._fitted(boxes)
            if area <= GROWTH * self._area:
                nodes = empty_nodes(len(pairs))
                nodes[:, :12] = pairs.reshape(-1, 12)
                nodes[:, 12:14] = as_bits(self._links + root * self._is_inner)
                return nodes
        found, numbers = median_trees(boxes, rows, np.zeros(1, np.int64), np.array([root]))
        nodes = found[np.argsort(numbers)]
        if len(rows) > 1:
            self._keep(nodes, boxes, rows, root)
        return nodes

    def _keep(self, nodes: NDArray[np.float32], boxes: NDArray[np.float32], rows: NDArray[np.int32], root: int) -> None:
        """Keep the topology of a tree."""
        count, order = len(rows), np.argsort(rows)
        self._links = nodes[:, 12:14].view(np.int32).astype(np.int64)
        self._is_inner = self._links > 0
        self._links -= root * self._is_inner
        leaves = order[np.searchsorted(rows[order], (-1 - self._links) // 4).clip(0, count - 1)]
        # Rows of the boxes of the instances, then of those of the nodes.
        self._children = np.where(self._is_inner, count + self._links, leaves)
        self._levels = [np.zeros(1, np.int64)]
        while len(below := self._links[self._levels[-1]][self._is_inner[self._levels[-1]]]):
            self._levels.append(below)
        self._area = self._fitted(boxes)[1]

    def _fitted(self, boxes: NDArray[np.float32]) -> tuple[NDArray[np.float32], float]:
        """Return the boxes of each node's children, float32 [n - 1, 2, 6], and the area of all nodes' boxes, m²."""
        count = len(boxes)
        every = np.concatenate([boxes, np.empty((count - 1, 6), np.float32)])
        pairs = np.empty((count - 1, 2, 6), np.float32)
        for level in reversed(self._levels):
            pairs[level] = pair = every[self._children[level]]
            every[count + level, :3] = np.minimum(pair[:, 0, :3], pair[:, 1, :3])
            every[count + level, 3:] = np.maximum(pair[:, 0, 3:], pair[:, 1, 3:])
        with np.errstate(over="ignore"):  # of huge boxes
            x, y, z = (every[count:, 3:] - every[count:, :3]).T
            return pairs, 2.0 * float((x * y + y * z + z * x).sum())


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
