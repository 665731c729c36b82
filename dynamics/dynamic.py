# SPDX-License-Identifier: Apache-2.0
"""Dynamic: what moves one body. The interface, and the parts that closed-form trajectories are made of."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dynamics import argument_checks
from dynamics.errors import ArgumentTypeError

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

# Columns of a segment: four coefficients of a cubic position in t (constant term first), then the rotation:
# quaternions at the ends and their inner controls (slerp or squad), or four coefficients of cubic Euler angles, rad.
POSITION, ROTATION, SEGMENT_COLUMNS = 0, 12, 28
# Rows of a segment's cumulative lengths: at t = 0, 1/16, ... 1.
LENGTH_STEPS = 16


@dataclass(frozen=True)
class Pose:
    """position: m. rotation: unit quaternion (w, x, y, z)."""

    position: Vector = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


class Dynamic(ABC):
    """What moves one body. It has its own clock, which starts at 0 and runs only while its timing lets it.

    Every dynamic is a frozen dataclass of plain values, so that it can be compared, copied and written to a file.
    """

    @property
    @abstractmethod
    def loop_time(self) -> float:
        """Seconds after which the body is back at its start pose; 0 if it never leaves it, inf if it never returns."""


class ClosedForm(Dynamic):
    """A dynamic whose pose is a formula of its clock: any moment costs the same, nothing is remembered."""

    @abstractmethod
    def tracks(self, start: Pose) -> tuple[Track, ...]:
        """The formula, for a body that was placed at `start`: poses, each in the frame of the one before."""


@dataclass(frozen=True, eq=False)
class Track:
    """One pose that changes in time. The kernel receives its parameter u, which the host derives exactly:

    u = (clock mod duration) * span / duration if `repeat`, else min(clock, duration) * span / duration; 0 without
    a duration (None).
    """

    duration: float | None
    span: float
    repeat: bool


@dataclass(frozen=True, eq=False)
class Curve(Track):
    """Cubic segments. segments: float64 [n, SEGMENT_COLUMNS].

    euler: rotations are cubic Euler angles, not quaternions.
    lengths: float64 [n, LENGTH_STEPS + 1], arc length from the curve's start, if u is a fraction of the whole length.
    times: float64 [n + 1], the knots, if u is a time. Neither: u counts segments.
    """

    segments: Array = field(kw_only=True)
    euler: bool = False
    lengths: Array | None = None
    times: Array | None = None


@dataclass(frozen=True, eq=False)
class Turn(Track):
    """A turn by u radians about a unit axis through the origin."""

    axis: Vector = field(kw_only=True)


@dataclass(frozen=True, eq=False)
class Aim(Track):
    """Keeps the position reached so far; turns -z to a fixed point of the world, +y as near to `up` as can be."""

    target: Vector = field(kw_only=True)
    up: Vector = field(kw_only=True)


def fixed(pose: Pose) -> Curve:
    """A track that stands still."""
    segment = np.zeros((1, SEGMENT_COLUMNS))
    segment[0, :3] = pose.position
    segment[0, ROTATION:] = np.tile(pose.rotation, 4)
    return Curve(None, 0.0, False, segments=segment)


def check_dynamic(value: object, name: str) -> Dynamic:
    """`value`, if it is a Dynamic. Raises TypeError."""
    if not isinstance(value, Dynamic):
        hint = " (an instance, not the class)" if isinstance(value, type) else ""
        raise ArgumentTypeError(f"{name}={value!r}: must be a Dynamic{hint}")
    return value


def unit(value: Vector, name: str) -> Vector:
    """`value` scaled to length 1. Raises ValueError if it has none."""
    x, y, z = argument_checks.direction(value, name)
    length = math.hypot(x, y, z)
    return (x / length, y / length, z / length)
