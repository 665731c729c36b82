# SPDX-License-Identifier: Apache-2.0
"""Still, Orbit, LookAt, Keyframes and Composite: the other dynamics that are formulas of time."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from dynamics import argument_checks
from dynamics.clocks import exact
from dynamics.dynamic import (
    ROTATION,
    SEGMENT_COLUMNS,
    Aim,
    ClosedForm,
    Curve,
    Pose,
    Track,
    Turn,
    Vector,
    check_dynamic,
    fixed,
    unit,
)
from dynamics.errors import ArgumentError, ArgumentTypeError
from dynamics.rotation import aligned, quaternion
from dynamics.waypoints import Waypoint, check_waypoints


@dataclass(frozen=True)
class Still(ClosedForm):
    """Stays where it was placed."""

    @property
    def loop_time(self) -> float:
        return 0.0

    def tracks(self, start: Pose) -> tuple[Track, ...]:
        return (fixed(start),)


@dataclass(frozen=True)
class Orbit(ClosedForm):
    """Carries the start pose, rigidly, round an axis: what faces the center goes on facing it.

    center: a point of the axis, m. period: s a turn. axis: its direction; turns are right-handed about it.
    """

    center: Vector = (0.0, 0.0, 0.0)
    period: float = 10.0
    axis: Vector = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", argument_checks.vector(self.center, "center"))
        object.__setattr__(self, "period", argument_checks.positive(self.period, "period"))
        object.__setattr__(self, "axis", argument_checks.direction(self.axis, "axis"))

    @property
    def loop_time(self) -> float:
        return self.period

    def tracks(self, start: Pose) -> tuple[Track, ...]:
        x, y, z = (mine - center for mine, center in zip(start.position, self.center, strict=True))
        return (
            fixed(Pose(self.center)),
            Turn(self.period, 2.0 * math.pi, True, axis=unit(self.axis, "axis")),
            fixed(Pose((x, y, z), start.rotation)),
        )


@dataclass(frozen=True)
class LookAt(ClosedForm):
    """Moves by another dynamic (default: stands) and turns its -z axis to a fixed point, as a camera does.

    target: m, world. up: what its +y keeps closest to. motion: gives the position.
    """

    target: Vector
    motion: ClosedForm = field(default_factory=Still)
    up: Vector = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", argument_checks.vector(self.target, "target"))
        object.__setattr__(self, "up", argument_checks.direction(self.up, "up"))
        check_closed_form(self.motion, "motion")

    @property
    def loop_time(self) -> float:
        return self.motion.loop_time

    def tracks(self, start: Pose) -> tuple[Track, ...]:
        return (*self.motion.tracks(start), Aim(None, 0.0, False, target=self.target, up=unit(self.up, "up")))


@dataclass(frozen=True)
class Keyframes(ClosedForm):
    """Poses at given times, straight lines and slerp between them; held before the first and after the last.

    times: s on the body's clock, increasing, one for each of `waypoints`.
    repeat: start again after the last time, instead of standing there.
    """

    times: Sequence[float]
    waypoints: Sequence[Waypoint]
    repeat: bool = False

    def __post_init__(self) -> None:
        waypoints = check_waypoints(self.waypoints)
        times = argument_checks.numbers(self.times, "times", len(waypoints))
        if times[0] < 0.0 or any(b <= a for a, b in itertools.pairwise(times)):
            raise ArgumentError(f"times={self.times!r}: must begin at 0 or later and increase")
        argument_checks.flag(self.repeat, "repeat")
        object.__setattr__(self, "waypoints", waypoints)
        object.__setattr__(self, "times", times)

    @property
    def loop_time(self) -> float:
        return self.times[-1] if self.repeat else math.inf

    def tracks(self, start: Pose) -> tuple[Track, ...]:
        positions = np.array([waypoint.position for waypoint in self.waypoints])
        rotations = np.array([quaternion(waypoint.rotation) for waypoint in self.waypoints])
        following = aligned(rotations[1:], rotations[:-1])
        segments = np.zeros((len(positions) - 1, SEGMENT_COLUMNS))
        segments[:, :3] = positions[:-1]
        segments[:, 3:6] = positions[1:] - positions[:-1]
        segments[:, ROTATION:] = np.concatenate([rotations[:-1], following, rotations[:-1], following], axis=1)
        last = self.times[-1]
        return (Curve(last, last, self.repeat, segments=segments, times=np.array(self.times)),)


@dataclass(frozen=True)
class Composite(ClosedForm):
    """Several dynamics at once: each moves in the frame that the ones before it make.

    Only the first starts where the body was placed; the others start at the origin of that frame. So
    ``Composite((CatmullWaypoints(...), Orbit(period=1.0)))`` follows a path and spins about its own y axis.
    """

    parts: Sequence[ClosedForm]

    def __post_init__(self) -> None:
        if not isinstance(self.parts, Sequence) or isinstance(self.parts, str):
            raise ArgumentTypeError(f"parts={self.parts!r}: must be a sequence of dynamics")
        if not self.parts:
            raise ArgumentError("parts: a Composite needs one dynamic or more")
        for index, part in enumerate(self.parts):
            check_closed_form(part, f"parts[{index}]")
            if index and isinstance(part, LookAt):
                raise ArgumentError(
                    f"parts[{index}]: LookAt aims at a point in world space and cannot be a later part; "
                    "use LookAt(target, motion=Composite(...))"
                )
        object.__setattr__(self, "parts", tuple(self.parts))

    @property
    def loop_time(self) -> float:
        """The least common multiple of the parts' loops."""
        loops = [part.loop_time for part in self.parts if part.loop_time > 0.0]
        if math.inf in loops:
            return math.inf
        return float(functools.reduce(_common_multiple, map(exact, loops))) if loops else 0.0

    def tracks(self, start: Pose) -> tuple[Track, ...]:
        starts = [start] + [Pose()] * (len(self.parts) - 1)
        return tuple(track for part, where in zip(self.parts, starts, strict=True) for track in part.tracks(where))


def check_closed_form(value: object, name: str) -> ClosedForm:
    """`value`, if its pose is a formula of time. Raises TypeError."""
    dynamic = check_dynamic(value, name)
    if not isinstance(dynamic, ClosedForm):
        raise ArgumentTypeError(f"{name}={value!r}: must be a dynamic in closed form, such as CatmullWaypoints")
    return dynamic


def _common_multiple(a: Fraction, b: Fraction) -> Fraction:
    return Fraction(math.lcm(a.numerator, b.numerator), math.gcd(a.denominator, b.denominator))
