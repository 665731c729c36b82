# SPDX-License-Identifier: Apache-2.0
"""Bodies, and the device columns that hold all their formulas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from numbers import Rational
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import argument_checks
from dynamics.closed_form import Still
from dynamics.dynamic import LENGTH_STEPS, SEGMENT_COLUMNS, Aim, Curve, Dynamic, Pose, Track, Turn, check_dynamic
from dynamics.errors import ArgumentError
from dynamics.rotation import quaternion

# Kinds of tracks, and how a curve finds its segment: by counting, by arc length, by a table of times.
CURVE, TURN, AIM = 0, 1, 2
BY_COUNT, BY_LENGTH, BY_TIME = 0, 1, 2


@dataclass(frozen=True)
class Body:
    """Something that moves.

    position: m, rotation: Euler angles (degrees) or a quaternion: where it is placed. Dynamics that name their own
    poses, such as waypoints, start from those instead.
    name: by which timings may refer to it.
    birth: s of the world's time at which it appears. Its clock runs from then on at the earliest.
    timed: whether the timings apply to it; if not, it moves from its birth on (a camera, say).
    """

    dynamic: Dynamic = field(default_factory=Still)
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    name: str = ""
    birth: float | Rational = 0
    timed: bool = True

    def __post_init__(self) -> None:
        check_dynamic(self.dynamic, "dynamic")
        object.__setattr__(self, "position", argument_checks.vector(self.position, "position"))
        object.__setattr__(self, "rotation", argument_checks.rotation(self.rotation, "rotation"))
        if argument_checks.number(self.birth, "birth") < 0.0:
            raise ArgumentError(f"birth={self.birth!r}: must not be before the start of the world's time, 0")
        if self.name != "":
            argument_checks.text(self.name, "name")
        argument_checks.flag(self.timed, "timed")

    @property
    def start(self) -> Pose:
        """Where it was placed."""
        w, x, y, z = quaternion(self.rotation).tolist()
        return Pose(self.position, (w, x, y, z))


@dataclass(frozen=True)
class BodyColumns:
    """What the kernel reads.

    bodies: int32 [n, 2], first track and number of tracks.
    tracks: int32 [t, 5], kind, first segment, number of segments, way to find the segment, Euler angles or not.
    axes: float64 [t, 6], of a turn its axis, of an aim its target and up direction.
    segments: float64 [s, SEGMENT_COLUMNS].
    spans: float64 [s, LENGTH_STEPS + 1], cumulative arc lengths, or times at both ends.
    """

    bodies: NDArray[np.int32]
    tracks: NDArray[np.int32]
    axes: NDArray[np.float64]
    segments: NDArray[np.float64]
    spans: NDArray[np.float64]

    def arrays(self) -> tuple[NDArray[Any], ...]:
        return self.bodies, self.tracks, self.axes, self.segments, self.spans


def columns(bodies: Sequence[Sequence[Track]]) -> BodyColumns:
    """The tracks of all bodies, side by side. Arrays have one row at least, since a device array cannot be empty."""
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
