# SPDX-License-Identifier: Apache-2.0
"""Joints by the schemas of UsdPhysics, which other programs read and write too.

`body` of a joint is physics:body1, `parent` is physics:body0; without a target the joint holds on to the world. Local
frames are in the axes of the target, before its scale. The exact values of tiscene's own joints are in TisceneJointAPI;
they count as long as the attributes of UsdPhysics agree with them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence, Set
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

from dynamics.joint_loops import closing_joints
from tiscene.scene.camera import quaternion_from_matrix
from tiscene.scene.description import Matrix
from tiscene.usd.core import schema
from tiscene.usd.core.pose import pose_matrix
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.units import Units
from tiscene.usd.scenario.layer import OverLayer

EXACT = "tiscene:joint:exact"
KINDS = {
    "FixedJoint": UsdPhysics.FixedJoint,
    "RevoluteJoint": UsdPhysics.RevoluteJoint,
    "PrismaticJoint": UsdPhysics.PrismaticJoint,
    "SphericalJoint": UsdPhysics.SphericalJoint,
    "DistanceJoint": UsdPhysics.DistanceJoint,
}
TOLERANCE = 1e-4  # relative, of lengths in stage units that are stored in single precision
_NEVER = 3.4e38  # some programs write the largest float where there is no limit


def write_joints(
    over: OverLayer,
    joints: Sequence[Mapping[str, Any]],
    objects: Sequence[Mapping[str, Any]],
    prims: Sequence[Usd.Prim],
) -> None:
    """Author joints as prims of UsdPhysics.

    Args:
        over: the layer.
        joints: JSON objects of the joints.
        objects: JSON objects of the scenario's objects.
        prims: their prims.
    """
    rows = {content["id"]: row for row, content in enumerate(objects)}
    for each in joints:
        path = over.unused_path(over.folder("Joints"), f"{each['body']}_{each['type']}")
        joint = KINDS[each["type"]].Define(over.stage, path)
        prim = joint.GetPrim()
        prim.AddAppliedSchema(schema.JOINT)
        schema.author(prim, EXACT, json.dumps(each))
        if any(id is not None and id not in rows for id in (each["body"], each["parent"])):
            joint.CreateJointEnabledAttr(False)  # an object that is spawned later has no prim
            continue
        sides = (
            (joint.CreateBody0Rel, joint.CreateLocalPos0Attr, joint.CreateLocalRot0Attr),
            (joint.CreateBody1Rel, joint.CreateLocalPos1Attr, joint.CreateLocalRot1Attr),
        )
        for (body, local_position, local_rotation), (id, frame) in zip(sides, _frames(each, objects), strict=True):
            target = None if id is None else prims[rows[id]]
            if target is not None:
                body().SetTargets([target.GetPath()])
                frame = pose_matrix(objects[rows[id]]["position"], objects[rows[id]]["rotation"]) @ frame
            position, rotation = _local(target, frame, over.units)
            local_position().Set(Gf.Vec3f(*position))
            local_rotation().Set(Gf.Quatf(*rotation))
        joint.CreateCollisionEnabledAttr(each["collide"])
        _write_limits(joint, each, over.units)


def _write_limits(joint: Any, each: Mapping[str, Any], units: Units) -> None:
    length = each["type"] != "RevoluteJoint"
    if "axis" in each:
        joint.CreateAxisAttr(each["axis"])
    if each.get("cone_angle") is not None:
        joint.CreateConeAngle0LimitAttr(each["cone_angle"])
        joint.CreateConeAngle1LimitAttr(each["cone_angle"])
    if "lower_limit" in each:
        for value, create in (
            (each["lower_limit"], joint.CreateLowerLimitAttr),
            (each["upper_limit"], joint.CreateUpperLimitAttr),
        ):
            if value is not None:
                create(units.to_stage(value, length))
    if each["type"] == "DistanceJoint":
        joint.CreateMinDistanceAttr(units.to_stage(each["min_distance"]))
        most = each["max_distance"]
        joint.CreateMaxDistanceAttr(-1.0 if most is None else units.to_stage(most))


def read_joints(
    stage: Usd.Stage,
    objects: Sequence[Mapping[str, Any]],
    paths: Sequence[str],
    rigid: Set[str],
    time: Usd.TimeCode,
    report: StageReport,
) -> dict[str, Any]:
    """Return the JSON objects of the joints of a stage that hold a rigid body of the scenario, as a member `joints`.

    Args:
        stage: the stage.
        objects: JSON objects of the scenario's objects.
        paths: paths of their prims.
        rigid: ids of the objects that are rigid bodies.
        time: time code at which transforms are read.
        report: receives what of the joints is not simulated.
    """
    if not rigid:
        return {}
    units = Units.of(stage)
    owners = {Sdf.Path(path): row for row, path in enumerate(paths)}
    ids = {each["id"] for each in objects}
    found: list[tuple[Sdf.Path, dict[str, Any]]] = []
    for prim in stage.Traverse():
        joint = UsdPhysics.Joint(prim)
        if not joint:
            continue
        with report.guard(prim.GetPath()):
            exact = schema.authored(prim, EXACT)
            exact = json.loads(exact) if exact else None
            if exact is not None and not {exact["body"], exact["parent"]} <= {None, *ids}:
                found.append((prim.GetPath(), exact))  # it names an object that is spawned later
                continue
            if joint.GetJointEnabledAttr().Get() is False:
                continue
            content = _read_joint(stage, joint, objects, owners, units, time, report)
            if content is None or rigid.isdisjoint((content["body"], content["parent"])):
                continue
            if fault := _fault(content):
                report.omission(prim.GetPath(), f"a joint is left out: {fault}")
                continue
            found.append((prim.GetPath(), exact if exact and _agree(exact, content, objects) else content))
    joints = _without_limits_in_loops(found, ids - rigid, report)
    held = {id for each in joints for id in (each["body"], each["parent"])}
    for path, each in zip(paths, objects, strict=True):
        if each["id"] in held and (each["dynamic"] or {}).get("starts_asleep"):
            report.omission(path, "a rigid body that a joint holds is awake from the start (physics:startsAsleep)")
    return {"joints": joints} if joints else {}


def _fault(content: Mapping[str, Any]) -> str | None:
    """Return why a joint that was read cannot be; None if it can."""
    for low, high in (("lower_limit", "upper_limit"), ("min_distance", "max_distance")):
        least, most = content.get(low), content.get(high)
        if least is not None and most is not None and least > most:
            return f"its least value {least:g} is above its greatest one, {most:g}"
    if content.get("axis", "X") not in ("X", "Y", "Z"):
        return f"its axis is {content['axis']!r}; it must be X, Y or Z"
    if content.get("max_distance") == 0.0:
        return "its greatest distance is 0"
    if "max_distance" in content and content["max_distance"] is None and content["min_distance"] == 0.0:
        return "it has neither a least nor a greatest distance"
    return None


def _without_limits_in_loops(
    found: Sequence[tuple[Sdf.Path, dict[str, Any]]], fixed: Set[str], report: StageReport
) -> list[dict[str, Any]]:
    """Return joints, without what cannot be simulated of those that close loops; `fixed` holds all but rigid bodies."""
    ends = [tuple(None if id in fixed else id for id in (each["body"], each["parent"])) for _, each in found]
    closing = closing_joints(ends, [each["type"] == "DistanceJoint" for _, each in found])
    joints = []
    for row, (path, each) in enumerate(found):
        if row in closing and each["type"] == "PrismaticJoint":
            report.omission(path, "a prismatic joint of objects that other joints connect is not simulated")
            continue
        if row in closing and any(each.get(name) is not None for name in ("lower_limit", "upper_limit")):
            report.omission(path, "limits of a joint of objects that other joints connect are not simulated")
            each = each | {"lower_limit": None, "upper_limit": None}
        joints.append(each)
    return joints


def _read_joint(
    stage: Usd.Stage,
    joint: UsdPhysics.Joint,
    objects: Sequence[Mapping[str, Any]],
    owners: Mapping[Sdf.Path, int],
    units: Units,
    time: Usd.TimeCode,
    report: StageReport,
) -> dict[str, Any] | None:
    """Return the JSON object of a joint from its attributes of UsdPhysics; None if it holds no object."""
    prim = joint.GetPrim()
    ends: list[tuple[int | None, Matrix]] = []
    faults: list[str] = []
    for relationship, position, rotation in (
        (joint.GetBody0Rel(), joint.GetLocalPos0Attr(), joint.GetLocalRot0Attr()),
        (joint.GetBody1Rel(), joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr()),
    ):
        targets = relationship.GetTargets()
        target = stage.GetPrimAtPath(targets[0]) if targets else None
        row = next((owners[path] for path in targets[0].GetPrefixes() if path in owners), None) if targets else None
        frame = np.eye(4)
        if targets and not target:
            faults.append(f"<{targets[0]}>, which it holds, does not exist")
        elif not (all(map(math.isfinite, position.Get())) and 0.0 < rotation.Get().GetLength() < math.inf):
            faults.append(f"{position.GetName()} or {rotation.GetName()} is not valid")
        else:
            frame = _world(target, position.Get(), rotation.Get(), units, time)
        if row is not None:
            frame = np.linalg.inv(pose_matrix(objects[row]["position"], objects[row]["rotation"])) @ frame
        ends.append((row, frame))
    if ends[0][0] is None and ends[1][0] is None:
        return None
    if ends[0][0] == ends[1][0]:
        faults.append("both of its ends are in one object")
    if faults:
        report.omission(prim.GetPath(), f"a joint is left out: {faults[0]}")
        return None
    kind = next((name for name, kind in KINDS.items() if prim.IsA(kind)), None)
    if kind is None:
        report.omission(prim.GetPath(), f"a {prim.GetTypeName()} is not simulated; supported: {', '.join(KINDS)}")
        return None
    for name in ("physics:breakForce", "physics:breakTorque"):
        value = schema.authored(prim, name)
        if value is not None and 0.0 <= value < _NEVER:
            report.omission(prim.GetPath(), f"a joint that breaks is not simulated ({name})")
    if any(name.startswith("PhysicsDriveAPI") for name in prim.GetAppliedSchemas()):
        report.omission(prim.GetPath(), "the drive of a joint is not simulated (PhysicsDriveAPI)")
    (other, other_frame), (row, frame) = ends
    flipped = row is None
    if flipped:
        (row, frame), (other, other_frame) = ends
    assert row is not None
    content: dict[str, Any] = {
        "type": kind,
        "body": objects[row]["id"],
        "parent": None if other is None else objects[other]["id"],
        "collide": bool(joint.GetCollisionEnabledAttr().Get()),
    }
    for prefix, pose in (("", frame), ("parent_", other_frame)):
        content[f"{prefix}position"] = pose[:3, 3].tolist()
        content[f"{prefix}rotation"] = list(quaternion_from_matrix(pose[:3, :3]))
    if kind == "SphericalJoint":
        return content | _read_cone(UsdPhysics.SphericalJoint(prim), report)
    return content | _read_limits(KINDS[kind](prim), kind, flipped, units)


def _read_cone(joint: UsdPhysics.SphericalJoint, report: StageReport) -> dict[str, Any]:
    """Return axis and cone angle of a spherical joint; angles that differ, or one alone, are reported."""
    angles = [float(each.Get()) for each in (joint.GetConeAngle0LimitAttr(), joint.GetConeAngle1LimitAttr())]
    limited = [each for each in angles if 0.0 <= each < 180.0]
    is_round = len(limited) == 2 and math.isclose(*limited, rel_tol=TOLERANCE) and limited[0] > 0.0
    if limited and not is_round:
        text = "the limits of a spherical joint are not simulated unless they are two equal angles above 0"
        report.omission(joint.GetPath(), f"{text} (physics:coneAngle0Limit, physics:coneAngle1Limit)")
    return {"axis": str(joint.GetAxisAttr().Get()), "cone_angle": limited[0] if is_round else None}


def _read_limits(joint: Any, kind: str, flipped: bool, units: Units) -> dict[str, Any]:
    scale = 1.0 if kind == "RevoluteJoint" else units.meters
    if kind in ("RevoluteJoint", "PrismaticJoint"):
        low, high = (float(each.Get()) * scale for each in (joint.GetLowerLimitAttr(), joint.GetUpperLimitAttr()))
        low, high = (-high, -low) if flipped else (low, high)
        return {
            "axis": str(joint.GetAxisAttr().Get()),
            "lower_limit": low if abs(low) < _NEVER * scale else None,
            "upper_limit": high if abs(high) < _NEVER * scale else None,
        }
    if kind == "DistanceJoint":
        low, high = (float(each.Get()) * scale for each in (joint.GetMinDistanceAttr(), joint.GetMaxDistanceAttr()))
        return {"min_distance": max(low, 0.0), "max_distance": high if 0.0 <= high < _NEVER * scale else None}
    return {}


def _frames(
    each: Mapping[str, Any], objects: Sequence[Mapping[str, Any]]
) -> tuple[tuple[str | None, Matrix], tuple[str, Matrix]]:
    """Return ids and frames of both sides of a joint, the parent first, in the axes of the objects."""
    begin = {content["id"]: _begin(content) for content in objects}
    own = pose_matrix(each["position"], each["rotation"])
    body, parent = each["body"], each["parent"]
    other = np.linalg.inv(np.eye(4) if parent is None else begin[parent]) @ begin[body] @ own
    if each["parent_position"] is not None:
        other[:3, 3] = each["parent_position"]
    if each["parent_rotation"] is not None:
        other[:3, :3] = pose_matrix((0, 0, 0), each["parent_rotation"])[:3, :3]
    return (parent, other), (body, own)


def _begin(content: Mapping[str, Any]) -> Matrix:
    """Return the pose at which an object begins; of a path, its first waypoint."""
    waypoints = (content["dynamic"] or {}).get("waypoints")
    at = waypoints[0] if waypoints else content
    return pose_matrix(at["position"], at["rotation"])


def _frame_of(target: Usd.Prim | None, units: Units, time: Usd.TimeCode) -> tuple[Matrix, Matrix]:
    """Return the pose of a prim in the world, m, and its scale; identities for the world."""
    if target is None or not target.IsA(UsdGeom.Xformable):
        return np.eye(4), np.ones(3)
    transform = Gf.Transform(UsdGeom.Xformable(target).ComputeLocalToWorldTransform(time))
    turn = transform.GetRotation().GetQuat()
    position = [each * units.meters for each in transform.GetTranslation()]
    return pose_matrix(position, [turn.GetReal(), *turn.GetImaginary()]), np.array(transform.GetScale())


def _local(target: Usd.Prim | None, frame: Matrix, units: Units) -> tuple[list[float], list[float]]:
    """Return a frame in the world as local position, in stage units before the scale, and local rotation."""
    pose, scale = _frame_of(target, units, Usd.TimeCode.Default())
    local = np.linalg.inv(pose) @ frame
    return (local[:3, 3] / units.meters / scale).tolist(), list(quaternion_from_matrix(local[:3, :3]))


def _world(target: Usd.Prim | None, position: Any, rotation: Any, units: Units, time: Usd.TimeCode) -> Matrix:
    """Return a local frame in the world; the inverse of `_local`."""
    pose, scale = _frame_of(target, units, time)
    place = np.array(position, np.float64) * units.meters * scale
    turned: Matrix = pose @ pose_matrix(place.tolist(), [rotation.GetReal(), *rotation.GetImaginary()])
    return turned


def _agree(exact: Mapping[str, Any], content: Mapping[str, Any], objects: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether exact values of a joint are, within rounding, those of its attributes of UsdPhysics."""
    for key in ("type", "body", "parent", "collide"):
        if exact.get(key) != content.get(key):
            return False
    if exact.get("axis", "X") != content.get("axis", "X"):  # older files have no axis of spherical joints
        return False
    for key in ("lower_limit", "upper_limit", "min_distance", "max_distance", "cone_angle"):
        one, other = exact.get(key), content.get(key)
        if (one is None) != (other is None) or (
            one is not None and not math.isclose(one, other or 0.0, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
        ):
            return False
    (_, parent), (_, own) = _frames(exact, objects)
    (_, read_parent), (_, read_own) = _frames(content, objects)
    return all(
        np.allclose(one, other, rtol=TOLERANCE, atol=TOLERANCE)
        for one, other in ((parent, read_parent), (own, read_own))
    )
