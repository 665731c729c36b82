# SPDX-License-Identifier: Apache-2.0
"""Gprims whose shape changes over time: the times at which it is authored, and their vertices at each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from tiscene.scene.animation import Deformation
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.time_samples import in_seconds
from tiscene.usd.geometry.primvar import array_of
from tiscene.usd.geometry.vertex_weld import WeldedMesh

MOST_BYTES = 4 << 30  # of one gprim's vertices over time
_MOVES = (
    *("points", "normals", "primvars:normals", "widths", "size", "radius", "height", "width", "length"),
    *("radiusTop", "radiusBottom"),
)
# What may not change while points move: a vertex is to be the same one at all times.
_TOPOLOGY = ("faceVertexCounts", "faceVertexIndices", "holeIndices", "curveVertexCounts", "orientation")
_HELD = ("primvars:st", "primvars:displayColor", "primvars:displayOpacity", "subdivisionScheme")


def shape_times(prim: Usd.Prim, report: StageReport) -> list[float]:
    """The time codes at which a gprim's shape is authored; none if it never changes, or cannot be played."""
    if not report.plays:
        return []
    held = [name for name in _HELD if varies(prim.GetAttribute(name))]
    if held:
        report.frozen(prim.GetPath(), f"{', '.join(held)} of a {prim.GetTypeName()}")
    moving = [name for name in _MOVES if varies(prim.GetAttribute(name))]
    topology = [name for name in _TOPOLOGY if varies(prim.GetAttribute(name))]
    if topology:
        report.frozen(prim.GetPath(), f"a {prim.GetTypeName()} whose topology changes ({', '.join(topology)})")
        return []
    return sorted({time for name in moving for time in prim.GetAttribute(name).GetTimeSamples()})


def varies(attribute: Usd.Attribute) -> bool:
    """Whether an attribute has different values at different times: many exporters sample what never changes."""
    times = attribute.GetTimeSamples() if attribute else []
    if len(times) < 2:
        return False
    first = attribute.Get(times[0])
    return any(attribute.Get(time) != first for time in times[1:])


def points_over_time(
    prim: Usd.Prim, times: Sequence[float], count: int, report: StageReport
) -> NDArray[np.float32] | None:
    """float32 [s, n, 3], the points of a gprim; None, with the reason reported, if they are not the same ones."""
    if not times:
        return None
    attribute = UsdGeom.PointBased(prim).GetPointsAttr()
    if count * len(times) * 24 > MOST_BYTES:
        report.frozen(prim.GetPath(), f"a {prim.GetTypeName()} of more than {MOST_BYTES >> 30} GiB of points")
        return None
    samples = []
    for time in times:
        points = array_of(attribute, Usd.TimeCode(time), np.float32, width=3)
        if len(points) != count:
            report.frozen(prim.GetPath(), f"a {prim.GetTypeName()} whose number of points changes")
            return None
        if not np.isfinite(points).all():
            report.problem(prim.GetPath(), "points", f"some at time code {time:g} are not finite numbers")
            return None
        samples.append(points)
    return np.stack(samples)


def read_again(
    prim: Usd.Prim,
    surface: WeldedMesh,
    times: Sequence[float],
    report: StageReport,
    read: Callable[[Usd.Prim, Usd.TimeCode, StageReport], WeldedMesh | None],
) -> WeldedMesh:
    """A gprim's surface with what it is at other times, read as it was itself."""
    found = [read(prim, Usd.TimeCode(time), report) for time in times]
    moments = [each for each in found if each is not None and np.array_equal(each.triangles, surface.triangles)]
    if len(moments) < len(times):
        report.frozen(prim.GetPath(), f"a {prim.GetTypeName()} whose topology changes")
        return surface
    normals: Any = None
    if surface.normals is not None:
        normals = np.stack([surface.normals if each.normals is None else each.normals for each in moments])
    moved = np.stack([each.positions for each in moments])
    return replace(surface, moved=moved, moved_normals=normals, times=times)


def deformation_of(surface: WeldedMesh, stage: Usd.Stage, meters: float) -> Deformation | None:
    """What becomes of a surface over time, in meters and seconds."""
    if surface.moved is None:
        return None
    positions = surface.moved * np.float32(meters)
    return Deformation(in_seconds(stage, surface.times), positions, surface.moved_normals)
