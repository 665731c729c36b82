# SPDX-License-Identifier: Apache-2.0
"""Split large instances in the TLAS into the children of their meshes' roots: one level of re-braiding.

The bounding box of a room's skirting or cables is mostly empty, and most rays that enter it miss (Benthin et al.,
"Improved Two-Level BVHs using Partial Re-Braiding", 2017). Hits are the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.affine_maps import transformed_boxes

PARTS = 8  # children of a root, at most
MAX_SPLIT = 32  # instances that are split, at most
MIN_AREA = 0.02  # of their boxes, as a fraction of the surface area of the box around all instances

# A leaf of the TLAS holds an instance's row, and in the bits above it the part, from 1 on; 0 for the whole instance.
ROW_BITS = 27
ROW_MASK = (1 << ROW_BITS) - 1
INFO_PARTS = 9  # first of the columns of `instance_info` with the references of the parts


@dataclass(frozen=True)
class SplitInstances:
    """The children of the roots of n meshes.

    Attributes:
        boxes: float64 [n, 8, 2, 3], object space, m.
        entries: int32 [n, 8], references; 0 for no child.
    """

    boxes: NDArray[np.float64]
    entries: NDArray[np.int32]

    def split(
        self, boxes: NDArray[np.float64], rows: NDArray[np.int32], meshes: NDArray[np.int32], matrices: NDArray[Any]
    ) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Return boxes and names for the leaves of a TLAS, of the parts of large instances in place of their own.

        Args:
            boxes: float64 [i, 6], world boxes of instances, m.
            rows: int32 [i], their rows.
            meshes: int32 [i], their meshes.
            matrices: float64 [i, 3, 4], their transforms, m.
        """
        large = instances_to_split(boxes)
        large = large[self.entries[meshes[large]].any(axis=1)]
        own = self.boxes[meshes[large]].swapaxes(0, 1)
        part_boxes = transformed_boxes(own, np.repeat(matrices[large][None], PARTS, axis=0))
        names = rows[large] | np.arange(1, PARTS + 1, dtype=np.int32)[:, None] << ROW_BITS
        real = self.entries[meshes[large]].T != 0
        left = np.delete(np.arange(len(rows)), large)
        return np.concatenate([boxes[left], part_boxes[real]]), np.concatenate([rows[left], names[real]])


def root_children(nodes: NDArray[np.float32]) -> SplitInstances:
    """Return the children of root nodes of the layout "bvh8", float32 [n, 8, 8]."""
    boxes = nodes[:, :6].astype(np.float64).reshape(-1, 2, 3, PARTS)
    entries = np.ascontiguousarray(nodes[:, 6]).view(np.int32)
    return SplitInstances(boxes.transpose(0, 3, 1, 2), entries)


def instances_to_split(boxes: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the rows of the world boxes [n, 6] that are worth splitting, the largest first."""
    areas = _half_areas(boxes)
    bounds = np.concatenate([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])
    order = np.argsort(-areas, kind="stable")[:MAX_SPLIT]
    return order[areas[order] > MIN_AREA * _half_areas(bounds[None])]


def _half_areas(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, z = (boxes[:, 3:] - boxes[:, :3]).T
    result: NDArray[np.float64] = x * y + y * z + z * x
    return result
