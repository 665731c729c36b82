# SPDX-License-Identifier: Apache-2.0
"""USD's row-vector matrices in stage units to column-vector matrices in meters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Gf

from tiscene.scene.description import Matrix

FARTHEST = 1e18  # m; areas of what is larger are beyond single precision


def to_matrix(matrix: Gf.Matrix4d, meters_per_unit: float) -> Matrix:
    """A USD transform as float64 4x4 for column vectors. Both its spaces turn from stage units to meters."""
    result = np.array(matrix, dtype=np.float64).T
    result[:3, 3] *= meters_per_unit
    return result


def beyond(matrices: NDArray[np.float64]) -> str:
    """Why transforms over time cannot place anything; "" if they can. What is squashed flat for a while is not seen."""
    if not np.isfinite(matrices).all():
        return "its transform holds numbers that are not finite"
    if np.abs(matrices).max(initial=0.0) > FARTHEST:
        return f"its transform holds numbers above {FARTHEST:g}"
    return ""


def is_flat(matrix: Matrix) -> bool:
    """Whether a transform squashes what it places: a scale is zero, or axes coincide."""
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    return not scale.all() or bool(abs(np.linalg.det(matrix[:3, :3] / scale)) < 1e-9)


def fault(matrix: Matrix) -> str:
    """Why a transform cannot place anything; "" if it can."""
    if wrong := beyond(matrix):
        return wrong
    if is_flat(matrix):
        return "its transform is singular: a scale is zero, or axes coincide"
    if np.abs(matrix[3] - (0.0, 0.0, 0.0, 1.0)).max() > 1e-9:
        return "its transform is not affine"
    return ""


def unmirrored(matrix: Matrix) -> Matrix:
    """The transform of what looks along its -z and has its +y up, with x turned round where it mirrors."""
    return matrix @ np.diag([-1.0, 1.0, 1.0, 1.0]) if np.linalg.det(matrix[:3, :3]) < 0.0 else matrix


def unscaled(matrix: Matrix) -> Matrix | None:
    """The transform without its scale and shear: -z stays normal to the xy plane, x keeps its direction.

    None for a singular transform.
    """
    if fault(matrix):
        return None
    x, y, z = matrix[:3, :3].T
    normal = np.cross(x, y)
    normal /= np.linalg.norm(normal) * np.sign(normal @ z)  # a mirrored light still emits towards its own -z
    right = x / np.linalg.norm(x)
    result = np.eye(4)
    result[:3, :3] = np.column_stack([right, np.cross(normal, right), normal])
    result[:3, 3] = matrix[:3, 3]
    return result
