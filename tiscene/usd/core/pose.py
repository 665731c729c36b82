# SPDX-License-Identifier: Apache-2.0
"""Poses of prims: transform operations that say a scenario's pose to the bit, and poses out of any transform."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from tiscene.scene.assembly import rigid
from tiscene.scene.camera import matrix_from_quaternion, quaternion_from_matrix
from tiscene.scene.description import Matrix
from tiscene.usd.core.transform import fault, to_matrix, unmirrored
from tiscene.usd.core.units import Units

STRETCH = "stretch"  # suffix of the operation that a template's own scale is kept in
_TYPES = Sdf.ValueTypeNames
_NEAR = 1e-6


@dataclass(frozen=True)
class PrimPose:
    """Where a prim is in the world.

    position: m. rotation: Euler degrees or a quaternion. scale: along its own axes.
    stretch: 4x4, what of its transform lies between the scaled pose and the prim's own space; no translation.
    """

    position: tuple[float, ...]
    rotation: tuple[float, ...]
    scale: tuple[float, ...]
    stretch: Matrix


def read_pose(prim: Usd.Prim, time: Usd.TimeCode, units: Units) -> PrimPose | str:
    """A prim's pose at a time; a text that says why if it has none.

    What `PoseOperations` wrote is read to the bit. Of any other transform the nearest rotation is taken; the rest is
    stretch.
    """
    world = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(time)
    matrix = to_matrix(world, units.meters)
    wrong = fault(matrix)
    if wrong:
        return wrong
    if prim.IsA(UsdGeom.Camera):
        matrix = unmirrored(matrix)
    values = _own_values(prim, time)
    if values is not None:
        orient = values.get("orient")
        rotation = list(values["rotateZXY"]) if orient is None else [orient.real, *orient.imaginary]
        stretch = np.eye(4)
        if f"transform:{STRETCH}" in values:
            stretch = to_matrix(values[f"transform:{STRETCH}"], units.meters)
        position = units.to_json(values["translate"], True)
        return PrimPose(tuple(position), tuple(rotation), tuple(values.get("scale", (1.0, 1.0, 1.0))), stretch)
    pose = rigid(matrix)
    stretch = np.linalg.inv(pose) @ matrix
    stretch[:3, 3] = 0.0
    return PrimPose(
        tuple(matrix[:3, 3].tolist()), tuple(quaternion_from_matrix(pose[:3, :3])), (1.0, 1.0, 1.0), stretch
    )


def _own_values(prim: Usd.Prim, time: Usd.TimeCode) -> dict[str, Any] | None:
    """Values of the transform operations by name, if they are such as are written here and no parent moves the prim."""
    xformable = UsdGeom.Xformable(prim)
    if not xformable.GetResetXformStack() and xformable.ComputeParentToWorldTransform(time) != Gf.Matrix4d(1.0):
        return None
    values = {str(op.GetOpName()).removeprefix("xformOp:"): op.Get(time) for op in xformable.GetOrderedXformOps()}
    known = [
        ["translate", rotation, *scale, *stretch]
        for rotation in ("rotateZXY", "orient")
        for scale in ([], ["scale"])
        for stretch in ([], [f"transform:{STRETCH}"])
    ]
    return values if list(values) in known and None not in values.values() else None


@dataclass(frozen=True)
class PoseOperations:
    """The operations of one prim that `set` writes poses to."""

    translate: UsdGeom.XformOp
    rotate: UsdGeom.XformOp

    def set(self, position: Any, rotation: Any, units: Units, time: Usd.TimeCode | None = None) -> None:
        """Author a pose (m; Euler degrees or a quaternion, as the operations were made for) at a time or for all."""
        time = Usd.TimeCode.Default() if time is None else time
        self.translate.Set(Gf.Vec3d(units.to_stage(position, True)), time)
        self.rotate.Set(Gf.Quatd(*rotation) if len(rotation) == 4 else Gf.Vec3d(*rotation), time)


def pose_operations(
    prim: Usd.Prim, *, euler: bool, scale: Sequence[float] = (1.0, 1.0, 1.0), stretch: Matrix | None = None
) -> PoseOperations:
    """Give a prim, which no parent moves, the operations that place it, instead of any others."""
    operations = [
        _operation(prim, "translate", _TYPES.Double3),
        _operation(prim, "rotateZXY", _TYPES.Double3) if euler else _operation(prim, "orient", _TYPES.Quatd),
    ]
    if tuple(scale) != (1.0, 1.0, 1.0):
        operations.append(_operation(prim, "scale", _TYPES.Double3))
        operations[-1].Set(Gf.Vec3d(*scale))
    if stretch is not None and not np.array_equal(stretch, np.eye(4)):
        operations.append(_operation(prim, f"transform:{STRETCH}", _TYPES.Matrix4d))
        operations[-1].Set(Gf.Matrix4d(np.ascontiguousarray(stretch.T)))
    UsdGeom.Xformable(prim).SetXformOpOrder(operations)
    return PoseOperations(operations[0], operations[1])


def _operation(prim: Usd.Prim, name: str, kind: Sdf.ValueTypeName) -> UsdGeom.XformOp:
    """An operation of this very type, whatever type the one of its name has in what the prim refers to."""
    return UsdGeom.XformOp(prim.CreateAttribute(f"xformOp:{name}", kind, False))


def unit_rotation(rotation: Sequence[float]) -> tuple[float, ...]:
    """Euler angles as they are; a quaternion of length 1, one that has it to the bit."""
    if len(rotation) == 3:
        return tuple(rotation)
    norm = math.sqrt(sum(component * component for component in rotation))
    return tuple(rotation) if abs(norm - 1.0) < 1e-14 else tuple(component / norm for component in rotation)


def agrees(exact: Sequence[float], position: Sequence[float], rotation: Sequence[float]) -> bool:
    """Whether an exact pose is the one of a transform."""
    if len(exact) != 3 + len(rotation):
        return False
    expected = (*position, *rotation)
    stated = (*exact[:3], *unit_rotation(exact[3:]))
    return all(math.isclose(a, b, rel_tol=_NEAR, abs_tol=_NEAR) for a, b in zip(stated, expected, strict=True))


def placed(position: Sequence[float], rotation: Sequence[float]) -> Matrix:
    """4x4 from an object's own axes to the world."""
    matrix = np.eye(4)
    if len(rotation) == 3:
        turned = Gf.Matrix3d(1.0)
        for axis, angle in (((0, 0, 1), rotation[2]), ((1, 0, 0), rotation[0]), ((0, 1, 0), rotation[1])):
            turned *= Gf.Matrix3d(Gf.Rotation(Gf.Vec3d(*axis), angle))
        matrix[:3, :3] = np.array(turned).T
    else:
        w, x, y, z = unit_rotation(rotation)
        matrix[:3, :3] = matrix_from_quaternion((w, x, y, z))
    matrix[:3, 3] = position
    return matrix
