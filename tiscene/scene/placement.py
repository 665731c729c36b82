# SPDX-License-Identifier: Apache-2.0
"""Where every instance is around one frame: the only thing that changes between the frames of a stream."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import Light
from tiscene.scene.lights.light_groups import LightGroups

PREVIOUS, CURRENT, NEXT = 0, 1, 2
MOVERS = 3  # no time: the tree over some of the instances at CURRENT


@dataclass(frozen=True, eq=False)
class Placement:
    """Instances at the frames k-1, k and k+1 (axis 0 of `world_from_object` and `present`), in the order of their ids.

    mesh: int32 [n], rows of the device scene's meshes.
    instance_id: int32 [n], the label, 1 and up; parts of one object share it.
    category_id: int32 [n], 0 for none.
    world_from_object: float64 [3, n, 3, 4], m.
    box_from_object: float64 [n, 3, 4], maps the mesh's space to its object's bounding box, 0..1.
    present: bool [3, n], False where the instance does not exist (not yet spawned, despawned).
    lights: those that shine now, each after the row of the description, in the order of `DeviceScene.add`, whose
    textures it reads; None: all that were added, as they were.
    light_groups: the same lights, their brightness told apart; None: all that were added.
    part: int32 [n], the number of the first of its object's parts that the instance shows; None: 0 everywhere.
    seconds: float64 [3], the times k-1, k and k+1, for meshes that deform, s.
    """

    mesh: NDArray[np.int32]
    instance_id: NDArray[np.int32]
    category_id: NDArray[np.int32]
    world_from_object: NDArray[np.float64]
    box_from_object: NDArray[np.float64]
    present: NDArray[np.bool_]
    lights: tuple[tuple[int, Light], ...] | None = None
    part: NDArray[np.int32] | None = None
    seconds: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    light_groups: LightGroups | None = None
