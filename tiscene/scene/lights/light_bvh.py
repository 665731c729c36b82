# SPDX-License-Identifier: Apache-2.0
"""Bounding volume hierarchy over the lights that rays can hit.

Lights are intersected separately from the scene BVH. Boxes are stored in blocks of eight, which a SIMD kernel tests at
once; an inner node has up to four blocks, which are independent of each other, and a leaf node has one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.lights.light_tree import LANES, split_groups

# Rows of a block, with a lane for each child. BOX_MIN (3), BOX_MAX (3): its box, m. REFERENCE: the row where the child
# node begins, or -1 - row of a light in the light table. BLOCKS: number of blocks of the node, in all lanes.
BOX_MIN, BOX_MAX, REFERENCE, BLOCKS, BLOCK_ROWS = 0, 3, 6, 7, 8
_MAX_SPLITS = 5  # of one node: 32 children
_EMPTY = 1e30  # m, minimum of the box of an empty lane, and minus its maximum; finite, since SIMD code computes with it

Floats = NDArray[np.float64]


def build(lower: Floats, upper: Floats, first: int) -> NDArray[np.float32]:
    """Build a BVH.

    Args:
        lower: [n, 3], m, minimum corners of the boxes of the lights in rows 0..n-1 of the light table.
        upper: [n, 3], m, maximum corners.
        first: Row of the device table at which the result is stored.

    Returns:
        float32 [m, LANES], the root first.
    """
    if not len(lower):
        return np.zeros((0, LANES), np.float32)
    order, starts, splits = np.arange(len(lower)), np.array([0]), 0
    while len(order) > LANES * len(starts):
        order, starts, _ = split_groups(order, starts, (0.5 * (lower + upper)).astype(np.float32))
        splits += 1
    of = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(order)))
    slots = LANES * of + np.arange(len(order)) - starts[of]
    low, high = (np.full((LANES * len(starts), 3), corner) for corner in (_EMPTY, -_EMPTY))
    low[slots], high[slots] = lower[order], upper[order]
    child = np.zeros(len(low))
    child[slots] = -1.0 - order

    # Of each level, from the root down: children of a node, number of nodes, rows of a node, first row.
    inner_levels = -(-splits // _MAX_SPLITS)
    widths = [1 << len(part) for part in np.array_split(np.arange(splits), inner_levels)] if inner_levels else []
    widths.append(LANES)
    counts = np.cumprod([1, *widths[:-1]])
    rows = BLOCK_ROWS * -(-np.array(widths) // LANES)
    begins = first + np.cumsum(counts * rows) - counts * rows
    levels = []
    for width, count, size, begin in reversed(list(zip(widths, counts, rows, begins, strict=True))):
        levels.append(_nodes(low, high, child, width, size // BLOCK_ROWS))
        low, high = low.reshape(count, width, 3).min(axis=1), high.reshape(count, width, 3).max(axis=1)
        child = begin + size * np.arange(count)
    return np.concatenate(levels[::-1]).astype(np.float32)


def _nodes(low: Floats, high: Floats, child: Floats, width: int, blocks: int) -> Floats:
    """Return nodes of `width` children each in `blocks` blocks, [n * blocks * BLOCK_ROWS, LANES]."""
    count = len(child) // width
    result = np.zeros((count, BLOCK_ROWS, LANES * blocks))
    result[:, BOX_MIN:BOX_MAX], result[:, BOX_MAX:REFERENCE], result[:, BLOCKS] = _EMPTY, -_EMPTY, blocks
    result[:, BOX_MIN:BOX_MAX, :width] = low.reshape(count, width, 3).transpose(0, 2, 1)
    result[:, BOX_MAX:REFERENCE, :width] = high.reshape(count, width, 3).transpose(0, 2, 1)
    result[:, REFERENCE, :width] = child.reshape(count, width)
    return result.reshape(count, BLOCK_ROWS, blocks, LANES).transpose(0, 2, 1, 3).reshape(-1, LANES)
