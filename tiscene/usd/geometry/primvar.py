# SPDX-License-Identifier: Apache-2.0
"""Primvars and normals of a mesh, validated against its topology.

A primvar whose size, interpolation or indices contradict the mesh is reported as an omission and ignored. What remains
is returned as an `Attribute` of points or of face corners: constant and uniform values are expanded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from tiscene.errors import counted
from tiscene.usd.core.color_space import attribute_colors
from tiscene.usd.core.prims import type_of
from tiscene.usd.core.report import StageReport
from tiscene.usd.geometry.vertex_weld import Attribute

TEXTURE_COORDINATE_TYPES = (
    Sdf.ValueTypeNames.TexCoord2fArray,
    Sdf.ValueTypeNames.TexCoord2dArray,
    Sdf.ValueTypeNames.TexCoord2hArray,
    Sdf.ValueTypeNames.Float2Array,
)


@dataclass(frozen=True)
class PrimvarNames:
    """Names of the primvars that a material reads per vertex.

    Attributes:
        uv: texture coordinates; "" for the mesh's default ones (see `read_uv`).
        second_uv: a second set of texture coordinates; "" for none.
        color: a primvar of three or four components; "" for none.
        opacity: a primvar of one component; "" for none.
    """

    uv: str = ""
    second_uv: str = ""
    color: str = ""
    opacity: str = ""

    @property
    def has_more_than_uv(self) -> bool:
        """Whether a second uv, color or opacity is read."""
        return bool(self.second_uv or self.color or self.opacity)


NO_PRIMVARS = PrimvarNames()
# Columns of the values that `read_vertex_values` returns; only UV where nothing else is read.
UV, SECOND_UV, COLOR, OPACITY = slice(0, 2), slice(2, 4), slice(4, 7), slice(7, 8)


@dataclass(frozen=True, eq=False)
class Topology:
    """Faces over points.

    Attributes:
        points: number of points.
        counts: int32 [faces], corners of each face.
        indices: int32 [corners], the point of each corner, face after face.
    """

    points: int
    counts: NDArray[np.int32]
    indices: NDArray[np.int32]

    @cached_property
    def face_of_corner(self) -> NDArray[np.int64]:
        """The face of each corner, int64 [corners]."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    def is_consistent(self) -> bool:
        """Return whether there are faces, and counts and indices fit each other and the points."""
        counts, indices = self.counts, self.indices
        if len(counts) == 0 or counts.min() < 0 or counts.sum(dtype=np.int64) != len(indices):
            return False
        return outside(indices, self.points) is None

    def element_count(self, interpolation: str) -> int | None:
        """Return how many values a primvar of this interpolation has; None for an unknown interpolation."""
        return {
            "constant": 1,
            "uniform": len(self.counts),
            "varying": self.points,
            "vertex": self.points,
            "faceVarying": len(self.indices),
        }.get(interpolation)


# Hydra's order of the faces of a cube is +z, -z, +y, -y, +x, -x; that of the points of a plane is ++, -+, --, +- in
# the directions of its width and length.
SHAPE_TOPOLOGIES = {
    "Cube": Topology(
        8,
        np.full(6, 4, np.int32),
        np.array([0, 1, 2, 3, 4, 5, 6, 7, 0, 6, 5, 1, 4, 7, 3, 2, 0, 3, 7, 6, 4, 2, 1, 5], np.int32),
    ),
    "Plane": Topology(4, np.full(1, 4, np.int32), np.arange(4, dtype=np.int32)),
}


def array_of(attribute: Usd.Attribute, time: Usd.TimeCode, dtype: Any, width: int | None = 1) -> NDArray[Any]:
    """Return an attribute's array as numpy, without a copy where the dtype agrees.

    Args:
        attribute: an array-valued attribute; may be invalid.
        time: when to evaluate it.
        dtype: numpy dtype of the result; None keeps the attribute's.
        width: components of each element; None for any number.

    Returns:
        [k] for width 1, else [k, width]; empty if the attribute has no value.

    Raises:
        ValueError: the elements have another shape. A schema's attribute holds such only in a damaged file.
    """
    value = attribute.Get(time) if attribute else None
    result = np.empty(0, dtype=dtype) if value is None else np.asarray(value, dtype=dtype)
    if result.size and width is not None and result.shape[1:] != (() if width == 1 else (width,)):
        raise ValueError(
            f"{attribute.GetName()} holds elements of shape {result.shape[1:]}, expected {width} components"
        )
    return result


