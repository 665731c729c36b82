# SPDX-License-Identifier: Apache-2.0
"""Affine maps [..., 3, 4] of many instances: inverses, moved origins, and boxes around transformed boxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

_SINGULAR = 1e-14  # determinant over the cube of the largest entry, up to which it is a rounding error
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])


def inverted(matrices: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return inverses of affine maps [..., 3, 4] and determinants [...]; zeros for those that are nearly singular."""
    rows = np.moveaxis(matrices, (-2, -1), (0, 1))
    (a, b, c, x), (d, e, f, y), (g, h, i, z) = rows
    cofactors = np.array(
        [
            [e * i - f * h, c * h - b * i, b * f - c * e],
            [f * g - d * i, a * i - c * g, c * d - a * f],
            [d * h - e * g, b * g - a * h, a * e - b * d],
        ]
    )
    determinant = a * cofactors[0, 0] + b * cofactors[1, 0] + c * cofactors[2, 0]
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        inverse = cofactors / determinant
        offset = -(inverse[:, 0] * x + inverse[:, 1] * y + inverse[:, 2] * z)
        usable = np.abs(determinant) > _SINGULAR * np.abs(matrices[..., :3]).max(axis=(-2, -1)) ** 3
    result = np.moveaxis(np.concatenate([inverse, offset[:, None]], axis=1), (0, 1), (-2, -1))
    usable &= np.isfinite(result).all(axis=(-2, -1))
    return np.where(usable[..., None, None], result, 0.0), np.where(usable, determinant, 0.0)


def with_origin(maps: NDArray[np.float64], origin: ArrayLike) -> NDArray[np.float64]:
    """Return affine maps [..., 3, 4] or [..., 4, 4] of a space whose origin is this point of the present one.

    Args:
        maps: The maps. They are returned themselves if no origin moves.
        origin: [3] or [..., 3].
    """
    offset = np.asarray(origin, np.float64)
    if not offset.any():
        return maps
    result = maps.copy()
    result[..., :3, 3] += np.einsum("...ij,...j->...i", maps[..., :3, :3], offset)
    return result


def corners_of(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners of boxes, [n, 8, 3]; boxes: lower and upper corner, [n, 2, 3]."""
    corners: NDArray[np.float64] = boxes[:, _CORNERS, np.arange(3)]
    return corners


def transformed_boxes(boxes: NDArray[np.float64], matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return world boxes [3, n, 6] around boxes [3, n, 2, 3] transformed by affine maps [3, n, 3, 4]."""
    center = 0.5 * (boxes[:, :, 0] + boxes[:, :, 1])
    half = 0.5 * (boxes[:, :, 1] - boxes[:, :, 0])
    world_center = matrices[..., 3].copy()
    world_half = np.zeros_like(world_center)
    for axis in range(3):
        world_center += matrices[..., axis] * center[:, :, axis, None]
        world_half += np.abs(matrices[..., axis]) * half[:, :, axis, None]
    return np.concatenate([world_center - world_half, world_center + world_half], axis=-1)
