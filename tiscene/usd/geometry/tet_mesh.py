# SPDX-License-Identifier: Apache-2.0
"""UsdGeomTetMesh: the triangles of its surface, with flat shading."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from tiscene.usd.core.report import StageReport
from tiscene.usd.geometry.deforming import points_at
from tiscene.usd.geometry.primvar import array_of, outside
from tiscene.usd.geometry.vertex_weld import WeldedMesh


def read_tet_mesh(prim: Usd.Prim, time: Usd.TimeCode, report: StageReport) -> WeldedMesh | None:
    """Read the surface of a mesh of tetrahedra: the authored faces, else those of one tetrahedron alone.

    Returns:
        The mesh; None, with the reason reported, if it has no surface or contradicts itself.
    """
    mesh = UsdGeom.TetMesh(prim)
    points = points_at(mesh, time)
    faces = array_of(mesh.GetSurfaceFaceVertexIndicesAttr(), time, np.int64, width=3)
    if len(faces) == 0:
        faces = np.asarray(UsdGeom.TetMesh.ComputeSurfaceFaces(mesh, time), np.int64).reshape(-1, 3)
    if (worst := outside(faces.ravel(), len(points))) is not None:
        report.problem(prim.GetPath(), "mesh", f"refers to point {worst}, but there are {len(points)} points")
        return None
    if not np.isfinite(points).all():
        report.problem(prim.GetPath(), "mesh", "a point is not a finite number")
        return None
    if len(faces) == 0:
        report.omission(prim.GetPath(), "TetMesh without anything to draw")
        return None
    if mesh.GetOrientationAttr().Get(time) == UsdGeom.Tokens.leftHanded:
        faces = faces[:, ::-1]
    triangles = np.ascontiguousarray(faces, np.int32)
    return WeldedMesh(points, triangles, None, None, np.arange(len(triangles), dtype=np.int32))
