# SPDX-License-Identifier: Apache-2.0
"""UsdGeom's parametric gprims as triangles: cube, sphere, cylinder, cone, capsule, plane.

Round shapes are surfaces of revolution with exact smooth normals and uv. A cube and a plane have the primvars that are
authored for their faces and points; elsewhere uv is generated. `TYPES` maps prim types to their functions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from tiscene.usd.core.prims import type_of
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.value_times import is_time_varying, value_at
from tiscene.usd.geometry.primvar import (
    NO_PRIMVARS,
    SECOND_UV,
    SHAPE_TOPOLOGIES,
    UV,
    PrimvarNames,
    read_uv,
    read_vertex_values,
    token_of,
)
from tiscene.usd.geometry.vertex_weld import WeldedMesh

Floats = NDArray[np.float64]

SEGMENTS = 64  # around an axis: corners of a silhouette turn by less than 6 degrees
RINGS = 32  # from pole to pole
_MAX_SIZE = 1e30  # stage units; float32 ends at 3.4e38
_VANISHING = 1e-30  # stage units; in place of an animated 0, which would have other triangles
_AXES = {"X": (2, 0, 1), "Y": (1, 2, 0), "Z": (0, 1, 2)}  # the columns of a shape about z that become x, y, z
_PLANE_AXES = {"X": (2, 1, 0), "Y": (0, 2, 1), "Z": (0, 1, 2)}  # width along z and length along y, along x and z
_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])  # of a quadrilateral
_QUAD = np.array([[0, 1, 2], [0, 2, 3]])  # its triangles
# The corner in SHAPE_TOPOLOGIES that each vertex is.
_CORNER_OF_VERTEX = {
    "Cube": np.array([23, 20, 21, 22, 18, 19, 16, 17, 15, 12, 13, 14, 10, 11, 8, 9, 7, 4, 5, 6, 2, 3, 0, 1]),
    "Plane": np.array([2, 3, 0, 1]),
}


def read_gprim(
    prim: Usd.Prim, time: Usd.TimeCode, report: StageReport, names: PrimvarNames = NO_PRIMVARS
) -> WeldedMesh | None:
    """Read a parametric gprim as triangles with smooth normals and uv.

    Args:
        prim: the gprim.
        time: when to evaluate it.
        report: collects what is wrong, and what is not drawn.
        names: the primvars that its material reads.

    Returns:
        The mesh; None, with a problem reported, if a size is negative, not finite, or always zero where it must not
        be.
    """
    kind = type_of(prim)
    sizes = {}
    for name in ("size", "radius", "height", "width", "length", "radiusTop", "radiusBottom"):
        attribute = prim.GetAttribute(name)
        if attribute:
            value = value_at(attribute, time)
            sizes[name] = math.nan if value is None else float(value)
            if not sizes[name] and is_time_varying(attribute):
                sizes[name] = _VANISHING
            if not 0.0 <= sizes[name] <= _MAX_SIZE or (name in ("size", "radius") and not sizes[name]):
                report.problem(prim.GetPath(), kind.lower(), f"{name} is {sizes[name]}")
                return None
    if kind == "Capsule_1" and sizes["radiusTop"] != sizes["radiusBottom"]:
        report.omission(prim.GetPath(), "a capsule of two radii is drawn with their mean")
    surface = TYPES[kind](sizes)
    axis = token_of(prim.GetAttribute("axis"), time, report) if prim.HasAttribute("axis") else "Z"
    order = (_PLANE_AXES if kind == "Plane" else _AXES)[axis]
    return _with_primvars(_permute_axes(surface, order), prim, names, time, report)


def _with_primvars(
    surface: WeldedMesh, prim: Usd.Prim, names: PrimvarNames, time: Usd.TimeCode, report: StageReport
) -> WeldedMesh:
    """Return a shape with the faces and the primvars that are authored for it."""
    kind = type_of(prim)
    if kind not in SHAPE_TOPOLOGIES:
        name = names.uv or "st"
        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
        if primvar and primvar.HasAuthoredValue():
            text = f"primvars:{name} of a {kind} is not used: round shapes have texture coordinates of their own"
            report.omission(prim.GetPath(), text)
        return surface
    topology, corners = SHAPE_TOPOLOGIES[kind], _CORNER_OF_VERTEX[kind]
    read = read_vertex_values(prim, names, names.has_more_than_uv, topology, time, report)
    values = surface.uv if read is None else read.at(topology.indices[corners], corners)
    assert values is not None
    for name, columns in ((names.uv, UV), (names.second_uv, SECOND_UV)):
        if columns.stop <= values.shape[1] and read_uv(prim, name, topology, time, report) is None:
            values[:, columns] = surface.uv
    face = topology.face_of_corner[corners[surface.triangles[:, 0]]].astype(np.int32)
    return replace(surface, uv=values, face=face)


def _permute_axes(surface: WeldedMesh, order: tuple[int, int, int]) -> WeldedMesh:
    """Permute the axes of a shape; `order` is the old column of each new one."""
    positions = np.ascontiguousarray(surface.positions[:, order])
    normals = None if surface.normals is None else np.ascontiguousarray(surface.normals[:, order])
    even = order in _AXES.values()  # odd permutations mirror
    triangles = surface.triangles if even else np.ascontiguousarray(surface.triangles[:, ::-1])
    return replace(surface, positions=positions, triangles=triangles, normals=normals)


def _cube(size: dict[str, float]) -> WeldedMesh:
    positions, normals = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            face = np.empty((4, 3))
            face[:, axis] = side
            face[:, (axis + 1) % 3] = _CORNERS[:, 0] * side
            face[:, (axis + 2) % 3] = _CORNERS[:, 1]
            positions.append(face)
            normal = np.zeros((4, 3))
            normal[:, axis] = side
            normals.append(normal)
    triangles = (4 * np.arange(6)[:, None, None] + _QUAD).reshape(-1, 3)
    uv = np.tile((_CORNERS + 1.0) / 2.0, (6, 1))
    return _as_float32(np.concatenate(positions) * size["size"] / 2.0, triangles, np.concatenate(normals), uv)


def _plane(size: dict[str, float]) -> WeldedMesh:
    half = np.array([size["width"], size["length"]]) / 2.0
    positions = np.concatenate([_CORNERS * half, np.zeros((4, 1))], axis=1)
    return _as_float32(positions, _QUAD, np.tile([0.0, 0.0, 1.0], (4, 1)), (_CORNERS + 1.0) / 2.0)


def _sphere(size: dict[str, float]) -> WeldedMesh:
    angle = np.linspace(-math.pi / 2.0, math.pi / 2.0, RINGS + 1)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return _revolve([(normal * size["radius"], normal)])


def _cylinder(size: dict[str, float]) -> WeldedMesh:
    """Make a Cylinder, or a Cylinder_1 with a radius for each end."""
    bottom = size.get("radiusBottom", size.get("radius", 0.0))
    top = size.get("radiusTop", size.get("radius", 0.0))
    return _frustum(bottom, top, size["height"] / 2.0)


def _frustum(bottom: float, top: float, half: float) -> WeldedMesh:
    slope = np.array([2.0 * half, bottom - top])
    normal = slope / max(float(np.linalg.norm(slope)), 1e-300)
    strips = [(np.array([[bottom, -half], [top, half]]), np.tile(normal, (2, 1)))] if slope.any() else []
    if bottom > 0.0:
        strips.append((np.array([[0.0, -half], [bottom, -half]]), np.tile([0.0, -1.0], (2, 1))))
    if top > 0.0:
        strips.append((np.array([[top, half], [0.0, half]]), np.tile([0.0, 1.0], (2, 1))))
    return _revolve(strips)


def _capsule(size: dict[str, float]) -> WeldedMesh:
    radius = size["radius"] if "radius" in size else (size["radiusTop"] + size["radiusBottom"]) / 2.0
    quarter = np.linspace(0.0, math.pi / 2.0, RINGS // 2 + 1)
    angle = np.concatenate([quarter - math.pi / 2.0, quarter])
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    profile = normal * radius
    profile[:, 1] += np.repeat([-0.5, 0.5], len(quarter)) * size["height"]
    return _revolve([(profile, normal)])


def _revolve(strips: list[tuple[Floats, Floats]]) -> WeldedMesh:
    """Make a surface of revolution about the z axis.

    Args:
        strips: points and normals [k, 2] of each profile, as (distance from the axis, z), upward on the outside.

    Returns:
        The mesh; u runs counter-clockwise from +x, v along each profile by arc length.
    """
    angle = np.linspace(0.0, 2.0 * math.pi, SEGMENTS + 1)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    around[-1] = around[0]
    positions, normals, uvs, triangles = [], [], [], []
    start = 0
    for profile, normal in strips:
        rings = len(profile)
        positions.append(_sweep(profile, around))
        normals.append(_sweep(normal, around))
        step = np.linalg.norm(np.diff(profile, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(step)]) / max(float(step.sum()), 1e-300)
        grid = np.meshgrid(angle / (2.0 * math.pi), along)
        uvs.append(np.stack(grid, axis=-1).reshape(-1, 2))
        lower = (np.arange(rings - 1)[:, None] * (SEGMENTS + 1) + np.arange(SEGMENTS)).reshape(-1)
        upper = lower + SEGMENTS + 1
        first = np.stack([lower, lower + 1, upper + 1], axis=-1)
        second = np.stack([lower, upper + 1, upper], axis=-1)
        at_axis = np.repeat(profile[:, 0] <= 1e-9 * profile[:, 0].max(), SEGMENTS)
        # At a pole, one triangle of each quadrilateral is degenerate.
        kept = [first[~at_axis[: len(first)]], second[~at_axis[SEGMENTS:]]]
        triangles.append(np.concatenate(kept) + start)
        start += rings * (SEGMENTS + 1)
    return _as_float32(*(np.concatenate(part) for part in (positions, triangles, normals, uvs)))


def _sweep(profile: Floats, around: Floats) -> Floats:
    """Rotate a profile [k, 2] to the directions `around` [s, 2] in the xy plane: [k s, 3]."""
    grid = np.empty((len(profile), len(around), 3))
    grid[..., :2] = profile[:, None, :1] * around
    grid[..., 2] = profile[:, 1:]
    return grid.reshape(-1, 3)


def _as_float32(positions: Floats, triangles: NDArray[Any], normals: Floats, uv: Floats) -> WeldedMesh:
    return WeldedMesh(
        positions.astype(np.float32),
        triangles.astype(np.int32),
        normals.astype(np.float32),
        uv.astype(np.float32),
        np.zeros(len(triangles), dtype=np.int32),
    )


TYPES: dict[str, Callable[[dict[str, float]], WeldedMesh]] = {
    "Cube": _cube,
    "Sphere": _sphere,
    "Cylinder": _cylinder,
    "Cylinder_1": _cylinder,
    "Cone": lambda size: _frustum(size["radius"], 0.0, size["height"] / 2.0),
    "Capsule": _capsule,
    "Capsule_1": _capsule,
    "Plane": _plane,
}
