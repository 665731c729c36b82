# SPDX-License-Identifier: Apache-2.0
"""Balls that contain the path of a body, from its tracks.

Time does not count: where several tracks move, the path is taken to hold all combinations of their poses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dynamics.dynamic import POSITION, ROTATION, Array, Curve, Track, Turn
from dynamics.rotation import rotate

PIECES = 64  # of a whole turn; a curve has up to as many more as it has segments
MAX_BALLS = 8192  # where several tracks move

# Bézier points of a cubic from its coefficients. The curve lies in their convex hull.
BEZIER: Array = np.array([[1, 0, 0, 0], [1, 1 / 3, 0, 0], [1, 2 / 3, 1 / 3, 0], [1, 1, 1, 1]])


def cover_path(tracks: Sequence[Track]) -> Array:
    """Return balls that contain the origin of a body wherever on its tracks it is.

    Args:
        tracks: Its tracks, each in the frame of the one before.

    Returns:
        float64 [n, 4], centers and radii, m.
    """
    balls = np.zeros((1, 4))
    for track in reversed(tracks):
        if isinstance(track, Curve):
            balls = _sums(_cover_curve(track), _rotated(balls, track))
        elif isinstance(track, Turn):
            balls = _turned(balls, track)
        else:
            balls = _about_origin(balls)
    return balls


def _cover_curve(curve: Curve) -> Array:
    """Return balls [n, 4] around pieces of about equal length, and of the jump from the end to the start."""
    cubics = curve.segments[:, POSITION:ROTATION].reshape(-1, 4, 3)
    if curve.repeat:
        start, end = cubics[0, 0], cubics[-1].sum(axis=0)
        cubics = np.concatenate([cubics, [[end, start - end, np.zeros(3), np.zeros(3)]]])
    lengths = np.linalg.norm(np.diff(BEZIER @ cubics, axis=1), axis=2).sum(axis=1)
    total = lengths.sum()
    pieces = np.maximum(np.ceil(PIECES * lengths / total), 1).astype(int) if total else np.ones(len(lengths), int)
    a, b, c, d = np.repeat(cubics, pieces, axis=0).swapaxes(0, 1)
    # Each piece as a cubic of its own parameter 0..1.
    step = np.repeat(1.0 / pieces, pieces)[:, None]
    t = step * (np.arange(len(step)) - np.repeat(np.cumsum(pieces) - pieces, pieces))[:, None]
    shifted = (a + t * (b + t * (c + t * d)), b + t * (2.0 * c + 3.0 * t * d), c + 3.0 * t * d, d)
    points = BEZIER @ np.stack([shifted[power] * step**power for power in range(4)], axis=1)
    centers = 0.5 * (points[:, 0] + points[:, 3])
    return np.column_stack([centers, np.linalg.norm(points - centers[:, None], axis=2).max(axis=1)])


def _rotated(balls: Array, curve: Curve) -> Array:
    """Return balls that contain others at all rotations of a curve."""
    quaternions = curve.segments[:, ROTATION:].reshape(-1, 4)
    if curve.euler or np.ptp(quaternions, axis=0).max() > 1e-9:
        return _about_origin(balls)
    return np.column_stack([rotate(quaternions[0], balls[:, :3]), balls[:, 3]])


def _turned(balls: Array, turn: Turn) -> Array:
    """Return balls that contain others at all angles of a turn."""
    axis = np.array(turn.axis)
    if not np.cross(axis, balls[:, :3]).any():
        return balls
    balls = _limited(balls, PIECES)
    along = (balls[:, :3] @ axis)[:, None] * axis
    across = balls[:, :3] - along
    angles = (2.0 * np.pi / PIECES * np.arange(PIECES))[:, None, None]
    centers = along + np.cos(angles) * across + np.sin(angles) * np.cross(axis, across)
    # The chord from the middle to the end of a piece.
    radii = balls[:, 3] + 2.0 * math.sin(0.5 * np.pi / PIECES) * np.linalg.norm(across, axis=1)
    return np.column_stack([centers.reshape(-1, 3), np.tile(radii, PIECES)])


def _sums(balls: Array, others: Array) -> Array:
    """Return the Minkowski sums of each ball with each of the others."""
    others = _limited(others, len(balls))
    sums: Array = (balls[:, None] + others).reshape(-1, 4)
    return sums


def _limited(balls: Array, factor: int) -> Array:
    """Return balls, or one around all where `factor` times their number is too large."""
    if factor == 1 or factor * len(balls) <= MAX_BALLS:
        return balls
    center = 0.5 * (balls[:, :3].min(axis=0) + balls[:, :3].max(axis=0))
    return np.array([[*center, (np.linalg.norm(balls[:, :3] - center, axis=1) + balls[:, 3]).max()]])


def _about_origin(balls: Array) -> Array:
    """Return the ball about the origin that contains others at all rotations."""
    return np.array([[0.0, 0.0, 0.0, (np.linalg.norm(balls[:, :3], axis=1) + balls[:, 3]).max()]])
