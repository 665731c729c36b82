# SPDX-License-Identifier: Apache-2.0
"""UsdGeomBasisCurves as tubes or ribbons, UsdGeomPoints as balls: simple geometry, whole batches at a time."""

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
_MOST = 2_000_000  # points, of Points or along curves
_FINE = 100_000  # up to so many samples tubes are round, and up to so many points balls are
_STEPS = 6  # samples of a cubic segment
_BASES = {  # rows: powers of t from 3 to 0
    "bezier": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 3, 0, 0], [1, 0, 0, 0]], float),
    "bspline": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 0, 3, 0], [1, 4, 1, 0]], float) / 6.0,
    "catmullRom": np.array([[-1, 3, -3, 1], [2, -5, 4, -1], [-1, 0, 1, 0], [0, 2, 0, 0]], float) / 2.0,
}


def read_curves(prim: Usd.Prim, time: Usd.TimeCode, report: StageReport) -> WeldedMesh | None:
    """Tubes of the curves' widths; ribbons that face their normals where these are authored. None, which is reported,
    if nothing can be drawn.
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
    fault = _fault(counts, point=points, width=widths, normal=normals)
    if kind == "cubic" and basis not in _BASES:
        fault = fault or f"basis {basis!r} is not known"
    if fault:
        report.problem(prim.GetPath(), "curves", fault)
        return None
    if kind == "linear":
        basis = "linear"
    if len(points) == 0:
        return _joined([], prim, report)
    if len(widths) == 0:
        report.omission(prim.GetPath(), "curves without widths are drawn as thin as a thousandth of their extent")
        widths = np.array([np.ptp(points, axis=0).max() / 1000.0], np.float32)
    starts = np.cumsum(counts) - counts
    strips: list[tuple[Floats, Floats, Floats | None, NDArray[np.int64]]] = []
    for count in np.unique(counts).tolist():
        which = np.flatnonzero(counts == count)
        rows = starts[which][:, None] + np.arange(count)
        sampled = _sampled(points[rows].astype(np.float64), basis, wrap)
        if sampled is None:
            report.omission(prim.GetPath(), f"curves of {count} points are too short for their basis")
            continue
        width = _widths_of(widths, rows, which, counts, basis, wrap, sampled.shape[1])
        if width is None:
            report.problem(
                prim.GetPath(), "curves", f"{len(widths)} widths fit neither {len(counts)} curves nor their points"
            )
            return None
        normal = _sampled(normals[rows].astype(np.float64), basis, wrap) if len(normals) else None
        strips.append((sampled, width, normal, which))
    samples = sum(strip[0].shape[0] * strip[0].shape[1] for strip in strips)
    if samples > _MOST:
        report.omission(prim.GetPath(), f"curves of {samples:,} samples are not drawn: more than {_MOST:,}")
        return None
    sides = 8 if samples <= _FINE else 4
    closed = wrap == "periodic"
    return _joined(
        [
            _ribbons(line, width, normal, which) if normal is not None else _tubes(line, width, which, sides, closed)
            for line, width, normal, which in strips
        ],
        prim,
        report,
    )


def read_points(prim: Usd.Prim, time: Usd.TimeCode, report: StageReport) -> WeldedMesh | None:
    """A ball at each point, as wide as `widths` says (1 if unauthored, as USD's own renderers have it)."""
    points = UsdGeom.Points(prim)
    at = array_of(points.GetPointsAttr(), time, np.float32, width=3)
    widths = array_of(points.GetWidthsAttr(), time, np.float32)
    if len(at) == 0:
        return _joined([], prim, report)
    if len(widths) == 0:
        report.omission(prim.GetPath(), "points without widths are drawn one unit wide")
        widths = np.ones(1, np.float32)
    if len(widths) not in (1, len(at)):
        report.problem(prim.GetPath(), "points", f"{len(widths)} widths, but {len(at)} points")
        return None
    if not np.isfinite(at).all() or not np.isfinite(widths).all():
        report.problem(prim.GetPath(), "points", "a point or width is not a finite number")
        return None
    if len(at) > _MOST:
        report.omission(prim.GetPath(), f"{len(at):,} points are not drawn: more than {_MOST:,}")
        return None
    ball, faces = _ball(1 if len(at) <= _FINE else 0)
    kept = np.broadcast_to(widths, len(at)) > 0.0
    rows = np.flatnonzero(kept)
    radius = np.broadcast_to(widths, len(at))[rows] / 2.0
    positions = at[rows][:, None] + ball * radius[:, None, None]
    triangles = faces + np.arange(len(rows))[:, None, None] * len(ball)
    surface = WeldedMesh(
        positions.reshape(-1, 3).astype(np.float32),
        triangles.reshape(-1, 3).astype(np.int32),
        np.tile(ball, (len(rows), 1)).astype(np.float32),
        None,
        np.repeat(rows, len(faces)).astype(np.int32),
    )
    return _joined([surface], prim, report)


def _fault(counts: NDArray[np.int64], **values: Floats) -> str:
    """What is wrong with the curves' numbers, of which `point` has one row for each control point; "" if nothing."""
    if len(counts) and counts.min() < 0:
        return f"curveVertexCounts holds {counts.min()}"
    if counts.sum() != len(values["point"]):
        return f"curveVertexCounts add up to {counts.sum()}, but there are {len(values['point'])} points"
    for name, numbers in values.items():
        if not np.isfinite(numbers).all():
            return f"a {name} is not a finite number"
    return ""


def _control(values: Floats, basis: str, wrap: str) -> Floats | None:
    """The four control values [c, segments, 4, k] of every cubic segment of curves [c, n, k]."""
    n = values.shape[1]
    if wrap == "periodic":
        segments = n // 3 if basis == "bezier" else n
        step = 3 if basis == "bezier" else 1
        if n < 3:
            return None
        index = (np.arange(segments)[:, None] * step + np.arange(4)) % n
        return np.asarray(values[:, index])
    if wrap == "pinned" and basis != "bezier":  # one more point before and after, so that the ends are met
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


def _sampled(values: Floats, basis: str, wrap: str) -> Floats | None:
    """Values [c, n, k] of control points along their curves, [c, m, k]; the first again at the end of closed ones."""
    if basis == "linear":
        if values.shape[1] < 2:
            return None
        return np.concatenate([values, values[:, :1]], axis=1) if wrap == "periodic" else values
    control = _control(values, basis, wrap)
    if control is None:
        return None
    t = np.arange(_STEPS + 1) / _STEPS
    weights = np.stack([t**3, t**2, t, np.ones_like(t)], axis=-1) @ _BASES[basis]
    samples = np.einsum("tq,csqk->cstk", weights, control)
    inner = samples[:, :, :-1].reshape(len(values), -1, values.shape[2])
    return np.concatenate([inner, samples[:, -1:, -1]], axis=1)


def _widths_of(
    widths: Floats,
    rows: NDArray[np.int64],
    which: NDArray[np.int64],
    counts: NDArray[np.int64],
    basis: str,
    wrap: str,
    samples: int,
) -> Floats | None:
    """Widths [c, m] at the samples, from one for all, for each curve, for each control point or segment's end."""
    if len(widths) == 1:
        return np.full((len(which), samples), float(widths[0]))
    if len(widths) == len(counts):
        return np.repeat(widths[which].astype(np.float64)[:, None], samples, axis=1)
    if len(widths) == counts.sum():
        sampled = _sampled(widths[rows][..., None].astype(np.float64), basis, wrap)
        return None if sampled is None else sampled[..., 0]
    ends = _ends(counts, basis, wrap)
    if len(widths) != ends.sum():
        return None
    start = (np.cumsum(ends) - ends)[which]
    count = int(ends[which[0]])
    at = widths[start[:, None] + np.arange(count)].astype(np.float64)
    if wrap == "periodic":
        at = np.concatenate([at, at[:, :1]], axis=1)
    place = np.linspace(0.0, at.shape[1] - 1.0, samples)
    low = np.minimum(place.astype(int), at.shape[1] - 2)
    part = place - low
    return np.asarray(at[:, low] * (1.0 - part) + at[:, low + 1] * part)


def _ends(counts: NDArray[np.int64], basis: str, wrap: str) -> NDArray[np.int64]:
    """How many values of `varying` interpolation each curve has."""
    if basis == "linear":
        return counts
    step = 3 if basis == "bezier" else 1
    if wrap == "periodic":
        return np.asarray(counts // step)
    if wrap == "pinned" and basis != "bezier":
        return counts
    return np.asarray(np.maximum((counts - 4) // step + 2, 0))


def _frames(line: Floats, closed: bool) -> tuple[Floats, Floats, Floats]:
    """Unit tangents and two perpendiculars [c, m, 3] that turn as little as can be along the lines."""
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
    for step in range(line.shape[1]):  # what of the last perpendicular is perpendicular here, too
        t = tangent[:, step]
        across = across - t * np.einsum("ck,ck->c", across, t)[:, None]
        norm = np.linalg.norm(across, axis=-1, keepdims=True)
        fallback = cross(t, np.eye(3)[np.argmin(np.abs(t), axis=-1)])
        across = np.where(norm > 1e-9, across / np.maximum(norm, 1e-300), fallback)
        side[:, step] = across
    return tangent, side, cross(tangent, side)


def _tubes(line: Floats, width: Floats, which: NDArray[np.int64], sides: int, closed: bool) -> WeldedMesh:
    curves, samples = line.shape[:2]
    tangent, side, other = _frames(line, closed)
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
    return _batch(positions, normals, triangles, which)


def _ribbons(line: Floats, width: Floats, normal: Floats, which: NDArray[np.int64]) -> WeldedMesh:
    tangent, _, _ = _frames(line, closed=False)
    side = cross(tangent, normal)
    side = side / np.maximum(np.linalg.norm(side, axis=-1, keepdims=True), 1e-30) * (0.5 * width)[..., None]
    facing = cross(side, tangent)
    facing = facing / np.maximum(np.linalg.norm(facing, axis=-1, keepdims=True), 1e-30)
    positions = np.stack([line - side, line + side], axis=2).reshape(len(line), -1, 3)
    low = 2 * np.arange(line.shape[1] - 1)[:, None]
    triangles = (low[:, :, None] + np.array([[0, 1, 3], [0, 3, 2]])).reshape(-1, 3)
    return _batch(positions, np.repeat(facing, 2, axis=1), triangles, which)


def _batch(positions: Floats, normals: Floats, triangles: NDArray[Any], which: NDArray[np.int64]) -> WeldedMesh:
    """The same triangles for each of some curves: positions and normals [c, v, 3]."""
    curves, vertices = positions.shape[:2]
    every = triangles + (np.arange(curves) * vertices)[:, None, None]
    return WeldedMesh(
        positions.reshape(-1, 3).astype(np.float32),
        every.reshape(-1, 3).astype(np.int32),
        normals.reshape(-1, 3).astype(np.float32),
        None,
        np.repeat(which, len(triangles)).astype(np.int32),
    )


def _joined(surfaces: list[WeldedMesh], prim: Usd.Prim, report: StageReport) -> WeldedMesh | None:
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


def _ball(level: int) -> tuple[Floats, NDArray[np.int64]]:
    """An icosahedron on the unit sphere whose faces were split `level` times."""
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
