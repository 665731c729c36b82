# SPDX-License-Identifier: Apache-2.0
"""Large instances enter the tree over instances in parts, the children of their meshes' roots.

The box of a room's skirting, or of its cables, holds hardly anything: most rays would enter it for nothing. It is one
level of re-braiding (Benthin et al. 2017). What a ray hits is the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

PARTS = 8  # children of a root, at most
MOST_OPENED = 32  # instances that are taken apart
LARGE = 0.02  # those with a box of more than this part of the surface of the box around all

# A leaf of the tree names an instance's row, and in the bits above which part of it, from 1 on; 0 for the whole.
ROW_BITS = 27
ROW_MASK = (1 << ROW_BITS) - 1
INFO_PARTS = 9  # the first of the columns of `instance_info` that say where rays enter the parts


@dataclass(frozen=True)
class SplitInstances:
    """Of each mesh the children of its root. boxes: [n, 8, 2, 3], m. entries: int32 [n, 8], 0 where there is none."""

    boxes: NDArray[np.float64]
    entries: NDArray[np.int32]


def parts_of(nodes: NDArray[np.float32]) -> SplitInstances:
    """Of roots' nodes of the wide layout, float32 [n, 8, 8]."""
    boxes = nodes[:, :6].astype(np.float64).reshape(-1, 2, 3, PARTS)
    entries = np.ascontiguousarray(nodes[:, 6]).view(np.int32)
    return SplitInstances(boxes.transpose(0, 3, 1, 2), entries)


def largest(boxes: NDArray[np.float64]) -> NDArray[np.int64]:
    """Which of the world boxes [n, 6] are worth taking apart, the largest first."""
    areas = _half_areas(boxes)
    around = np.concatenate([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])
    order = np.argsort(-areas, kind="stable")[:MOST_OPENED]
    return order[areas[order] > LARGE * _half_areas(around[None])]


def _half_areas(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, z = (boxes[:, 3:] - boxes[:, :3]).T
    result: NDArray[np.float64] = x * y + y * z + z * x
    return result
