# SPDX-License-Identifier: Apache-2.0
"""UsdGeomMesh as triangles.

`read_mesh` validates topology, reads the primvars that the bound materials use, subdivides or triangulates, drops holes
and reverses left-handed faces. A mesh that contradicts itself is reported as a problem and left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from tiscene.errors import counted
from tiscene.scene.skinned_deformation import Skin
from tiscene.usd.core.content import content_digest
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import shared_path
from tiscene.usd.core.time_samples import in_seconds
from tiscene.usd.core.value_times import time_code_number
from tiscene.usd.geometry.catmull_clark import Creases
from tiscene.usd.geometry.deforming import points_at, read_point_samples
from tiscene.usd.geometry.primvar import (
    PrimvarNames,
    Topology,
    array_of,
    outside,
    read_normals,
    read_vertex_values,
    token_of,
)
from tiscene.usd.geometry.skinned_mesh import control_of, posed, with_normals
from tiscene.usd.geometry.skinning import skin_of
from tiscene.usd.geometry.subdivision import MAX_LEVELS, subdivide
from tiscene.usd.geometry.triangulate import triangulate
from tiscene.usd.geometry.vertex_weld import Attribute, WeldedMesh, weld, with_position_samples

_INFINITE_SHARPNESS = 10.0  # UsdGeomMesh's SHARPNESS_INFINITE


def read_mesh(
    prim: Usd.Prim,
    time: Usd.TimeCode,
    report: StageReport,
    primvars: Sequence[PrimvarNames],
    primvars_of_face: NDArray[np.intp] | None,
    times: Sequence[float],
) -> WeldedMesh | None:
    """Read a mesh as triangles that are counter-clockwise seen from outside.

    Args:
        prim: a UsdGeomMesh.
        time: when to evaluate its attributes.
        report: collects problems and omissions.
        primvars: the primvars that its materials read, one entry for each distinct choice.
        primvars_of_face: [faces], which entry of `primvars` each face uses; None: all use the first.
        times: time codes at which to sample a changing shape; empty for a constant one.

    Returns:
        The mesh; None, with the reason reported, if it has no visible face or contradicts itself.
    """
    mesh = UsdGeom.Mesh(prim)
    checked = _read_topology(mesh, time, report)
    if checked is None:
        return None
    points, topology = checked
    skin = skin_of(prim, report)
    if skin is not None and len(skin.points) != len(points):
        skin = None
    smooth = _is_smooth(mesh, topology, time, report)
    normals = None if smooth else read_normals(prim, topology, time, report)
    if skin is not None:
        skin = with_normals(skin, normals, topology)
        points, normals = posed(skin, normals, in_seconds(prim.GetStage(), [time_code_number(prim, time)])[0])
    samples = None if skin is not None else read_point_samples(prim, times, len(points), report)
    uv = _read_values(prim, topology, time, report, primvars, primvars_of_face)
    visible = _visible_faces(mesh, len(topology.counts), time, report)
    if visible is None:
        return None
    faces = _Faces(points, topology, visible, uv, samples, skin)
    if smooth:
        surface = _refined(mesh, faces, time, report)
    else:
        normal_samples = None if samples is None else _normals_over_time(prim, topology, normals, times, report)
        surface = _triangulated(faces, normals, normal_samples)
    if len(surface.triangles) == 0:
        text = "a mesh without a visible face"
        if smooth and mesh.GetInterpolateBoundaryAttr().Get(time) == "none" and visible.any():
            text += ': its interpolateBoundary "none" leaves out every face with a point on its boundary'
        report.omission(prim.GetPath(), text)
        return None
    if token_of(mesh.GetOrientationAttr(), time, report) == UsdGeom.Tokens.leftHanded:
        surface = _reverse_winding(surface, flip_normals=smooth)
    return replace(surface, times=times if samples is not None else (), skin=skin)


@dataclass(frozen=True, eq=False)
class _Faces:
    """What the triangles of a mesh are made of.

    Attributes:
        points: float32 [n, 3].
        topology: the faces over them.
        visible: bool [faces], False for holes.
        uv: what its materials read per vertex.
        samples: points at other times, as of `read_point_samples`; None for a constant shape.
        skin: what moves the points; None if nothing does.
    """

    points: NDArray[np.float32]
    topology: Topology
    visible: NDArray[np.bool_]
    uv: Attribute | None
    samples: NDArray[np.float32] | None
    skin: Skin | None


def _is_smooth(mesh: UsdGeom.Mesh, topology: Topology, time: Usd.TimeCode, report: StageReport) -> bool:
    """Return whether a mesh is a subdivision surface, and report rules that are not applied."""
    scheme = token_of(mesh.GetSubdivisionSchemeAttr(), time, report)
    if scheme == "loop":
        report.omission(mesh.GetPath(), "Loop subdivision is drawn by the Catmull-Clark rules")
    rule = mesh.GetTriangleSubdivisionRuleAttr().Get(time)
    if scheme == "catmullClark" and rule == UsdGeom.Tokens.smooth and (topology.counts == 3).any():
        report.omission(mesh.GetPath(), "triangleSubdivisionRule 'smooth' is not applied")
    return scheme in ("catmullClark", "loop")


def _visible_faces(mesh: UsdGeom.Mesh, count: int, time: Usd.TimeCode, report: StageReport) -> NDArray[np.bool_] | None:
    """Return which of `count` faces are no holes; None, with a problem reported, if a hole is no face."""
    holes = array_of(mesh.GetHoleIndicesAttr(), time, np.int64)
    if (worst := outside(holes, count)) is not None:
        text = f"holeIndices refer to face {worst}, but there are {count} (0-{count - 1})"
        report.problem(mesh.GetPath(), "mesh", text)
        return None
    visible = np.ones(count, dtype=bool)
    visible[holes] = False
    return visible


def _refined(mesh: UsdGeom.Mesh, faces: _Faces, time: Usd.TimeCode, report: StageReport) -> WeldedMesh:
    """Return a subdivision surface, refined once for all equal meshes of the stage."""
    topology, uv, levels = faces.topology, faces.uv, report.budget.levels.get(shared_path(mesh.GetPrim()), MAX_LEVELS)
    creases = _read_creases(mesh, topology, time, report)
    boundary = token_of(mesh.GetInterpolateBoundaryAttr(), time, report)
    uv_rule = token_of(mesh.GetFaceVaryingLinearInterpolationAttr(), time, report)
    if uv is not None and uv.interpolation == "varying":  # linear over each face, whatever the surface is
        uv, uv_rule = Attribute(uv.at(topology.indices, np.arange(len(topology.indices))), True), "all"
    key = content_digest(
        (
            *(faces.points, topology.counts, topology.indices, faces.visible, *vars(creases).values()),
            *(() if uv is None else (uv.values, uv.per_corner)),
            *(boundary, uv_rule, faces.samples, levels, faces.skin is not None),
        )
    )
    if key not in report.budget.refined:
        report.budget.refined[key] = subdivide(
            faces.points,
            topology,
            creases,
            faces.visible,
            uv,
            boundary=boundary,
            uv_rule=uv_rule,
            position_samples=faces.samples,
            levels=levels,
            controlled=faces.skin is not None,
        )
    surface: WeldedMesh = report.budget.refined[key]
    return surface


def _triangulated(faces: _Faces, normals: Attribute | None, normal_samples: list[Attribute] | None) -> WeldedMesh:
    """Return the triangles of flat faces.

    Args:
        faces: the faces.
        normals: authored normals; None for flat shading.
        normal_samples: the same at the times of the points' samples; None if they do not change.
    """
    topology = faces.topology
    corners, face = triangulate(faces.points, topology.counts, topology.indices)
    kept = faces.visible[face]
    split_by = np.arange(len(topology.indices)) if normal_samples and normals and normals.per_corner else None
    surface = weld(faces.points, topology.indices, corners[kept], face[kept], normals, faces.uv, split_by)
    if faces.samples is not None:
        surface = with_position_samples(surface, faces.samples, normal_samples)
    return surface if faces.skin is None else replace(surface, control=control_of(surface, normals))


def _normals_over_time(
    prim: Usd.Prim, topology: Topology, normals: Attribute | None, times: Sequence[float], report: StageReport
) -> list[Attribute] | None:
    """Return a mesh's authored normals at each time; None if they do not change."""
    names = ("primvars:normals", "normals")
    if normals is None or not any(prim.GetAttribute(name).ValueMightBeTimeVarying() for name in names):
        return None
    read = [read_normals(prim, topology, Usd.TimeCode(time), report) for time in times]
    return [normals if each is None or each.per_corner != normals.per_corner else each for each in read]


