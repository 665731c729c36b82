# SPDX-License-Identifier: Apache-2.0
"""UsdGeomBasisCurves as tubes or ribbons, UsdGeomPoints as spheres.

Curves of equal vertex count are evaluated together as arrays [curves, points, components]. The more spheres a prim has,
the fewer triangles each gets. Above 100,000 samples, tubes get fewer sides; above 2,000,000 a prim is not drawn, which
is reported.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from tiscene.errors import counted
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.value_times import value_times
from tiscene.usd.geometry.curve_evaluation import BASES, CurveGroup, Curves
from tiscene.usd.geometry.deforming import points_at
from tiscene.usd.geometry.primvar import (
    NO_PRIMVARS,
    PrimvarNames,
    array_of,
    array_or_primvar,
    default_values,
    read_element_values,
    token_of,
)
from tiscene.usd.geometry.swept_curves import Start, Strip, repeated, ribbons, tubes
from tiscene.usd.geometry.vertex_weld import WeldedMesh

Floats = NDArray[np.floating]
_MAX_SAMPLES = 2_000_000  # points of a Points prim, or samples along all curves of a prim
_MAX_FINE_SAMPLES = 100_000  # up to this many, tubes have 8 sides and spheres at least 80 triangles; above, 4 and 20
_MAX_FINE_TRIANGLES = 250_000  # of spheres as smooth as UsdGeomSphere, or nearly so


def read_curves(
    prim: Usd.Prim,
    time: Usd.TimeCode,
    report: StageReport,
    names: PrimvarNames = NO_PRIMVARS,
    before: dict[int, Start] | None = None,
) -> WeldedMesh | None:
    """Read curves as tubes of their widths, or as ribbons facing their normals where those are authored.

    Args:
        prim: the curves.
        time: when to evaluate them.
        report: collects what is wrong, and what is not drawn.
        names: the primvars that their material reads.
        before: carries where tubes start to turn from one time to the next, see `tubes`; empty at the first time.

    Returns:
        The mesh; None, with the reason reported, if there is nothing to draw.
    """
    path = prim.GetPath()
    attributes = UsdGeom.BasisCurves(prim)
    points = points_at(attributes, time)
    curves = _topology(attributes, time, report)
    widths = _widths(attributes.GetWidthsAttr(), time, report)
    normals = array_or_primvar(attributes.GetNormalsAttr(), time, width=3)
    if not normals.any():  # other programs write zeros where they have no normals
        normals = normals[:0]
    if fault := _describe_fault(curves, point=points, width=widths, normal=normals):
        report.problem(path, "curves", fault)
        return None
    if len(points) == 0:
        return _concatenate([], prim, report)
    if len(widths) == 0:
        report.omission(path, "curves without widths are drawn with a width of a thousandth of their extent")
        widths = np.array([np.ptp(points, axis=0).max() / 1000.0], np.float32)
    elements = f"{counted(len(curves.counts), 'curve')} nor their points"
    if not curves.fit(widths):
        report.problem(path, "curves", f"{counted(len(widths), 'width fits', 'widths fit')} neither {elements}")
        return None
    if len(normals) and not curves.fit(normals):
        report.omission(
            path, f"{counted(len(normals), 'normal fits', 'normals fit')} neither {elements}; tubes are drawn"
        )
        normals = normals[:0]
    authored = []
    for name, columns, values in read_element_values(prim, names, time, report):
        if curves.fit(values):
            authored.append((columns, values))
        else:
            fault = f"{counted(len(values), 'value fits', 'values fit')} neither {elements}"
            report.omission(path, f"primvars:{name}: {fault}, so that it is not used")
    strips: list[Strip] = []
    for group in curves.groups():
        line = _line(group, points, prim, report)
        if line is None:
            continue
        samples = line.shape[1]
        vertex_values = None
        if authored or names.has_more_than_uv:
            vertex_values = default_values(line.shape[:2], names)
            for columns, values in authored:
                found = group.sampled(values, samples)
                vertex_values[..., columns] = np.clip(found, values.min(axis=0), values.max(axis=0))
        normal = group.sampled(normals, samples) if len(normals) else None
        width = group.sampled(widths[:, None], samples)[..., 0]
        strips.append(Strip(line, width, normal, vertex_values, group.ids))
    return _sweep(strips, curves, prim, report, {} if before is None else before)


def _topology(attributes: UsdGeom.BasisCurves, time: Usd.TimeCode, report: StageReport) -> Curves:
    counts = array_of(attributes.GetCurveVertexCountsAttr(), time, np.int64)
    kind, wrap = (token_of(each, time, report) for each in (attributes.GetTypeAttr(), attributes.GetWrapAttr()))
    return Curves(counts, "linear" if kind == "linear" else str(attributes.GetBasisAttr().Get(time)), wrap)


def _line(group: CurveGroup, points: Floats, prim: Usd.Prim, report: StageReport) -> Floats | None:
    """Return samples [c, m, 3] along curves; None, which is reported, if they are too short."""
    line, count, basis = group.along(points), group.rows.shape[1], group.curves.basis
    if line is None:
        report.omission(prim.GetPath(), f"curves of {counted(count, 'point')} are too short for their basis")
    elif (unused := group.unused_points()) > 0:
        text = f"{basis} curves of {counted(count, 'point')}, which is not valid, are drawn without the last {unused}"
        report.omission(prim.GetPath(), text)
    return line


def _sweep(
    strips: list[Strip], curves: Curves, prim: Usd.Prim, report: StageReport, before: dict[int, Start]
) -> WeldedMesh | None:
    """Return the tubes, or the ribbons, of curves; None, with the reason reported, if there is nothing to draw."""
    samples = sum(strip.line.shape[0] * strip.line.shape[1] for strip in strips)
    if samples > _MAX_SAMPLES:
        report.omission(prim.GetPath(), f"curves of {samples:,} samples are not drawn: the limit is {_MAX_SAMPLES:,}")
        return None
    sides = 8 if samples <= _MAX_FINE_SAMPLES else 4
    corners, closed = curves.basis == "linear" and samples <= _MAX_FINE_SAMPLES, curves.wrap == "periodic"
    surfaces = [
        tubes(strip, sides, corners, closed, before)
        if strip.normal is None
        else ribbons(strip, strip.normal, corners, closed)
        for strip in strips
    ]
    shape = ("points", "widths", "primvars:widths", "normals", "primvars:normals")
    if not any(value_times(prim.GetAttribute(name)) for name in shape):
        surfaces = [_without_empty_triangles(surface) for surface in surfaces]
    return _concatenate(surfaces, prim, report)


def read_points(
    prim: Usd.Prim, time: Usd.TimeCode, report: StageReport, names: PrimvarNames = NO_PRIMVARS
) -> WeldedMesh | None:
    """Read a sphere for each point, of the diameters `widths` (1 if unauthored, as in Hydra).

    Args:
        prim: the points.
        time: when to evaluate them.
        report: collects what is wrong, and what is not drawn.
        names: the primvars that their material reads; each sphere has one value of each.

    Returns:
        The mesh; None, with the reason reported, if there is nothing to draw.
    """
    points = UsdGeom.Points(prim)
    at = points_at(points, time)
    widths = _widths(points.GetWidthsAttr(), time, report)
    if len(at) == 0:
        return _concatenate([], prim, report)
    if len(widths) == 0:
        report.omission(prim.GetPath(), "points without widths are drawn one unit wide")
        widths = np.ones(1, np.float32)
    if len(widths) not in (1, len(at)):
        report.problem(prim.GetPath(), "points", f"{counted(len(widths), 'width')}, but {counted(len(at), 'point')}")
        return None
    if not np.isfinite(at).all() or not np.isfinite(widths).all():
        report.problem(prim.GetPath(), "points", "a point or width is not a finite number")
        return None
    if len(at) > _MAX_SAMPLES:
        report.omission(prim.GetPath(), f"{counted(len(at), 'point')} not drawn: the limit is {_MAX_SAMPLES:,}")
        return None
    times = {time for name in ("points", "widths", "primvars:widths") for time in value_times(prim.GetAttribute(name))}
    sphere, faces = _icosphere(_sphere_level(len(at) * max(1, len(times))))
    kept = np.broadcast_to(widths, len(at)) > 0.0
    rows = np.flatnonzero(kept)
    radius = np.broadcast_to(widths, len(at))[rows] / 2.0
    values = _point_values(prim, names, time, len(at), report)
    positions = at[rows][:, None] + sphere * radius[:, None, None]
    normals = np.broadcast_to(sphere, positions.shape)
    every = None if values is None else np.repeat(values[rows][:, None], len(sphere), axis=1)
    return _concatenate([repeated(positions, normals, faces, every, rows)], prim, report)


def _widths(attribute: Usd.Attribute, time: Usd.TimeCode, report: StageReport) -> Floats:
    """Return the `widths` of curves or points; empty if they have none."""
    widths = array_or_primvar(attribute, time)
    if (widths < 0.0).any():
        report.omission(attribute.GetPrim().GetPath(), "widths below 0 count as 0")
    return np.maximum(widths, np.float32(0.0))


def _point_values(
    prim: Usd.Prim, names: PrimvarNames, time: Usd.TimeCode, count: int, report: StageReport
) -> Floats | None:
    """Return the vertex values [count, 2 or 8] of points; None if their material reads none that are authored."""
    authored = read_element_values(prim, names, time, report)
    result = default_values((count,), names) if authored or names.has_more_than_uv else None
    for name, columns, values in authored:
        if result is None or len(values) not in (1, count):
            fault = f"{counted(len(values), 'value')}, but {counted(count, 'point')}"
            report.omission(prim.GetPath(), f"primvars:{name}: {fault}, so that it is not used")
            continue
        result[:, columns] = values
    return result


def _describe_fault(curves: Curves, **values: Floats) -> str:
    """Describe what is wrong with the curves' values; `point` has a row for each control point. "" if nothing."""
    counts, basis = curves.counts, curves.basis
    if len(counts) and counts.min() < 0:
        return f"curveVertexCounts holds {counts.min()}"
    if counts.sum() != len(values["point"]):
        return f"curveVertexCounts add up to {counts.sum()}, but it has {counted(len(values['point']), 'point')}"
    for name, numbers in values.items():
        if not np.isfinite(numbers).all():
            return f"a {name} is not a finite number"
    if basis != "linear" and basis not in BASES:
        return f"basis {basis!r} is not known; expected one of {', '.join(BASES)}"
    return ""


