# SPDX-License-Identifier: Apache-2.0
"""Rotations as quaternions (w, x, y, z) and as Euler angles, in numpy.

Euler angles are degrees (x, y, z): rotate about the fixed z axis, then about the fixed x axis, then about the fixed y
axis, R = R_y R_x R_z, each right-handed. This is Unity's order in right-handed space: x is pitch (positive looks up
when facing -z), y is yaw (positive turns left, counter-clockwise seen from above), z is roll. All functions accept
arrays of rotations along leading axes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def quaternion_from_euler(degrees: ArrayLike) -> Array:
    """Return the unit quaternions [..., 4] of Euler angles [..., 3] in degrees."""
    half = np.radians(np.asarray(degrees, dtype=np.float64)) * 0.5
    quaternions = np.zeros((3, *half.shape[:-1], 4))
    for axis in range(3):
        quaternions[axis, ..., 0] = np.cos(half[..., axis])
        quaternions[axis, ..., 1 + axis] = np.sin(half[..., axis])
    about_x, about_y, about_z = quaternions
    return multiply(multiply(about_y, about_x), about_z)


def quaternion(rotation: Sequence[float]) -> Array:
    """Return the unit quaternion [4] of three Euler angles (degrees) or of a quaternion (w, x, y, z) of any length."""
    if len(rotation) == 3:
        return quaternion_from_euler(rotation)
    values = np.asarray(rotation, dtype=np.float64)
    unit: Array = values / np.linalg.norm(values)
    return unit


def multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the Hamilton products [..., 4]: the rotation `b`, then the rotation `a`."""
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    w, v = a[..., :1], a[..., 1:]
    scalar = w * b[..., :1] - np.sum(v * b[..., 1:], axis=-1, keepdims=True)
    return np.concatenate([scalar, w * b[..., 1:] + b[..., :1] * v + np.cross(v, b[..., 1:])], axis=-1)


def conjugate(q: ArrayLike) -> Array:
    """Return the inverse rotations [..., 4]."""
    return np.asarray(q, dtype=np.float64) * (1.0, -1.0, -1.0, -1.0)


def rotate(q: ArrayLike, vectors: ArrayLike) -> Array:
    """Return `vectors` [..., 3] rotated by the unit quaternions `q` [..., 4]."""
    q, vectors = np.asarray(q, dtype=np.float64), np.asarray(vectors, dtype=np.float64)
    twice = 2.0 * np.cross(q[..., 1:], vectors)
    return vectors + q[..., :1] * twice + np.cross(q[..., 1:], twice)


def aligned(q: ArrayLike, reference: ArrayLike) -> Array:
    """Return `q` or -q [..., 4], the same rotations, whichever lie in the hemisphere of `reference`."""
    q = np.asarray(q, dtype=np.float64)
    return np.where(np.sum(q * reference, axis=-1, keepdims=True) < 0.0, -q, q)


def matrix_from_quaternion(q: ArrayLike) -> Array:
    """Return the matrices [..., 3, 3] of unit quaternions [..., 4]."""
    w, x, y, z = np.moveaxis(np.asarray(q, dtype=np.float64), -1, 0)
    matrix = np.empty((*w.shape, 3, 3))
    matrix[..., 0, 0] = 1 - 2 * (y * y + z * z)
    matrix[..., 0, 1] = 2 * (x * y - w * z)
    matrix[..., 0, 2] = 2 * (x * z + w * y)
    matrix[..., 1, 0] = 2 * (x * y + w * z)
    matrix[..., 1, 1] = 1 - 2 * (x * x + z * z)
    matrix[..., 1, 2] = 2 * (y * z - w * x)
    matrix[..., 2, 0] = 2 * (x * z - w * y)
    matrix[..., 2, 1] = 2 * (y * z + w * x)
    matrix[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return matrix


def log(q: ArrayLike) -> Array:
    """Return half the rotation vectors [..., 3] of unit quaternions."""
    q = np.asarray(q, dtype=np.float64)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = np.arctan2(sine, q[..., :1])
    # angle / sine tends to 1 at the identity.
    scale: Array = np.divide(angle, sine, out=np.ones_like(sine), where=sine > 1e-12)
    return q[..., 1:] * scale


def exp(v: ArrayLike) -> Array:
    """Return the unit quaternions [..., 4] of half rotation vectors."""
    v = np.asarray(v, dtype=np.float64)
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle), v * np.sinc(angle / np.pi)], axis=-1)


def squad_controls(q: Array) -> Array:
    """Return the inner control quaternions [n, 4] for squad of a closed loop of n unit quaternions.

    s_i = q_i exp(-(log(q_i^-1 q_{i+1}) + log(q_i^-1 q_{i-1})) / 4), with neighbors in the hemisphere of q_i (Shoemake,
    "Quaternion Calculus and Fast Animation", SIGGRAPH course notes 1987). Angular velocity is continuous when all
    segments last equally long.
    """
    following, preceding = aligned(np.roll(q, -1, axis=0), q), aligned(np.roll(q, 1, axis=0), q)
    inverse = conjugate(q)
    turn = log(multiply(inverse, following)) + log(multiply(inverse, preceding))
    return multiply(q, exp(-0.25 * turn))
