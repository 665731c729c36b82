# SPDX-License-Identifier: Apache-2.0
"""Lights that stand still and only shine more or less, in groups: light adds up, so that it is enough to trace what
each of them gives once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import DistantLight, Light

Color = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class LightGroups:
    """Lights that are always the same but for how much they shine, which is told apart.

    lights: as `Placement.lights`, each as bright as it ever is. group: of each its number; those of group 0 never
    change. factors: float32 [groups, 3], how much of that red, green and blue there is now.
    """

    lights: tuple[tuple[int, Light], ...]
    group: tuple[int, ...]
    factors: NDArray[np.float32]

    def alone(self, group: int) -> tuple[tuple[int, Light], ...]:
        """The lights with only those of one group shining."""
        return tuple(
            (row, light if number == group else shining(light, (0.0, 0.0, 0.0)))
            for (row, light), number in zip(self.lights, self.group, strict=True)
        )


def shine(light: Light) -> Color:
    """How much a light shines: its radiance (of a distant light the irradiance)."""
    color: Color = getattr(light, _field(light))
    return color


def shining(light: Light, color: Color) -> Light:
    """The light with another radiance (of a distant light, irradiance)."""
    field: dict[str, Any] = {_field(light): color}
    return replace(light, **field)


def _field(light: Light) -> str:
    return "irradiance" if isinstance(light, DistantLight) else "radiance"
