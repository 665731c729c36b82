# SPDX-License-Identifier: Apache-2.0
"""Bodies (`Body`), and the arrays that hold the tracks of all bodies for the kernel (`BodyColumns`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Rational
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.argument_checks import flag, not_negative, rotation, set_checked, text, vector
from dynamics.closed_form import Still
from dynamics.dynamic import (
    LENGTH_STEPS,
    SEGMENT_COLUMNS,
    Aim,
    ClosedForm,
    Curve,
    Dynamic,
    Pose,
    Track,
    Turn,
    check_dynamic,
    fixed,
)
from dynamics.rotation import quaternion
from dynamics.stepped_dynamic import Stepped, SteppedStates

# Kinds of tracks, and how u selects the segment of a curve: by index, by arc length, by time.
CURVE, TURN, AIM = 0, 1, 2
BY_COUNT, BY_LENGTH, BY_TIME = 0, 1, 2


@dataclass(frozen=True)
class Body:
    """A rigid body and its trajectory.

    Args:
        dynamic: How it moves.
        position: Where it is placed, meters. Dynamics that define their own poses, such as waypoints, ignore the
            placement.
        rotation: How it is placed: Euler angles (degrees) or a quaternion (w, x, y, z).
        name: Name by which timings refer to it.
        birth: World time in seconds at which it appears. Its clock does not run before.
        timed: Whether timings apply to it; if not, it moves from its birth on, as a camera does.
    """

    dynamic: Dynamic = field(default_factory=Still)
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    name: str = ""
    birth: float | Rational = 0
    timed: bool = True

    def __post_init__(self) -> None:
        set_checked(self, dynamic=check_dynamic, position=vector, rotation=rotation)
        not_negative(self.birth, "birth")
        if self.name != "":
            text(self.name, "name")
        flag(self.timed, "timed")

    @property
    def start(self) -> Pose:
        """Pose at which the body is placed."""
        w, x, y, z = quaternion(self.rotation).tolist()
        return Pose(self.position, (w, x, y, z))

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """Tracks of its path, computed once: a static one for a dynamic that is not closed-form."""
        return self.dynamic.tracks(self.start) if isinstance(self.dynamic, ClosedForm) else (fixed(self.start),)

    @property
    def duration(self) -> float:
        """Seconds on its clock in which it goes through the longest of its tracks; 0 if they all stand still."""
        return max(track.duration or 0.0 for track in self.tracks)

    @cached_property
    def states(self) -> SteppedStates | None:
        """States of its Stepped dynamic, which all simulations of the body share; None for other dynamics."""
        return SteppedStates(self.dynamic, self.start, self.name) if isinstance(self.dynamic, Stepped) else None


@dataclass(frozen=True)
class BodyColumns:
    """The tracks of all bodies as arrays.

    Attributes:
        bodies: int32 [n, 2], first track and number of tracks.
        tracks: int32 [t, 5], kind, first segment, number of segments, how u selects a segment, whether Euler angles.
        axes: float64 [t, 6], axis of a turn; target and up direction of an aim.
        segments: float64 [s, SEGMENT_COLUMNS].
        spans: float64 [s, LENGTH_STEPS + 1], cumulative arc lengths, or times at both ends.
    """

    bodies: NDArray[np.int32]
    tracks: NDArray[np.int32]
    axes: NDArray[np.float64]
    segments: NDArray[np.float64]
    spans: NDArray[np.float64]

    def arrays(self) -> tuple[NDArray[Any], ...]:
        """Return the arrays in the order of the kernel's arguments."""
        return self.bodies, self.tracks, self.axes, self.segments, self.spans


def columns(bodies: Sequence[Sequence[Track]]) -> BodyColumns:
    """Return the tracks of all bodies in arrays of at least one row, since a device array cannot be empty."""
    ranges: list[tuple[int, int]] = []
    tracks: list[tuple[int, ...]] = []
    axes, segments, spans = [], [], []
    rows = 0
    for body in bodies:
        ranges.append((len(tracks), len(body)))
        for track in body:
            kind, count, find, euler, axis = AIM, 0, BY_COUNT, False, np.zeros(6)
            if isinstance(track, Curve):
                kind, count, euler = CURVE, len(track.segments), track.euler
                span = np.zeros((count, LENGTH_STEPS + 1))
                if track.lengths is not None:
                    find, span = BY_LENGTH, track.lengths
                elif track.times is not None:
                    find = BY_TIME
                    span[:, 0], span[:, -1] = track.times[:-1], track.times[1:]
                segments.append(track.segments)
                spans.append(span)
            elif isinstance(track, Turn):
                kind, axis[:3] = TURN, track.axis
            elif isinstance(track, Aim):
                axis[:3], axis[3:] = track.target, track.up
            tracks.append((kind, rows, count, find, int(euler)))
            axes.append(axis)
            rows += count
    return BodyColumns(
        bodies=np.array(ranges or [(0, 0)], dtype=np.int32),
        tracks=np.array(tracks or [(0, 0, 0, 0, 0)], dtype=np.int32),
        axes=np.array(axes or [np.zeros(6)]),
        segments=np.concatenate(segments) if segments else np.zeros((1, SEGMENT_COLUMNS)),
        spans=np.concatenate(spans) if spans else np.zeros((1, LENGTH_STEPS + 1)),
    )
