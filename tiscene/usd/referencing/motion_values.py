# SPDX-License-Identifier: Apache-2.0
"""Trajectories and scenarios of tiscene's schema on another stage: they are in the world of the stage they are on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pxr import Gf, Sdf, Usd, Vt

from dynamics.rotation import quaternion_from_euler
from tiscene.usd.core import schema
from tiscene.usd.core.report import StageReport
from tiscene.usd.referencing.conversion import Conversion
from tiscene.usd.referencing.converted_values import ConvertedValue, Values
from tiscene.usd.scenario.motion_schema import CLASS_BY_TYPE, KEYS_BY_CLASS, LENGTHS, PARAMETERS, STEPPED

_MOTION, _SCENARIO = schema.NAMESPACES[schema.MOTION], schema.NAMESPACES[schema.SCENARIO]
_TYPES = Sdf.ValueTypeNames
_IN_METERS = ("edits", "lights", "overrides")  # JSON of a scenario
_UP = Gf.Vec3d(0.0, 1.0, 0.0)  # the axis of yaw in Euler angles, whatever the up axis


def motion_values(prim: Usd.Prim, conversion: Conversion, relative: bool, report: StageReport) -> Values:
    """Yield the attributes of a prim's trajectory, and of a scenario, that change, by path.

    Args:
        prim: the prim.
        conversion: to the other stage.
        relative: whether the trajectory is in the frame that others move, not in the world.
        report: receives what cannot be converted.
    """
    if schema.has(prim, schema.SCENARIO):
        yield from _scenario_values(prim, conversion, report)
    kind = str(schema.authored(prim, f"{_MOTION}:type") if schema.has(prim, schema.MOTION) else "")
    if kind == STEPPED:
        text = "the fields of a trajectory of type stepped are in meters, and keep their numbers"
        report.omission(prim.GetPath(), text)
    change: dict[Sdf.ValueTypeName, Callable[[Any], Any]] = {
        _TYPES.Double: lambda value: value * conversion.length,
        _TYPES.Point3d: (lambda value: value * conversion.length) if relative else conversion.point,
        _TYPES.Vector3d: (lambda value: value) if relative else conversion.direction,
    }
    for key in KEYS_BY_CLASS.get(CLASS_BY_TYPE.get(kind, ""), ()):
        if key == "waypoints":
            yield from _waypoint_values(prim, conversion, change[_TYPES.Point3d], relative, report)
        elif key in PARAMETERS:
            attribute = prim.GetAttribute(f"{_MOTION}:{PARAMETERS[key]}")
            value_type = schema.properties()[f"{_MOTION}:{PARAMETERS[key]}"]
            if (key in LENGTHS or value_type == _TYPES.Vector3d) and attribute and attribute.Get() is not None:
                yield attribute.GetPath(), ConvertedValue.of(attribute, change[value_type])


def relative_parts(prims: list[Usd.Prim]) -> set[Sdf.Path]:
    """Return the prims whose trajectories are in the frame that another part of a composite moves."""
    found: set[Sdf.Path] = set()
    for prim in prims:
        if schema.has(prim, schema.MOTION) and schema.authored(prim, f"{_MOTION}:type") == schema.token("Composite"):
            found.update(schema.targets(prim, f"{_MOTION}:parts")[1:])
    pending = list(found)
    while pending:
        prim = prims[0].GetStage().GetPrimAtPath(pending.pop())
        new = set(schema.targets(prim, f"{_MOTION}:parts")) - found if prim else set()
        found |= new
        pending += new
    return found


def _scenario_values(prim: Usd.Prim, conversion: Conversion, report: StageReport) -> Values:
    far = prim.GetAttribute(f"{_SCENARIO}:frustumFar")
    if far and far.HasAuthoredValue():
        yield far.GetPath(), ConvertedValue.of(far, conversion.distance)
    for name in _IN_METERS:
        if schema.authored(prim, f"{_SCENARIO}:{name}"):
            text = f"{_SCENARIO}:{name} is in meters of the world that it was written in, and is not converted"
            report.omission(prim.GetPath(), text)


def _waypoint_values(
    prim: Usd.Prim, conversion: Conversion, place: Callable[[Any], Any], relative: bool, report: StageReport
) -> Values:
    """Yield positions and rotations of waypoints."""
    names = [f"{_MOTION}:{name}" for name in ("positions", "rotations", "orientations", "interpolation")]
    positions, eulers, quaternions, interpolation = (schema.authored(prim, name) for name in names)
    paths = [prim.GetPath().AppendProperty(name) for name in names]
    if not positions:
        return
    yield paths[0], ConvertedValue(_TYPES.Point3dArray, Vt.Vec3dArray([place(Gf.Vec3d(each)) for each in positions]))
    turn = conversion.rotation
    if relative or turn.GetAngle() == 0.0:
        return
    eulers = [Gf.Vec3d(each) for each in eulers or [Gf.Vec3d(0.0)] * len(positions)]
    given = [Gf.Quatd(each) for each in quaternions or []]
    yaw = turn.GetAngle() * Gf.Dot(turn.GetAxis(), _UP)
    if Gf.IsClose(abs(yaw), turn.GetAngle(), 1e-9):  # further angles than half a turn are kept
        yield paths[1], ConvertedValue(_TYPES.Double3Array, Vt.Vec3dArray([each + yaw * _UP for each in eulers]))
        turned = [conversion.orientation(each) if each.GetLength() else each for each in given]
        if given:
            yield paths[2], ConvertedValue(_TYPES.QuatdArray, Vt.QuatdArray(turned))
        return
    if interpolation == "euler":
        text = "Euler angles of a trajectory become quaternions, which turn the shortest way"
        report.omission(prim.GetPath(), text)
        yield paths[3], ConvertedValue(_TYPES.Token, "quaternion")
    own = [Gf.Quatd(*quaternion_from_euler(each).tolist()) for each in eulers]
    own = [q if q.GetLength() else other for q, other in zip(given or [Gf.Quatd(0.0)] * len(own), own, strict=True)]
    turned = [conversion.orientation(each) for each in own]
    yield paths[2], ConvertedValue(_TYPES.QuatdArray, Vt.QuatdArray(turned))
