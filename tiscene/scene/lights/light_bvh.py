# SPDX-License-Identifier: Apache-2.0
"""Where rays meet lights: a tree of the boxes about them.

Its nodes are wide: eight boxes are looked at at once, and one eight does not wait for another as a node does for its
parent.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.lights.light_tree import LANES, halved

# A node is one to four eights of members: groups, or lights, then one eight. An eight is EIGHT_ROWS rows of LANES
# numbers: the least x, y, z of each member, the largest; MEMBER: the row where a group's own node begins, or -1 - the
# row of the light; EIGHTS: how many the node has, in all lanes.
LEAST, LARGEST, MEMBER, EIGHTS, EIGHT_ROWS = 0, 3, 6, 7, 8
_MOST_HALVINGS = 5  # 32 members
# The corner of a box where there is no member; finite, as nothing else can be computed with.
_NOWHERE = 1e30

Floats = NDArray[np.float64]


def boxes(least: Floats, largest: Floats, first: int) -> NDArray[np.float32]:
    """The nodes of a tree over the boxes of the lights of rows 0..n-1, [n, 3] each: f32 [m, LANES], the root first.

    first: at which row of a table that will stand.
    """
    if not len(least):
        return np.zeros((0, LANES), np.float32)
    order, starts, halvings = np.arange(len(least)), np.array([0]), 0
    while len(order) > LANES * len(starts):
        order, starts, _ = halved(order, starts, (0.5 * (least + largest)).astype(np.float32))
        halvings += 1
    of = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(order)))
    places = LANES * of + np.arange(len(order)) - starts[of]
    low, high = (np.full((LANES * len(starts), 3), corner) for corner in (_NOWHERE, -_NOWHERE))
    low[places], high[places] = least[order], largest[order]
    child = np.zeros(len(low))
    child[places] = -1.0 - order

    # Of each level, from the root on: how many members its nodes have, how many nodes there are, where they begin.
    upper = -(-halvings // _MOST_HALVINGS)
    members = [1 << len(part) for part in np.array_split(np.arange(halvings), upper)] if upper else []
    members.append(LANES)
    counts = np.cumprod([1, *members[:-1]])
    rows = EIGHT_ROWS * -(-np.array(members) // LANES)
    begins = first + np.cumsum(counts * rows) - counts * rows
    levels = []
    for width, count, size, begin in reversed(list(zip(members, counts, rows, begins, strict=True))):
        levels.append(_nodes(low, high, child, width, size // EIGHT_ROWS))
        low, high = low.reshape(count, width, 3).min(axis=1), high.reshape(count, width, 3).max(axis=1)
        child = begin + size * np.arange(count)
    return np.concatenate(levels[::-1]).astype(np.float32)


def _nodes(low: Floats, high: Floats, child: Floats, width: int, eights: int) -> Floats:
    """Nodes of so many members and eights, [n * eights * EIGHT_ROWS, LANES]."""
    count = len(child) // width
    result = np.zeros((count, EIGHT_ROWS, LANES * eights))
    result[:, LEAST:LARGEST], result[:, LARGEST:MEMBER], result[:, EIGHTS] = _NOWHERE, -_NOWHERE, eights
    result[:, LEAST:LARGEST, :width] = low.reshape(count, width, 3).transpose(0, 2, 1)
    result[:, LARGEST:MEMBER, :width] = high.reshape(count, width, 3).transpose(0, 2, 1)
    result[:, MEMBER, :width] = child.reshape(count, width)
    return result.reshape(count, EIGHT_ROWS, eights, LANES).transpose(0, 2, 1, 3).reshape(-1, LANES)
