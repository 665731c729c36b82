# SPDX-License-Identifier: Apache-2.0
"""Closed paths through waypoints: `LinearWaypoints` (straight lines) and `CatmullWaypoints` (Catmull-Rom splines).

Both turn their waypoints into cubic segments of position and rotation (`dynamics.dynamic.Curve`), which the kernel in
`dynamics.trajectory_kernel` evaluates.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dynamics import argument_checks
from dynamics.dynamic import POSITION, ROTATION, SEGMENT_COLUMNS, Array, ClosedForm, Curve, Pose
from dynamics.errors import ArgumentError, ArgumentTypeError
from dynamics.quadrature import curve_lengths
from dynamics.rotation import aligned, quaternion, squad_controls


@dataclass(frozen=True)
class Waypoint:
    """A pose that a path passes through.

    Args:
        position: Meters, world.
        rotation: Euler angles (x, y, z) in degrees, or a quaternion (w, x, y, z) of any length; see
            `dynamics.rotation`.

    Raises:
        ArgumentError: For a wrong number of components, one that is not finite, or a zero quaternion.
    """

    position: tuple[float, float, float]
    rotation: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        argument_checks.set_checked(self, position=argument_checks.vector, rotation=argument_checks.rotation)


@dataclass(frozen=True)
class WaypointLoop(ClosedForm):
    """A closed path through waypoints, the last one followed by the first; see `LinearWaypoints` for the arguments."""

    waypoints: Sequence[Waypoint]
    total_time: float = 10.0
    pacing: Literal["equal_time", "arc_length"] = "equal_time"
    rotation: Literal["quaternion", "euler"] = "quaternion"

    def __post_init__(self) -> None:
        object.__setattr__(self, "waypoints", check_waypoints(self.waypoints))
        object.__setattr__(self, "total_time", argument_checks.positive(self.total_time, "total_time"))
        argument_checks.choice(self.pacing, "pacing", ("equal_time", "arc_length"))
        argument_checks.choice(self.rotation, "rotation", ("quaternion", "euler"))
        if self.rotation == "euler":
            for index, waypoint in enumerate(self.waypoints):
                if len(waypoint.rotation) != 3:
                    raise ArgumentError(
                        f"rotation='euler' interpolates angles, but waypoints[{index}].rotation={waypoint.rotation} "
                        "is a quaternion; pass three angles in degrees, or use rotation='quaternion'"
                    )
        if self.pacing == "arc_length":
            lengths = curve_lengths(self.cubics(self._positions(), np.zeros(3)))[:, -1]
            for index, length in enumerate(np.diff(lengths, prepend=0.0)):
                if length < 1e-9:
                    raise ArgumentError(
                        f"pacing='arc_length' divides time by length, but the segment from waypoints[{index}] to "
                        f"waypoints[{(index + 1) % len(lengths)}] has zero length; use pacing='equal_time'"
                    )

    @property
    def loop_time(self) -> float:
        return self.total_time

    def tracks(self, start: Pose) -> tuple[Curve]:
        count = len(self.waypoints)
        segments = np.zeros((count, SEGMENT_COLUMNS))
        segments[:, POSITION:ROTATION] = self.cubics(self._positions(), np.zeros(3))
        if self.rotation == "euler":
            angles = np.radians([waypoint.rotation for waypoint in self.waypoints])
            whole_turns = 2.0 * np.pi * np.round((angles[-1] - angles[0]) / (2.0 * np.pi))
            segments[:, ROTATION : ROTATION + 12] = self.cubics(angles, whole_turns)
        else:
            segments[:, ROTATION:] = self._quaternions(np.array([quaternion(each.rotation) for each in self.waypoints]))
        by_length = self.pacing == "arc_length"
        return (
            Curve(
                duration=self.total_time,
                span=1.0 if by_length else float(count),
                repeat=True,
                segments=segments,
                euler=self.rotation == "euler",
                lengths=curve_lengths(segments[:, POSITION:ROTATION]) if by_length else None,
            ),
        )

    def _positions(self) -> Array:
        return np.array([waypoint.position for waypoint in self.waypoints])

    @staticmethod
    @abstractmethod
    def cubics(values: Array, period: Array) -> Array:
        """Return the coefficients [n, 12] of the cubics through `values` [n, 3] and back to values[0] + period."""

    @abstractmethod
    def _quaternions(self, q: Array) -> Array:
        """Return [n, 16]: per segment the quaternions at both ends and their inner controls."""


@dataclass(frozen=True)
class LinearWaypoints(WaypointLoop):
    """A closed path of straight lines with slerped rotations; velocity jumps at waypoints.

    The last waypoint is followed by the first. The body is at waypoint 0 until its clock starts.

    Args:
        waypoints: Two or more, in world space. The pose at which the body is placed plays no part.
        total_time: Seconds for the whole loop.
        pacing: "equal_time": all segments take equally long. "arc_length": constant speed along the whole loop.
        rotation: "quaternion": the shortest turn from each waypoint to the next. "euler": interpolate the angles, which
            keeps turns of more than 180 degrees; the closing segment leads to the first waypoint's angles plus whole
            turns, whichever are nearest. "euler" requires all rotations as Euler angles.

    Raises:
        ArgumentError: For fewer than two waypoints, quaternions with rotation="euler", or a segment without length with
            pacing="arc_length".
    """

    @staticmethod
    def cubics(values: Array, period: Array) -> Array:
        following = np.roll(values, -1, axis=0)
        following[-1] += period
        zero = np.zeros_like(values)
        return np.concatenate([values, following - values, zero, zero], axis=1)

    def _quaternions(self, q: Array) -> Array:
        following = aligned(np.roll(q, -1, axis=0), q)
        # A squad whose inner controls are its ends is a slerp.
        return np.concatenate([q, following, q, following], axis=1)


@dataclass(frozen=True)
class CatmullWaypoints(WaypointLoop):
    """A closed uniform Catmull-Rom spline with rotations by squad; velocity is continuous with pacing="equal_time".

    The arguments are those of `LinearWaypoints`. Catmull and Rom, "A Class of Local Interpolating Splines", 1974.
    """

    @staticmethod
    def cubics(values: Array, period: Array) -> Array:
        before, after, beyond = (np.roll(values, shift, axis=0) for shift in (1, -1, -2))
        before[0] -= period
        after[-1] += period
        beyond[-2:] += period
        return np.concatenate(
            [
                values,
                0.5 * (after - before),
                before - 2.5 * values + 2.0 * after - 0.5 * beyond,
                0.5 * (beyond - before) + 1.5 * (values - after),
            ],
            axis=1,
        )

    def _quaternions(self, q: Array) -> Array:
        controls = squad_controls(q)
        # Both ends in one hemisphere; a control changes sign together with its quaternion.
        following = np.roll(q, -1, axis=0)
        sign = np.where(np.sum(following * q, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
        return np.concatenate([q, sign * following, controls, sign * np.roll(controls, -1, axis=0)], axis=1)


def check_waypoints(waypoints: object) -> tuple[Waypoint, ...]:
    """Return `waypoints` as a tuple of at least two Waypoints."""
    if not isinstance(waypoints, Iterable):
        raise ArgumentTypeError(f"waypoints={waypoints!r}: must be a sequence of Waypoint(position, rotation)")
    result = tuple(waypoints)
    for index, waypoint in enumerate(result):
        if not isinstance(waypoint, Waypoint):
            raise ArgumentTypeError(f"waypoints[{index}]={waypoint!r}: must be a Waypoint(position, rotation)")
        argument_checks.position(waypoint.position, f"waypoints[{index}].position")
    if len(result) < 2:
        raise ArgumentError(f"waypoints: a path needs 2 or more, not {len(result)}; use Still() for a static body")
    return result
