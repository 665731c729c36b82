# SPDX-License-Identifier: Apache-2.0
"""Gprims whose topology, number of points or subsets change: spans of time within which their vertices are the same.

USD holds topology from sample to sample. Each span is read as a mesh of its own, which is shown during the span.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pxr import Usd, UsdGeom

from tiscene.usd.core.prims import ALSO_ABSTRACT
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.value_times import is_time_varying, value_times
from tiscene.usd.geometry.skinning import skin_of

_TOPOLOGY_ATTRIBUTES = (
    *("faceVertexCounts", "faceVertexIndices", "holeIndices", "curveVertexCounts", "orientation"),
    *("tetVertexIndices", "surfaceFaceVertexIndices"),
)


@dataclass(frozen=True)
class TopologySpan:
    """Time codes at which a gprim has one topology.

    Attributes:
        code: when to read it.
        start: the first time code; -inf where it has the topology from the beginning.
        end: the first time code after it; inf where it keeps the topology.
    """

    code: Usd.TimeCode
    start: float = -math.inf
    end: float = math.inf

    @property
    def is_whole(self) -> bool:
        """Whether the topology never changes."""
        return self.start == -math.inf and self.end == math.inf

    def holds(self, time: float) -> bool:
        """Return whether a time code is in the span."""
        return self.start <= time < self.end


def topology_spans(prim: Usd.Prim, time: Usd.TimeCode, report: StageReport) -> list[TopologySpan]:
    """Return the spans of a gprim's topology in which it has faces or points; at least one.

    Args:
        prim: the gprim.
        time: time code of the read. A gprim whose topology does not change has one span, read then.
        report: says whether animation is read.
    """
    whole = [TopologySpan(time)]
    if not report.reads_animation or skin_of(prim, report) is not None:
        return whole
    attributes = [prim.GetAttribute(name) for name in _TOPOLOGY_ATTRIBUTES]
    subsets = (child for child in prim.GetFilteredChildren(ALSO_ABSTRACT) if child.IsA(UsdGeom.Subset))
    attributes += [UsdGeom.Subset(each).GetIndicesAttr() for each in subsets]
    varying = [attribute for attribute in attributes if is_time_varying(attribute)]
    times = {time for each in varying for time in value_times(each)}
    if prim.IsA(UsdGeom.PointBased):
        times.update(value_times(UsdGeom.PointBased(prim).GetPointsAttr()))
    starts, topology = list[float](), None
    empty = set[float]()
    for each in sorted(times):
        found = [attribute.Get(each) for attribute in varying], _point_count(prim, each)
        if found != topology:
            starts.append(each)
            topology = found
            if _is_empty(prim, each):
                empty.add(each)
    if len(starts) < 2:
        return whole
    first = -math.inf, *starts[1:]
    last = *starts[1:], math.inf
    spans = [TopologySpan(Usd.TimeCode(at), *span) for at, *span in zip(starts, first, last, strict=True)]
    return [each for each in spans if each.code.GetValue() not in empty] or whole


def varies_within(attribute: Usd.Attribute, spans: Sequence[TopologySpan]) -> bool:
    """Return whether an attribute has different values at different times of one of a gprim's spans."""
    if spans[0].is_whole:
        return is_time_varying(attribute)
    starts = {span.code.GetValue() for span in spans}
    times = [time for time in value_times(attribute) if time not in starts]
    return any(attribute.Get(time) != attribute.Get(span.code) for span in spans for time in times if span.holds(time))


def _point_count(prim: Usd.Prim, time: float) -> int:
    """Return the number of points of a gprim; 0 for one without points."""
    points: Any = UsdGeom.PointBased(prim).GetPointsAttr().Get(time) if prim.IsA(UsdGeom.PointBased) else None
    return 0 if points is None else len(points)


def _is_empty(prim: Usd.Prim, time: float) -> bool:
    if prim.IsA(UsdGeom.Mesh) and not UsdGeom.Mesh(prim).GetFaceVertexCountsAttr().Get(time):
        return True
    return prim.IsA(UsdGeom.PointBased) and _point_count(prim, time) == 0
