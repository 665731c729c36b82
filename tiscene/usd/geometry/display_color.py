# SPDX-License-Identifier: Apache-2.0
"""displayColor and displayOpacity, and other primvars that stand for a constant, of gprims."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from tiscene.usd.core.report import StageReport
from tiscene.usd.geometry.primvar import Topology, elements_of, read_primvar
from tiscene.usd.geometry.vertex_weld import sum_rows

Floats = NDArray[np.floating]
_MOST_COLORS = 4096  # materials that one gprim's colors become
_DEFAULTS = {"displayColor": (0.18, 0.18, 0.18), "displayOpacity": (1.0,)}


def constant_primvar(
    gprim: Usd.Prim, name: str, width: int, time: Usd.TimeCode, report: StageReport, *, tell_if_it_varies: bool = True
) -> tuple[float, ...] | None:
    """One value for the whole gprim: its constant primvar, or the mean of one that varies; None if unauthored."""
    primvar = UsdGeom.PrimvarsAPI(gprim).FindPrimvarWithInheritance(name)
    value = primvar.Get(time) if primvar else None
    if value is None:
        return None
    values = np.asarray(value, dtype=np.float64)
    if values.size == 0 or values.size % width:
        return None
    values = values.reshape(-1, width)
    if primvar.IsIndexed() and (indices := np.asarray(primvar.GetIndices(time))).size:
        values = values[np.clip(indices, 0, len(values) - 1)]
    if not np.isfinite(values).all():
        report.problem(gprim.GetPath(), name, "is not a finite number")
        return None
    if tell_if_it_varies and len(values) > 1 and (values != values[0]).any():
        report.omission(gprim.GetPath(), f"primvar {name!r} varies over the surface, its mean is used")
    return tuple(round(v, 7) for v in values.mean(axis=0).tolist())


def varies(gprim: Usd.Prim, name: str, time: Usd.TimeCode, *, within_faces: bool = False) -> bool:
    """Whether a primvar of a mesh has different values, which its vertices must then have. within_faces: in a face."""
    primvar = UsdGeom.PrimvarsAPI(gprim).FindPrimvarWithInheritance(name) if name else None
    if not primvar or not gprim.IsA(UsdGeom.Mesh) or not primvar.HasValue():
        return False
    if primvar.GetInterpolation() not in ("vertex", "varying", "faceVarying", *(() if within_faces else ("uniform",))):
        return False
    values = np.asarray(primvar.Get(time))
    return len(values) > 1 and bool((values != values[0]).any())


def varying_display(gprim: Usd.Prim, time: Usd.TimeCode, report: StageReport) -> Floats | None:
    """Color and opacity [elements, 4] of each face, point or curve; None if they are the same everywhere."""
    if not any(_varies(UsdGeom.PrimvarsAPI(gprim).FindPrimvarWithInheritance(name)) for name in _DEFAULTS):
        return None
    topology = elements_of(gprim, time)
    if topology.counts.min(initial=0) < 0:  # which is told where its surface is read
        return None
    parts = [_of_elements(gprim, name, len(default), topology, time, report) for name, default in _DEFAULTS.items()]
    if all(part is None for part in parts):
        return None
    columns = []
    for part, (name, default) in zip(parts, _DEFAULTS.items(), strict=True):
        fixed = constant_primvar(gprim, name, len(default), time, report, tell_if_it_varies=False) or default
        columns.append(np.broadcast_to(fixed, (len(topology.counts), len(default))) if part is None else part)
    return np.concatenate(columns, axis=1)


def _varies(primvar: UsdGeom.Primvar) -> bool:
    return bool(primvar) and primvar.HasValue() and primvar.GetInterpolation() != UsdGeom.Tokens.constant


def _of_elements(
    gprim: Usd.Prim, name: str, width: int, topology: Topology, time: Usd.TimeCode, report: StageReport
) -> Floats | None:
    primvar = UsdGeom.PrimvarsAPI(gprim).FindPrimvarWithInheritance(name)
    if not _varies(primvar) or len(topology.counts) == 0:
        return None
    read = read_primvar(primvar, width, topology, time, report)
    if read is None or not len(read.values):
        return None
    corners = read.at(topology.indices, np.arange(len(topology.indices))).astype(np.float64)
    sums = sum_rows(topology.face_of_corner, corners, len(topology.counts))
    values = np.asarray(sums / np.maximum(topology.counts, 1)[:, None])
    if np.abs(corners - values[topology.face_of_corner]).max(initial=0.0) > 1.0 / 255.0:
        report.omission(gprim.GetPath(), f"primvar {name!r} varies within faces: each has the mean of its corners")
    return values


def quantized(values: Floats) -> tuple[list[tuple[float, float, float, float]], list[NDArray[np.int64]]]:
    """Distinct colors of some rows, not more than can be materials, and the rows of each. Each is its rows' mean."""
    steps = 255.0
    distinct, row = np.unique(np.rint(values * steps), axis=0, return_inverse=True)
    while len(distinct) > _MOST_COLORS:
        steps /= 2.0
        distinct, row = np.unique(np.rint(values * steps), axis=0, return_inverse=True)
    order = np.argsort(row.reshape(-1), kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(row.reshape(-1)))[:-1])
    means = [tuple(round(v, 7) for v in values[group].mean(axis=0).tolist()) for group in groups]
    return [(r, g, b, a) for r, g, b, a in means], groups
