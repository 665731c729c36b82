# SPDX-License-Identifier: Apache-2.0
"""Primvars and normals of a mesh, checked against its topology."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from tiscene.usd.core.report import StageReport
from tiscene.usd.geometry.vertex_weld import Attribute

_TEXTURE_COORDINATE_TYPES = (
    Sdf.ValueTypeNames.TexCoord2fArray,
    Sdf.ValueTypeNames.TexCoord2dArray,
    Sdf.ValueTypeNames.TexCoord2hArray,
    Sdf.ValueTypeNames.Float2Array,
)


@dataclass(frozen=True)
class Primvars:
    """Names of the primvars that a material reads of vertices. uv: "" for any; of the others for none.

    color: three or four numbers; opacity: one.
    """

    uv: str = ""
    second_uv: str = ""
    color: str = ""
    opacity: str = ""

    @property
    def many(self) -> bool:
        """Whether there is more than a uv."""
        return bool(self.second_uv or self.color or self.opacity)


NO_PRIMVARS = Primvars()
# Columns of what `read_vertex_values` returns where more than a uv is read; else it has the first two.
UV, SECOND_UV, COLOR, OPACITY = slice(0, 2), slice(2, 4), slice(4, 7), slice(7, 8)


@dataclass(frozen=True, eq=False)
class Topology:
    """Faces over points. counts: [faces]; indices: [corners], the point of each corner of each face."""

    points: int
    counts: NDArray[np.int32]
    indices: NDArray[np.int32]

    @cached_property
    def face_of_corner(self) -> NDArray[np.int64]:
        """int64 [corners]."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    def elements(self, interpolation: str) -> int | None:
        """How many values a primvar of this interpolation has; None for an unknown interpolation."""
        return {
            "constant": 1,
            "uniform": len(self.counts),
            "varying": self.points,
            "vertex": self.points,
            "faceVarying": len(self.indices),
        }.get(interpolation)


def array_of(attribute: Usd.Attribute, time: Usd.TimeCode, dtype: Any, width: int | None = 1) -> NDArray[Any]:
    """The attribute's array as numpy, without a copy where dtype agrees; empty if it has no value.

    width: how many numbers each element has, None for any. Raises ValueError for an array of another kind, which a
    schema's attribute holds only in a damaged file.
    """
    value = attribute.Get(time) if attribute else None
    result = np.empty(0, dtype=dtype) if value is None else np.asarray(value, dtype=dtype)
    if result.size and width is not None and result.shape[1:] != (() if width == 1 else (width,)):
        raise ValueError(f"{attribute.GetName()} holds elements of shape {result.shape[1:]}")
    return result


def read_normals(prim: Usd.Prim, topology: Topology, time: Usd.TimeCode, report: StageReport) -> Attribute | None:
    """The authored normals of a polygon mesh; `primvars:normals` comes before `normals`. None for flat shading."""
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals")
    if primvar and primvar.HasAuthoredValue():
        return read_primvar(primvar, 3, topology, time, report)
    mesh = UsdGeom.Mesh(prim)
    values = array_of(mesh.GetNormalsAttr(), time, np.float32, width=3)
    if values.size == 0:
        return None
    return _checked(prim, "normals", values, None, mesh.GetNormalsInterpolation(), 3, topology, report)


def read_uv(prim: Usd.Prim, name: str, topology: Topology, time: Usd.TimeCode, report: StageReport) -> Attribute | None:
    """The texture coordinates of that name ("" for whichever there are: `st`, else the first of such a type)."""
    api = UsdGeom.PrimvarsAPI(prim)
    primvar = api.FindPrimvarWithInheritance(name or "st")
    if not (primvar and primvar.HasAuthoredValue()):
        if name and name != "st":
            report.omission(prim.GetPath(), f"has no primvar {name!r} that its material reads, 'st' is read instead")
            return read_uv(prim, "st", topology, time, report)
        others = [p for p in api.GetPrimvarsWithAuthoredValues() if p.GetTypeName() in _TEXTURE_COORDINATE_TYPES]
        if name or not others:
            return None
        primvar = others[0]
    return read_primvar(primvar, 2, topology, time, report)


