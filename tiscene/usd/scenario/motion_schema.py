# SPDX-License-Identifier: Apache-2.0
"""Trajectories as attributes of TisceneMotionAPI: conversion from and to the JSON objects of a scenario.

`PARAMETERS` maps the keys of the JSON objects to attributes. Attributes are in camelCase and stage units, JSON keys in
snake_case and meters. An attribute that is not authored is left out of the JSON object, whose class has the default.

A trajectory that a user has written in Python has type `stepped`: the name of its class, and its fields as JSON in
meters.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pxr import Gf, Sdf, Usd

from tiscene.errors import counted
from tiscene.usd.core import schema
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.units import Units

Content = Mapping[str, Any]
_PREFIX = schema.NAMESPACES[schema.MOTION]
NO_MOTION, STEPPED = "none", "stepped"

# Attributes below `tiscene:motion` by keys of the JSON objects; those in LENGTHS are in meters in JSON.
PARAMETERS = {
    "total_time": "totalTime",
    "pacing": "pacing",
    "rotation": "interpolation",
    "times": "times",
    "repeat": "repeat",
    "speed": "speed",
    "angular_speed": "angularSpeed",
    "start_direction": "startDirection",
    "seed": "seed",
    "center": "center",
    "period": "period",
    "axis": "axis",
    "target": "target",
    "up": "up",
}
LENGTHS = ("speed", "center", "target")
_WAYPOINT_LOOP = ("waypoints", "total_time", "pacing", "rotation")
# Keys of the JSON object of each class. `waypoints` become three arrays; `motion` and `parts` are other prims.
KEYS_BY_CLASS = {
    "Still": (),
    "LinearWaypoints": _WAYPOINT_LOOP,
    "CatmullWaypoints": _WAYPOINT_LOOP,
    "UniformMovementRandomBounce": ("speed", "angular_speed", "start_direction", "seed"),
    "Keyframes": ("times", "waypoints", "repeat"),
    "Orbit": ("center", "period", "axis"),
    "LookAt": ("target", "motion", "up"),
    "Composite": ("parts",),
}
CLASS_BY_TYPE = {schema.token(name): name for name in KEYS_BY_CLASS}


def read_dynamic(prim: Usd.Prim, units: Units, report: StageReport) -> dict[str, Any] | None:
    """Return the trajectory authored on a prim as a JSON object; None if there is none, or an invalid one."""
    return _read(prim, units, report, ())


def _read(prim: Usd.Prim, units: Units, report: StageReport, above: Sequence[Sdf.Path]) -> dict[str, Any] | None:
    path = prim.GetPath()
    kind = _authored(prim, "type")
    if kind is None or kind == NO_MOTION:
        return None
    if kind == STEPPED:
        return _read_stepped(prim, report)
    if kind not in CLASS_BY_TYPE:
        known = ", ".join((NO_MOTION, *CLASS_BY_TYPE, STEPPED))
        report.refuse(path, "motion", f"tiscene:motion:type is {str(kind)!r}; it must be one of {known}")
        return None
    if path in above:
        report.refuse(path, "motion", "it is a part of itself")
        return None
    name = CLASS_BY_TYPE[str(kind)]
    content: dict[str, Any] = {"type": name}
    for key in KEYS_BY_CLASS[name]:
        if key == "waypoints":
            content[key] = read_waypoints(prim, units, report)
        elif key in ("motion", "parts"):
            parts = _read_parts(prim, units, report, (*above, path))
            if key == "parts":
                content[key] = parts
            elif len(parts) > 1:
                report.refuse(
                    path, "motion", f"lookAt has {counted(len(parts), 'part')}; it takes its position from one"
                )
            elif parts:
                content[key] = parts[0]
        else:
            value = _authored(prim, PARAMETERS[key])
            if value is not None:
                content[key] = units.to_json(value, key in LENGTHS)
    return content


def _read_stepped(prim: Usd.Prim, report: StageReport) -> dict[str, Any] | None:
    name, text = _authored(prim, "class"), _authored(prim, "fields")
    if not name:
        report.refuse(prim.GetPath(), "motion", "its type is stepped, but tiscene:motion:class is empty")
        return None
    try:
        fields = json.loads(text or "{}")
    except json.JSONDecodeError as error:
        report.refuse(prim.GetPath(), "motion", f"tiscene:motion:fields is not JSON: {error}")
        return None
    if not isinstance(fields, dict):
        report.refuse(prim.GetPath(), "motion", f"tiscene:motion:fields is {text!r}; it must be a JSON object")
        return None
    return fields | {"type": str(name)}


def read_waypoints(prim: Usd.Prim, units: Units, report: StageReport) -> list[dict[str, Any]]:
    """Return the waypoints of the arrays `positions`, `rotations` and `orientations` as JSON objects."""
    positions = _authored(prim, "positions") or ()
    rotations = _authored(prim, "rotations") or ()
    orientations = _authored(prim, "orientations") or ()
    for name, values in (("rotations", rotations), ("orientations", orientations)):
        if values and len(values) != len(positions):
            text = f"{counted(len(positions), 'position')}, but {len(values)} {name}; there must be as many, or none"
            report.refuse(prim.GetPath(), "motion", text)
            return []
    waypoints = []
    for row, position in enumerate(positions):
        rotation = list(rotations[row]) if rotations else [0.0, 0.0, 0.0]
        if orientations:
            quaternion = [orientations[row].real, *orientations[row].imaginary]
            rotation = quaternion if any(quaternion) else rotation
        waypoints.append({"position": units.to_json(position), "rotation": rotation})
    return waypoints


def _read_parts(prim: Usd.Prim, units: Units, report: StageReport, above: Sequence[Sdf.Path]) -> list[dict[str, Any]]:
    parts = []
    for target in schema.targets(prim, f"{_PREFIX}:parts"):
        part = prim.GetStage().GetPrimAtPath(target)
        content = _read(part, units, report, above) if part else None
        if content is None:
            report.refuse(prim.GetPath(), "motion", f"its part <{target}> has no motion")
        else:
            parts.append(content)
    return parts


def write_dynamic(
    prim: Usd.Prim, content: Content | None, units: Units, part_path: Callable[[], Sdf.Path], report: StageReport
) -> None:
    """Author a trajectory on a prim.

    Args:
        prim: the prim.
        content: the trajectory's JSON object; None: static.
        units: unit of length of the stage.
        part_path: returns a path for the Scope of the next part of the trajectory.
        report: receives a problem for a value that does not fit USD.
    """
    prim.AddAppliedSchema(schema.MOTION)
    if content is None:
        _author(prim, "type", NO_MOTION)
        return
    name = str(content["type"])
    if name not in KEYS_BY_CLASS:
        fields = {key: value for key, value in content.items() if key != "type"}
        _author(prim, "type", STEPPED)
        _author(prim, "class", name)
        _author(prim, "fields", json.dumps(fields))
        return
    _author(prim, "type", schema.token(name))
    for key in KEYS_BY_CLASS[name]:
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
            report.refuse(prim.GetPath(), "motion", f"seed={value} is not within 64 bits")
        else:
            _author(prim, PARAMETERS[key], units.to_stage(value, key in LENGTHS))


def _write_waypoints(prim: Usd.Prim, waypoints: Sequence[Content], units: Units) -> None:
    positions = [Gf.Vec3d(units.to_stage(each["position"])) for each in waypoints]
    eulers = [each["rotation"] if len(each["rotation"]) == 3 else (0.0, 0.0, 0.0) for each in waypoints]
    quaternions = [each["rotation"] if len(each["rotation"]) == 4 else (0.0, 0.0, 0.0, 0.0) for each in waypoints]
    _author(prim, "positions", positions)
    _author(prim, "rotations", [Gf.Vec3d(*each) for each in eulers] if any(map(any, eulers)) else [])
    _author(prim, "orientations", [Gf.Quatd(*each) for each in quaternions] if any(map(any, quaternions)) else [])


def _authored(prim: Usd.Prim, name: str) -> Any:
    return schema.authored(prim, f"{_PREFIX}:{name}")


def _author(prim: Usd.Prim, name: str, value: Any) -> None:
    schema.author(prim, f"{_PREFIX}:{name}", value)
