# SPDX-License-Identifier: Apache-2.0
"""Conversions between Unity's space, which SAILenv uses, and tiscene's. No other module knows Unity's conventions.

Unity's space is left-handed, Y up, +Z forward, in meters, with Euler angles in degrees. Mirroring z converts it to
tiscene's space and back: a point (x, y, z) becomes (x, y, -z), rotations about x and y change sign, those about z do
not. Unity rotates about z, then x, then y, as `dynamics.rotation` does. In Unity a positive pitch (x) looks down and a
positive yaw (y) turns right; in tiscene they look up and turn left.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import matrix_from_quaternion, quaternion_from_euler
from tiscene.scene.camera import Quaternion, Vector3


def mirrored(vector: Vector3) -> Vector3:
    """Convert a point or direction from one space to the other."""
    x, y, z = vector
    return (x, y, 0.0 - z)


def mirrored_euler(degrees: Vector3) -> Vector3:
    """Convert Euler angles (x, y, z), degrees, from one space to the other."""
    x, y, z = degrees
    return (0.0 - x, 0.0 - y, z)


def quaternion_of(degrees: Vector3) -> Quaternion:
    """Return tiscene's unit quaternion (w, x, y, z) of Unity's Euler angles, degrees."""
    w, x, y, z = quaternion_from_euler(mirrored_euler(degrees)).tolist()
    return (w, x, y, z)


def euler_of(rotation: Quaternion) -> Vector3:
    """Return Unity's Euler angles, 0..360 degrees, of tiscene's quaternion; looking straight up or down, roll is 0."""
    matrix = matrix_from_quaternion(rotation)
    sine = -float(np.clip(matrix[1, 2], -1.0, 1.0))
    x = math.asin(sine)
    if abs(sine) < 1.0 - 1e-9:
        y = math.atan2(matrix[0, 2], matrix[2, 2])
        z = math.atan2(matrix[1, 0], matrix[1, 1])
    else:
        y, z = math.atan2(-matrix[2, 0], matrix[0, 0]), 0.0
    a, b, c = mirrored_euler((math.degrees(x), math.degrees(y), math.degrees(z)))
    return (a % 360.0 % 360.0, b % 360.0 % 360.0, c % 360.0 % 360.0)  # `-1e-17 % 360.0` is 360.0


def flow_of(backward: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return SAILenv's flow, (-dx, +dy) with (dx, dy) = p(k) - p(k-1), px, y down.

    Args:
        backward: The buffer `backward_flow` [h, w, 2].

    Returns:
        A new array [h, w, 2].
    """
    return backward * np.array([1.0, -1.0], np.float32) + np.float32(0.0)  # adding 0 turns -0 into 0
