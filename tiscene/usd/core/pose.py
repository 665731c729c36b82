# SPDX-License-Identifier: Apache-2.0
"""Poses of prims: read from any transform, and written as transform operations that are read back exactly.

A pose is a position (meters) and a rotation (Euler degrees or a quaternion). The rest of a transform, its scale and
shear, is called its stretch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from dynamics.rotation import matrix_from_quaternion
from tiscene.scene.assembly import rigid
from tiscene.scene.camera import quaternion_from_matrix
from tiscene.scene.description import Matrix
from tiscene.usd.core.transform import to_matrix, transform_fault, unmirrored
from tiscene.usd.core.units import Units

STRETCH = "stretch"  # suffix of the transform operation that holds a template's own scale and shear
_TYPES = Sdf.ValueTypeNames
_TOLERANCE = 1e-6


@dataclass(frozen=True)
class PrimPose:
    """Where a prim is in the world.

    Attributes:
        position: m.
        rotation: (x, y, z) Euler degrees, applied in the order z, x, y, or a quaternion (w, x, y, z).
        scale: along the prim's own axes.
        stretch: float64 4x4 without translation, from the prim's own space to the scaled pose.
    """

    position: tuple[float, ...]
    rotation: tuple[float, ...]
    scale: tuple[float, ...]
    stretch: Matrix


def read_pose(prim: Usd.Prim, time: Usd.TimeCode, units: Units) -> PrimPose | str:
    """Return a prim's pose at a time code, or the reason why it has none.

    Operations that `PoseOperations` has written are read back exactly. Of any other transform the nearest rotation is
    taken; the rest is stretch.
    """
    world = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(time)
    matrix = to_matrix(world, units.meters)
    if fault := transform_fault(matrix):
        return fault
    if prim.IsA(UsdGeom.Camera):
        matrix = unmirrored(matrix)
    values = _own_values(prim, time)
    if values is not None:
        orient = values.get("orient")
        rotation = list(values["rotateZXY"]) if orient is None else [orient.real, *orient.imaginary]
        stretch = np.eye(4)
        if f"transform:{STRETCH}" in values:
            stretch = to_matrix(values[f"transform:{STRETCH}"], units.meters)
        position = units.to_json(values["translate"])
        return PrimPose(tuple(position), tuple(rotation), tuple(values.get("scale", (1.0, 1.0, 1.0))), stretch)
    pose = rigid(matrix)
    stretch = np.linalg.inv(pose) @ matrix
    stretch[:3, 3] = 0.0
    return PrimPose(
        tuple(matrix[:3, 3].tolist()), tuple(quaternion_from_matrix(pose[:3, :3])), (1.0, 1.0, 1.0), stretch
    )


def _own_values(prim: Usd.Prim, time: Usd.TimeCode) -> dict[str, Any] | None:
    """Return the values of operations that `pose_operations` made, by name; None for others."""
    xformable = UsdGeom.Xformable(prim)
    if not xformable.GetResetXformStack() and xformable.ComputeParentToWorldTransform(time) != Gf.Matrix4d(1.0):
        return None
    values = {str(op.GetOpName()).removeprefix("xformOp:"): op.Get(time) for op in xformable.GetOrderedXformOps()}
    written_here = [
        ["translate", rotation, *scale, *stretch]
        for rotation in ("rotateZXY", "orient")
        for scale in ([], ["scale"])
        for stretch in ([], [f"transform:{STRETCH}"])
    ]
    return values if list(values) in written_here and None not in values.values() else None


@dataclass(frozen=True)
class PoseOperations:
    """The transform operations of one prim that hold its pose.

    Attributes:
        translate: its position.
        rotate: its rotation, as Euler angles or a quaternion.
    """

    translate: UsdGeom.XformOp
    rotate: UsdGeom.XformOp

    def set(self, position: Any, rotation: Any, units: Units, time: Usd.TimeCode | None = None) -> None:
        """Author a pose.

        Args:
            position: m.
            rotation: Euler degrees or a quaternion, whichever the operations were made for.
            units: unit of length of the stage.
            time: time code of the sample; None: the default value.
        """
        time = Usd.TimeCode.Default() if time is None else time
        self.translate.Set(Gf.Vec3d(units.to_stage(position)), time)
        self.rotate.Set(Gf.Quatd(*rotation) if len(rotation) == 4 else Gf.Vec3d(*rotation), time)


def pose_operations(
    prim: Usd.Prim, *, euler: bool, scale: Sequence[float] = (1.0, 1.0, 1.0), stretch: Matrix | None = None
) -> PoseOperations:
    """Replace a prim's transform operations by those of a pose. Its parent's transform must be the identity.

    Args:
        prim: the prim.
        euler: whether its rotation is written as Euler angles, else as a quaternion.
        scale: along its own axes.
        stretch: float64 4x4 without translation, applied first; None: the identity.

    Returns:
        The operations to write the pose to.
    """
    operations = [
        _operation(prim, "translate", _TYPES.Double3),
        _operation(prim, "rotateZXY", _TYPES.Double3) if euler else _operation(prim, "orient", _TYPES.Quatd),
    ]
    if tuple(scale) != (1.0, 1.0, 1.0):
        operations.append(UsdGeom.XformOp(prim.CreateAttribute("xformOp:scale", _TYPES.Double3, False)))
        operations[-1].Set(Gf.Vec3d(*scale))
    if stretch is not None and not np.array_equal(stretch, np.eye(4)):
        operations.append(_operation(prim, f"transform:{STRETCH}", _TYPES.Matrix4d))
        operations[-1].Set(Gf.Matrix4d(np.ascontiguousarray(stretch.T)))
    UsdGeom.Xformable(prim).SetXformOpOrder(operations)
    return PoseOperations(operations[0], operations[1])


def _operation(prim: Usd.Prim, name: str, kind: Sdf.ValueTypeName) -> UsdGeom.XformOp:
    """Create an operation of this value type, also where a referenced layer has one of another type by that name."""
    layer, path = prim.GetStage().GetEditTarget().GetLayer(), prim.GetPath().AppendProperty(f"xformOp:{name}")
    spec = layer.GetAttributeAtPath(path)
    if spec is None or spec.typeName != kind:
        prim.RemoveProperty(path.name)
        Sdf.CreatePrimAttributeInLayer(layer, path, kind)  # prim.CreateAttribute keeps the type of the referenced layer
    return UsdGeom.XformOp(prim.GetAttribute(path.name))


def unit_rotation(rotation: Sequence[float]) -> tuple[float, ...]:
    """Return Euler angles unchanged, and a quaternion normalized; one of unit length is unchanged to the last bit."""
    if len(rotation) == 3:
        return tuple(rotation)
    norm = math.sqrt(sum(component * component for component in rotation))
    return tuple(rotation) if abs(norm - 1.0) < 1e-14 else tuple(component / norm for component in rotation)


def is_same_pose(exact: Sequence[float], position: Sequence[float], rotation: Sequence[float]) -> bool:
    """Return whether an exactly stated pose is, within rounding, the pose of a transform.

    Args:
        exact: position and rotation, 6 or 7 numbers.
        position: position of the transform, m.
        rotation: its rotation, of the same kind.
    """
    if len(exact) != 3 + len(rotation):
        return False
    expected = (*position, *rotation)
    stated = (*exact[:3], *unit_rotation(exact[3:]))
    return all(
        math.isclose(a, b, rel_tol=_TOLERANCE, abs_tol=_TOLERANCE) for a, b in zip(stated, expected, strict=True)
    )


def pose_matrix(position: Sequence[float], rotation: Sequence[float]) -> Matrix:
    """Return the float64 4x4 from an object's axes to the world.

    Args:
        position: m.
        rotation: Euler degrees or a quaternion.
    """
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
