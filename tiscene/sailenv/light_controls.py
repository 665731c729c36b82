# SPDX-License-Identifier: Apache-2.0
"""Lights by SAILenv's names and in its terms: 8-bit sRGB colors, and intensities relative to what the scene has.

Positions and directions are in Unity's space.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError, LightNotFound
from tiscene.sailenv.json_messages import bounded
from tiscene.sailenv.unity_coordinates import mirrored
from tiscene.scene.camera import Vector3
from tiscene.scene.color import decode_srgb, encode_srgb
from tiscene.scene.description import DiskLight, DistantLight, DomeLight, Light, RectLight, SphereLight
from tiscene.scene.lights.light_groups import emission_of, with_emission

MAX_FACTOR = 1e9  # of an intensity or an indirect multiplier
FIXED_NAMES = {"main light": 0, "directional light": 0, "rim light": 1}  # the numbers of their lights
Color8 = tuple[int, int, int]
UNITY_TYPES: dict[type, str] = {
    DistantLight: "Directional",
    DiskLight: "Disc",
    RectLight: "Rectangle",
    SphereLight: "Point",
}


@dataclass
class NamedLight:
    """A light and its edits.

    Attributes:
        row: Its row in `stage.lights`.
        light: The light as it was authored, but for its pose.
        peak: The largest component of its authored emission; an intensity of 1 has this emission.
        color: 8-bit sRGB, relative to `peak`.
        intensity: Factor of the emission.
        indirect: Factor of its indirect light.
    """

    row: int
    light: Light
    peak: float
    color: Color8
    intensity: float = 1.0
    indirect: float = 1.0

    def edited(self) -> Light:
        """Return the light with all edits."""
        r, g, b = (component * self.peak * self.intensity for component in linear(self.color))
        return replace(with_emission(self.light, (r, g, b)), indirect=self.indirect)


class LightControls:
    """The lights of a scene by name, to read and to edit. Every method that takes a name raises LightNotFound.

    The first lights that are no domes have SAILenv's names, the others their own, or their paths where an earlier light
    has the name. Whatever names a scene lists, "Main Light" and "Directional Light" are its first light and "Rim Light"
    its second, or its only one.

    Attributes:
        names: The names of all lights.
    """

    def __init__(
        self, stage_lights: Sequence[Light], sailenv_names: Sequence[str], change: Callable[[int, Light], None]
    ) -> None:
        """Name the lights.

        Args:
            stage_lights: The lights of the stage.
            sailenv_names: SAILenv's names of the first lights of this scene.
            change: Called for each edit with the light's row and the edited light.
        """
        self._change = change
        rows = [row for row, light in enumerate(stage_lights) if not isinstance(light, DomeLight)]
        rows = rows or list(range(len(stage_lights)))
        self._lights = [_named_light(row, stage_lights[row]) for row in rows]
        fixed = {name: min(number, len(self._lights) - 1) for name, number in FIXED_NAMES.items() if self._lights}
        own_names = _different_names([each.light for each in self._lights], fixed)
        self.names = [*sailenv_names[: len(own_names)], *own_names[len(sailenv_names) :]]
        self._by_name = {name.casefold(): light for name, light in zip(own_names, self._lights, strict=True)}
        self._by_name |= {name: self._lights[number] for name, number in fixed.items()}

    def find(self, name: str) -> NamedLight:
        """Return the light of a name; case does not matter."""
        light = self._by_name.get(str(name).strip().casefold())
        if light is None:
            raise LightNotFound("light", name, self.names)
        return light

    def color(self, name: str) -> Color8:
        """Return the color, 8-bit sRGB."""
        return self.find(name).color

    def set_color(self, name: str, color: Sequence[int]) -> None:
        """Set the color, 8-bit sRGB; values outside 0..255 are clipped."""
        light = self.find(name)
        light.color = clipped(color)
        self._apply(light)

    def intensity(self, name: str) -> float:
        """Return the intensity; 1 is that of the scene."""
        return self.find(name).intensity

    def set_intensity(self, name: str, intensity: float) -> None:
        """Set the intensity, 1 is that of the scene; negative values count as 0. Raises ArgumentError above 1e9."""
        light = self.find(name)
        light.intensity = _factor(intensity)
        self._apply(light)

    def indirect_multiplier(self, name: str) -> float:
        """Return the factor of the indirect light; 1 is that of the scene."""
        return self.find(name).indirect

    def set_indirect_multiplier(self, name: str, multiplier: float) -> None:
        """Set the factor of the light that arrives by way of other surfaces.

        Negative values count as 0. Raises ArgumentError above 1e9.
        """
        light = self.find(name)
        light.indirect = _factor(multiplier)
        self._apply(light)

    def position(self, name: str) -> Vector3:
        """Return the position, m."""
        x, y, z = self.find(name).light.world_from_light[:3, 3].tolist()
        return mirrored((x, y, z))

    def set_position(self, name: str, position: Vector3) -> None:
        """Set the position, m. It has no effect on lights at infinity."""
        light = self.find(name)
        matrix = light.light.world_from_light.copy()
        matrix[:3, 3] = mirrored(bounded(position))
        light.light = replace(light.light, world_from_light=matrix)
        self._apply(light)

    def direction(self, name: str) -> Vector3:
        """Return the unit vector in which the light is emitted."""
        x, y, z = (-self.find(name).light.world_from_light[:3, 2]).tolist()
        return mirrored((x, y, z))

    def set_direction(self, name: str, direction: Vector3) -> None:
        """Set the direction of emission. It has no effect on domes and on lights that emit equally in all directions.

        A vector of length 0 changes nothing.
        """
        light = self.find(name)
        bounded(direction)
        if math.hypot(*direction) < 1e-9 or isinstance(light.light, DomeLight):
            return
        matrix = light.light.world_from_light.copy()
        matrix[:3, :3] = _axes_towards(np.array(mirrored(direction)))
        light.light = replace(light.light, world_from_light=matrix)
        self._apply(light)

    def type(self, name: str) -> str:
        """Return Unity's name of the type of light."""
        return UNITY_TYPES.get(type(self.find(name).light), "Area")

    def _apply(self, light: NamedLight) -> None:
        self._change(light.row, light.edited())


