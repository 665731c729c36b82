# SPDX-License-Identifier: Apache-2.0
"""Transforms: USD's row-vector matrices in stage units as column-vector matrices in meters, and their validity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom

from tiscene.scene.description import Matrix

MAX_COORDINATE = 1e18  # m; squares of larger numbers, hence areas, overflow single precision


def to_matrix(matrix: Gf.Matrix4d, meters_per_unit: float) -> Matrix:
    """Return a USD transform as float64 4x4 for column vectors, with both its spaces in meters."""
    result = np.array(matrix, dtype=np.float64).T
    result[:3, 3] *= meters_per_unit
    return result


def from_matrix(matrix: Matrix, meters_per_unit: float) -> Gf.Matrix4d:
    """Return the USD transform that `to_matrix` gives a matrix for."""
    result = Gf.Matrix4d(matrix.T.tolist())
    return result.SetTranslateOnly(result.ExtractTranslation() / meters_per_unit)


def point_matrices(instancer: UsdGeom.PointInstancer, time: Usd.TimeCode) -> NDArray[np.float64]:
    """Return the transforms of an instancer's points, masked ones too, in its space: [n, 4, 4], stage units."""
    transforms = instancer.ComputeInstanceTransformsAtTime(
        time, time, UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
    )
    return np.asarray(transforms, np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)


def range_fault(matrices: NDArray[np.float64]) -> str:
    """Return why transforms are out of range, "" if they are not. Singular ones are in range: they hide for a while.

    Args:
        matrices: float64 [..., 4, 4].
    """
    if not np.isfinite(matrices).all():
        return "its transform holds numbers that are not finite"
    if np.abs(matrices).max(initial=0.0) > MAX_COORDINATE:
        return f"its transform holds numbers above {MAX_COORDINATE:g}"
    return ""


def is_singular(matrix: Matrix) -> bool:
    """Return whether a transform flattens objects: a scale is zero, or axes coincide; False if it is not finite."""
    with np.errstate(invalid="ignore"):
        scale = np.linalg.norm(matrix[:3, :3], axis=0)
        return not scale.all() or bool(abs(np.linalg.det(matrix[:3, :3] / scale)) < 1e-9)


def transform_fault(matrix: Matrix) -> str:
    """Return why a 4x4 transform cannot place an object, "" if it can."""
    if fault := range_fault(matrix):
        return fault
    if is_singular(matrix):
        return "its transform is singular: a scale is zero, or axes coincide"
    if np.abs(matrix[3] - (0.0, 0.0, 0.0, 1.0)).max() > 1e-9:
        return "its transform is not affine"
    return ""


def unmirrored(matrix: Matrix) -> Matrix:
    """Return the transform of a camera, which looks along -z with +y up, with x flipped where it mirrors."""
    return matrix @ np.diag([-1.0, 1.0, 1.0, 1.0]) if is_mirroring(matrix) else matrix


def is_mirroring(matrix: Matrix) -> bool:
    """Return whether a transform turns left-handed objects into right-handed ones; False if it is not finite."""
    with np.errstate(invalid="ignore"):
        return bool(np.linalg.det(matrix[:3, :3]) < 0.0)


def unscaled(matrix: Matrix) -> Matrix | None:
    """Return a transform without its scale and shear; None for an invalid one.

    The x axis keeps its direction, and -z stays normal to the xy plane: that is how a light or a camera is oriented.
    """
    if transform_fault(matrix):
        return None
    x, y, z = matrix[:3, :3].T
    normal = np.cross(x, y)
    normal /= np.linalg.norm(normal) * np.sign(normal @ z)  # a mirrored light still emits towards its own -z
    right = x / np.linalg.norm(x)
    result = np.eye(4)
    result[:3, :3] = np.column_stack([right, np.cross(normal, right), normal])
    result[:3, 3] = matrix[:3, 3]
    return result


def scale_along(matrix: Matrix, pose: Matrix) -> NDArray[np.float64]:
    """Return the scale [3] along the axes of `pose`, which is `unscaled` of the transform.

    Without shear it is the length of each axis. With shear it keeps the areas of rectangles in the xy plane.
    """
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    across = np.abs((pose[:3, :3] * matrix[:3, :3]).sum(axis=0))
    return np.asarray(across if is_sheared(matrix) else lengths)


def is_sheared(matrix: Matrix) -> bool:
    """Return whether any two axes of a transform are not perpendicular, by 0.6 degrees or more."""
    axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
    return bool(np.abs(axes.T @ axes - np.eye(3)).max() > 0.01)
