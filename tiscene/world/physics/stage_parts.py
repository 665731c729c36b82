# SPDX-License-Identifier: Apache-2.0
"""StageParts: the meshes of a stage as convex parts, each mesh once for each scale."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import Instance, Mesh
from tiscene.world.physics.part_shapes import PartShape
from tiscene.world.physics.parts_cache import PartsCache

Array = NDArray[np.float64]
TOLERANCE = 0.02  # m: how far a part may reach from the surface
TASK = "preparing rigid bodies"
THICKNESS = 0.03  # m: of thin plates, at their back


class StageParts:
    """Convex parts of a stage's meshes.

    Args:
        meshes: the stage's meshes.
        progress: called with what is being prepared and how much of it is done, 0..1; None: nothing is called.
    """

    def __init__(self, meshes: Sequence[Mesh], progress: Callable[[str, float], None] | None) -> None:
        self._meshes = meshes
        self._progress = progress or (lambda task, done: None)
        self._known: dict[tuple[int, bytes], list[PartShape]] = {}
        self._disk: PartsCache | None = None

    def placed(
        self, instances: Sequence[Instance], present: Sequence[bool]
    ) -> list[tuple[int, Array, Sequence[PartShape]]]:
        """Return row, pose [7] and parts of each instance that is present and takes part in collisions."""
        found: list[tuple[int, Array, Sequence[PartShape]]] = []
        size = sum(len(self._meshes[each.mesh].triangles) for each in instances)
        done = 0
        for row, (instance, is_present) in enumerate(zip(instances, present, strict=True)):
            if self._disk is not None and self._disk.is_new:
                self._progress(TASK, done / max(size, 1))
            done += len(self._meshes[instance.mesh].triangles)
            if is_present and instance.collides:
                pose, inner = _pose_and_rest(np.asarray(instance.world_from_object, np.float64))
                parts = self._parts(instance.mesh, inner)
                if parts:
                    found.append((row, pose, parts))
        if self._disk is not None and self._disk.is_new:
            self._progress(TASK, 1.0)
            self._disk.save()
        return found

    def _parts(self, mesh: int, inner: Array) -> list[PartShape]:
        key = mesh, np.round(inner, 9).tobytes()
        if key not in self._known:
            points = self._meshes[mesh].positions.astype(np.float64) @ inner.T
            triangles = np.asarray(self._meshes[mesh].triangles).reshape(-1, 3)
            if np.linalg.det(inner) < 0.0:
                triangles = triangles[:, ::-1]
            self._known[key] = self._of_disk().parts(points[triangles], TOLERANCE, THICKNESS)
        return self._known[key]

    def _of_disk(self) -> PartsCache:
        if self._disk is None:
            digest = hashlib.sha256()
            for mesh in self._meshes:
                digest.update(np.ascontiguousarray(mesh.positions).tobytes())
                digest.update(np.ascontiguousarray(mesh.triangles).tobytes())
            self._disk = PartsCache(digest.digest())
        return self._disk


def _pose_and_rest(matrix: Array) -> tuple[Array, Array]:
    """Return the pose [7] of a transform [4, 4], and the linear part [3, 3] that is left: scale, mirror and shear."""
    left, _, right = np.linalg.svd(matrix[:3, :3])
    rotation = left @ right
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    plain = matrix[:3, :3] / np.maximum(lengths, 1e-300)
    if np.abs(plain.T @ plain - np.eye(3)).max() < 1e-9:
        rotation = plain
    if np.linalg.det(rotation) < 0.0:
        rotation = rotation * np.array([1.0, 1.0, -1.0])
    return np.concatenate([matrix[:3, 3], _quaternion_of(rotation)]), rotation.T @ matrix[:3, :3]


def _quaternion_of(rotation: Array) -> Array:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix (Shepperd 1978)."""
    m = rotation
    diagonal = np.array([np.trace(m), *np.diag(m)])
    largest = int(np.argmax(diagonal))
    if largest == 0:
        q = np.array([1.0 + diagonal[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q = np.empty(4)
        q[0] = m[k, j] - m[j, k]
        q[1 + i] = 1.0 + m[i, i] - m[j, j] - m[k, k]
        q[1 + j], q[1 + k] = m[j, i] + m[i, j], m[k, i] + m[i, k]
    return np.asarray(q / np.linalg.norm(q))
