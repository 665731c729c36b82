# SPDX-License-Identifier: Apache-2.0
"""Imported meshes as UsdGeomMesh: points, normals, texture coordinates, colors, and their samples over time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from tiscene.usd.importers.gltf_animation import FRAME_RATE
from tiscene.usd.importers.imported_mesh import ImportedMesh
from tiscene.usd.importers.materials import VERTEX_COLOR, VERTEX_OPACITY, VERTEX_TINT


def define_mesh(
    stage: Usd.Stage,
    path: Sdf.Path,
    imported: ImportedMesh,
    points: NDArray[Any],
    normals: NDArray[Any],
    is_mirrored: bool,
) -> UsdGeom.Mesh:
    """Author a mesh with transformed points and normals; a mirroring transform reverses its winding."""
    triangles = imported.triangles[:, ::-1] if is_mirrored else imported.triangles
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(triangles), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(triangles, np.int32).reshape(-1)))
    _author_shape(mesh, points, normals, is_mirrored, Usd.TimeCode.Default())
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.faceVarying)
    api = UsdGeom.PrimvarsAPI(mesh)
    for name, uv in (("st", imported.uv), ("st1", imported.second_uv)):
        if uv is not None:
            primvar = api.CreatePrimvar(name, Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
            primvar.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(uv, np.float32)))
    read = imported.material.vertex_inputs.values()
    if imported.colors is not None and VERTEX_TINT in read:
        tint = api.CreatePrimvar(VERTEX_TINT, Sdf.ValueTypeNames.Color4fArray, UsdGeom.Tokens.vertex)
        tint.Set(Vt.Vec4fArray.FromNumpy(np.ascontiguousarray(imported.colors, np.float32)))
    elif imported.colors is not None:
        color = api.CreatePrimvar(VERTEX_COLOR, Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex)
        color.Set(vectors(imported.colors[:, :3]))
    if imported.colors is not None and VERTEX_OPACITY in read:
        opacity = Vt.FloatArray.FromNumpy(np.ascontiguousarray(imported.colors[:, 3], np.float32))
        api.CreatePrimvar(VERTEX_OPACITY, Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex).Set(opacity)
    return mesh


def author_samples(
    mesh: UsdGeom.Mesh, imported: ImportedMesh, points: NDArray[Any], normals: NDArray[Any], is_mirrored: bool
) -> None:
    """Author a mesh's points [s, n, 3] and corner normals [s, m, 3, 3] over time; frame k is time code k."""
    assert imported.samples is not None
    for time, moved, turned in zip(imported.samples.times.tolist(), points, normals, strict=True):
        _author_shape(mesh, moved, turned, is_mirrored, Usd.TimeCode(round(time * FRAME_RATE)))
    stage = mesh.GetPrim().GetStage()
    stage.SetTimeCodesPerSecond(FRAME_RATE)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(max(stage.GetEndTimeCode(), round(float(imported.samples.times[-1]) * FRAME_RATE)))


def _author_shape(
    mesh: UsdGeom.Mesh, points: NDArray[Any], normals: NDArray[Any], is_mirrored: bool, code: Usd.TimeCode
) -> None:
    """Author a mesh's points [n, 3], extent and corner normals [m, 3, 3] at a time code."""
    flat = (normals[:, ::-1] if is_mirrored else normals).reshape(-1, 3)
    mesh.CreatePointsAttr().Set(vectors(points), code)
    mesh.CreateExtentAttr().Set(vectors(np.stack([points.min(axis=0), points.max(axis=0)])), code)
    mesh.CreateNormalsAttr().Set(vectors(flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-30)), code)


def vectors(values: NDArray[Any]) -> Vt.Vec3fArray:
    """Return rows of three numbers as a USD array."""
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, np.float32))