def array_or_primvar(attribute: Usd.Attribute, time: Usd.TimeCode, width: int | None = 1) -> NDArray[np.float32]:
    """Return a gprim's `widths` or `normals` as `array_of` does; a primvar of the same name takes precedence."""
    primvar = UsdGeom.PrimvarsAPI(attribute.GetPrim()).GetPrimvar(attribute.GetName())
    if not (primvar and primvar.HasAuthoredValue()):
        return array_of(attribute, time, np.float32, width)
    values = array_of(primvar.GetAttr(), time, np.float32, width)
    return values[np.asarray(primvar.GetIndices(time))] if primvar.IsIndexed() else values


def token_of(attribute: Usd.Attribute, time: Usd.TimeCode, report: StageReport) -> str:
    """Return a token of a schema. One that the schema does not allow is reported; its fallback is used."""
    value = attribute.Get(time)
    if value is not None and value in (attribute.GetMetadata("allowedTokens") or (value,)):
        return str(value)
    fallback = str(attribute.GetPrim().GetPrimDefinition().GetAttributeFallbackValue(attribute.GetName()))
    if value is not None:
        text = f"{attribute.GetName()} {value!r} is not known; {fallback!r} is used"
        report.omission(attribute.GetPrim().GetPath(), text)
    return fallback


def outside(indices: NDArray[np.integer], count: int) -> int | None:
    """Return an index that is not within 0..count - 1, the largest if that is one; None if there is none."""
    if len(indices) and indices.max() >= count:
        return int(indices.max())
    return int(indices.min()) if len(indices) and indices.min() < 0 else None


def read_normals(prim: Usd.Prim, topology: Topology, time: Usd.TimeCode, report: StageReport) -> Attribute | None:
    """Read the authored normals of a mesh; `primvars:normals` takes precedence over `normals`. None: flat shading."""
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals")
    if primvar and primvar.HasAuthoredValue():
        return read_primvar(primvar, 3, topology, time, report)
    mesh = UsdGeom.Mesh(prim)
    values = array_of(mesh.GetNormalsAttr(), time, np.float32, width=3)
    if values.size == 0:
        return None
    return _to_attribute(mesh.GetNormalsAttr(), values, None, mesh.GetNormalsInterpolation(), 3, topology, report)


def read_uv(prim: Usd.Prim, name: str, topology: Topology, time: Usd.TimeCode, report: StageReport) -> Attribute | None:
    """Read the texture coordinates of that name; "" means `st`, else the first primvar of a texture-coordinate type.

    None if there are none. A name that the mesh lacks is reported: its texture coordinates are (0, 0), as of a primvar
    reader without a fallback, whichever others the mesh has.
    """
    api = UsdGeom.PrimvarsAPI(prim)
    primvar = api.FindPrimvarWithInheritance(name or "st")
    if not (primvar and primvar.HasAuthoredValue()):
        if name:
            if prim.IsA(UsdGeom.PointBased):  # other gprims have coordinates of their own
                report_missing_coordinates(prim, name, (0.0, 0.0), report)
            return None
        others = [p for p in api.GetPrimvarsWithAuthoredValues() if p.GetTypeName() in TEXTURE_COORDINATE_TYPES]
        if not others:
            return None
        primvar = others[0]
    return read_primvar(primvar, 2, topology, time, report)


def report_missing_coordinates(prim: Usd.Prim, name: str, used: Sequence[float], report: StageReport) -> None:
    """Report texture coordinates that a material reads and its mesh lacks, with those that are used."""
    u, v = used
    text = f"has no primvar {name!r}, which its material reads; its texture coordinates are ({u:g}, {v:g})"
    report.omission(prim.GetPath(), text)


