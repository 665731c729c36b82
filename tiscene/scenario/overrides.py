# SPDX-License-Identifier: Apache-2.0
"""Overrides: changes of a stage's lights, materials, objects and cameras that hold for all frames.

An override makes another stage of the one that is authored: what it moves is static, costs nothing while frames are
rendered, and is no event. Edits (`tiscene.scenario.edits`) change a stream while it runs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dynamics.argument_checks import (
    flag,
    not_negative,
    number,
    optional,
    position,
    positive,
    rotation,
    set_checked,
    text,
    vector,
)
from tiscene.errors import ScenarioError, scenario_errors
from tiscene.scene.camera import Quaternion, Vector3

Color = tuple[float, float, float]


@dataclass(frozen=True)
class LightOverride:
    """Changes a light of the stage. A `LightMotion` of the same light multiplies and moves what results.

    Attributes:
        prim: path or name of the light's prim.
        intensity: factor of its radiance.
        color: factors of red, green and blue, linear Rec.709.
        pitch: turn about the light's own x axis, degrees; positive: up.
        yaw: turn about the vertical through its origin, degrees; positive: to the left. Turns a dome's image too.

    Raises:
        ScenarioError: a value is invalid.
    """

    prim: str
    intensity: float = 1.0
    color: Color = (1.0, 1.0, 1.0)
    pitch: float = 0.0
    yaw: float = 0.0

    def __post_init__(self) -> None:
        with scenario_errors():
            set_checked(self, prim=text, intensity=not_negative, color=_factors, pitch=number, yaw=number)


@dataclass(frozen=True)
class MaterialOverride:
    """Changes a material of the stage or of a template.

    Attributes:
        prim: path or name of the material's prim; in a template's file such as "Chair 01/Looks/Oak".
        like: path or name of another material of the same file, all of whose inputs it takes first; None: its own.
        color: base color in place of its own and of its texture, linear Rec.709, 0..1; None: its own.
        tint: factors of the base color, of a texture too.
        roughness: roughness in place of its own and of its texture, 0..1; None: its own.
        metallic: the same for metalness.

    Raises:
        ScenarioError: a value is invalid.
    """

    prim: str
    like: str | None = None
    color: Color | None = None
    tint: Color = (1.0, 1.0, 1.0)
    roughness: float | None = None
    metallic: float | None = None

    def __post_init__(self) -> None:
        with scenario_errors():
            set_checked(self, prim=text, like=optional(text), color=optional(_fractions), tint=_factors)
            set_checked(self, roughness=optional(_fraction), metallic=optional(_fraction))


@dataclass(frozen=True)
class ObjectOverride:
    """Places an object of the stage elsewhere, with its lights and colliders, or leaves it out.

    Attributes:
        prim: path or name of the object's prim.
        position: of its axes, m, as in `frame.objects`; None: as authored.
        rotation: Euler angles in degrees, or a quaternion; None: as authored.
        visible: False: the object is left out. Ids of other objects stay the same.

    Raises:
        ScenarioError: a value is invalid.
    """

    prim: str
    position: Vector3 | None = None
    rotation: tuple[float, ...] | None = None
    visible: bool = True

    def __post_init__(self) -> None:
        with scenario_errors():
            set_checked(self, prim=text, position=optional(position), rotation=optional(rotation), visible=flag)


@dataclass(frozen=True)
class CameraOverride:
    """Changes a camera of the stage. It keeps its other attributes, such as its exposure.

    Cameras of the scenario itself stay as they are. Those are also the ones that move on the stage.

    Attributes:
        prim: name or prim path of the camera; "": the first.
        position: m; None: as authored.
        rotation: Euler angles in degrees, or a quaternion; None: as authored.
        vertical_fov: rad; None: as authored.
        lens_radius: m; None: as authored.
        focus_distance: m; None: as authored.

    Raises:
        ScenarioError: a value is invalid.
    """

    prim: str = ""
    position: Vector3 | None = None
    rotation: tuple[float, ...] | Quaternion | None = None
    vertical_fov: float | None = None
    lens_radius: float | None = None
    focus_distance: float | None = None

    def __post_init__(self) -> None:
        with scenario_errors():
            if not isinstance(self.prim, str):
                raise ScenarioError(f"prim={self.prim!r}: must be the name of a camera")
            set_checked(self, position=optional(vector), rotation=optional(rotation))
            set_checked(self, vertical_fov=optional(positive))
            set_checked(self, lens_radius=optional(not_negative), focus_distance=optional(positive))
            if self.vertical_fov is not None and self.vertical_fov >= 3.14159:
                raise ScenarioError(f"vertical_fov={self.vertical_fov!r}: must lie between 0 and pi radians")


Override = LightOverride | MaterialOverride | ObjectOverride | CameraOverride


def _factors(value: Any, name: str) -> Color:
    color = vector(value, name)
    if min(color) < 0.0:
        raise ScenarioError(f"{name}={value!r}: must be 0 or more")
    return color


def _fractions(value: Any, name: str) -> Color:
    color = vector(value, name)
    if min(color) < 0.0 or max(color) > 1.0:
        raise ScenarioError(f"{name}={value!r}: must lie within 0..1")
    return color


def _fraction(value: Any, name: str) -> float:
    fraction = number(value, name)
    if not 0.0 <= fraction <= 1.0:
        raise ScenarioError(f"{name}={value!r}: must lie within 0..1")
    return fraction