def _without_empty_triangles(surface: WeldedMesh) -> WeldedMesh:
    """Return a mesh without triangles two of whose vertices are at one place, as between two sides of a joint."""
    a, b, c = surface.positions[surface.triangles].transpose(1, 0, 2)
    kept = ~((a == b).all(axis=1) | (b == c).all(axis=1) | (c == a).all(axis=1))
    return replace(surface, triangles=surface.triangles[kept], face=surface.face[kept])


def _concatenate(surfaces: list[WeldedMesh], prim: Usd.Prim, report: StageReport) -> WeldedMesh | None:
    """Concatenate meshes; None, which is reported, if all are empty."""
    surfaces = [surface for surface in surfaces if len(surface.triangles)]
    if not surfaces:
        report.omission(prim.GetPath(), f"{prim.GetTypeName()} without anything to draw")
        return None
    first = np.cumsum([0, *(len(surface.positions) for surface in surfaces)])
    return WeldedMesh(
        np.concatenate([surface.positions for surface in surfaces]),
        np.concatenate([s.triangles + np.int32(start) for s, start in zip(surfaces, first, strict=False)]),
        np.concatenate([surface.normals for surface in surfaces if surface.normals is not None]),
        None if surfaces[0].uv is None else np.concatenate([each.uv for each in surfaces if each.uv is not None]),
        np.concatenate([surface.face for surface in surfaces]),
    )


