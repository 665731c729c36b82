# SPDX-License-Identifier: Apache-2.0
"""Closed-form trajectories beside waypoints: Still, Orbit, LookAt, Keyframes and Composite.

Each is a frozen dataclass whose `tracks` describe the pose as a formula of the body's clock (`dynamics.dynamic`).
"""

from __future__ import annotations

import functools
import itertools
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dynamics.argument_checks import direction, flag, numbers, position, positive, set_checked
from dynamics.clocks import common_multiple, exact
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
    """A body that stays where it is placed."""

    @property
    def loop_time(self) -> float:
        return 0.0

    def tracks(self, start: Pose) -> tuple[Track, ...]:
        return (fixed(start),)


@dataclass(frozen=True)
class Orbit(ClosedForm):
    """A rigid rotation of the start pose about an axis; what faces the center keeps facing it.

    Args:
        center: A point of the axis, meters.
        period: Seconds per turn.
        axis: Direction of the axis, of any length; turns are right-handed about it.
    """

    center: Vector = (0.0, 0.0, 0.0)
    period: float = 10.0
    axis: Vector = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        set_checked(self, center=position, period=positive, axis=direction)

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
    """A motion with the rotation replaced: the -z axis points at a fixed target, as a camera's does.

    Args:
        target: Point to look at, meters, world.
        motion: Closed-form dynamic that gives the position.
        up: Direction that the +y axis stays closest to.
    """

    target: Vector
    motion: ClosedForm = field(default_factory=Still)
    up: Vector = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        set_checked(self, target=position, up=direction, motion=check_closed_form)

    @property
    def loop_time(self) -> float:
        return self.motion.loop_time

    def tracks(self, start: Pose) -> tuple[Track, ...]:
        return (*self.motion.tracks(start), Aim(None, 0.0, False, target=self.target, up=unit(self.up, "up")))


@dataclass(frozen=True)
class Keyframes(ClosedForm):
    """Poses at given times, with straight lines and slerp between them.

    The first pose is held before its time; the last is held after it, unless `repeat` is set.

    Args:
        times: Seconds on the body's clock, increasing, one for each waypoint.
        waypoints: Two or more poses.
        repeat: Start again after the last time.
    """

    times: Sequence[float]
    waypoints: Sequence[Waypoint]
    repeat: bool = False

    def __post_init__(self) -> None:
        waypoints = check_waypoints(self.waypoints)
        times = numbers(self.times, "times", len(waypoints))
        if times[0] < 0.0 or any(b <= a for a, b in itertools.pairwise(times)):
            raise ArgumentError(f"times={self.times!r}: must begin at 0 or later and increase")
        flag(self.repeat, "repeat")
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
    """Several dynamics at once: each moves in the frame that those before it define.

    The first starts where the body is placed, the others at the origin of that frame. For example,
    ``Composite((CatmullWaypoints(...), Orbit(period=1.0)))`` follows a path and spins about its own y axis.

    Args:
        parts: One or more closed-form dynamics; LookAt only as the first.
    """

    parts: Sequence[ClosedForm]

    def __post_init__(self) -> None:
        if not isinstance(self.parts, Sequence) or isinstance(self.parts, str):
            raise ArgumentTypeError(f"parts={self.parts!r}: must be a sequence of dynamics")
        if not self.parts:
            raise ArgumentError("parts=(): must hold one dynamic or more")
        for index, part in enumerate(self.parts):
            check_closed_form(part, f"parts[{index}]")
            if index and isinstance(part, LookAt):
                raise ArgumentError(
                    f"parts[{index}]: LookAt aims at a point in world space, so it can only be the first part; "
                    "use LookAt(target, motion=Composite(...))"
                )
        object.__setattr__(self, "parts", tuple(self.parts))

    @property
    def loop_time(self) -> float:
        """Least common multiple of the parts' loop times, seconds; infinite beyond the range of floats."""
        loops = [part.loop_time for part in self.parts if part.loop_time > 0.0]
        if math.inf in loops:
            return math.inf
        multiple = functools.reduce(common_multiple, map(exact, loops)) if loops else 0
        return float(multiple) if multiple <= sys.float_info.max else math.inf

    def tracks(self, start: Pose) -> tuple[Track, ...]:
        starts = [start] + [Pose()] * (len(self.parts) - 1)
        return tuple(track for part, where in zip(self.parts, starts, strict=True) for track in part.tracks(where))


def check_closed_form(value: object, name: str) -> ClosedForm:
    """Return `value`, a closed-form dynamic."""
    dynamic = check_dynamic(value, name)
    if not isinstance(dynamic, ClosedForm):
        raise ArgumentTypeError(f"{name}={value!r}: must be a dynamic in closed form, such as CatmullWaypoints")
    return dynamic
