# SPDX-License-Identifier: Apache-2.0
"""Lights of a base image: sampled as at their maximum intensity, with the intensity of each frame applied per group.

Light selection then does not depend on the frame, so cached paths stay valid while lights change their intensity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tiscene.device.memory import upload
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.lights.light_groups import LightGroups
from tiscene.scene.lights.light_table import RADIANCE, LightArrays


class BaseLights:
    """The lights that a DeviceScene has placed. Emissive movers are not sampled, only hit.

    Args:
        scene: The scene, as placed without the movers.
        groups: Light groups; None: one group of all lights.

    Attributes:
        groups: Number of groups.
    """

    def __init__(self, scene: DeviceScene, groups: LightGroups | None) -> None:
        self._arrays = scene.lights.arrays(scene.textures)
        self._values = self._arrays.values.to_numpy()
        self._rows = scene.lights.rows()
        self._group = np.zeros(len(self._rows), int) if groups is None else np.array(groups.group)
        self.groups = 1 if groups is None else len(groups.factors)

    def scaled(self, factors: NDArray[np.float32]) -> LightArrays:
        """Return the lights with the radiance of each group multiplied.

        Args:
            factors: float32 [groups, 3], factors of red, green and blue.
        """
        if self.groups == 1:
            return self._arrays
        values = self._values.copy()
        values[self._rows, RADIANCE : RADIANCE + 3] *= factors[self._group]
        return self._arrays._replace(values=upload(values))

    def only(self, group: int) -> LightArrays:
        """Return the lights with the radiance of all but one group set to zero. Emissive meshes are in group 0."""
        return self.scaled(np.repeat(np.eye(self.groups, dtype=np.float32)[group][:, None], 3, axis=1))
