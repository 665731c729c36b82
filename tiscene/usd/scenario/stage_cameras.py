# SPDX-License-Identifier: Apache-2.0
"""Cameras of a stage as members of a scenario: which there are, and their exact values by TisceneCameraAPI."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

from pxr import Usd, UsdGeom

from tiscene.scene.camera import Camera
from tiscene.usd.core import schema
from tiscene.usd.core.pose import PrimPose
from tiscene.usd.core.prims import DEFINED
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.schema import authored

# Members of a camera's JSON object, and the attributes of TisceneCameraAPI that hold their exact values.
CAMERA_VALUES = {
    "vertical_fov": "verticalFov",
    "lens_radius": "lensRadius",
    "focus_distance": "focusDistance",
    "near": "near",
    "far": "far",
    "exposure": "exposure",
    "orthographic_height": "viewHeight",
}


def stage_cameras(stage: Usd.Stage) -> list[Usd.Prim]:
    """Return the cameras in the order of `read_stage`: those in objects and instances too, but not those of points."""
    cameras = []
    prims = iter(Usd.PrimRange(stage.GetPseudoRoot(), DEFINED))
    for prim in prims:
        if prim.IsA(UsdGeom.PointInstancer):
            prims.PruneChildren()
        elif prim.IsA(UsdGeom.Camera):
            cameras.append(prim)
    return cameras


def listed_name(prim: Usd.Prim) -> str:
    """Return a camera's name, or its path if others have that name too: the layer below may name them otherwise."""
    same = [each for each in stage_cameras(prim.GetStage()) if each.GetName() == prim.GetName()]
    return str(prim.GetName() if len(same) == 1 else prim.GetPath())


def exact_camera(prim: Usd.Prim, camera: Camera, pose: PrimPose, report: StageReport) -> dict[str, Any]:
    """Return a camera's JSON object, with the exact values of TisceneCameraAPI where they agree with the camera."""
    content = dataclasses.asdict(dataclasses.replace(camera, dynamic=None))
    content["position"] = list(pose.position)
    if len(pose.rotation) == 4:
        content["rotation"] = list(pose.rotation)
    content["name"] = authored(prim, "tiscene:camera:name") or camera.name
    for key, name in CAMERA_VALUES.items():
        value = authored(prim, f"tiscene:camera:{name}")
        if (
            value is not None
            and content[key] is not None
            and math.isclose(value, content[key], rel_tol=1e-5, abs_tol=1e-7)
        ):
            content[key] = float(value)
    if schema.has(prim, schema.CAMERA):
        content["aspect"] = authored(prim, "tiscene:camera:aspect") or None
        content["aperture_offset"] = list(authored(prim, "tiscene:camera:apertureOffset") or camera.aperture_offset)
        content["conform"] = str(authored(prim, "tiscene:camera:conform") or camera.conform)
        if lens := authored(prim, "tiscene:camera:lens"):
            try:
                content["lens"] = json.loads(lens)
            except ValueError as error:
                report.refuse(prim.GetPath(), "camera", f"tiscene:camera:lens is not JSON: {error}")
    return content