def read_vertex_values(
    prim: Usd.Prim, names: Primvars, many: bool, topology: Topology, time: Usd.TimeCode, report: StageReport
) -> Attribute | None:
    """The uv of a mesh; where many, with the second one, the color and the opacity of its vertices: 8 columns."""
    uv = read_uv(prim, names.uv, topology, time, report)
    if not many:
        return uv
    second = read_uv(prim, names.second_uv, topology, time, report) if names.second_uv else None
    api = UsdGeom.PrimvarsAPI(prim)
    color = opacity = None
    if names.color and (primvar := api.FindPrimvarWithInheritance(names.color)):
        color = read_primvar(primvar, 4 if _width(primvar, time) == 4 else 3, topology, time, report)
    if names.opacity and (primvar := api.FindPrimvarWithInheritance(names.opacity)):
        opacity = read_primvar(primvar, 1, topology, time, report)
    parts = ((uv, UV), (second, SECOND_UV), (color, COLOR), (opacity, OPACITY))
    per_corner = any(each is not None and each.per_corner for each, _ in parts)
    values = np.zeros((len(topology.indices) if per_corner else topology.points, 8), np.float32)
    values[:, COLOR], values[:, OPACITY] = 0.18, 1.0
    points = topology.indices if per_corner else np.arange(topology.points)
    for each, columns in parts:
        if each is not None:
            own = each.at(points, np.arange(len(values)))
            values[:, columns] = own[:, : columns.stop - columns.start]
    return Attribute(values, per_corner)


def _width(primvar: UsdGeom.Primvar, time: Usd.TimeCode) -> int:
    values = np.asarray(primvar.Get(time))
    return int(values.shape[1]) if values.ndim == 2 else 1


def read_primvar(
    primvar: UsdGeom.Primvar, width: int, topology: Topology, time: Usd.TimeCode, report: StageReport
) -> Attribute | None:
    """A primvar of `width` numbers; None, which is reported, if it does not fit the mesh."""
    attribute = primvar.GetAttr()
    values = array_of(attribute, time, None, width=None)
    if values.size == 0:
        return None
    indices = np.asarray(primvar.GetIndices(time)) if primvar.IsIndexed() else None
    name = attribute.GetName()
    if width == 1 and values.ndim == 1:
        values = values[:, None]
    return _checked(attribute.GetPrim(), name, values, indices, primvar.GetInterpolation(), width, topology, report)


def _checked(
    prim: Usd.Prim,
    name: str,
    values: NDArray[Any],
    indices: NDArray[np.int32] | None,
    interpolation: str,
    width: int,
    topology: Topology,
    report: StageReport,
) -> Attribute | None:
    fault = _fault(values, indices, interpolation, width, topology.elements(interpolation))
    if fault:
        report.omission(prim.GetPath(), f"{name}: {fault}, so that it is not used")
        return None
    values = values.astype(np.float32, copy=False)
    if indices is not None:
        values = values[indices]
    if interpolation == "constant":
        return Attribute(np.broadcast_to(values[:1], (topology.points, width)), per_corner=False)
    if interpolation == "faceVarying":
        return Attribute(values, per_corner=True)
    if interpolation == "uniform":
        return Attribute(values[topology.face_of_corner], per_corner=True)
    return Attribute(values, per_corner=False)


def _fault(
    values: NDArray[Any], indices: NDArray[np.int32] | None, interpolation: str, width: int, wanted: int | None
) -> str:
    """What is wrong with a primvar that should have `wanted` values of `width` numbers; "" if nothing."""
    if wanted is None:
        return f"unknown interpolation {interpolation!r}"
    if values.ndim != 2 or values.shape[1] != width or not np.issubdtype(values.dtype, np.floating):
        return f"has values of shape {values.shape[1:]}, but {width} numbers each are needed"
    count = len(values) if indices is None else len(indices)
    if count != wanted and not (interpolation == "constant" and count > 0):
        kind = "values" if indices is None else "indices"
        return f"{count} {kind}, but {interpolation} interpolation needs {wanted}"
    if indices is not None and (indices.min() < 0 or indices.max() >= len(values)):
        worst = indices.max() if indices.max() >= len(values) else indices.min()
        return f"an index refers to value {worst}, but there are {len(values)} values"
    if not np.isfinite(values).all():
        return f"{int((~np.isfinite(values).all(axis=1)).sum())} values are not finite numbers"
    return ""


def elements_of(prim: Usd.Prim, time: Usd.TimeCode) -> Topology:
    """What primvars of a gprim belong to: the faces of a mesh; each of some points, or each of some curves, as one."""
    if prim.IsA(UsdGeom.Mesh):
        mesh = UsdGeom.Mesh(prim)
        counts = array_of(mesh.GetFaceVertexCountsAttr(), time, np.int32)
        indices = array_of(mesh.GetFaceVertexIndicesAttr(), time, np.int32)
        return Topology(len(array_of(mesh.GetPointsAttr(), time, None, width=3)), counts, indices)
    if prim.IsA(UsdGeom.Points):
        points = len(array_of(UsdGeom.Points(prim).GetPointsAttr(), time, None, width=3))
        return Topology(points, np.ones(points, np.int32), np.arange(points, dtype=np.int32))
    if prim.IsA(UsdGeom.BasisCurves):
        counts = array_of(UsdGeom.BasisCurves(prim).GetCurveVertexCountsAttr(), time, np.int32)
        return Topology(int(counts.sum()), counts, np.arange(counts.sum(), dtype=np.int32))
    return Topology(0, np.zeros(0, np.int32), np.zeros(0, np.int32))
