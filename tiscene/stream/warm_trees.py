# SPDX-License-Identifier: Apache-2.0
"""WarmTrees: trees of the stages that a stream was in last, so that coming back to one of them builds nothing."""

from __future__ import annotations

import math
from typing import Any, Protocol

from tiscene.device import runtime
from tiscene.scene.bvh.obstacle_tree import MeshTrees
from tiscene.scene.description import SceneDescription

TREE_BYTES = 1 << 29  # 512 MB


class TreeSource(Protocol):
    """What keeping trees needs of a ViewRenderer."""

    world: Any

    def stage_trees(self) -> MeshTrees | None:
        """Return the trees of the stage's meshes alone, if there are any."""


class WarmTrees:
    """Trees on the device, by the meshes of a stage.

    Those used least recently are dropped where all together take more than `limit`.

    Args:
        limit: memory limit, bytes.
    """

    def __init__(self, limit: int = TREE_BYTES) -> None:
        self.limit = limit
        # By the id of a stage's tuple of meshes, which overrides share: that tuple, its trees, and Taichi's session.
        self._kept: dict[int, tuple[Any, MeshTrees, object]] = {}

    @property
    def nbytes(self) -> int:
        """The memory that is used, bytes."""
        return sum(
            _bytes(each) for _, trees, _ in self._kept.values() for each in (trees.bvh.nodes, trees.bvh.leaf_blocks)
        )

    def get(self, stage: SceneDescription) -> MeshTrees | None:
        """Return the trees of a stage; None if there are none."""
        key = id(stage.meshes)
        if key in self._kept and self._kept[key][2] is not runtime.session():
            del self._kept[key]
        if key not in self._kept:
            return None
        self._kept[key] = self._kept.pop(key)
        return self._kept[key][1]

    def keep(self, source: TreeSource) -> None:
        """Keep the trees of the stage of a renderer that is about to end."""
        meshes = source.world.stage.meshes
        if self.get(source.world.stage) is None and (trees := source.stage_trees()) is not None:
            self._kept[id(meshes)] = meshes, trees, runtime.session()
        while self.nbytes > self.limit:
            del self._kept[next(iter(self._kept))]

    def drop(self, stage: SceneDescription) -> None:
        """Forget the trees of a stage."""
        self._kept.pop(id(stage.meshes), None)

    def clear(self) -> None:
        """Forget all trees."""
        self._kept.clear()

    def __getstate__(self) -> dict[str, Any]:
        """Return everything except device arrays."""
        return {"limit": self.limit, "_kept": {}}


def _bytes(array: Any) -> int:
    """Return the memory of a device array of numbers or vectors of 32 bits, bytes."""
    lengths: tuple[int, ...] = (*array.shape, *array.element_shape)
    return 4 * math.prod(lengths)