def face_count(prim: Usd.Prim, time: Usd.TimeCode) -> int:
    """Return the number of faces of a mesh."""
    return len(array_of(UsdGeom.Mesh(prim).GetFaceVertexCountsAttr(), time, np.int32))


def _read_topology(
    mesh: UsdGeom.Mesh, time: Usd.TimeCode, report: StageReport
) -> tuple[NDArray[np.float32], Topology] | None:
    """Return points [n, 3] and faces; None, with the reason reported, if they contradict each other or are absent."""
    path = mesh.GetPath()
    points = points_at(mesh, time)
    counts = array_of(mesh.GetFaceVertexCountsAttr(), time, np.int32)
    indices = array_of(mesh.GetFaceVertexIndicesAttr(), time, np.int32)
    if len(counts) == 0 and len(indices) == 0:
        report.omission(path, "a mesh without faces")
        return None
    problems = len(points) == 0
    if problems:
        report.problem(path, "mesh", f"{counted(len(counts), 'face')}, but no points")
    elif not np.isfinite(points).all():
        count = int((~np.isfinite(points).all(axis=1)).sum())
        report.problem(path, "mesh", f"{counted(count, 'point is', 'points are')} not finite")
        problems = True
    if len(counts) and counts.min() < 0:
        report.problem(path, "mesh", f"faceVertexCounts holds {counts.min()}")
        return None
    total = int(counts.sum(dtype=np.int64))
    if total != len(indices):
        text = f"faceVertexCounts add up to {total}, but there are {len(indices)} faceVertexIndices"
        report.problem(path, "mesh", text)
        return None
    if problems:
        return None
    topology = Topology(len(points), counts, indices)
    outside = (indices < 0) | (indices >= len(points))
    if outside.any():
        _report_outside(topology, outside, path, report)
        return None
    if counts.min() < 3:
        report.omission(path, "faces of fewer than 3 vertices enclose nothing")
    return points, topology


