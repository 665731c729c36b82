# SPDX-License-Identifier: Apache-2.0
"""BVHCache: trees of the stages that a stream was in last, so that coming back to one of them builds nothing.

With them are kept the arrays of the last scene of each stage, so that meshes and images are not copied again.
"""

from __future__ import annotations

from typing import Any

from tiscene.device import runtime
from tiscene.scene.bvh.obstacle_tree import MeshTrees
from tiscene.scene.description import SceneDescription
from tiscene.stream.view_renderer import ViewRenderer

TREE_BYTES = 1 << 29  # 512 MB


class BVHCache:
    """Trees on the device, by the meshes of a stage.

    Where all together take more than `limit`, arrays that are with them are dropped, then trees: those used least
    recently first.

    Attributes:
        limit: memory limit, bytes.
    """

    def __init__(self) -> None:
        self.limit = TREE_BYTES
        # By the id of a stage's tuple of meshes, which overrides share: that tuple, its trees, and Taichi's session.
        self._kept: dict[int, tuple[Any, MeshTrees, object]] = {}

    @property
    def nbytes(self) -> int:
        """The memory that is used, bytes."""
        return sum(trees.nbytes for _, trees, _ in self._kept.values())

    def get(self, stage: SceneDescription) -> MeshTrees | None:
        """Return the trees of a stage; None if there are none."""
        key, session = id(stage.meshes), runtime.session()
        self._kept = {other: kept for other, kept in self._kept.items() if kept[2] is session}
        if key in self._kept:
            self._kept[key] = self._kept.pop(key)
        for other in self._kept:
            if other != key and self.nbytes > self.limit:
                self._kept[other][1].drop_arrays()
        return self._kept[key][1] if key in self._kept else None

    def keep(self, renderer: ViewRenderer) -> None:
        """Keep the trees of the stage of a renderer that is about to end."""
        stage = renderer.world.stage
        if self.get(stage) is None and (trees := renderer.stage_trees()) is not None:
            self._kept[id(stage.meshes)] = stage.meshes, trees, runtime.session()
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
