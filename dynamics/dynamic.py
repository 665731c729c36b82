# SPDX-License-Identifier: Apache-2.0
"""Interface of trajectories (`Dynamic`, `ClosedForm`), and the tracks that closed-form trajectories consist of.

A closed-form trajectory is a chain of tracks, each a pose in the frame of the one before: cubic curves, turns about an
axis, aiming at a point. `dynamics.bodies` packs tracks into arrays; `dynamics.trajectory_kernel` evaluates them.
"""

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

# Columns of a segment: four coefficients of the cubic position in t (constant term first), then the rotation: both end
# quaternions and their inner controls (for slerp or squad), or four coefficients of cubic Euler angles, radians.
POSITION, ROTATION, SEGMENT_COLUMNS = 0, 12, 28
# Steps of a segment's table of arc lengths: t = 0, 1/16, ... 1.
LENGTH_STEPS = 16


@dataclass(frozen=True)
class Pose:
    """A position and an orientation.

    Attributes:
        position: Meters.
        rotation: Unit quaternion (w, x, y, z).
    """

    position: Vector = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


class Dynamic(ABC):
    """Interface of trajectories: how one body moves on its own clock.

    The clock starts at 0 and runs while the timing lets it. Every dynamic is a frozen dataclass of plain values, so
    that it can be compared, copied and serialized.
    """

    @property
    @abstractmethod
    def loop_time(self) -> float:
        """Seconds until the body is back at its start pose; 0 if it never leaves it, inf if it never returns."""


class ClosedForm(Dynamic):
    """A dynamic whose pose is a formula of its clock: every time costs the same, and there is no state."""

    @abstractmethod
    def tracks(self, start: Pose) -> tuple[Track, ...]:
        """Return the tracks of a body placed at `start`, each in the frame of the one before."""


@dataclass(frozen=True, eq=False)
class Track:
    """A pose as a function of a parameter u, which the host computes exactly.

    u = (clock mod duration) * span / duration if `repeat`, else min(clock, duration) * span / duration.

    Attributes:
        duration: Seconds; None for a static track, whose u is 0.
        span: u at the end of the duration.
        repeat: Whether the track starts again after its duration.
    """

    duration: float | None
    span: float
    repeat: bool


@dataclass(frozen=True, eq=False)
class Curve(Track):
    """Cubic segments. u is a fraction of the arc length (`lengths`), a time (`times`), or else counts segments.

    Attributes:
        segments: float64 [n, SEGMENT_COLUMNS].
        euler: Whether rotations are cubic Euler angles, not quaternions.
        lengths: float64 [n, LENGTH_STEPS + 1], arc length from the start of the curve, meters; None: u is no length.
        times: float64 [n + 1], knots; None: u is no time.
    """

    segments: Array = field(kw_only=True)
    euler: bool = False
    lengths: Array | None = None
    times: Array | None = None


@dataclass(frozen=True, eq=False)
class Turn(Track):
    """A rotation by u radians about a unit axis through the origin."""

    axis: Vector = field(kw_only=True)


@dataclass(frozen=True, eq=False)
class Aim(Track):
    """A rotation that turns -z to a fixed point of the world and +y as near to `up` as possible; keeps the position."""

    target: Vector = field(kw_only=True)
    up: Vector = field(kw_only=True)


def fixed(pose: Pose) -> Curve:
    """Return a static track."""
    segment = np.zeros((1, SEGMENT_COLUMNS))
    segment[0, :3] = pose.position
    segment[0, ROTATION:] = np.tile(pose.rotation, 4)
    return Curve(None, 0.0, False, segments=segment)


def check_dynamic(value: object, name: str) -> Dynamic:
    """Return `value`, a Dynamic."""
    if not isinstance(value, Dynamic):
        hint = " (an instance, not the class)" if isinstance(value, type) else ""
        raise ArgumentTypeError(f"{name}={value!r}: must be a Dynamic{hint}")
    return value


def unit(value: Vector, name: str) -> Vector:
    """Return `value` scaled to length 1."""
    x, y, z = argument_checks.direction(value, name)
    length = math.hypot(x, y, z)
    return (x / length, y / length, z / length)
