# SPDX-License-Identifier: Apache-2.0
"""The light probes of a scene, in memory and on disk. Panoramas of anchors near each other share one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dynamics.lru_cache import LRUCache
from tiscene.render.integrators.panorama.cell_files import CellFiles
from tiscene.render.integrators.panorama.light_probe import PLANE, SIZE, LightProbe, ProbeSampling, trace_probe
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.sampling.cube import FACES
from tiscene.scene.camera import Vector3
from tiscene.scene.placement import Placement

_KEPT = 64  # probes in memory, of a quarter of a megabyte each


class LightProbes:
    """Light probes by their centers.

    Args:
        paths: Path tracer.
        files: Probes on disk; None: none.
    """

    def __init__(self, paths: PathPass, files: CellFiles | None) -> None:
        self._paths, self._files = paths, files
        self._probes: LRUCache[tuple[Any, ...], LightProbe] = LRUCache(_KEPT)

    def at(
        self,
        center: Vector3,
        statics: Sequence[Placement],
        sampling: ProbeSampling,
        *,
        contents: tuple[Any, ...],
        file_key: Callable[[], str],
    ) -> LightProbe:
        """Return the light around a point. Tracing it changes what the scene has placed.

        Args:
            center: The point, world, m.
            statics: The static scene under each light group.
            sampling: How to trace it.
            contents: What distinguishes the static scene from others here.
            file_key: Returns the digest of everything that the cells depend on.
        """
        return self._probes.get(
            (center, sampling, *contents),
            lambda: LightProbe(center, self._cells(center, statics, sampling, file_key)),
        )

    def _cells(
        self, center: Vector3, statics: Sequence[Placement], sampling: ProbeSampling, file_key: Callable[[], str]
    ) -> Any:
        files, columns = self._files, PLANE + 3 * len(statics)
        key = f"{file_key()}-probe" if files else ""
        cells = files.load(key, SIZE * SIZE, columns, np.float32)[1] if files else None
        if cells is None or len(cells) < FACES:
            cells = trace_probe(self._paths, statics, center, sampling)
            if files:
                files.append(key, np.arange(FACES, dtype=np.int32), cells)
        return cells
