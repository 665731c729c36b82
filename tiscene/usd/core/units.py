# SPDX-License-Identifier: Apache-2.0
"""Units: conversion between meters and a stage's unit of length that keeps decimal numbers as they were written."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from pxr import Usd, UsdGeom


@dataclass(frozen=True)
class Units:
    """A stage's unit of length.

    Attributes:
        meters: meters per stage unit.
    """

    meters: float = 1.0

    @classmethod
    def of(cls, stage: Usd.Stage) -> Units:
        """Return the unit of a stage."""
        return cls(float(UsdGeom.GetStageMetersPerUnit(stage)))

    def to_json(self, value: Any, length: bool = True) -> Any:
        """Return an attribute's value as JSON: vectors and arrays as lists, tokens as text.

        Args:
            value: the value.
            length: whether it is a length, which is converted to meters; False: a number without a unit.
        """
        if isinstance(value, str | bool | int):
            return value
        if hasattr(value, "__len__"):  # vectors of Gf are not Iterable
            return [self.to_json(each, length) for each in value]
        return self._scaled(float(value), Fraction(repr(self.meters))) if length else float(value)

    def to_stage(self, value: Any, length: bool = True) -> Any:
        """Return a JSON value as an attribute takes it: vectors and arrays as tuples.

        Args:
            value: the value.
            length: whether it is a length in meters, which is converted to stage units; False: a number without a unit.
        """
        if isinstance(value, Iterable) and not isinstance(value, str):
            return tuple(self.to_stage(each, length) for each in value)
        return self._scaled(float(value), 1 / Fraction(repr(self.meters))) if length else value

    def _scaled(self, value: float, factor: Fraction) -> float:
        """Multiply exactly the decimal notation of a number: 1.23 m is 123 cm, and 123 cm is 1.23 m."""
        return value if factor == 1 or not math.isfinite(value) else float(Fraction(repr(value)) * factor)
