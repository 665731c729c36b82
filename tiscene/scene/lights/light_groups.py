# SPDX-License-Identifier: Apache-2.0
"""Static lights with per-group intensity factors, for incremental rendering.

Light transport is linear: an image of each group at its reference intensity, times the group's current factors, summed,
is the image under all lights.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.scene.description import Color, DistantLight, Light


@dataclass(frozen=True, eq=False)
class LightGroups:
    """Lights that differ between frames by their intensity alone.

    Attributes:
        lights: As `Placement.lights`, each at its maximum radiance.
        group: Group of each light. The lights of group 0 never change.
        factors: float32 [groups, 3], of red, green and blue; the current emission over the maximum.
    """

    lights: tuple[tuple[int, Light], ...]
    group: tuple[int, ...]
    factors: NDArray[np.float32]

    def only_group(self, group: int) -> tuple[tuple[int, Light], ...]:
        """Return all lights, with the emission of those of other groups set to zero."""
        return tuple(
            (row, light if number == group else with_emission(light, (0.0, 0.0, 0.0)))
            for (row, light), number in zip(self.lights, self.group, strict=True)
        )


def emission_of(light: Light) -> Color:
    """Return a light's radiance, W/m²/sr; of a point the intensity, W/sr; of a distant light the irradiance, W/m²."""
    color: Color = getattr(light, _emission_field(light))
    return color


def with_emission(light: Light, color: Color) -> Light:
    """Return the light with another emission, in the units of `emission_of`."""
    field: dict[str, Any] = {_emission_field(light): color}
    return replace(light, **field)


def _emission_field(light: Light) -> str:
    return "irradiance" if isinstance(light, DistantLight) else "radiance"
