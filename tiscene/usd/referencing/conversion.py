# SPDX-License-Identifier: Apache-2.0
"""Conversion: from the units, axes and place of one stage to those of another."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from pxr import Gf, Usd, UsdGeom, UsdPhysics

_UNLIMITED = 3e38  # some programs write the largest float where there is no limit
_SAME_UNIT = 1e-5  # relative, as of UsdGeom.LinearUnitsAre: files store units in single precision too


@dataclass(frozen=True)
class Conversion:
    """From the units, axes and place of a stage to those of another that references it.

    Attributes:
        length: units of length of the other stage per unit of the stage.
        mass: the same of masses.
        turned_from: up axis of the stage, "Y" or "Z", if the other stage has another one; else "".
        world: from the world of the stage to that of the other one.
    """

    length: float
    mass: float
    turned_from: str
    world: Gf.Matrix4d

    @classmethod
    def between(cls, stage: Usd.Stage, other: Usd.Stage) -> Conversion:
        """Return the conversion from a stage to another one, about their origins."""
        length = _ratio(*(UsdGeom.GetStageMetersPerUnit(each) for each in (stage, other)))
        mass = _ratio(*(UsdPhysics.GetStageKilogramsPerUnit(each) for each in (stage, other)))
        up_axis, new = (str(UsdGeom.GetStageUpAxis(each)) for each in (stage, other))
        world = Gf.Matrix4d(1.0)
        if up_axis != new:
            sign = 1.0 if new == "Z" else -1.0
            world = Gf.Matrix4d(1, 0, 0, 0, 0, 0, sign, 0, 0, -sign, 0, 0, 0, 0, 0, 1)
        world *= Gf.Matrix4d(1.0).SetScale(length)
        return cls(length, mass, up_axis if up_axis != new else "", world)

    @property
    def is_identity(self) -> bool:
        """Whether nothing is converted."""
        return self.length == self.mass == 1.0 and self.world == Gf.Matrix4d(1.0)

    @property
    def rotation(self) -> Gf.Rotation:
        """The turn of `world`."""
        return Gf.Transform(self.world).GetRotation()

    @property
    def degrees_about_x(self) -> float:
        """The turn from the stage's up axis to that of the other stage; 0 if they have the same."""
        return {"": 0.0, "Y": 90.0, "Z": -90.0}[self.turned_from]

    def factor(self, length: int = 0, mass: int = 0) -> float:
        """Return what numbers are multiplied by whose unit is of these powers of length and mass."""
        return float(self.length**length * self.mass**mass)

    def distance(self, value: float) -> float:
        """Return a distance; 0 and negative numbers, which stand for none, as they are."""
        return value * self.length if value > 0.0 else value

    def point(self, value: Any) -> Any:
        """Return a point of the world; a vector of the same type."""
        return type(value)(self.world.Transform(Gf.Vec3d(value)))

    def direction(self, value: Any) -> Any:
        """Return a direction of the world with its length; a vector of the same type."""
        return type(value)(self.rotation.TransformDir(Gf.Vec3d(value)))

    def orientation(self, value: Any) -> Any:
        """Return a rotation to the world; a quaternion of the same type."""
        turned = self.rotation.GetQuat() * Gf.Quatd(value)
        return type(value)(turned.GetReal(), *turned.GetImaginary())


def scaled(value: Any, factor: float) -> Any:
    """Return a number or a vector times a factor; numbers that stand for no limit as they are."""
    return value if isinstance(value, float) and abs(value) > _UNLIMITED else value * factor


def _ratio(one: float, other: float) -> float:
    """Return the ratio of two units: that of their decimal notations, so that 1 mm is exactly 0.1 cm.

    It is 1 where one is not valid.
    """
    if not (0.0 < one < math.inf and 0.0 < other < math.inf) or abs(one - other) <= _SAME_UNIT * other:
        return 1.0
    return float(Fraction(repr(float(one))) / Fraction(repr(float(other))))
