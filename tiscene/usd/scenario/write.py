# SPDX-License-Identifier: Apache-2.0
"""write_scenario: a scenario as a USD layer over its scene, by tiscene's schema. `read` is its inverse."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

from pxr import Sdf, Usd

from tiscene.errors import CameraNotFound
from tiscene.scene.camera import Camera
from tiscene.usd.core import schema
from tiscene.usd.core.pose import unit_rotation
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.stage import quiet, readable
from tiscene.usd.read.stage_camera import unique_names
from tiscene.usd.read.stage_render_settings import read_render_settings
from tiscene.usd.scenario.filtered_pairs_schema import write_filtered_pairs
from tiscene.usd.scenario.joint_schema import write_joints
from tiscene.usd.scenario.layer import OverLayer
from tiscene.usd.scenario.motion_schema import write_dynamic
from tiscene.usd.scenario.rigid_body_schema import write_rigid_body
from tiscene.usd.scenario.stage_cameras import CAMERA_VALUES, stage_cameras


def write_scenario(content: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Write a scenario as a USD layer over its scene. `read_scenario` returns the same JSON values.

    Objects are at their start poses. In a scene whose unit is not the meter, lengths of more than 15 digits may change
    in the last one.

    Args:
        content: the scenario's JSON object, of `Scenario.to_json`.
        path: file that ends in .usda, .usdc or .usd.

    Raises:
        SceneNotFound, TemplateNotFound, CameraNotFound: a name that does not exist.
        StageError: the scene or a template cannot be read, or a value does not fit USD.
        ArgumentError: another suffix, or a prim that cannot be a template.
        ExportError: the file cannot be written.
    """
    with quiet(), readable(os.fspath(path)):
        over = OverLayer(content["scene"], "Scenario", content.get("variants"))
        report = StageReport(os.fspath(path))
        root = over.stage.GetPrimAtPath(over.root)
        root.AddAppliedSchema(schema.SCENARIO)
        schema.author(root, "tiscene:scenario:scene", content["scene"])
        _write_timings(root, content["timings"])
        if content["frustum"] is not None:
            far = content["frustum"]["far"]
            far = far if far == -1.0 else over.units.to_stage(far)
            schema.author(root, "tiscene:scenario:frustumFar", far)
        prims = [_write_object(over, each, report) for each in content["objects"]]
        root.CreateRelationship("tiscene:scenario:objects", False).SetTargets([prim.GetPath() for prim in prims])
        write_joints(over, content.get("joints", ()), content["objects"], prims)
        write_filtered_pairs(root, content.get("filtered_pairs", ()), content["objects"], prims)
        camera = content["camera"]
        if camera is not None:
            cameras = [
                _camera_named(over, each) if isinstance(each, str) else _write_camera(over, each, report)
                for each in (camera if isinstance(camera, list) else [camera])
            ]
            paths = [prim.GetPath() for prim in cameras]
            root.CreateRelationship("tiscene:scenario:camera", False).SetTargets(paths)
        for key in ("edits", "lights", "variants", "overrides"):
            if content.get(key):
                schema.author(root, f"tiscene:scenario:{key}", json.dumps(content[key]))
        if stops := content.get("exposure_compensation"):
            schema.author(root, "tiscene:scenario:exposureCompensation", stops)
        if content.get("physics"):
            schema.author(root, "tiscene:scenario:physics", True)
        report.raise_problems()
        over.export(path)


def _write_object(over: OverLayer, content: Mapping[str, Any], report: StageReport) -> Usd.Prim:
    rotation = content["rotation"]
    prim, operations = over.define_object(
        content["id"], content["template"], euler=len(rotation) == 3, scale=content["scale"]
    )
    operations.set(content["position"], unit_rotation(rotation), over.units)
    prim.AddAppliedSchema(schema.OBJECT)
    schema.author(prim, "tiscene:object:id", content["id"])
    schema.author(prim, "tiscene:object:template", content["template"])
    schema.author(prim, "tiscene:object:firstFrame", content["first_frame"])
    last = content["last_frame"]
    schema.author(prim, "tiscene:object:lastFrame", -1 if last is None else last)
    schema.author(prim, "tiscene:object:frustumLimited", content["frustum_limited"])
    schema.author(prim, "tiscene:object:collide", content["collide"])
    back = over.units.to_json(over.units.to_stage(content["position"]))
    if back != list(content["position"]) or unit_rotation(rotation) != tuple(rotation):
        schema.author(prim, "tiscene:object:exactPose", [*content["position"], *rotation])
    write_dynamic(prim, content["dynamic"], over.units, lambda: _part_path(over, prim), report)
    write_rigid_body(prim, content["dynamic"], over.units)
    return prim


def _part_path(over: OverLayer, prim: Usd.Prim) -> Sdf.Path:
    """Return the path for the next part of a prim's composite motion."""
    return over.unused_path(over.folder("Motions"), f"{prim.GetName()}_part")


def _write_timings(root: Usd.Prim, content: Mapping[str, Any]) -> None:
    schema.author(root, "tiscene:scenario:timing", schema.token(content["type"]))
    if "wait_time" in content:
        schema.author(root, "tiscene:scenario:waitTime", content["wait_time"])
    if "repeat" in content:
        schema.author(root, "tiscene:scenario:repeat", content["repeat"])
    if "times" in content:
        keys, times = zip(*content["times"], strict=True)
        ids = [key if isinstance(key, str) else "" for key in keys]
        schema.author(root, "tiscene:scenario:turns", ids)
        if not all(ids):
            numbers = [0 if isinstance(key, str) else key for key in keys]
            schema.author(root, "tiscene:scenario:turnIndices", numbers)
        schema.author(root, "tiscene:scenario:turnTimes", times)


def _write_camera(over: OverLayer, content: Mapping[str, Any], report: StageReport) -> Usd.Prim:
    values = {key: value for key, value in content.items() if key not in ("dynamic", "lens")}
    prim, operations = over.define_camera(Camera(**values))
    operations.set(content["position"], content["rotation"], over.units)
    prim.AddAppliedSchema(schema.CAMERA)
    schema.author(prim, "tiscene:camera:name", content["name"])
    for key, name in CAMERA_VALUES.items():
        if content[key] is not None:
            schema.author(prim, f"tiscene:camera:{name}", content[key])
    schema.author(prim, "tiscene:camera:aspect", content["aspect"] or 0.0)
    schema.author(prim, "tiscene:camera:conform", content["conform"])
    if any(content["aperture_offset"]):
        schema.author(prim, "tiscene:camera:apertureOffset", tuple(content["aperture_offset"]))
    if content.get("lens"):
        schema.author(prim, "tiscene:camera:lens", json.dumps(content["lens"]))
    if content["dynamic"] is not None:
        write_dynamic(prim, content["dynamic"], over.units, lambda: _part_path(over, prim), report)
    return prim


def _camera_named(over: OverLayer, name: str) -> Usd.Prim:
    """Return the scene's camera of a name or prim path, which is the one that a world chooses."""
    settings = read_render_settings(over.stage)
    cameras = [prim for prim in stage_cameras(over.stage) if not prim.GetPath().HasPrefix(over.root)]
    names = unique_names([prim.GetPath() for prim in settings.main_first(cameras, Usd.Prim.GetPath)])
    for path, each in names.items():
        if name in (each, str(path)):
            return over.stage.GetPrimAtPath(path)
    raise CameraNotFound("camera", name, names.values(), " on the stage")
