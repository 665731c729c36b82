# SPDX-License-Identifier: Apache-2.0
"""Deforming gprims: the time samples of a shape, and its vertices at each of them.

Points, normals, widths and sizes may change over time. A vertex must be the same vertex in all frames (motion vectors
and incremental rendering follow it): where topology changes, each span of one topology is a mesh of its own
(`topology_spans`). What cannot be played is reported as frozen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from tiscene.scene.animation import Deformation
from tiscene.scene.skinned_deformation import SkinnedDeformation
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.time_samples import in_seconds
from tiscene.usd.core.value_times import JUMP, dense_times, is_time_varying, steps_per_time_code, value_times
from tiscene.usd.geometry.display_color import is_constant_color
from tiscene.usd.geometry.primvar import TEXTURE_COORDINATE_TYPES, array_of, array_or_primvar
from tiscene.usd.geometry.topology_spans import TopologySpan, varies_within
from tiscene.usd.geometry.vertex_weld import WeldedMesh

MAX_BYTES = 4 << 30  # vertices of one gprim at all times
_MAX_TURN_BYTES = 1 << 30  # of one prim's curves with the times that turns add
_STRAIGHT = math.cos(math.radians(5.0))  # of the largest angle between two times that is not a turn
_SHAPE_ATTRIBUTES = (
    *("points", "normals", "primvars:normals", "widths", "primvars:widths"),
    *("size", "radius", "height", "width", "length", "radiusTop", "radiusBottom"),
)
_UNSUPPORTED_ATTRIBUTES = (
    *("primvars:displayColor", "primvars:displayOpacity", "subdivisionScheme"),
    *("creaseIndices", "creaseLengths", "creaseSharpnesses", "cornerIndices", "cornerSharpnesses"),
)


def shape_times(prim: Usd.Prim, spans: Sequence[TopologySpan], report: StageReport) -> dict[TopologySpan, list[float]]:
    """Return the time codes of each span at which a gprim's shape is authored; empty if it is constant within it."""
    if not report.reads_animation:
        return {span: [] for span in spans}
    primvars = UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues()
    coordinates = [each.GetName() for each in primvars if each.GetTypeName() in TEXTURE_COORDINATE_TYPES]
    unsupported = [
        name
        for name in (*coordinates, *_UNSUPPORTED_ATTRIBUTES)
        if any(varies_within(prim.GetAttribute(each), spans) for each in (name, f"{name}:indices"))
        and not (name.startswith("primvars:display") and is_constant_color(prim))  # that plays as a material
    ]
    if unsupported:
        report.frozen(prim.GetPath(), f"{', '.join(unsupported)} of a {prim.GetTypeName()}")
    moving = [name for name in _SHAPE_ATTRIBUTES if is_time_varying(prim.GetAttribute(name))]
    times = {*_drift_times(prim), *(time for name in moving for time in value_times(prim.GetAttribute(name)))}
    return {span: sorted(times) if span.is_whole else _times_within(prim, span, times) for span in spans}


def _times_within(prim: Usd.Prim, span: TopologySpan, times: set[float]) -> list[float]:
    """Return those of a shape's time codes that are in a span, its first one, and the last before it ends."""
    within = {time for time in times if span.holds(time)} | ({span.code.GetValue()} if times else set())
    if times and _goes_on(prim, span.end):
        within.add(span.end - JUMP)
    return sorted(within) if len(within) > 1 else []


def _goes_on(prim: Usd.Prim, time: float) -> bool:
    """Return whether USD interpolates the points of a gprim up to a time code: their number is the same at it."""
    if not prim.IsA(UsdGeom.PointBased) or time == math.inf:
        return False
    points = UsdGeom.PointBased(prim).GetPointsAttr()
    return len(points.Get(time - JUMP) or ()) == len(points.Get(time) or ())


def points_at(based: UsdGeom.PointBased, time: Usd.TimeCode) -> NDArray[np.float32]:
    """Return the points [n, 3] of a gprim. Beyond their samples its velocities carry them, as USD computes it."""
    points = array_of(based.GetPointsAttr(), time, np.float32, width=3)
    samples = based.GetPointsAttr().GetTimeSamples()
    if not samples or time.IsEarliestTime() or samples[0] <= time.GetValue() <= samples[-1]:
        return points
    if not _has_velocities(based, samples[0] if time.GetValue() < samples[0] else samples[-1]):
        return points
    return np.asarray(based.ComputePointsAtTime(time, time), np.float32).reshape(-1, 3)


def _has_velocities(based: UsdGeom.PointBased, sample: float) -> bool:
    """Return whether all points of a sample, at a time code, have velocities."""
    time = Usd.TimeCode(sample)
    points = array_of(based.GetPointsAttr(), time, None, width=3)
    velocities = array_of(based.GetVelocitiesAttr(), time, np.float32, width=3)
    aligned = sample in based.GetVelocitiesAttr().GetTimeSamples() and len(velocities) == len(points)
    return aligned and bool(velocities.any())


