# SPDX-License-Identifier: Apache-2.0
"""Poses of waypoint loops in plain numpy, one body and one time at once, by other formulas than the kernel's."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynamics import CatmullWaypoints, LinearWaypoints

Array = NDArray[np.float64]

# Catmull and Rom's basis: rows t^0 .. t^3, columns the points before, at, after and beyond.
CATMULL_ROM = 0.5 * np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]])
# Pieces per segment of the polyline that measures arc length.
FINE = 500


def quaternion_of_euler(degrees: tuple[float, ...]) -> Array:
    """Return (w, x, y, z) of R_y R_x R_z, from the expanded product."""
    (cx, sx), (cy, sy), (cz, sz) = ((math.cos(math.radians(a) / 2), math.sin(math.radians(a) / 2)) for a in degrees)
    return np.array(
        [
            cy * cx * cz + sy * sx * sz,
            cy * sx * cz + sy * cx * sz,
            sy * cx * cz - cy * sx * sz,
            cy * cx * sz - sy * sx * cz,
        ]
    )


def quaternion_of(rotation: tuple[float, ...]) -> Array:
    """Return the unit quaternion of Euler angles (degrees) or of a quaternion."""
    if len(rotation) == 3:
        return quaternion_of_euler(rotation)
    return np.asarray(rotation) / np.linalg.norm(rotation)


def hamilton(a: Array, b: Array) -> Array:
    """Return the Hamilton product as a matrix product."""
    w, x, y, z = a
    left = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    product: Array = left @ b
    return product


def slerp(a: Array, b: Array, t: float) -> Array:
    """Interpolate within an orthonormal basis of the plane of both quaternions."""
    cosine = float(np.clip(a @ b, -1.0, 1.0))
    across = b - cosine * a
    length = np.linalg.norm(across)
    if length < 1e-12:
        return a
    angle = math.atan2(length, cosine) * t
    result: Array = math.cos(angle) * a + math.sin(angle) * across / length
    return result


def power(q: Array, exponent: float) -> Array:
    """Return q^exponent of a unit quaternion."""
    half = math.atan2(np.linalg.norm(q[1:]), q[0])
    if half < 1e-15:
        return np.array([1.0, 0.0, 0.0, 0.0])
    axis = q[1:] / math.sin(half)
    return np.array([math.cos(half * exponent), *(math.sin(half * exponent) * axis)])


def logarithm(q: Array) -> Array:
    """Return half the rotation vector of a unit quaternion."""
    half = math.atan2(np.linalg.norm(q[1:]), q[0])
    return q[1:] * (half / math.sin(half)) if half > 1e-12 else q[1:]


def same_side(q: Array, reference: Array) -> Array:
    """Return `q` or -q, whichever is in the hemisphere of `reference`."""
    return -q if q @ reference < 0 else q


def squad_control(before: Array, at: Array, after: Array) -> Array:
    """Return the inner control quaternion of squad at `at`."""
    inverse = at * (1, -1, -1, -1)
    total = logarithm(hamilton(inverse, same_side(after, at))) + logarithm(hamilton(inverse, same_side(before, at)))
    angle = float(np.linalg.norm(total)) / 4
    axis = -total / (4 * angle) if angle > 1e-15 else np.zeros(3)
    return hamilton(at, np.array([math.cos(angle), *(math.sin(angle) * axis)]))


def pose(path: LinearWaypoints | CatmullWaypoints, clock: float) -> Array:
    """Return the pose [7] at a time of the path's own clock: position, and quaternion up to its sign."""
    count = len(path.waypoints)
    phase = clock / path.total_time % 1.0
    u = phase * count if path.pacing == "equal_time" else _parameter_of_length(path, phase)
    segment = min(int(u), count - 1)
    return np.concatenate([_position(path, u), _rotation(path, segment, u - segment)])


def _around(values: list[Array], segment: int) -> list[Array]:
    return [values[(segment + step) % len(values)] for step in (-1, 0, 1, 2)]


def _blend(four: list[Array], t: float, smooth: bool) -> Array:
    if not smooth:
        return (1 - t) * four[1] + t * four[2]
    result: Array = np.array([1, t, t * t, t**3]) @ CATMULL_ROM @ np.array(four)
    return result


def _position(path: LinearWaypoints | CatmullWaypoints, u: float) -> Array:
    segment = min(int(u), len(path.waypoints) - 1)
    four = _around([np.array(waypoint.position) for waypoint in path.waypoints], segment)
    return _blend(four, u - segment, isinstance(path, CatmullWaypoints))


def _rotation(path: LinearWaypoints | CatmullWaypoints, segment: int, t: float) -> Array:
    smooth = isinstance(path, CatmullWaypoints)
    if path.rotation == "euler":
        angles = [np.array(waypoint.rotation) for waypoint in path.waypoints]
        count = len(angles)
        turn = 360.0 * np.round((angles[-1] - angles[0]) / 360.0)
        four = [angles[(segment + step) % count] + turn * ((segment + step) // count) for step in (-1, 0, 1, 2)]
        return quaternion_of_euler(tuple(_blend(four, t, smooth)))
    quaternions = [quaternion_of(waypoint.rotation) for waypoint in path.waypoints]
    before, a, b, beyond = _around(quaternions, segment)
    b = same_side(b, a)
    if not smooth:
        return slerp(a, b, t)
    inner = slerp(squad_control(before, a, b), squad_control(a, b, beyond), t)
    return slerp(slerp(a, b, t), inner, 2 * t * (1 - t))


def _parameter_of_length(path: LinearWaypoints | CatmullWaypoints, phase: float) -> float:
    """Return the path's parameter at a fraction of its arc length, from a fine polyline."""
    u = np.linspace(0, len(path.waypoints), FINE * len(path.waypoints) + 1)
    points = np.array([_position(path, each) for each in u])
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return float(np.interp(phase * lengths[-1], lengths, u))
