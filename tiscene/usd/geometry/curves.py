# SPDX-License-Identifier: Apache-2.0
"""UsdGeomBasisCurves as tubes or ribbons, UsdGeomPoints as spheres.

Curves of equal vertex count are evaluated together as arrays [curves, points, components]. Above 100,000 samples, tubes
get fewer sides and spheres fewer triangles; above 2,000,000 a prim is not drawn, curve_ids is reported.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from tiscene.usd.core.report import StageReport
from tiscene.usd.geometry.primvar import array_of
from tiscene.usd.geometry.triangulate import cross
from tiscene.usd.geometry.vertex_weld import WeldedMesh

Floats = NDArray[np.floating]
_MAX_SAMPLES = 2_000_000  # points of a Points prim, or samples along all curves of a prim
_MAX_FINE_SAMPLES = 100_000  # up to this many, tubes have 8 sides and spheres 80 triangles; above, 4 and 20
_STEPS = 6  # samples of a cubic segment
_BASES = {  # basis matrices; rows: powers of t from 3 to 0
    "bezier": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 3, 0, 0], [1, 0, 0, 0]], float),
    "bspline": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 0, 3, 0], [1, 4, 1, 0]], float) / 6.0,
    "catmullRom": np.array([[-1, 3, -3, 1], [2, -5, 4, -1], [-1, 0, 1, 0], [0, 2, 0, 0]], float) / 2.0,
}


def read_curves(prim: Usd.Prim, time: Usd.TimeCode, report: StageReport) -> WeldedMesh | None:
    """Read curves as tubes of their widths, or as ribbons facing their normals where those are authored.

    Returns:
        The mesh; None, with the reason reported, if there is nothing to draw.
    """
    curves = UsdGeom.BasisCurves(prim)
    points = array_of(curves.GetPointsAttr(), time, np.float32, width=3)
    counts = array_of(curves.GetCurveVertexCountsAttr(), time, np.int64)
    kind, basis, wrap = (
        str(attribute.Get(time)) for attribute in (curves.GetTypeAttr(), curves.GetBasisAttr(), curves.GetWrapAttr())
    )
    widths = array_of(curves.GetWidthsAttr(), time, np.float32)
    normals = array_of(curves.GetNormalsAttr(), time, np.float32, width=3)
    if len(normals) != len(points):
        normals = normals[:0]
    fault = _describe_fault(counts, point=points, width=widths, normal=normals)
    if kind == "cubic" and basis not in _BASES:
        fault = fault or f"basis {basis!r} is not known; expected one of {', '.join(_BASES)}"
    if fault:
        report.problem(prim.GetPath(), "curves", fault)
        return None
    if kind == "linear":
        basis = "linear"
    if len(points) == 0:
        return _concatenate([], prim, report)
    if len(widths) == 0:
        report.omission(prim.GetPath(), "curves without widths are drawn with a width of a thousandth of their extent")
        widths = np.array([np.ptp(points, axis=0).max() / 1000.0], np.float32)
    starts = np.cumsum(counts) - counts
    strips: list[tuple[Floats, Floats, Floats | None, NDArray[np.int64]]] = []
    for count in np.unique(counts).tolist():
        curve_ids = np.flatnonzero(counts == count)
        rows = starts[curve_ids][:, None] + np.arange(count)
        sampled = _evaluate(points[rows].astype(np.float64), basis, wrap)
        if sampled is None:
            report.omission(prim.GetPath(), f"curves of {count} points are too short for their basis")
            continue
        width = _evaluate_widths(widths, rows, curve_ids, counts, basis, wrap, sampled.shape[1])
        if width is None:
            report.problem(
                prim.GetPath(), "curves", f"{len(widths)} widths fit neither {len(counts)} curves nor their points"
            )
            return None
        normal = _evaluate(normals[rows].astype(np.float64), basis, wrap) if len(normals) else None
        strips.append((sampled, width, normal, curve_ids))
    samples = sum(strip[0].shape[0] * strip[0].shape[1] for strip in strips)
    if samples > _MAX_SAMPLES:
        report.omission(prim.GetPath(), f"curves of {samples:,} samples are not drawn: the limit is {_MAX_SAMPLES:,}")
        return None
    sides = 8 if samples <= _MAX_FINE_SAMPLES else 4
    closed = wrap == "periodic"
    return _concatenate(
        [
            _ribbons(line, width, normal, curve_ids)
            if normal is not None
            else _tubes(line, width, curve_ids, sides, closed)
            for line, width, normal, curve_ids in strips
        ],
        prim,
        report,
    )


def read_points(prim: Usd.Prim, time: Usd.TimeCode, report: StageReport) -> WeldedMesh | None:
    """Read a sphere for each point, of the diameters `widths` (1 if unauthored, as in Hydra).

    Returns:
        The mesh; None, with the reason reported, if there is nothing to draw.
    """
    points = UsdGeom.Points(prim)
    at = array_of(points.GetPointsAttr(), time, np.float32, width=3)
    widths = array_of(points.GetWidthsAttr(), time, np.float32)
    if len(at) == 0:
        return _concatenate([], prim, report)
    if len(widths) == 0:
        report.omission(prim.GetPath(), "points without widths are drawn one unit wide")
        widths = np.ones(1, np.float32)
    if len(widths) not in (1, len(at)):
        report.problem(prim.GetPath(), "points", f"{len(widths)} widths, but {len(at)} points")
        return None
    if not np.isfinite(at).all() or not np.isfinite(widths).all():
        report.problem(prim.GetPath(), "points", "a point or width is not a finite number")
        return None
    if len(at) > _MAX_SAMPLES:
        report.omission(prim.GetPath(), f"{len(at):,} points are not drawn: the limit is {_MAX_SAMPLES:,}")
        return None
    sphere, faces = _icosphere(1 if len(at) <= _MAX_FINE_SAMPLES else 0)
    kept = np.broadcast_to(widths, len(at)) > 0.0
    rows = np.flatnonzero(kept)
    radius = np.broadcast_to(widths, len(at))[rows] / 2.0
    positions = at[rows][:, None] + sphere * radius[:, None, None]
    triangles = faces + np.arange(len(rows))[:, None, None] * len(sphere)
    surface = WeldedMesh(
        positions.reshape(-1, 3).astype(np.float32),
        triangles.reshape(-1, 3).astype(np.int32),
        np.tile(sphere, (len(rows), 1)).astype(np.float32),
        None,
        np.repeat(rows, len(faces)).astype(np.int32),
    )
    return _concatenate([surface], prim, report)


def _describe_fault(counts: NDArray[np.int64], **values: Floats) -> str:
    """Describe what is wrong with the curves' values; `point` has a row for each control point. "" if nothing."""
    if len(counts) and counts.min() < 0:
        return f"curveVertexCounts holds {counts.min()}"
    if counts.sum() != len(values["point"]):
        return f"curveVertexCounts add up to {counts.sum()}, but there are {len(values['point'])} points"
    for name, numbers in values.items():
        if not np.isfinite(numbers).all():
            return f"a {name} is not a finite number"
    return ""