def _drift_times(prim: Usd.Prim) -> list[float]:
    """Return the time codes at which velocities carry points beyond their samples, as far as the stage's range."""
    based, stage = UsdGeom.PointBased(prim), prim.GetStage()
    samples = based.GetPointsAttr().GetTimeSamples() if based else []
    if not samples or not based.GetVelocitiesAttr().GetNumTimeSamples() or not stage.HasAuthoredTimeCodeRange():
        return []
    first, last = samples[0], samples[-1]
    ends = (first, min(first, stage.GetStartTimeCode())), (last, max(last, stage.GetEndTimeCode()))
    beyond = [end for sample, end in ends if end != sample and _has_velocities(based, sample)]
    times = {first, last, *beyond} if beyond else set()
    return dense_times(times, stage) if based.GetAccelerationsAttr().GetNumTimeSamples() else sorted(times)


def read_point_samples(
    prim: Usd.Prim, times: Sequence[float], count: int, report: StageReport
) -> NDArray[np.float32] | None:
    """Read the points of a gprim at all times.

    Args:
        prim: a point-based gprim.
        times: time codes; empty gives None.
        count: the number of points that it must have at each.
        report: collects why the points cannot be played.

    Returns:
        float32 [s, count, 3]; None, with the reason reported, if they are not finite, or take more than MAX_BYTES.
    """
    if not times:
        return None
    if count * len(times) * 24 > MAX_BYTES:
        report.frozen(prim.GetPath(), f"a {prim.GetTypeName()} of more than {MAX_BYTES >> 30} GiB of points")
        return None
    samples = []
    for time in times:
        points = points_at(UsdGeom.PointBased(prim), Usd.TimeCode(time))
        if not np.isfinite(points).all():
            report.problem(prim.GetPath(), "points", f"some at time code {time:g} are not finite numbers")
            return None
        samples.append(points)
    return np.stack(samples)


def with_shape_samples(
    prim: Usd.Prim,
    surface: WeldedMesh,
    times: Sequence[float],
    report: StageReport,
    read: Callable[[Usd.Prim, Usd.TimeCode, StageReport], WeldedMesh | None],
) -> WeldedMesh:
    """Return a gprim's mesh with position and normal samples, made by reading the gprim at each time.

    Args:
        prim: the gprim.
        surface: its mesh at the time that is read.
        times: time codes of the samples; curves get others between them, see `_with_turns`.
        report: collects why the shape cannot be played; `surface` is then returned as it is.
        read: the reader that made `surface`.
    """
    if prim.IsA(UsdGeom.BasisCurves):
        times = _with_turns(UsdGeom.BasisCurves(prim), times, len(surface.positions))
    samples = []
    for time in times:
        found = read(prim, Usd.TimeCode(time), report)
        if found is None or not np.array_equal(found.triangles, surface.triangles):
            report.frozen(prim.GetPath(), f"a {prim.GetTypeName()} whose topology changes")
            return surface
        samples.append(replace(found, triangles=surface.triangles, face=surface.face))  # shared: one copy of each
    normals: Any = None
    if surface.normals is not None:
        normals = np.stack([surface.normals if each.normals is None else each.normals for each in samples])
    moved = np.stack([each.positions for each in samples])
    return replace(surface, position_samples=moved, normal_samples=normals, times=times)


def _with_turns(curves: UsdGeom.BasisCurves, times: Sequence[float], vertices: int) -> Sequence[float]:
    """Return the time codes of curves, and steps between where a direction turns by more than 5° to the next.

    Vertices go straight from sample to sample: where a tube turns, that makes it thinner half way, by the cosine of
    half the angle. Times whose vertices would take more than _MAX_TURN_BYTES are returned as they are.
    """
    result = sorted({*times, *(time for pair in pairwise(times) for time in _times_of_turn(curves, *pair))})
    return result if vertices * len(result) * 24 <= _MAX_TURN_BYTES else times


def _times_of_turn(curves: UsdGeom.BasisCurves, first: float, second: float) -> list[float]:
    """Return the steps to add between two time codes."""
    steps = steps_per_time_code(curves.GetPrim().GetStage())
    middle = round(steps * (first + second) / 2.0) / steps
    if not first < middle < second or not _turns(curves, first, second):
        return []
    return [*_times_of_turn(curves, first, middle), middle, *_times_of_turn(curves, middle, second)]


def _turns(curves: UsdGeom.BasisCurves, first: float, second: float) -> bool:
    """Return whether the direction of a segment, or a normal, of curves turns from one time code to a second one."""
    codes = Usd.TimeCode(first), Usd.TimeCode(second)
    segments = [np.diff(points_at(curves, code), axis=0) for code in codes]
    normals = [array_or_primvar(curves.GetNormalsAttr(), code, width=3) for code in codes]
    for a, b in (segments, normals):
        if len(a) == len(b) > 0:
            lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
            if (np.einsum("nk,nk->n", a, b) < _STRAIGHT * lengths).any():
                return True
    return False


def deformation_of(surface: WeldedMesh, stage: Usd.Stage, meters: float) -> Deformation | None:
    """Return the position and normal samples of a mesh in meters and seconds; None if it has none."""
    if surface.skin is not None and surface.control is not None:
        times = surface.skin.poses.times
        if len(times) < 2:
            return None
        return SkinnedDeformation(times, skin=surface.skin, surface=surface.control, meters=meters)
    if surface.position_samples is None:
        return None
    positions = surface.position_samples * np.float32(meters)
    return Deformation(in_seconds(stage, surface.times), positions, surface.normal_samples)
