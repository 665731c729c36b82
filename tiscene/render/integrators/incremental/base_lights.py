# SPDX-License-Identifier: Apache-2.0
"""The lights of a base: chosen as when all of them are at their brightest, and shining as they do in a frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tiscene.device.memory import upload
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.lights.light_groups import LightGroups
from tiscene.scene.lights.light_table import RADIANCE, LightArrays


class BaseLights:
    """What a DeviceScene has placed: the lights of the groups, or if there are none, one group of all.

    Of what moves and emits there is nothing: that is met, not sampled.
    """

    def __init__(self, scene: DeviceScene, groups: LightGroups | None) -> None:
        self._arrays = scene.lights.arrays(scene.textures)
        self._values = self._arrays.values.to_numpy()
        self._rows = scene.lights.rows()
        self._group = np.zeros(len(self._rows), int) if groups is None else np.array(groups.group)
        self.groups = 1 if groups is None else len(groups.factors)

    def shining(self, factors: NDArray[np.float32]) -> LightArrays:
        """So much of each group's red, green and blue, [groups, 3]."""
        if self.groups == 1:
            return self._arrays
        values = self._values.copy()
        values[self._rows, RADIANCE : RADIANCE + 3] *= factors[self._group]
        return self._arrays._replace(values=upload(values))

    def alone(self, group: int) -> LightArrays:
        """One group; meshes that emit are of group 0."""
        return self.shining(np.repeat(np.eye(self.groups, dtype=np.float32)[group][:, None], 3, axis=1))