def read_vertex_values(
    prim: Usd.Prim, names: PrimvarNames, all_columns: bool, topology: Topology, time: Usd.TimeCode, report: StageReport
) -> Attribute | None:
    """Read the vertex values that a material needs.

    Args:
        prim: the mesh.
        names: the primvars to read.
        all_columns: whether to return 8 columns (UV, SECOND_UV, COLOR, OPACITY) rather than the uv alone.
        topology: the mesh's faces.
        time: when to evaluate the primvars.
        report: collects primvars that do not fit the mesh.

    Returns:
        Values of 2 or 8 columns; absent colors are 0.18, absent opacities 1. None if there is no uv and
        `all_columns` is False.
    """
    uv = read_uv(prim, names.uv, topology, time, report)
    if not all_columns:
        return uv
    second = read_uv(prim, names.second_uv, topology, time, report) if names.second_uv else None
    api = UsdGeom.PrimvarsAPI(prim)
    color = opacity = None
    if names.color and (primvar := api.FindPrimvarWithInheritance(names.color)):
        color = read_color(primvar, topology, time, report)
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
    kinds = {each.interpolation for each, _ in parts if each is not None} - {"constant", "uniform"}
    return Attribute(values, per_corner, kinds.pop() if len(kinds) == 1 else "")


def read_element_values(
    prim: Usd.Prim, names: PrimvarNames, time: Usd.TimeCode, report: StageReport
) -> list[tuple[str, slice, NDArray[Any]]]:
    """Read the primvars that a material needs of curves or points, without a topology.

    Args:
        prim: the curves or points.
        names: the primvars; texture coordinates without a name are `st`.
        time: when to evaluate them.
        report: collects texture coordinates that are missing.

    Returns:
        (name, columns as in `read_vertex_values`, finite values [n, components]) of each that is authored.
    """
    result = []
    parts = (names.uv or "st", UV), (names.second_uv, SECOND_UV), (names.color, COLOR), (names.opacity, OPACITY)
    for name, columns in parts:
        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name) if name else None
        value = primvar.ComputeFlattened(time) if primvar else None
        width = columns.stop - columns.start
        values = np.asarray(value if value is not None else (), np.float64)
        if values.ndim == 1 or not primvar:
            values = values.reshape(-1, 1)
        else:
            values = attribute_colors(primvar.GetAttr(), values)[:, :width]
        if len(values) and values.shape[1] == width and np.isfinite(values).all():
            result.append((name, columns, values))
        elif name in (names.uv, names.second_uv) and name:
            report_missing_coordinates(prim, name, (0.0, 0.0), report)
    return result


def default_values(shape: tuple[int, ...], names: PrimvarNames) -> NDArray[np.float64]:
    """Return vertex values [*shape, 2 or 8 columns]: texture coordinates of 0, a color of 0.18, an opacity of 1."""
    values = np.zeros((*shape, 8 if names.has_more_than_uv else 2))
    if names.has_more_than_uv:
        values[..., COLOR], values[..., OPACITY] = 0.18, 1.0
    return values


def read_color(
    primvar: UsdGeom.Primvar, topology: Topology, time: Usd.TimeCode, report: StageReport
) -> Attribute | None:
    """Read a primvar of three or four components as `read_primvar` does."""
    width = 4 if np.shape(primvar.Get(time))[1:] == (4,) else 3
    return read_primvar(primvar, width, topology, time, report)


def read_primvar(
    primvar: UsdGeom.Primvar, width: int, topology: Topology, time: Usd.TimeCode, report: StageReport
) -> Attribute | None:
    """Read a primvar of `width` components; None if it is empty or does not fit the mesh, which is reported."""
    attribute = primvar.GetAttr()
    values = array_of(attribute, time, None, width=None)
    if values.size == 0:
        return None
    indices = np.asarray(primvar.GetIndices(time)) if primvar.IsIndexed() else None
    if values.ndim > 1:
        values = attribute_colors(attribute, values)
    elif width == 1:
        values = values[:, None]
    return _to_attribute(attribute, values, indices, primvar.GetInterpolation(), width, topology, report)


