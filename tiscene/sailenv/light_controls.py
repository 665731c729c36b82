# SPDX-License-Identifier: Apache-2.0
"""The lights of a scene by SAILenv's names, in its terms: 8-bit sRGB colors, 1 for the intensity the scene has."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError, LightNotFound
from tiscene.sailenv.json_messages import bounded
from tiscene.sailenv.unity_coordinates import mirrored
from tiscene.scene.camera import Vector3
from tiscene.scene.color import decode_srgb, encode_srgb
from tiscene.scene.description import DiskLight, DistantLight, DomeLight, Light, RectLight, SphereLight
from tiscene.scene.lights.light_groups import shine, shining

BRIGHTEST = 1e9  # times what the scene has
Color8 = tuple[int, int, int]
TYPES: dict[type, str] = {DistantLight: "Directional", DiskLight: "Disc", RectLight: "Rectangle", SphereLight: "Point"}


@dataclass
class NamedLight:
    """A light and what was done to it.

    row: its place among the stage's lights. peak: the greatest part of its radiance that is intensity 1.
    """

    row: int
    light: Light
    peak: float
    color: Color8
    intensity: float = 1.0
    indirect: float = 1.0

    def described(self) -> Light:
        """The light as it is now."""
        r, g, b = (component * self.peak * self.intensity for component in linear(self.color))
        return replace(shining(self.light, (r, g, b)), indirect=self.indirect)


class LightControls:
    """Get and set, by name. Names: SAILenv's for the first two that are no sky, then the stage's own for the others.

    Every scene understands "Main Light", "Rim Light" and "Directional Light", whichever it lists.
    """

    def __init__(
        self, stage_lights: Sequence[Light], listed: Sequence[str], change: Callable[[int, Light], None]
    ) -> None:
        """listed: SAILenv's names in this scene. change: is told the row of a light and what it is from now on."""
        self._change = change
        rows = [row for row, light in enumerate(stage_lights) if not isinstance(light, DomeLight)]
        rows = rows or list(range(len(stage_lights)))
        self._lights = [_named(row, stage_lights[row]) for row in rows]
        own = [each.light.name for each in self._lights]
        self.names = [*listed[: len(own)], *own[len(listed) :]]
        self._by_name = {name.casefold(): light for name, light in zip(own, self._lights, strict=True)}
        for name, number in (("Main Light", 0), ("Directional Light", 0), ("Rim Light", 1)):
            if self._lights:
                self._by_name[name.casefold()] = self._lights[min(number, len(self._lights) - 1)]

    def find(self, name: str) -> NamedLight:
        """Raises LightNotFound."""
        light = self._by_name.get(str(name).strip().casefold())
        if light is None:
            raise LightNotFound("light", name, self.names)
        return light

    def color(self, name: str) -> Color8:
        """8-bit sRGB."""
        return self.find(name).color

    def set_color(self, name: str, color: Sequence[int]) -> None:
        """Values beyond 0..255 count as those."""
        light = self.find(name)
        light.color = clipped(color)
        self._changed(light)

    def intensity(self, name: str) -> float:
        """1: as the scene has it."""
        return self.find(name).intensity

    def set_intensity(self, name: str, intensity: float) -> None:
        """Less than 0 counts as 0. Raises ArgumentError too for a number out of bounds, as the following do."""
        light = self.find(name)
        light.intensity = _factor(intensity)
        self._changed(light)

    def indirect_multiplier(self, name: str) -> float:
        """1: as the scene has it."""
        return self.find(name).indirect

    def set_indirect_multiplier(self, name: str, multiplier: float) -> None:
        """Of what the light gives to surfaces that are seen by way of others. Less than 0 counts as 0."""
        light = self.find(name)
        light.indirect = _factor(multiplier)
        self._changed(light)

    def position(self, name: str) -> Vector3:
        """Unity's space, m."""
        x, y, z = self.find(name).light.world_from_light[:3, 3].tolist()
        return mirrored((x, y, z))

    def set_position(self, name: str, position: Vector3) -> None:
        """Of no effect on what shines from infinity."""
        light = self.find(name)
        matrix = light.light.world_from_light.copy()
        matrix[:3, 3] = mirrored(bounded(position))
        light.light = replace(light.light, world_from_light=matrix)
        self._changed(light)

    def direction(self, name: str) -> Vector3:
        """Where its light goes, Unity's space, a unit vector."""
        x, y, z = (-self.find(name).light.world_from_light[:3, 2]).tolist()
        return mirrored((x, y, z))

    def set_direction(self, name: str, direction: Vector3) -> None:
        """Of no effect on what shines in all directions, and on the sky. A direction of no length changes nothing."""
        light = self.find(name)
        bounded(direction)
        if math.hypot(*direction) < 1e-9 or isinstance(light.light, DomeLight):
            return
        matrix = light.light.world_from_light.copy()
        matrix[:3, :3] = _axes_towards(np.array(mirrored(direction)))
        light.light = replace(light.light, world_from_light=matrix)
        self._changed(light)

    def type(self, name: str) -> str:
        """Unity's name for the kind of light."""
        return TYPES.get(type(self.find(name).light), "Area")

    def _changed(self, light: NamedLight) -> None:
        self._change(light.row, light.described())


def linear(color: Sequence[int]) -> tuple[float, float, float]:
    """Scene-linear values of 8-bit sRGB."""
    r, g, b = decode_srgb(np.asarray(color, np.float64) / 255.0).tolist()
    return (r, g, b)


def whole(color: Sequence[int]) -> Color8:
    """Three whole numbers. Raises ArgumentError."""
    try:
        r, g, b = map(int, color)
    except (TypeError, ValueError, OverflowError):
        raise ArgumentError(f"{color!r}: must be three numbers of a color, 0 to 255") from None
    return (r, g, b)


def clipped(color: Sequence[int]) -> Color8:
    """A color in 0..255. Raises ArgumentError for what is none."""
    r, g, b = (min(max(component, 0), 255) for component in whole(color))
    return (r, g, b)


def _named(row: int, light: Light) -> NamedLight:
    values = shine(light)
    peak = max(values)
    encoded = encode_srgb(np.asarray(values) / (peak or 1.0))
    return NamedLight(row, light, peak, clipped(np.rint(encoded * 255.0).tolist()), indirect=light.indirect)


def _axes_towards(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """A rotation matrix whose -z column is the direction, its y column as near to upwards as can be."""
    backward = -direction / np.linalg.norm(direction)
    up = np.array([0.0, 1.0, 0.0]) if abs(backward[1]) < 0.999 else np.array([0.0, 0.0, 1.0])
    right = np.cross(up, backward)
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(backward, right), backward])


def _factor(value: float) -> float:
    """A factor of light, 0 for less. Raises ArgumentError."""
    if not abs(value) <= BRIGHTEST:
        raise ArgumentError(f"{value}: must be a number of at most {BRIGHTEST:g}")
    return max(float(value), 0.0)
