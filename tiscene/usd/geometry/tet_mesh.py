# SPDX-License-Identifier: Apache-2.0
"""UsdGeomTetMesh: the triangles of its surface, with flat shading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pxr import Usd, UsdGeom

from tiscene.errors import counted
from tiscene.usd.core.report import StageReport
from tiscene.usd.geometry.deforming import points_at
from tiscene.usd.geometry.primvar import NO_PRIMVARS, PrimvarNames, outside, primvar_topology, read_vertex_values
from tiscene.usd.geometry.vertex_weld import WeldedMesh, weld


def read_tet_mesh(
    prim: Usd.Prim, time: Usd.TimeCode, report: StageReport, names: PrimvarNames = NO_PRIMVARS
) -> WeldedMesh | None:
    """Read the surface of a mesh of tetrahedra: the authored faces, else those of one tetrahedron alone.

    Args:
        prim: the mesh.
        time: when to evaluate it.
        report: collects what is wrong.
        names: the primvars that its material reads, of points or of the faces of the surface.

    Returns:
        The mesh; None, with the reason reported, if it has no surface or contradicts itself.
    """
    mesh = UsdGeom.TetMesh(prim)
    points = points_at(mesh, time)
    topology = primvar_topology(prim, time)
    faces = topology.indices.reshape(-1, 3)
    if (worst := outside(topology.indices, len(points))) is not None:
        report.problem(
            prim.GetPath(), "mesh", f"refers to point {worst}, but the mesh has {counted(len(points), 'point')}"
        )
        return None
    if not np.isfinite(points).all():
        report.problem(prim.GetPath(), "mesh", "a point is not a finite number")
        return None
    if len(faces) == 0:
        report.omission(prim.GetPath(), "TetMesh without anything to draw")
        return None
    surface = WeldedMesh(points, faces, None, None, np.arange(len(faces), dtype=np.int32))
    values = read_vertex_values(prim, names, names.has_more_than_uv, topology, time, report)
    if values is not None:
        corners = np.arange(faces.size).reshape(-1, 3)
        surface = weld(points, topology.indices, corners, surface.face, None, values)
    if mesh.GetOrientationAttr().Get(time) == UsdGeom.Tokens.leftHanded:
        surface = replace(surface, triangles=np.ascontiguousarray(surface.triangles[:, ::-1]))
    return surface