def _to_attribute(
    attribute: Usd.Attribute,
    values: NDArray[Any],
    indices: NDArray[np.int32] | None,
    interpolation: str,
    width: int,
    topology: Topology,
    report: StageReport,
) -> Attribute | None:
    fault = _fault(values, indices, interpolation, width, topology.element_count(interpolation))
    if fault:
        text = f"{attribute.GetName()}: {fault}, so that it is not used"
        report.omission(attribute.GetPrim().GetPath(), text)
        return None
    values = values.astype(np.float32, copy=False)
    if indices is not None:
        values = values[indices]
    if interpolation == "constant":
        return Attribute(np.broadcast_to(values[:1], (topology.points, width)), False, interpolation)
    if interpolation == "uniform":
        return Attribute(values[topology.face_of_corner], True, interpolation)
    return Attribute(values, interpolation == "faceVarying", interpolation)


def _fault(
    values: NDArray[Any], indices: NDArray[np.int32] | None, interpolation: str, width: int, expected: int | None
) -> str:
    """Describe what is wrong with a primvar that needs `expected` values of `width` components; "" if nothing."""
    if expected is None:
        return f"unknown interpolation {interpolation!r}"
    if values.ndim != 2 or values.shape[1] != width or not np.issubdtype(values.dtype, np.floating):
        return f"has values of shape {values.shape[1:]}, but {width} numbers each are needed"
    count = len(values) if indices is None else len(indices)
    if count != expected and not (interpolation == "constant" and count > 0):
        given = counted(count, "value") if indices is None else counted(count, "index", "indices")
        return f"{given}, but {interpolation} interpolation needs {expected}"
    if indices is not None and (worst := outside(indices, len(values))) is not None:
        return f"an index refers to value {worst}, but it has {counted(len(values), 'value')}"
    if not np.isfinite(values).all():
        invalid = int((~np.isfinite(values).all(axis=1)).sum())
        return f"{counted(invalid, 'value is', 'values are')} not finite"
    return ""


def primvar_topology(prim: Usd.Prim, time: Usd.TimeCode) -> Topology:
    """Return the elements that a gprim's primvars belong to: faces of a mesh, or of the surface of tetrahedra; each
    point or each curve as one face; all points of an instancer as one face.

    Faces and points of a cube and of a plane are those of the meshes that Hydra makes of them; round shapes have none.
    """
    if prim.IsA(UsdGeom.Mesh):
        mesh = UsdGeom.Mesh(prim)
        counts = array_of(mesh.GetFaceVertexCountsAttr(), time, np.int32)
        indices = array_of(mesh.GetFaceVertexIndicesAttr(), time, np.int32)
        return Topology(len(array_of(mesh.GetPointsAttr(), time, None, width=3)), counts, indices)
    if prim.IsA(UsdGeom.Points):
        points = len(array_of(UsdGeom.Points(prim).GetPointsAttr(), time, None, width=3))
        return Topology(points, np.ones(points, np.int32), np.arange(points, dtype=np.int32))
    if prim.IsA(UsdGeom.PointInstancer):
        points = len(array_of(UsdGeom.PointInstancer(prim).GetProtoIndicesAttr(), time, None))
        return Topology(points, np.array([points], np.int32), np.arange(points, dtype=np.int32))
    if prim.IsA(UsdGeom.BasisCurves):
        counts = array_of(UsdGeom.BasisCurves(prim).GetCurveVertexCountsAttr(), time, np.int32)
        return Topology(int(counts.sum()), counts, np.arange(counts.sum(), dtype=np.int32))
    if prim.IsA(UsdGeom.TetMesh):
        tets = UsdGeom.TetMesh(prim)
        faces = array_of(tets.GetSurfaceFaceVertexIndicesAttr(), time, np.int32, width=3)
        if len(faces) == 0:
            faces = np.asarray(UsdGeom.TetMesh.ComputeSurfaceFaces(tets, time), np.int32).reshape(-1, 3)
        points = len(array_of(tets.GetPointsAttr(), time, None, width=3))
        return Topology(points, np.full(len(faces), 3, np.int32), faces.reshape(-1))
    return SHAPE_TOPOLOGIES.get(type_of(prim), Topology(0, np.zeros(0, np.int32), np.zeros(0, np.int32)))