def _segment_controls(values: Floats, basis: str, wrap: str) -> Floats | None:
    """Return the four control values [c, segments, 4, k] of each cubic segment of curves [c, n, k]; None: too short."""
    n = values.shape[1]
    if wrap == "periodic":
        segments = n // 3 if basis == "bezier" else n
        step = 3 if basis == "bezier" else 1
        if n < 3:
            return None
        index = (np.arange(segments)[:, None] * step + np.arange(4)) % n
        return np.asarray(values[:, index])
    if wrap == "pinned" and basis != "bezier":  # phantom points make the curve reach its ends
        if n < 2:
            return None
        first, last = 2.0 * values[:, :1] - values[:, 1:2], 2.0 * values[:, -1:] - values[:, -2:-1]
        values = np.concatenate([first, values, last], axis=1)
        n += 2
    step = 3 if basis == "bezier" else 1
    segments = (n - 4) // step + 1 if n >= 4 else 0
    if segments < 1:
        return None
    return np.asarray(values[:, np.arange(segments)[:, None] * step + np.arange(4)])


def _evaluate(values: Floats, basis: str, wrap: str) -> Floats | None:
    """Evaluate curves with control values [c, n, k] at m samples: [c, m, k]; None if n is too small.

    Closed curves repeat their first sample at the end.
    """
    if basis == "linear":
        if values.shape[1] < 2:
            return None
        return np.concatenate([values, values[:, :1]], axis=1) if wrap == "periodic" else values
    control = _segment_controls(values, basis, wrap)
    if control is None:
        return None
    t = np.arange(_STEPS + 1) / _STEPS
    weights = np.stack([t**3, t**2, t, np.ones_like(t)], axis=-1) @ _BASES[basis]
    samples = np.einsum("tq,csqk->cstk", weights, control)
    inner = samples[:, :, :-1].reshape(len(values), -1, values.shape[2])
    return np.concatenate([inner, samples[:, -1:, -1]], axis=1)


