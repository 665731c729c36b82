# SPDX-License-Identifier: Apache-2.0
"""Unity's space, in which SAILenv speaks: left-handed, Y up, +Z ahead, meters, Euler degrees. Only this file knows it.

Mirroring z turns it into tiscene's space and back: a point (x, y, z) is (x, y, -z), a turn about x or y changes its
sense, one about z keeps it. Unity turns about z, then x, then y, as `dynamics.rotation` does: in Unity a positive pitch
(x) looks down and a positive yaw (y) turns right, in tiscene they look up and turn left.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import matrix_from_quaternion, quaternion_from_euler
from tiscene.scene.camera import Quaternion, Vector3


def mirrored(vector: Vector3) -> Vector3:
    """A point or direction of one space in the other."""
    x, y, z = vector
    return (x, y, 0.0 - z)


def mirrored_euler(degrees: Vector3) -> Vector3:
    """Euler angles (x, y, z) of one space in the other, degrees."""
    x, y, z = degrees
    return (0.0 - x, 0.0 - y, z)


def quaternion_of(degrees: Vector3) -> Quaternion:
    """tiscene's unit quaternion (w, x, y, z) of Unity's Euler angles, degrees."""
    w, x, y, z = quaternion_from_euler(mirrored_euler(degrees)).tolist()
    return (w, x, y, z)


def euler_of(rotation: Quaternion) -> Vector3:
    """Unity's Euler angles in 0..360 degrees of tiscene's quaternion; looking straight up or down, roll is 0."""
    matrix = matrix_from_quaternion(rotation)
    sine = -float(np.clip(matrix[1, 2], -1.0, 1.0))
    x = math.asin(sine)
    if abs(sine) < 1.0 - 1e-9:
        y = math.atan2(matrix[0, 2], matrix[2, 2])
        z = math.atan2(matrix[1, 0], matrix[1, 1])
    else:
        y, z = math.atan2(-matrix[2, 0], matrix[0, 0]), 0.0
    a, b, c = mirrored_euler((math.degrees(x), math.degrees(y), math.degrees(z)))
    return (a % 360.0 % 360.0, b % 360.0 % 360.0, c % 360.0 % 360.0)  # once is 360 for a little less than 0


def flow_of(backward: NDArray[np.float32]) -> NDArray[np.float32]:
    """SAILenv's flow, (-dx, +dy) where (dx, dy) = p(k) - p(k-1), px, y down, of `backward_flow` [h, w, 2]: a copy."""
    return backward * np.array([1.0, -1.0], np.float32) + np.float32(0.0)  # no -0
