# SPDX-License-Identifier: Apache-2.0
"""Tests for surfaces that overlap: whether two surfaces cross, and whether a point lies inside a closed one.

Results are exact up to rounding. Whether surfaces that only touch count as crossing depends on their triangles: shrink
one of them first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLOCK = 32  # neighboring triangles that are culled together
PAIRS = 256  # pairs of blocks that are tested at once


def surfaces_cross(a: Array, b: Array) -> bool:
    """Return whether a triangle of one surface crosses a triangle of another.

    Args:
        a: float64 [n, 3, 3], corners of triangles, m.
        b: float64 [m, 3, 3], the same of the other surface.
    """
    a = a[boxes_touch(_boxes(a), _bounds(b))]
    b = b[boxes_touch(_boxes(b), _bounds(a))]
    if not len(a) or not len(b):
        return False
    a, b = _in_blocks(a), _in_blocks(b)
    boxes_a, boxes_b = _boxes(a), _boxes(b)
    blocks_a, blocks_b = _bounds(a), _bounds(b)
    pairs = np.argwhere(boxes_touch(blocks_a[:, None], blocks_b[None]))
    for first in range(0, len(pairs), PAIRS):
        rows_a, rows_b = pairs[first : first + PAIRS].T
        near = np.argwhere(boxes_touch(boxes_a[rows_a][:, :, None], boxes_b[rows_b][:, None]))
        pair, place_a, place_b = near.T
        if _any_crossing(a[rows_a[pair], place_a], b[rows_b[pair], place_b]):
            return True
    return False


def winding_number(point: Array, triangles: Array) -> float:
    """Return how often a surface winds around a point: 1 inside a closed surface that faces outwards, 0 outside.

    The sum of signed solid angles (Van Oosterom and Strackee, "The Solid Angle of a Plane Triangle", 1983).

    Args:
        point: float64 [3], m.
        triangles: float64 [n, 3, 3], corners counter-clockwise seen from outside, m.
    """
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    length_a, length_b, length_c = (np.linalg.norm(each, axis=1) for each in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    scale = length_a * length_b * length_c
    for one, two, opposite in ((a, b, length_c), (b, c, length_a), (c, a, length_b)):
        scale = scale + np.einsum("ij,ij->i", one, two) * opposite
    return float(np.arctan2(volume, scale).sum() / (2.0 * np.pi))


def shrunk(triangles: Array, margin: float, largest: float) -> Array:
    """Return a surface shrunk about the center of its box, along each axis.

    Args:
        triangles: float64 [n, 3, 3], m.
        margin: how far each side of its box moves inwards, m.
        largest: largest such distance as a fraction of the box's size.
    """
    low, high = _bounds(triangles)
    size = high - low
    factor = 1.0 - 2.0 * np.minimum(margin / np.maximum(size, 1e-12), largest)
    center = 0.5 * (low + high)
    result: Array = center + factor * (triangles - center)
    return result


def _boxes(triangles: Array) -> Array:
    """Return lowest and highest corner [..., 2, 3] of triangles [..., 3, 3]."""
    return np.stack([triangles.min(axis=-2), triangles.max(axis=-2)], axis=-2)


def _bounds(triangles: Array) -> Array:
    """Return lowest and highest corner [..., 2, 3] of surfaces [..., n, 3, 3]; inf and -inf for no triangles."""
    low = triangles.min(axis=(-3, -2), initial=np.inf)
    high = triangles.max(axis=(-3, -2), initial=-np.inf)
    return np.stack([low, high], axis=-2)


def boxes_touch(a: Array, b: Array) -> NDArray[np.bool_]:
    """Return which boxes [..., 2, 3] touch; boxes of NaN touch nothing."""
    return np.asarray(((a[..., 0, :] <= b[..., 1, :]) & (b[..., 0, :] <= a[..., 1, :])).all(axis=-1), np.bool_)


def _in_blocks(triangles: Array) -> Array:
    """Sort triangles along a Morton curve into blocks [k, BLOCK, 3, 3]; the last block repeats its last triangle."""
    centers = triangles.mean(axis=1)
    low, high = centers.min(axis=0), centers.max(axis=0)
    cells = (1023.0 * (centers - low) / np.maximum(high - low, 1e-12)).astype(np.int64)
    code = np.zeros(len(cells), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    order = np.argsort(code, kind="stable")
    count = -(-len(order) // BLOCK) * BLOCK
    blocks: Array = triangles[np.pad(order, (0, count - len(order)), mode="edge")].reshape(-1, BLOCK, 3, 3)
    return blocks


def _any_crossing(a: Array, b: Array) -> bool:
    """Return whether in any pair of triangles [n, 3, 3] an edge of one passes through the other."""
    for one, other in ((a, b), (b, a)):
        for corner in range(3):
            if _pierces(one[:, corner], one[:, (corner + 1) % 3], other).any():
                return True
    return False


def _pierces(start: Array, end: Array, triangles: Array) -> NDArray[np.bool_]:
    """Return which of the segments [n, 3] pass through their triangles [n, 3, 3]."""
    corners = [triangles[:, corner] for corner in range(3)]
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    below = np.einsum("ij,ij->i", start - corners[0], normal)
    above = np.einsum("ij,ij->i", end - corners[0], normal)
    along = end - start
    arms = [corner - start for corner in corners]
    sides = np.stack(
        [np.einsum("ij,ij->i", along, np.cross(arms[each], arms[(each + 1) % 3])) for each in range(3)], axis=1
    )
    within = (sides >= 0.0).all(axis=1) | (sides <= 0.0).all(axis=1)
    result: NDArray[np.bool_] = within & (below * above < 0.0)
    return result