def _report_outside(topology: Topology, outside: NDArray[np.bool_], path: object, report: StageReport) -> None:
    """Report the faces whose corners [corners] refer to points that do not exist."""
    wrong = topology.indices[outside]
    worst = int(wrong[0])
    faces = len(np.unique(topology.face_of_corner[outside]))
    refer = counted(faces, "face refers", "faces refer")
    others = len(np.unique(wrong)) - 1
    more = f" and {others} other missing ones" if others else ""
    points = counted(topology.points, "point")
    report.problem(path, "mesh", f"{refer} to point {worst}{more}, but the mesh has {points} (0-{topology.points - 1})")


def _read_values(
    prim: Usd.Prim,
    topology: Topology,
    time: Usd.TimeCode,
    report: StageReport,
    primvars: Sequence[PrimvarNames],
    primvars_of_face: NDArray[np.intp] | None,
) -> Attribute | None:
    """Read texture coordinates and colors; where faces use different primvars, as values of corners."""
    wide = any(each.has_more_than_uv for each in primvars)
    read = [read_vertex_values(prim, each, wide, topology, time, report) for each in primvars]
    if len(read) == 1 or primvars_of_face is None:
        return read[0]
    corners = np.arange(len(topology.indices))
    per_corner = np.zeros((len(topology.indices), 8 if wide else 2), dtype=np.float32)
    for row, attribute in enumerate(read):
        if attribute is not None:
            uses = primvars_of_face[topology.face_of_corner] == row
            per_corner[uses] = attribute.at(topology.indices[uses], corners[uses])
    return Attribute(per_corner, per_corner=True)


def _read_creases(mesh: UsdGeom.Mesh, topology: Topology, time: Usd.TimeCode, report: StageReport) -> Creases:
    """Read creases and corners; those that contradict the mesh are reported and ignored."""
    path = mesh.GetPath()
    corners = array_of(mesh.GetCornerIndicesAttr(), time, np.int64)
    corner_sharpness = array_of(mesh.GetCornerSharpnessesAttr(), time, np.float64)
    indices = array_of(mesh.GetCreaseIndicesAttr(), time, np.int64)
    lengths = array_of(mesh.GetCreaseLengthsAttr(), time, np.int64)
    sharpness = array_of(mesh.GetCreaseSharpnessesAttr(), time, np.float64)
    none = Creases.none()
    for name, values in (("cornerIndices", corners), ("creaseIndices", indices)):
        if outside(values, topology.points) is not None:
            report.problem(path, "creases", f"{name} refer to points outside 0-{topology.points - 1}")
            return none
    if len(corners) != len(corner_sharpness):
        report.problem(path, "creases", f"{len(corners)} cornerIndices, but {len(corner_sharpness)} cornerSharpnesses")
        return none
    if (len(lengths) and lengths.min() < 2) or lengths.sum() != len(indices):
        report.problem(path, "creases", f"creaseLengths must be at least 2 and add up to {len(indices)} creaseIndices")
        return none
    edges = int((lengths - 1).sum())
    if len(sharpness) not in (len(lengths), edges):
        expected = f"{len(lengths)} or {edges}"
        report.problem(path, "creases", f"{len(sharpness)} creaseSharpnesses, but there must be {expected}")
        return none
    if np.isnan(sharpness).any() or np.isnan(corner_sharpness).any():
        report.problem(path, "creases", "a crease or corner sharpness is not a number")
        return none
    if len(sharpness) != edges:
        sharpness = np.repeat(sharpness, lengths - 1)
    last = np.zeros(len(indices), dtype=bool)
    last[np.cumsum(lengths) - 1] = True
    start = np.flatnonzero(~last)
    return Creases(
        edges=np.stack([indices[start], indices[start + 1]], axis=-1) if len(start) else np.empty((0, 2), np.int64),
        edge_sharpness=np.where(sharpness >= _INFINITE_SHARPNESS, np.inf, sharpness),
        points=corners,
        point_sharpness=np.where(corner_sharpness >= _INFINITE_SHARPNESS, np.inf, corner_sharpness),
    )


def _reverse_winding(surface: WeldedMesh, flip_normals: bool) -> WeldedMesh:
    """Reverse the winding of the triangles.

    Args:
        surface: a mesh.
        flip_normals: whether to negate the normals: those computed from the winding, not authored ones.
    """
    normals = surface.normals
    if flip_normals and normals is not None:
        normals = -normals
    normal_samples = surface.normal_samples
    if flip_normals and normal_samples is not None:
        normal_samples = -normal_samples
    triangles = np.ascontiguousarray(surface.triangles[:, ::-1])
    control = None if surface.control is None else surface.control.with_reversed_winding(flip_normals)
    return replace(surface, triangles=triangles, normals=normals, normal_samples=normal_samples, control=control)
