# SPDX-License-Identifier: Apache-2.0
"""Units of the inputs of MaterialX nodes. USD has none for inputs: theirs are kept in customData."""

from __future__ import annotations

from pxr import Usd, UsdGeom

UNIT = "unit"  # in the customData of an input, MaterialX's name of its unit
METERS = {  # of a unit of distance
    "nanometer": 1e-9,
    "micron": 1e-6,
    "millimeter": 1e-3,
    "centimeter": 0.01,
    "inch": 0.0254,
    "foot": 0.3048,
    "yard": 0.9144,
    "meter": 1.0,
    "kilometer": 1000.0,
    "mile": 1609.344,
}
ANGLES = ("degree", "radian")  # inputs without a unit are in degrees


def meters_per_unit(attribute: Usd.Attribute) -> float:
    """Return the meters of an input's unit of distance; of the stage's unit if it names none."""
    unit = str(attribute.GetCustomDataByKey(UNIT))
    return METERS[unit] if unit in METERS else float(UsdGeom.GetStageMetersPerUnit(attribute.GetStage()))


def is_in_radians(attribute: Usd.Attribute) -> bool:
    """Return whether an input's unit is the radian."""
    return bool(attribute.GetCustomDataByKey(UNIT) == "radian")
