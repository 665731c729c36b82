# SPDX-License-Identifier: Apache-2.0
"""Between meters and a stage's unit, so that numbers that people write come back as they were written."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from pxr import Usd, UsdGeom


@dataclass(frozen=True)
class Units:
    """meters: how many one stage unit has."""

    meters: float = 1.0

    @classmethod
    def of(cls, stage: Usd.Stage) -> Units:
        """The unit of a stage."""
        return cls(float(UsdGeom.GetStageMetersPerUnit(stage)))

    def to_json(self, value: Any, length: bool = False) -> Any:
        """A value of an attribute as JSON: vectors and arrays as lists, tokens as text. length: in m."""
        if isinstance(value, str | bool | int):
            return value
        if hasattr(value, "__len__"):  # USD's own vectors are no Iterables
            return [self.to_json(each, length) for each in value]
        return self._scaled(float(value), Fraction(repr(self.meters))) if length else float(value)

    def to_stage(self, value: Any, length: bool = False) -> Any:
        """A JSON value as what an attribute takes; vectors and arrays as tuples. length: from m."""
        if isinstance(value, Iterable) and not isinstance(value, str):
            return tuple(self.to_stage(each, length) for each in value)
        return self._scaled(float(value), 1 / Fraction(repr(self.meters))) if length else value

    def _scaled(self, value: float, factor: Fraction) -> float:
        """The product of what both are written as in decimals: 1.23 m is 123 cm, and 123 cm is 1.23 m."""
        return value if factor == 1 or not math.isfinite(value) else float(Fraction(repr(value)) * factor)