def linear(color: Sequence[int]) -> tuple[float, float, float]:
    """Return the scene-linear values 0..1 of 8-bit sRGB."""
    r, g, b = decode_srgb(np.asarray(color, np.float64) / 255.0).tolist()
    return (r, g, b)


def integer_color(color: Sequence[int]) -> Color8:
    """Return three integers. Raises ArgumentError."""
    try:
        r, g, b = map(int, color)
    except (TypeError, ValueError, OverflowError):
        raise ArgumentError(f"color {color!r}: must be three integers from 0 to 255") from None
    return (r, g, b)


def clipped(color: Sequence[int]) -> Color8:
    """Return a color clipped to 0..255. Raises ArgumentError."""
    r, g, b = (min(max(component, 0), 255) for component in integer_color(color))
    return (r, g, b)


def _different_names(lights: Sequence[Light], fixed: Mapping[str, int]) -> list[str]:
    """Return the names of lights; the path, without its first slash, of one whose name another has.

    Args:
        lights: The lights.
        fixed: Names, in lower case, that lights have in any case: the number of the light of each.
    """
    taken, names = dict(fixed), []
    for number, light in enumerate(lights):
        is_free = taken.setdefault(light.name.casefold(), number) == number
        names.append(light.name if is_free else light.prim_path.removeprefix("/"))
    return names


def _named_light(row: int, light: Light) -> NamedLight:
    emission = emission_of(light)
    peak = max(emission)
    encoded = encode_srgb(np.asarray(emission) / (peak or 1.0))
    return NamedLight(row, light, peak, clipped(np.rint(encoded * 255.0).tolist()), indirect=light.indirect)


def _axes_towards(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a rotation matrix whose -z column is the direction and whose y column is as close to up as possible."""
    backward = -direction / np.linalg.norm(direction)
    up = np.array([0.0, 1.0, 0.0]) if abs(backward[1]) < 0.999 else np.array([0.0, 0.0, 1.0])
    right = np.cross(up, backward)
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(backward, right), backward])


def _factor(value: float) -> float:
    """Return a factor of light, at least 0. Raises ArgumentError."""
    if not abs(value) <= MAX_FACTOR:
        raise ArgumentError(f"{value}: must be a number of at most {MAX_FACTOR:g}")
    return max(float(value), 0.0)