def _evaluate_widths(
    widths: Floats,
    rows: NDArray[np.int64],
    curve_ids: NDArray[np.int64],
    counts: NDArray[np.int64],
    basis: str,
    wrap: str,
    samples: int,
) -> Floats | None:
    """Evaluate the widths of some curves at their samples.

    Args:
        widths: constant (1), uniform (one for each curve), vertex (each control point) or varying (each segment end).
        rows: [c, n], the control points of the curves among all.
        curve_ids: [c], the curves among all.
        counts: control points of every curve.
        basis: "linear" or a cubic basis.
        wrap: "nonperiodic", "periodic" or "pinned".
        samples: samples m of each curve.

    Returns:
        float64 [c, m]; None if the number of widths fits none of these.
    """
    if len(widths) == 1:
        return np.full((len(curve_ids), samples), float(widths[0]))
    if len(widths) == len(counts):
        return np.repeat(widths[curve_ids].astype(np.float64)[:, None], samples, axis=1)
    if len(widths) == counts.sum():
        sampled = _evaluate(widths[rows][..., None].astype(np.float64), basis, wrap)
        return None if sampled is None else sampled[..., 0]
    ends = _varying_counts(counts, basis, wrap)
    if len(widths) != ends.sum():
        return None
    start = (np.cumsum(ends) - ends)[curve_ids]
    count = int(ends[curve_ids[0]])
    at = widths[start[:, None] + np.arange(count)].astype(np.float64)
    if wrap == "periodic":
        at = np.concatenate([at, at[:, :1]], axis=1)
    position = np.linspace(0.0, at.shape[1] - 1.0, samples)
    low = np.minimum(position.astype(int), at.shape[1] - 2)
    fraction = position - low
    return np.asarray(at[:, low] * (1.0 - fraction) + at[:, low + 1] * fraction)


