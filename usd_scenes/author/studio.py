# SPDX-License-Identifier: Apache-2.0
"""A photo studio for pictures of one template: paper cove, softbox lights, camera."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade

from usd_scenes.author import usd_writer as usd
from usd_scenes.author.polygon_mesh import Array, grid
from usd_scenes.author.shapes import fillet

PAPER = (0.70, 0.69, 0.67)


def write(template: Path, path: Path, *, yaw: float = 28.0, variants: Mapping[str, str] | None = None) -> None:
    """Write a stage with a template on a paper cove, a large soft light from the left, and a camera "Main".

    All sizes are relative to the template's, so that a fork and a sofa fill the picture alike.

    Args:
        template: the template's file.
        path: the stage to write.
        yaw: rotation of the template about y, degrees.
        variants: variants to select on the template.
    """
    stage, _ = usd.new_stage("Studio", "assembly")
    xform = UsdGeom.Xform.Define(stage, "/Studio/Template")
    xform.GetPrim().GetReferences().AddReference(str(template.resolve()))
    for name, choice in (variants or {}).items():
        xform.GetPrim().GetVariantSets().SetSelection(name, choice)
    turn = xform.AddRotateYOp()
    turn.Set(yaw)
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    box = cache.ComputeWorldBound(xform.GetPrim()).ComputeAlignedRange()
    low, size = np.array(box.GetMin()), np.array(box.GetSize())
    xform.GetPrim().RemoveProperty(turn.GetName())
    xform.ClearXformOpOrder()
    xform.AddTranslateOp().Set(Gf.Vec3d(0.0, -float(low[1]), 0.0))
    xform.AddRotateYOp().Set(yaw)
    radius = 0.5 * float(np.linalg.norm(size))
    _cove(stage, radius)
    _lights(stage, radius)
    _camera(stage, size)
    usd.save(stage, path)


def _cove(stage: Usd.Stage, radius: float) -> None:
    """Define a paper backdrop that curves from the table up the wall."""
    profile = np.array(fillet([[40.0, 0.0], [-6.0, 0.0], [-6.0, 24.0]], 5.0, 24)) * radius
    points = np.stack([np.insert(profile[:, ::-1], 0, x * 30.0 * radius, axis=1) for x in (-1.0, 1.0)], axis=1)
    mesh = grid(points, points[..., :2])
    prim = UsdGeom.Mesh.Define(stage, "/Studio/Paper")
    prim.CreatePointsAttr([Gf.Vec3f(*map(float, p)) for p in mesh.points])
    prim.CreateNormalsAttr([Gf.Vec3f(*map(float, n)) for n in mesh.normals])
    prim.CreateFaceVertexCountsAttr(mesh.counts.tolist())
    prim.CreateFaceVertexIndicesAttr(mesh.indices.tolist())
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateDoubleSidedAttr(True)
    material = UsdShade.Material.Define(stage, "/Studio/PaperLook")
    shader = UsdShade.Shader.Define(stage, "/Studio/PaperLook/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*PAPER))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.9)
    output = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(output)
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(material)


def _lights(stage: Usd.Stage, radius: float) -> None:
    """Define key, fill and rim lights around an object of this radius, and a dim dome."""
    for name, at, size, radiance, color in (
        ("Key", (-3.2, 3.6, 2.6), 2.4, 12.0, (1.0, 0.95, 0.89)),
        ("Fill", (4.2, 1.8, 2.4), 2.4, 0.9, (0.90, 0.95, 1.0)),
        ("Rim", (2.0, 4.0, -3.4), 1.6, 9.0, (1.0, 0.98, 0.95)),
    ):
        light = UsdLux.RectLight.Define(stage, f"/Studio/{name}")
        light.CreateWidthAttr(size * radius)
        light.CreateHeightAttr(size * radius)
        light.CreateIntensityAttr(radiance)
        light.CreateColorAttr(Gf.Vec3f(*color))
        x, y, z = at
        light.AddTranslateOp().Set(Gf.Vec3d(*(radius * value for value in at)))
        pitch = math.degrees(math.atan2(-y + 0.5, math.hypot(x, z)))
        light.AddRotateXYZOp().Set(Gf.Vec3f(pitch, math.degrees(math.atan2(x, z)), 0.0))
    dome = UsdLux.DomeLight.Define(stage, "/Studio/Room")
    dome.CreateIntensityAttr(0.24)


def _camera(stage: Usd.Stage, size: Array) -> None:
    """Define an 85 mm lens on a 24 mm sensor that frames the object; flat objects are seen from higher up."""
    width, height, depth = map(float, size)
    pitch = math.radians(16.0 + 24.0 * max(0.0, 1.0 - 2.5 * height / max(width, depth)))
    tall = height * math.cos(pitch) + depth * math.sin(pitch)
    distance = 0.56 * max(width, tall) * 0.85 / 0.12 + depth / 2.0
    camera = UsdGeom.Camera.Define(stage, "/Studio/Main")
    camera.CreateHorizontalApertureAttr(0.24)
    camera.CreateVerticalApertureAttr(0.24)
    camera.CreateFocalLengthAttr(0.85)
    camera.CreateExposureAttr(0.35)
    camera.AddTranslateOp().Set(Gf.Vec3d(0.0, height / 2.0 + distance * math.sin(pitch), distance * math.cos(pitch)))
    camera.AddRotateXOp().Set(-math.degrees(pitch))
