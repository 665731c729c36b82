# SPDX-License-Identifier: Apache-2.0
"""Rays between pairs of points of a static scene, and the placement of its instances."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tiscene.render.intersect.ray_queue import RayWave
from tiscene.scene.description import Instance
from tiscene.scene.placement import Placement

Array = NDArray[np.float64]


def static_placement(instances: Sequence[Instance], present: NDArray[np.bool_]) -> Placement:
    """Return the placement of instances that stand still; their ids are 1, 2, ...

    Args:
        instances: one or more.
        present: bool [3, n], at which of PREVIOUS, CURRENT and NEXT each is there.
    """
    count = len(instances)
    matrices = np.array([each.world_from_object[:3] for each in instances])
    return Placement(
        mesh=np.array([each.mesh for each in instances], np.int32),
        instance_id=np.arange(1, count + 1, dtype=np.int32),
        category_id=np.zeros(count, np.int32),
        world_from_object=np.broadcast_to(matrices, (3, count, 3, 4)).copy(),
        box_from_object=np.broadcast_to(np.eye(4)[:3], (count, 3, 4)).copy(),
        present=present,
    )


def segment_rays(wave: RayWave, starts: Array, ends: Array, part: float = 1.0) -> RayWave:
    """Return the wave with a ray in each of its first rows, from a start towards its end.

    Args:
        wave: resized if it has fewer rows.
        starts: float64 [n, 3], m.
        ends: float64 [n, 3], m.
        part: length of the rays, as a fraction of the distance.
    """
    count = len(starts)
    wave = wave.reserved(count)
    offset = ends - starts
    length = np.linalg.norm(offset, axis=1)
    rays = np.zeros((*wave.rays.shape, 8), np.float32)
    rays[:count, :3] = starts
    rays[:count, 4:7] = offset / np.maximum(length, 1e-12)[:, None]
    rays[:count, 7] = length * part
    wave.rays.from_numpy(rays)
    return wave
