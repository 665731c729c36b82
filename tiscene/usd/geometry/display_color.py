# SPDX-License-Identifier: Apache-2.0
"""displayColor, displayOpacity and other primvars that a material reads as one value per gprim.

A primvar that varies over the surface becomes its mean (`constant_primvar`), one material per face, point or curve
(`read_element_colors`, `quantize_colors`), or a vertex attribute, for which `varies_over_surface` is the test.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from tiscene.usd.core.color_space import attribute_colors
from tiscene.usd.core.prims import type_of
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.value_times import value_times
from tiscene.usd.geometry.primvar import SHAPE_TOPOLOGIES, Topology, primvar_topology, read_color, read_primvar
from tiscene.usd.geometry.vertex_weld import sum_rows

Floats = NDArray[np.floating]
_MAX_COLORS = 4096  # materials made of one gprim's colors
_DEFAULTS = {"displayColor": (0.18, 0.18, 0.18), "displayOpacity": (1.0,)}
DISPLAY_PRIMVARS = tuple(_DEFAULTS)


def constant_primvar(
    gprim: Usd.Prim, name: str, width: int, time: Usd.TimeCode, report: StageReport, *, report_varying: bool = True
) -> tuple[float, ...] | None:
    """Return one value for the whole gprim.

    Args:
        gprim: the prim; its primvars may be inherited.
        name: the primvar, without "primvars:".
        width: components of each value.
        time: when to evaluate it.
        report: collects values that are of another size, not finite, or of another number than the gprim has points or
            faces.
        report_varying: whether to report as an omission that a primvar of several values is replaced by its mean, also
            where the gprim has faces, points or curves that could have their own values.

    Returns:
        `width` numbers: the constant primvar, or the mean of one that varies, without the alpha of four read as three;
        None if it is unauthored or empty, or, which is reported, of another size, not finite or unfit for the gprim.
    """
    primvar = UsdGeom.PrimvarsAPI(gprim).FindPrimvarWithInheritance(name)
    value = primvar.Get(time) if primvar else None
    if value is None:
        return None
    values = np.asarray(value, dtype=np.float64)
    has_alpha = width == 3 and values.shape[-1:] == (4,)  # whatever its type: that of displayColor is its schema's
    size = 4 if has_alpha else width
    if values.size % size:
        report.omission(gprim.GetPath(), f"primvar {name!r} has no {width} numbers in each value; it is not used")
        return None
    if values.size == 0:
        return None
    values = attribute_colors(primvar.GetAttr(), values.reshape(-1, size))
    if primvar.IsIndexed() and (indices := np.asarray(primvar.GetIndices(time))).size:
        values = values[np.clip(indices, 0, len(values) - 1)]
    if not np.isfinite(values).all():
        report.problem(gprim.GetPath(), name, "is not a finite number")
        return None
    has_elements = False
    if _is_not_constant(primvar):
        topology = primvar_topology(gprim, time)
        has_elements = len(topology.counts) > 0
        is_valid = topology.counts.min(initial=0) >= 0  # else it is reported where the gprim is read
        if is_valid and has_elements and read_primvar(primvar, size, topology, time, report) is None:
            return None
    if (report_varying or not has_elements) and len(values) > 1 and (values != values[0]).any():
        report.omission(gprim.GetPath(), f"primvar {name!r} varies over the surface, its mean is used")
    return tuple(round(v, 7) for v in values.mean(axis=0)[:width].tolist())


def varies_over_surface(gprim: Usd.Prim, name: str, time: Usd.TimeCode, *, within_faces: bool = False) -> bool:
    """Return whether a primvar has several values on faces, points or curves, so that it must be a vertex attribute.

    Args:
        gprim: the prim; False for a round shape, which has no faces.
        name: the primvar, without "primvars:"; False for "".
        time: when to evaluate it.
        within_faces: whether to ignore primvars that are constant in each face: of uniform interpolation, or of points.
    """
    primvar = UsdGeom.PrimvarsAPI(gprim).FindPrimvarWithInheritance(name) if name else None
    types = (UsdGeom.Mesh, UsdGeom.TetMesh, UsdGeom.BasisCurves, *(() if within_faces else (UsdGeom.Points,)))
    has_elements = any(map(gprim.IsA, types)) or type_of(gprim) in SHAPE_TOPOLOGIES
    if not primvar or not has_elements or not primvar.HasValue():
        return False
    if primvar.GetInterpolation() not in ("vertex", "varying", "faceVarying", *(() if within_faces else ("uniform",))):
        return False
    values = np.asarray(primvar.Get(time))
    return len(values) > 1 and bool((values != values[0]).any())


def constant_times(gprim: Usd.Prim, names: Iterable[str], report: StageReport) -> list[float]:
    """Return the time codes of those primvars of a gprim that are constant over its surface; empty if none is animated.

    Others are not played; `deforming.shape_times` reports those of displayColor and displayOpacity.
    """
    if not report.reads_animation:
        return []
    times: set[float] = set()
    for name in names:
        primvar = UsdGeom.PrimvarsAPI(gprim).FindPrimvarWithInheritance(name)
        if primvar and not _is_not_constant(primvar) and primvar.ValueMightBeTimeVarying():
            times.update(value_times(primvar.GetAttr()), value_times(primvar.GetIndicesAttr()))
    return sorted(times)


def read_element_colors(gprim: Usd.Prim, time: Usd.TimeCode, report: StageReport) -> Floats | None:
    """Return color and opacity [elements, 4] of each face, point or curve; None if neither primvar varies."""
    if is_constant_color(gprim):
        return None
    topology = primvar_topology(gprim, time)
    if topology.counts.min(initial=0) < 0:  # reported where the mesh is read
        return None
    parts = [_element_means(gprim, name, len(default), topology, time, report) for name, default in _DEFAULTS.items()]
    if all(part is None for part in parts):
        return None
    columns = []
    for part, (name, default) in zip(parts, _DEFAULTS.items(), strict=True):
        fixed = constant_primvar(gprim, name, len(default), time, report, report_varying=False) or default
        columns.append(np.broadcast_to(fixed, (len(topology.counts), len(default))) if part is None else part)
    return np.concatenate(columns, axis=1)


def is_constant_color(gprim: Usd.Prim) -> bool:
    """Return whether neither displayColor nor displayOpacity has an interpolation other than constant."""
    api = UsdGeom.PrimvarsAPI(gprim)
    return not any(_is_not_constant(api.FindPrimvarWithInheritance(name)) for name in _DEFAULTS)


def _is_not_constant(primvar: UsdGeom.Primvar) -> bool:
    return bool(primvar) and primvar.HasValue() and primvar.GetInterpolation() != UsdGeom.Tokens.constant


def _element_means(
    gprim: Usd.Prim, name: str, width: int, topology: Topology, time: Usd.TimeCode, report: StageReport
) -> Floats | None:
    primvar = UsdGeom.PrimvarsAPI(gprim).FindPrimvarWithInheritance(name)
    if not _is_not_constant(primvar) or len(topology.counts) == 0:
        return None
    read = (
        read_color(primvar, topology, time, report) if width == 3 else read_primvar(primvar, 1, topology, time, report)
    )
    if read is None or not len(read.values):
        return None
    corners = read.at(topology.indices, np.arange(len(topology.indices)))[:, :width].astype(np.float64)
    sums = sum_rows(topology.face_of_corner, corners, len(topology.counts))
    values = np.asarray(sums / np.maximum(topology.counts, 1)[:, None])
    if np.abs(corners - values[topology.face_of_corner]).max(initial=0.0) > 1.0 / 255.0:
        report.omission(gprim.GetPath(), f"primvar {name!r} varies within faces: each has the mean of its corners")
    return values


def quantize_colors(values: Floats) -> tuple[list[tuple[float, float, float, float]], list[NDArray[np.int64]]]:
    """Group colors [k, 4] into at most 4096 by rounding to as many steps as that allows, at most 255.

    Returns:
        colors: the mean RGBA of each group.
        groups: the rows of each group.
    """
    steps = 255.0
    distinct, row = np.unique(np.rint(values * steps), axis=0, return_inverse=True)
    while len(distinct) > _MAX_COLORS:
        steps /= 2.0
        distinct, row = np.unique(np.rint(values * steps), axis=0, return_inverse=True)
    order = np.argsort(row.reshape(-1), kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(row.reshape(-1)))[:-1])
    means = [tuple(round(v, 7) for v in values[group].mean(axis=0).tolist()) for group in groups]
    return [(r, g, b, a) for r, g, b, a in means], groups