def _sphere_level(spheres: int) -> int:
    """Return how often to subdivide the triangles of a number of spheres, counted at each of their samples."""
    fine = (level for level in (4, 3, 2) if spheres * 20 * 4**level <= _MAX_FINE_TRIANGLES)
    return next(fine, 1 if spheres <= _MAX_FINE_SAMPLES else 0)


def _icosphere(level: int) -> tuple[Floats, NDArray[np.int64]]:
    """Return the vertices [n, 3] and triangles [m, 3] of an icosahedron subdivided `level` times on the unit sphere."""
    g = (1.0 + math.sqrt(5.0)) / 2.0
    points = np.array([(s, t * g, 0.0) for s in (-1, 1) for t in (-1, 1)])
    vertices = np.concatenate([points, points[:, [2, 0, 1]], points[:, [1, 2, 0]]])
    pairs = np.linalg.norm(vertices[:, None] - vertices[None], axis=-1)
    near = np.abs(pairs - 2.0) < 1e-9
    faces = [
        (a, b, c)
        for a in range(12)
        for b in range(a + 1, 12)
        for c in range(b + 1, 12)
        if near[a, b] and near[b, c] and near[a, c]
    ]
    triangles = np.array([face if np.linalg.det(vertices[list(face)]) > 0 else face[::-1] for face in faces])
    vertices = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    for _ in range(level):
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, row = np.unique(edges, axis=0, return_inverse=True)
        middle = vertices[unique].sum(axis=1)
        ab, bc, ca = (len(vertices) + row.reshape(-1, 3)).T
        a, b, c = triangles.T
        vertices = np.concatenate([vertices, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        triangles = np.concatenate([np.stack(t, -1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    return vertices, triangles