def _varying_counts(counts: NDArray[np.int64], basis: str, wrap: str) -> NDArray[np.int64]:
    """Return how many values of varying interpolation each curve has, [curves]."""
    if basis == "linear":
        return counts
    step = 3 if basis == "bezier" else 1
    if wrap == "periodic":
        return np.asarray(counts // step)
    if wrap == "pinned" and basis != "bezier":
        return counts
    return np.asarray(np.maximum((counts - 4) // step + 2, 0))


def _parallel_frames(line: Floats, closed: bool) -> tuple[Floats, Floats, Floats]:
    """Return tangents and two perpendiculars, each [c, m, 3], that rotate as little as possible along polylines."""
    tangent = np.empty_like(line)
    tangent[:, 1:-1] = line[:, 2:] - line[:, :-2]
    tangent[:, 0], tangent[:, -1] = line[:, 1] - line[:, 0], line[:, -1] - line[:, -2]
    if closed:
        tangent[:, 0] = tangent[:, -1] = line[:, 1] - line[:, -2]
    length = np.linalg.norm(tangent, axis=-1, keepdims=True)
    tangent = np.where(length > 0.0, tangent / np.maximum(length, 1e-300), (0.0, 0.0, 1.0))
    side = np.empty_like(line)
    least = np.argmin(np.abs(tangent[:, 0]), axis=-1)
    across = np.eye(3)[least]
    for step in range(line.shape[1]):  # project the last side vector onto the plane perpendicular here
        t = tangent[:, step]
        across = across - t * np.einsum("ck,ck->c", across, t)[:, None]
        norm = np.linalg.norm(across, axis=-1, keepdims=True)
        fallback = cross(t, np.eye(3)[np.argmin(np.abs(t), axis=-1)])
        across = np.where(norm > 1e-9, across / np.maximum(norm, 1e-300), fallback)
        side[:, step] = across
    return tangent, side, cross(tangent, side)


def _tubes(line: Floats, width: Floats, curve_ids: NDArray[np.int64], sides: int, closed: bool) -> WeldedMesh:
    """Make tubes with flat caps around polylines [c, m, 3] of widths [c, m]; closed ones have no caps."""
    curves, samples = line.shape[:2]
    tangent, side, other = _parallel_frames(line, closed)
    turn = 2.0 * math.pi * np.arange(sides) / sides
    outward = side[:, :, None] * np.cos(turn)[:, None] + other[:, :, None] * np.sin(turn)[:, None]
    rings = line[:, :, None] + outward * (0.5 * width)[:, :, None, None]
    ring = np.arange(sides)
    after = (ring + 1) % sides
    lower = (np.arange(samples - 1) * sides)[:, None]
    quads = [lower + ring, lower + after, lower + sides + after, lower + sides + ring]
    strip = np.stack([np.stack([quads[0], quads[1], quads[2]], -1), np.stack([quads[0], quads[2], quads[3]], -1)], -2)
    positions, normals = rings.reshape(curves, -1, 3), outward.reshape(curves, -1, 3)
    triangles = strip.reshape(-1, 3)
    if not closed:
        fan = np.stack([np.zeros(sides - 2, int), np.arange(1, sides - 1), np.arange(2, sides)], axis=-1)
        caps = [fan[:, ::-1] + samples * sides, fan + (samples + 1) * sides]
        triangles = np.concatenate([triangles, *caps])
        positions = np.concatenate([positions, rings[:, 0], rings[:, -1]], axis=1)
        ends = [np.repeat(-tangent[:, :1], sides, axis=1), np.repeat(tangent[:, -1:], sides, axis=1)]
        normals = np.concatenate([normals, *ends], axis=1)
    return _repeat_triangles(positions, normals, triangles, curve_ids)


def _ribbons(line: Floats, width: Floats, normal: Floats, curve_ids: NDArray[np.int64]) -> WeldedMesh:
    """Make ribbons along polylines [c, m, 3] of widths [c, m], facing the normals [c, m, 3]."""
    tangent, _, _ = _parallel_frames(line, closed=False)
    side = cross(tangent, normal)
    side = side / np.maximum(np.linalg.norm(side, axis=-1, keepdims=True), 1e-30) * (0.5 * width)[..., None]
    facing = cross(side, tangent)
    facing = facing / np.maximum(np.linalg.norm(facing, axis=-1, keepdims=True), 1e-30)
    positions = np.stack([line - side, line + side], axis=2).reshape(len(line), -1, 3)
    low = 2 * np.arange(line.shape[1] - 1)[:, None]
    triangles = (low[:, :, None] + np.array([[0, 1, 3], [0, 3, 2]])).reshape(-1, 3)
    return _repeat_triangles(positions, np.repeat(facing, 2, axis=1), triangles, curve_ids)


def _repeat_triangles(
    positions: Floats, normals: Floats, triangles: NDArray[Any], curve_ids: NDArray[np.int64]
) -> WeldedMesh:
    """Make a mesh of c curves with the same triangles; positions and normals are [c, v, 3]."""
    curves, vertices = positions.shape[:2]
    every = triangles + (np.arange(curves) * vertices)[:, None, None]
    return WeldedMesh(
        positions.reshape(-1, 3).astype(np.float32),
        every.reshape(-1, 3).astype(np.int32),
        normals.reshape(-1, 3).astype(np.float32),
        None,
        np.repeat(curve_ids, len(triangles)).astype(np.int32),
    )


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
        None,
        np.concatenate([surface.face for surface in surfaces]),
    )


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
