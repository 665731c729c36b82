# SPDX-License-Identifier: Apache-2.0
"""Dynamics as attributes of TisceneMotionAPI, both ways: to and from the JSON values of a scenario's dynamics.

The attributes of a kind of motion are those of its JSON object, by the table below. Values on the stage are stage units
and camelCase, those of JSON meters and snake_case. What is not authored is left out, and so has the default of the
class that reads the JSON.

A motion that somebody wrote in Python is of type `stepped`: its class by name, its fields as in JSON, in meters.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pxr import Gf, Sdf, Usd, Vt

from tiscene.usd.core import schema
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.units import Units

Content = Mapping[str, Any]
_PREFIX = schema.NAMESPACES[schema.MOTION]
_TYPES = Sdf.ValueTypeNames
NO_MOTION, STEPPED = "none", "stepped"


@dataclass(frozen=True)
class _Parameter:
    """attribute: its name below `tiscene:motion`. length: m in JSON, stage units on the stage."""

    attribute: str
    type: Sdf.ValueTypeName
    length: bool = False


_PARAMETERS = {
    "total_time": _Parameter("totalTime", _TYPES.Double),
    "pacing": _Parameter("pacing", _TYPES.Token),
    "rotation": _Parameter("interpolation", _TYPES.Token),
    "times": _Parameter("times", _TYPES.DoubleArray),
    "repeat": _Parameter("repeat", _TYPES.Bool),
    "speed": _Parameter("speed", _TYPES.Double, length=True),
    "angular_speed": _Parameter("angularSpeed", _TYPES.Double),
    "start_direction": _Parameter("startDirection", _TYPES.Vector3d),
    "seed": _Parameter("seed", _TYPES.Int64),
    "center": _Parameter("center", _TYPES.Point3d, length=True),
    "period": _Parameter("period", _TYPES.Double),
    "axis": _Parameter("axis", _TYPES.Vector3d),
    "target": _Parameter("target", _TYPES.Point3d, length=True),
    "up": _Parameter("up", _TYPES.Vector3d),
}
_WAYPOINT_LOOP = ("waypoints", "total_time", "pacing", "rotation")
# The keys of each class's JSON object. `waypoints` are three arrays, `motion` and `parts` other prims.
_KEYS = {
    "Still": (),
    "LinearWaypoints": _WAYPOINT_LOOP,
    "CatmullWaypoints": _WAYPOINT_LOOP,
    "UniformMovementRandomBounce": ("speed", "angular_speed", "start_direction", "seed"),
    "Keyframes": ("times", "waypoints", "repeat"),
    "Orbit": ("center", "period", "axis"),
    "LookAt": ("target", "motion", "up"),
    "Composite": ("parts",),
}
_CLASSES = {name[0].lower() + name[1:]: name for name in _KEYS}


def read_dynamic(prim: Usd.Prim, units: Units, report: StageReport) -> dict[str, Any] | None:
    """The motion authored on a prim as a JSON object; None if there is none. Faults go to the report."""
    return _read(prim, units, report, ())


def _read(prim: Usd.Prim, units: Units, report: StageReport, above: Sequence[Sdf.Path]) -> dict[str, Any] | None:
    path = prim.GetPath()
    kind = _authored(prim, "type")
    if kind is None or kind == NO_MOTION:
        return None
    if kind == STEPPED:
        return _read_stepped(prim, report)
    if kind not in _CLASSES:
        known = ", ".join((NO_MOTION, *_CLASSES, STEPPED))
        report.problem(path, "motion", f"tiscene:motion:type is {str(kind)!r}; it must be one of {known}")
        return None
    if path in above:
        report.problem(path, "motion", "it is a part of itself")
        return None
    name = _CLASSES[str(kind)]
    content: dict[str, Any] = {"type": name}
    for key in _KEYS[name]:
        if key == "waypoints":
            content[key] = read_waypoints(prim, units, report)
        elif key in ("motion", "parts"):
            parts = _read_parts(prim, units, report, (*above, path))
            if key == "parts":
                content[key] = parts
            elif len(parts) > 1:
                report.problem(path, "motion", f"lookAt takes its position from one motion, not from {len(parts)}")
            elif parts:
                content[key] = parts[0]
        else:
            parameter = _PARAMETERS[key]
            value = _authored(prim, parameter.attribute)
            if value is not None:
                content[key] = units.to_json(value, parameter.length)
    return content


def _read_stepped(prim: Usd.Prim, report: StageReport) -> dict[str, Any] | None:
    name, text = _authored(prim, "class"), _authored(prim, "fields")
    if not name:
        report.problem(prim.GetPath(), "motion", "it is stepped, but tiscene:motion:class does not name its class")
        return None
    try:
        fields = json.loads(text or "{}")
    except json.JSONDecodeError as error:
        report.problem(prim.GetPath(), "motion", f"tiscene:motion:fields is not JSON: {error}")
        return None
    if not isinstance(fields, dict):
        report.problem(prim.GetPath(), "motion", f"tiscene:motion:fields is {text!r}; it must be a JSON object")
        return None
    return fields | {"type": str(name)}


def read_waypoints(prim: Usd.Prim, units: Units, report: StageReport) -> list[dict[str, Any]]:
    """Waypoints from the arrays `positions`, `rotations` and `orientations`."""
    positions = _authored(prim, "positions") or ()
    rotations = _authored(prim, "rotations") or ()
    orientations = _authored(prim, "orientations") or ()
    for name, values in (("rotations", rotations), ("orientations", orientations)):
        if values and len(values) != len(positions):
            text = f"{len(positions)} positions, but {len(values)} {name}; there must be as many, or none"
            report.problem(prim.GetPath(), "motion", text)
            return []
    waypoints = []
    for row, position in enumerate(positions):
        rotation = list(rotations[row]) if rotations else [0.0, 0.0, 0.0]
        if orientations:
            quaternion = [orientations[row].real, *orientations[row].imaginary]
            rotation = quaternion if any(quaternion) else rotation
        waypoints.append({"position": units.to_json(position, True), "rotation": rotation})
    return waypoints


def _read_parts(prim: Usd.Prim, units: Units, report: StageReport, above: Sequence[Sdf.Path]) -> list[dict[str, Any]]:
    parts = []
    for target in schema.targets(prim, f"{_PREFIX}:parts"):
        part = prim.GetStage().GetPrimAtPath(target)
        content = _read(part, units, report, above) if part else None
        if content is None:
            report.problem(prim.GetPath(), "motion", f"its part <{target}> has no motion")
        else:
            parts.append(content)
    return parts


def write_dynamic(
    prim: Usd.Prim, content: Content | None, units: Units, part_path: Callable[[], Sdf.Path], report: StageReport
) -> None:
    """Author a dynamic's JSON object on a prim, or that it has none.

    part_path: gives a path for the Scope of each motion that is a part of this one.
    """
    prim.AddAppliedSchema(schema.MOTION)
    if content is None:
        _author(prim, "type", _TYPES.Token, NO_MOTION)
        return
    name = str(content["type"])
    if name not in _KEYS:
        fields = {key: value for key, value in content.items() if key != "type"}
        _author(prim, "type", _TYPES.Token, STEPPED)
        _author(prim, "class", _TYPES.String, name)
        _author(prim, "fields", _TYPES.String, json.dumps(fields))
        return
    _author(prim, "type", _TYPES.Token, name[0].lower() + name[1:])
    for key in _KEYS[name]:
        value = content[key]
        if key == "waypoints":
            _write_waypoints(prim, value, units)
        elif key in ("motion", "parts"):
            scopes = []
            for part in value if key == "parts" else [value]:
                scope = prim.GetStage().DefinePrim(part_path(), "Scope")
                write_dynamic(scope, part, units, part_path, report)
                scopes.append(scope.GetPath())
            prim.CreateRelationship(f"{_PREFIX}:parts").SetTargets(scopes)
        elif key == "seed" and not -(2**63) <= value < 2**63:
            report.problem(prim.GetPath(), "motion", f"seed={value} is not within 64 bits")
        else:
            parameter = _PARAMETERS[key]
            _author(prim, parameter.attribute, parameter.type, units.to_stage(value, parameter.length))


def _write_waypoints(prim: Usd.Prim, waypoints: Sequence[Content], units: Units) -> None:
    positions = [Gf.Vec3d(units.to_stage(each["position"], True)) for each in waypoints]
    eulers = [each["rotation"] if len(each["rotation"]) == 3 else (0.0, 0.0, 0.0) for each in waypoints]
    quaternions = [each["rotation"] if len(each["rotation"]) == 4 else (0.0, 0.0, 0.0, 0.0) for each in waypoints]
    _author(prim, "positions", _TYPES.Point3dArray, Vt.Vec3dArray(positions))
    some_turn, some_quaternions = any(map(any, eulers)), any(map(any, quaternions))
    rotations = [Gf.Vec3d(*each) for each in eulers] * some_turn
    _author(prim, "rotations", _TYPES.Double3Array, Vt.Vec3dArray(rotations))
    orientations = [Gf.Quatd(*each) for each in quaternions] * some_quaternions
    _author(prim, "orientations", _TYPES.QuatdArray, Vt.QuatdArray(orientations))


def _authored(prim: Usd.Prim, name: str) -> Any:
    return schema.authored(prim, f"{_PREFIX}:{name}")


def _author(prim: Usd.Prim, name: str, kind: Sdf.ValueTypeName, value: Any) -> None:
    """Author a value, unless it is there already: by default, or in what the prim refers to."""
    name = f"{_PREFIX}:{name}"
    value = kind.type.pythonClass(value) if isinstance(value, tuple) else value
    if prim.HasAttribute(name) and prim.GetAttribute(name).Get() == value:
        return
    prim.CreateAttribute(name, kind, False, Sdf.VariabilityUniform).Set(value)
