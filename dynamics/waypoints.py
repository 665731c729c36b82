# SPDX-License-Identifier: Apache-2.0
"""Closed loops through waypoints: straight from one to the next, or along a smooth curve."""

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
    """A pose to pass through.

    position: m. rotation: Euler angles (x, y, z) in degrees, or a quaternion (w, x, y, z); see `dynamics.rotation`.
    """

    position: tuple[float, float, float]
    rotation: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", argument_checks.vector(self.position, "position"))
        object.__setattr__(self, "rotation", argument_checks.rotation(self.rotation, "rotation"))


@dataclass(frozen=True)
class WaypointLoop(ClosedForm):
    """A closed loop through waypoints, the last followed by the first; the body is at waypoint 0 until it starts.

    waypoints: two or more, in world space: where the body was placed plays no part.
    total_time: s for the whole loop.
    pacing: "equal_time": every segment takes equally long. "arc_length": constant speed along the whole loop.
    rotation: "quaternion": the shortest turn from each waypoint to the next. "euler": the angles themselves are
    interpolated, so that turns of more than 180 degrees are kept; the closing segment goes to the first angles or
    whole turns beyond them, whichever is nearest. It needs every waypoint's rotation as Euler angles.
    """

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
                        "is a quaternion; give three angles in degrees, or use rotation='quaternion'"
                    )
        if self.pacing == "arc_length":
            lengths = curve_lengths(self._cubics(self._positions(), np.zeros(3)))[:, -1]
            for index, length in enumerate(np.diff(lengths, prepend=0.0)):
                if length < 1e-9:
                    raise ArgumentError(
                        f"pacing='arc_length' gives time by length, but the segment from waypoints[{index}] to "
                        f"waypoints[{(index + 1) % len(lengths)}] has none; use pacing='equal_time'"
                    )

    @property
    def loop_time(self) -> float:
        return self.total_time

    def tracks(self, start: Pose) -> tuple[Curve]:
        count = len(self.waypoints)
        segments = np.zeros((count, SEGMENT_COLUMNS))
        segments[:, POSITION:ROTATION] = self._cubics(self._positions(), np.zeros(3))
        if self.rotation == "euler":
            angles = np.radians([waypoint.rotation for waypoint in self.waypoints])
            whole_turns = 2.0 * np.pi * np.round((angles[-1] - angles[0]) / (2.0 * np.pi))
            segments[:, ROTATION : ROTATION + 12] = self._cubics(angles, whole_turns)
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

    @abstractmethod
    def _cubics(self, values: Array, period: Array) -> Array:
        """Coefficients [n, 12] of the cubics through `values` [n, 3] and back to values[0] + period."""

    @abstractmethod
    def _quaternions(self, q: Array) -> Array:
        """Per segment [n, 16]: the quaternions at both ends and their inner controls."""


@dataclass(frozen=True)
class LinearWaypoints(WaypointLoop):
    """Straight lines; rotations by slerp. Speed jumps at the waypoints. See `WaypointLoop` for the fields."""

    def _cubics(self, values: Array, period: Array) -> Array:
        following = np.roll(values, -1, axis=0)
        following[-1] += period
        nothing = np.zeros_like(values)
        return np.concatenate([values, following - values, nothing, nothing], axis=1)

    def _quaternions(self, q: Array) -> Array:
        following = aligned(np.roll(q, -1, axis=0), q)
        # A squad whose inner controls are its ends is a slerp.
        return np.concatenate([q, following, q, following], axis=1)


@dataclass(frozen=True)
class CatmullWaypoints(WaypointLoop):
    """A uniform Catmull-Rom spline; rotations by squad. Velocity is continuous with equal time per segment.

    See `WaypointLoop` for the fields. (Catmull and Rom, "A class of local interpolating splines", 1974.)
    """

    def _cubics(self, values: Array, period: Array) -> Array:
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
    """`waypoints` as a tuple of at least two Waypoints. Raises TypeError, ValueError."""
    if not isinstance(waypoints, Iterable):
        raise ArgumentTypeError(f"waypoints={waypoints!r}: must be a sequence of Waypoint(position, rotation)")
    result = tuple(waypoints)
    for index, waypoint in enumerate(result):
        if not isinstance(waypoint, Waypoint):
            raise ArgumentTypeError(f"waypoints[{index}]={waypoint!r}: must be a Waypoint(position, rotation)")
    if len(result) < 2:
        raise ArgumentError(f"waypoints: a path needs 2 or more, not {len(result)}; use Still() for a body that stands")
    return result
