# SPDX-License-Identifier: Apache-2.0
"""Jambs, heads and thresholds of the openings between rooms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdSemantics, UsdShade, Vt

from tiscene.usd.core.prims import unused_path
from tiscene.usd.joining.floor_plan import Opening

LINING = 0.020  # m, thickness of jambs, head and threshold
_PAINT, _WOOD = (0.72, 0.71, 0.68), (0.30, 0.185, 0.095)  # albedos


def line(stage: Usd.Stage, root: Usd.Prim, openings: Sequence[Opening], up_axis: str, meters: float) -> None:
    """Define jambs, head and threshold of the openings, as objects with the label "door frame"."""
    lined = [each for each in openings if each.lined]
    if not lined:
        return
    scope = unused_path(stage, root.GetPath(), "Openings")
    Usd.ModelAPI(UsdGeom.Xform.Define(stage, scope).GetPrim()).SetKind(Kind.Tokens.group)
    UsdGeom.Scope.Define(stage, scope.AppendChild("Looks"))
    paint = _material(stage, scope.AppendPath("Looks/Paint"), _PAINT, 0.32)
    wood = _material(stage, scope.AppendPath("Looks/Wood"), _WOOD, 0.5)
    for number, opening in enumerate(lined, 1):
        frame = UsdGeom.Xform.Define(stage, scope.AppendChild(f"Opening{number}"))
        Usd.ModelAPI(frame.GetPrim()).SetKind(Kind.Tokens.component)
        UsdSemantics.LabelsAPI.Apply(frame.GetPrim(), "class").CreateLabelsAttr(["door frame"])
        world = in_units(opening.world_from_passage(up_axis), meters)
        frame.AddTransformOp().Set(Gf.Matrix4d(np.round(world, 9).T.tolist()))
        w, h, depth = opening.width / 2.0, opening.height, opening.depth / 2.0 - 0.0005
        jambs = [(side * (w + LINING / 2.0), h / 2.0, LINING / 2.0, h / 2.0) for side in (-1.0, 1.0)]
        head = (0.0, h + LINING / 2.0, w + LINING, LINING / 2.0)
        for part, boards, material, along in (
            ("Frame", [*jambs, head], paint, depth),
            ("Threshold", [(0.0, 0.003 - LINING / 2.0, w, LINING / 2.0)], wood, depth + 0.012),
        ):
            mesh = _boards(stage, frame.GetPath().AppendChild(part), boards, along)
            UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def _boards(
    stage: Usd.Stage, path: Sdf.Path, boards: Sequence[tuple[float, float, float, float]], depth: float
) -> UsdGeom.Mesh:
    """Define boxes along z from -depth to depth; each is (x, y, half width, half height), m."""
    signs = np.array([[1 if i >> axis & 1 else -1 for axis in range(3)] for i in range(8)], float)
    faces = np.array([[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]])
    points = [signs * (w, h, depth) + (x, y, 0.0) for x, y, w, h in boards]
    corners = np.concatenate([box[faces].reshape(-1, 3) for box in points]).round(6)
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(corners.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([4] * (len(corners) // 4))
    mesh.CreateFaceVertexIndicesAttr(list(range(len(corners))))
    quads = corners.reshape(-1, 4, 3)
    normals = np.cross(quads[:, 1] - quads[:, 0], quads[:, 2] - quads[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(np.repeat(normals, 4, axis=0).round(6).astype(np.float32)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    unit = np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32), (len(quads), 1))
    kind = Sdf.ValueTypeNames.TexCoord2fArray
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", kind, UsdGeom.Tokens.vertex).Set(Vt.Vec2fArray.FromNumpy(unit))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr([Gf.Vec3f(*map(float, corners.min(axis=0))), Gf.Vec3f(*map(float, corners.max(axis=0)))])
    return mesh


def _material(
    stage: Usd.Stage, path: Sdf.Path, color: tuple[float, float, float], roughness: float
) -> UsdShade.Material:
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, path.AppendChild("Surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(roughness)
    shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return material


def in_units(matrix: NDArray[np.float64], meters: float) -> NDArray[np.float64]:
    """Return a matrix to world positions in meters as one to stage units."""
    return np.diag([1.0 / meters] * 3 + [1.0]) @ matrix
