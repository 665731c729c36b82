# SPDX-License-Identifier: Apache-2.0
"""Trees of meshes in the layout "bvh2": large ranges split by all threads together, nodes numbered on the host."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.memory import device_array, upload
from tiscene.device.prefix_sums import SCAN_BLOCKS, scans_in_blocks
from tiscene.errors import DeviceError
from tiscene.scene.bvh import large_range_kernels as kernels
from tiscene.scene.bvh.build_kernels import BINS, STACK
from tiscene.scene.bvh.instance_tree import as_bits, empty_nodes

LARGE = 512  # primitives of a range from which on all threads split it


class Primitives(NamedTuple):
    """Primitives on the device.

    Attributes:
        boxes: Their boxes, [n, 6].
        order: Their numbers, [n].
    """

    boxes: Any
    order: Any


def split_large(
    boxes: NDArray[np.float32],
    order: NDArray[np.int32],
    ranges: NDArray[np.int32],
    node_box: Any,
    node_link: Any,
    sah_depth: int,
    block: int,
) -> tuple[Primitives, NDArray[np.int32]]:
    """Split ranges until none has more than LARGE primitives.

    Args:
        boxes: Boxes of the primitives, [n, 6].
        order: Primitives, [n].
        ranges: Rows of (slot, begin, end, depth), [m, 4].
        node_box: Device array, see `large_range_kernels.choose_splits`.
        node_link: Device array, see there.
        sah_depth: See there.
        block: See there.

    Returns:
        The primitives in another order, and the ranges that remain.
    """
    count = len(order)
    here = Primitives(upload(boxes), upload(order))
    if not (ranges[:, 2] - ranges[:, 1] > LARGE).any():
        return here, ranges
    there = Primitives(device_array(ti.f32, (count, 6)), device_array(ti.i32, count))  # where the next level goes
    before, bin_numbers = device_array(ti.i32, count + 1 + SCAN_BLOCKS), device_array(ti.i32, count)
    small = []
    while True:
        is_large = ranges[:, 2] - ranges[:, 1] > LARGE
        small.append(ranges[~is_large])
        ranges = ranges[is_large]
        if not len(ranges):
            return here, np.concatenate(small)
        numbers = np.full(count, -1, np.int32)
        for number, (_, begin, end, _) in enumerate(ranges.tolist()):
            numbers[begin:end] = number
        owner, rows = upload(numbers), upload(ranges)
        bounds = device_array(ti.f32, (len(ranges), kernels.BOUNDS))
        splits = device_array(ti.i32, (len(ranges), kernels.SPLITS))
        counts, bins = device_array(ti.i32, (len(ranges), 3 * BINS)), device_array(ti.f32, (len(ranges), 3 * BINS, 6))
        kernels.bound_ranges(here.boxes, owner, len(ranges), bounds)
        kernels.bin_ranges(here.boxes, owner, len(ranges), bounds, bin_numbers, counts, bins)
        kernels.choose_splits(rows, len(ranges), bounds, counts, bins, splits, node_box, node_link, sah_depth, block)
        kernels.part_ranges(*here, owner, rows, bin_numbers, splits, before, *there, scans_in_blocks())
        here, there = there, here
        slot, begin, end, depth = ranges.T
        middle = splits.to_numpy()[:, kernels.MIDDLE]
        left = np.stack([slot + 1, begin, middle, depth + 1], axis=1)
        right = np.stack([slot + 2 * (middle - begin), middle, end, depth + 1], axis=1)
        ranges = np.concatenate([left, right])


def numbered_nodes(
    node_box: NDArray[np.float32], node_link: NDArray[np.int32], roots: NDArray[np.integer]
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Number the nodes of binary trees depth first, tree after tree.

    Args:
        node_box: Boxes of the binary nodes, by slot.
        node_link: Links of the binary nodes, by slot (`build_kernels.grow`).
        roots: Slot of each tree's root, ascending.

    Returns:
        The nodes, float32 [n, 16]: two boxes (lowest x, y, z, highest x, y, z), two references (bits of int32), two
        unused. A reference is an inner node, or -1 - (4 * first row + rows - 1) of a leaf. And for each tree, the
        numbers of nodes and of primitives up to it, and the most entries that the traversal of any tree can have on the
        stack, int32 [trees, 3].

    Raises:
        DeviceError: The links form no trees.
    """
    inner = [level := roots[node_link[roots, 0] >= 0]]
    while len(level):
        level = node_link[level, :2].ravel()
        level = level[node_link[level, 0] >= 0]
        inner.append(level)
        if len(level) > len(node_link) or len(inner) > STACK:
            raise DeviceError("the device built a tree whose nodes form a cycle: its kernels do not work")
    single = roots[node_link[roots, 0] < 0]  # a tree of one leaf
    slots = np.sort(np.concatenate([*inner, single]))  # a node's slot is before those below it
    number_of_slot = np.zeros(len(node_link), np.int32)
    number_of_slot[slots] = np.arange(len(slots))
    nodes = empty_nodes(len(slots))
    references = np.zeros((len(slots), 2), np.int32)
    is_inner = node_link[slots, 0] >= 0
    for side in range(2):
        child = np.where(is_inner, node_link[slots, side], slots if side == 0 else -1)
        exists = child >= 0
        first, count = node_link[child, 2], node_link[child, 3]
        reference = np.where(node_link[child, 0] >= 0, number_of_slot[child], -4 * first - count)
        references[exists, side] = reference[exists]
        nodes[exists, 6 * side : 6 * side + 6] = node_box[child[exists]]
    nodes[:, 12:14] = as_bits(references)
    found = np.zeros((len(roots), 3), np.int32)
    found[:, 0] = np.searchsorted(slots, np.append(roots[1:], len(node_link)))
    found[:, 1] = np.cumsum(node_link[roots, 3])
    found[:, 2] = len(inner) - 1
    return nodes, found


def placed_nodes(nodes: NDArray[np.float32], first_node: int, first_row: int) -> NDArray[np.float32]:
    """Return nodes with references from a node and a row of triangles on, in place of 0."""
    placed = nodes.copy()
    references = placed[:, 12:14].view(np.int32)
    references[references > 0] += first_node
    references[references < 0] -= 4 * first_row
    return placed
