# SPDX-License-Identifier: Apache-2.0
"""Ranges of the factors of a scenario that are not its objects' places: light, materials, furniture, clutter, views.

Each class is one factor. Its defaults change nothing. `TYPICAL` are the ranges of a factor that is to vary, without
any wish how.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

from dynamics.argument_checks import MAX_POSITION
from tiscene.errors import ArgumentError
from tiscene.randomization.ranges import range_of, whole_range_of, words_of

Range = tuple[float, float]


@dataclass(frozen=True)
class FactorRanges:
    """Base class: ranges that are checked by their field's entry in `LIMITS`."""

    LIMITS: ClassVar[Mapping[str, tuple[float, float]]] = {}
    TYPICAL: ClassVar[Mapping[str, Any]] = {}

    def __post_init__(self) -> None:
        for name, (least, most) in self.LIMITS.items():
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, range_of(value, name, most, least))

    @classmethod
    def of(cls, value: Any, factor: str) -> Self:
        """Return ranges: as they are, by name in a mapping, or, of None and True, the typical ones.

        Args:
            value: what a user has given.
            factor: name of the factor, for messages.

        Raises:
            ArgumentError: a name or a value is wrong.
        """
        if isinstance(value, cls):
            return value
        if value is None or value is True:
            return cls(**cls.TYPICAL)
        known = [each.name for each in fields(cls)]
        if not isinstance(value, Mapping):
            raise ArgumentError(f"{factor}={value!r}: must be True, or ranges by name: {', '.join(known)}")
        for name in value:
            if name not in known:
                raise ArgumentError(f"{factor}: no such range {name!r}; there are {', '.join(known)}")
        try:
            return cls(**value)
        except ArgumentError as error:
            raise ArgumentError(f"{factor}: {error}") from None


@dataclass(frozen=True)
class IlluminationRanges(FactorRanges):
    """Light.

    Attributes:
        lighting: variants of the scene's variant set `lighting` to draw from; (): as it is.
        strength: factor of each light's radiance, drawn on a logarithmic scale.
        color: saturation of each light's tint, 0..1.
        yaw: turn of distant lights and domes about the vertical, degrees, to either side.
        pitch: the same about their horizontal axis.
        exposure: stops of exposure compensation.
    """

    lighting: Sequence[str] = ()
    strength: Range = (1.0, 1.0)
    color: Range = (0.0, 0.0)
    yaw: Range = (0.0, 0.0)
    pitch: Range = (0.0, 0.0)
    exposure: Range = (0.0, 0.0)

    LIMITS: ClassVar = {
        "strength": (1e-3, 1e3),
        "color": (0.0, 1.0),
        "yaw": (0.0, 180.0),
        "pitch": (0.0, 90.0),
        "exposure": (-20.0, 20.0),
    }
    TYPICAL: ClassVar = {
        "lighting": ("*",),
        "strength": (0.5, 2.0),
        "color": (0.0, 0.3),
        "yaw": (0.0, 30.0),
        "pitch": (0.0, 10.0),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.lighting, str):
            object.__setattr__(self, "lighting", (self.lighting,))
        elif self.lighting != ():
            object.__setattr__(self, "lighting", words_of(self.lighting, "lighting"))


@dataclass(frozen=True)
class MaterialRanges(FactorRanges):
    """Materials. Glass, mirrors, emissive and cut-out materials stay as they are.

    Attributes:
        share: fraction of the materials that change.
        color: how far base colors change, 0..1: hue by that part of a turn to either side, lightness and saturation by
            that fraction.
        roughness: how far roughness changes, to either side. Roughness from a texture stays.
        swap: probability that a material becomes like another one of its kind: wood, fabric or paint.
    """

    share: Range = (1.0, 1.0)
    color: Range = (0.0, 0.0)
    roughness: Range = (0.0, 0.0)
    swap: Range = (0.0, 0.0)

    LIMITS: ClassVar = {"share": (0.0, 1.0), "color": (0.0, 1.0), "roughness": (0.0, 1.0), "swap": (0.0, 1.0)}
    TYPICAL: ClassVar = {"color": (0.1, 0.5), "roughness": (0.0, 0.3), "swap": (0.5, 0.5)}


@dataclass(frozen=True)
class FurnitureRanges(FactorRanges):
    """Objects of the scene that its author has made movable (UsdPhysics rigid bodies).

    Attributes:
        shift: how far each is moved along its support, m.
        turn: how far each is turned about the vertical, degrees, to either side.
        variants: probability that the variant of an object's own variant sets, such as its color, is drawn anew.
    """

    shift: Range = (0.0, 0.0)
    turn: Range = (0.0, 0.0)
    variants: Range = (0.0, 0.0)

    LIMITS: ClassVar = {"shift": (0.0, 10.0), "turn": (0.0, 180.0), "variants": (0.0, 1.0)}
    TYPICAL: ClassVar = {"shift": (0.0, 0.4), "turn": (0.0, 30.0), "variants": (1.0, 1.0)}


@dataclass(frozen=True)
class ClutterRanges(FactorRanges):
    """Distractors: still objects that no task is about, at free places in view, clear of the objects' paths.

    Attributes:
        count: their number.
        templates: templates to draw from; None: the whole catalog, without categories that the scenario's objects have.
        depth: distance from the camera along its axis, m.
        scale: scale factor.
        size: size, m, of templates that are drawn from the whole catalog, as `min_size` of `Scenario.sample` counts it.
    """

    count: tuple[int, int] = (0, 0)
    templates: Sequence[str] | None = None
    depth: Range = (1.0, 5.0)
    scale: Range = (1.0, 1.0)
    size: Range = (0.0, 0.6)

    LIMITS: ClassVar = {"depth": (1e-3, MAX_POSITION), "scale": (1e-3, 1e3), "size": (0.0, math.inf)}
    TYPICAL: ClassVar = {"count": (3, 6)}

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "count", whole_range_of(self.count, "count", 0, math.inf))
        if self.templates is not None:
            object.__setattr__(self, "templates", words_of(self.templates, "templates"))


@dataclass(frozen=True)
class ViewRanges(FactorRanges):
    """The main camera's pose and lens.

    Attributes:
        shift: how far the camera is moved, m, in a random direction, within free space.
        yaw: how far it is turned about the vertical, degrees, to either side.
        pitch: the same up and down.
        zoom: factor of its focal length, drawn on a logarithmic scale.
        lens_radius: radius of its aperture, m; None: its own.
        focus_distance: distance of the plane in focus, m; None: its own.
    """

    shift: Range = (0.0, 0.0)
    yaw: Range = (0.0, 0.0)
    pitch: Range = (0.0, 0.0)
    zoom: Range = (1.0, 1.0)
    lens_radius: Range | None = None
    focus_distance: Range | None = None

    LIMITS: ClassVar = {
        "shift": (0.0, 100.0),
        "yaw": (0.0, 180.0),
        "pitch": (0.0, 90.0),
        "zoom": (0.05, 20.0),
        "lens_radius": (0.0, 1.0),
        "focus_distance": (1e-3, math.inf),
    }
    TYPICAL: ClassVar = {"shift": (0.0, 0.4), "yaw": (0.0, 12.0), "pitch": (0.0, 5.0), "zoom": (0.85, 1.2)}
