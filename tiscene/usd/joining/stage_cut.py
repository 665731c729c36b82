# SPDX-License-Identifier: Apache-2.0
"""Cut openings into the gprims of a stage: overrides that hold what is left of each mesh."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdSemantics, Vt

from tiscene.errors import StageError
from tiscene.usd.core.prims import DRAWN_PURPOSES
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import ROOM, uninstance
from tiscene.usd.geometry.gprim import TYPES, read_gprim
from tiscene.usd.joining.box_cut import CutFaces, cut_box

Floats = NDArray[np.float64]
_NOW = Usd.TimeCode.EarliestTime()
_CORNER_DATA = (
    "cornerIndices",
    "cornerSharpnesses",
    "creaseIndices",
    "creaseLengths",
    "creaseSharpnesses",
    "holeIndices",
)


@dataclass(frozen=True, eq=False)
class GprimCut:
    """What a cut changes of a gprim.

    Attributes:
        path: the gprim.
        boxes: rows of the boxes that take something away from it.
        values: new values of attributes by name; empty: nothing is left of it.
        indexed: names of primvars whose indices the new values replace.
        subsets: new indices of its GeomSubsets by path.
    """

    path: Sdf.Path
    boxes: frozenset[int]
    values: dict[str, NDArray[Any]] = field(default_factory=dict)
    indexed: tuple[str, ...] = ()
    subsets: dict[Sdf.Path, NDArray[np.int32]] = field(default_factory=dict)

    def same_as(self, other: GprimCut) -> bool:
        """Return whether another cut has the same result."""
        if self.values.keys() != other.values.keys():
            return False
        return all(np.array_equal(value, other.values[name]) for name, value in self.values.items())

    def author(self, stage: Usd.Stage) -> None:
        """Write the cut to the stage's edit target."""
        prim = stage.GetPrimAtPath(self.path)
        if not self.values:
            prim.SetActive(False)
            return
        mesh = UsdGeom.Mesh.Define(stage, self.path)
        for name, value in self.values.items():
            attribute = mesh.GetPrim().GetAttribute(name)
            if not attribute:  # the texture coordinates of a shape that was no mesh
                kind = Sdf.ValueTypeNames.TexCoord2fArray
                attribute = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(name[9:], kind, UsdGeom.Tokens.vertex).GetAttr()
            attribute.Set(_to_vt(value, attribute.GetTypeName()))
        for name in self.indexed:
            UsdGeom.PrimvarsAPI(mesh).GetPrimvar(name).BlockIndices()
        if not prim.GetAttribute("subdivisionScheme").HasAuthoredValue():
            mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        for name in _CORNER_DATA:
            if mesh.GetPrim().GetAttribute(name).HasAuthoredValue():
                mesh.GetPrim().GetAttribute(name).Block()
        for path, indices in self.subsets.items():
            UsdGeom.Subset(stage.GetPrimAtPath(path)).GetIndicesAttr().Set(Vt.IntArray.FromNumpy(indices))


def release_instances(stage: Usd.Stage, boxes: Sequence[Floats]) -> None:
    """Make instances that are cut by a box editable, in the stage's edit target."""
    uninstance(stage, lambda: [prim for prim in _gprims(stage) if prim.IsInstanceProxy() and _is_cut(prim, boxes)])


def _is_cut(prim: Usd.Prim, boxes: Sequence[Floats]) -> bool:
    """Return whether boxes take something away from a gprim, or it cannot be cut."""
    met = _boxes_met(prim, boxes)
    try:
        return bool(met) and _cut(prim, met) is not None
    except ValueError:
        return True


def cuts(stage: Usd.Stage, boxes: Sequence[Floats]) -> dict[Sdf.Path, GprimCut]:
    """Return the cuts of all gprims that meet a box, by path.

    Args:
        stage: the stage; nothing is changed.
        boxes: float64 [4, 4], from the stage's world to the axes of each box, in which it is the cube -1..1.

    Raises:
        StageError: a gprim cannot be cut, such as a subdivision surface.
    """
    result: dict[Sdf.Path, GprimCut] = {}
    problems: list[str] = []
    for prim in _gprims(stage):
        met = _boxes_met(prim, boxes)
        if not met:
            continue
        try:
            if (found := _cut(prim, met)) is not None:
                result[prim.GetPath()] = found
        except ValueError as error:
            if _is_drawn(prim):
                problems.append(f"<{prim.GetPath()}> opening: {error}")
    if problems:
        raise StageError(stage.GetRootLayer().GetDisplayName(), problems)
    return result


def _gprims(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    """Yield the shapes and point instancers of a stage, without prototypes, lights and volumes of rooms."""
    prims = iter(stage.Traverse(Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim.IsA(UsdGeom.PointInstancer):
            prims.PruneChildren()
            yield prim
        elif (
            prim.IsA(UsdGeom.Gprim)
            and not prim.HasAPI(UsdLux.LightAPI)
            and not prim.HasAPI(UsdSemantics.LabelsAPI, ROOM)
        ):
            yield prim


def _is_drawn(prim: Usd.Prim) -> bool:
    """Return whether a prim is visible and not for other programs alone, as guides are."""
    shape = UsdGeom.Imageable(prim)
    is_visible = shape.ComputeVisibility(_NOW) != UsdGeom.Tokens.invisible
    return is_visible and shape.ComputePurpose() in DRAWN_PURPOSES


def _boxes_met(prim: Usd.Prim, boxes: Sequence[Floats]) -> dict[int, Floats]:
    """Return the boxes that the bounds of a gprim meet, by their rows."""
    extent = UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(prim), _NOW)
    if not extent:
        return {}
    return {row: boxes[row] for row in np.flatnonzero(_overlaps(_world_of(prim), extent[0], extent[1], boxes)).tolist()}


def _overlaps(world: Floats, low: Sequence[float], high: Sequence[float], boxes: Sequence[Floats]) -> NDArray[np.bool_]:
    """Return which boxes meet bounds with a transform [4, 4] to the world, tested along the axes of each box."""
    corners = [(*corner, 1.0) for corner in itertools.product(*zip(low, high, strict=True))]
    local = np.stack(boxes) @ world @ np.transpose(corners)
    return np.asarray(((local.min(axis=2) < 1.0) & (local.max(axis=2) > -1.0))[:, :3].all(axis=1))


def _world_of(prim: Usd.Prim) -> Floats:
    """Return the transform [4, 4] of a prim to the world."""
    return np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(_NOW)).T


def _to_box(world: Floats, box: Floats, points: Floats) -> Floats:
    """Return points [n, 3] with a transform [4, 4] to the world in the axes of a box."""
    matrix = box @ world
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def _check_instances(prim: Usd.Prim, boxes: Mapping[int, Floats]) -> None:
    """Raise ValueError if instances of a point instancer are in a box: nothing can be cut out of one alone."""
    instancer = UsdGeom.PointInstancer(prim)
    count = instancer.GetInstanceCount(_NOW)
    shown = instancer.ComputeMaskAtTime(_NOW) or [True] * count
    rows = [row for row in range(count) if shown[row]]
    bounds = UsdGeom.BBoxCache(_NOW, DRAWN_PURPOSES).ComputePointInstanceWorldBounds(instancer, rows)
    met = []
    for row, bound in zip(rows, bounds or (), strict=False):
        world, extent = np.array(bound.GetMatrix()).T, bound.GetRange()
        if not extent.IsEmpty() and _overlaps(world, extent.GetMin(), extent.GetMax(), [*boxes.values()]).any():
            met.append(str(row))
    if met:
        raise ValueError(f"instances {', '.join(met)} cannot be cut; move them out of it, or list them in invisibleIds")


def _cut(prim: Usd.Prim, boxes: Mapping[int, Floats]) -> GprimCut | None:
    """Return a gprim without what is in the boxes, by their rows; None if they take nothing away."""
    if prim.IsA(UsdGeom.PointInstancer):
        _check_instances(prim, boxes)
        return None
    if prim.IsA(UsdGeom.Mesh):
        data = _MeshData.of(UsdGeom.Mesh(prim))
    elif prim.GetTypeName() in TYPES:
        data = _MeshData.of_shape(prim)
    else:
        raise ValueError(f"a {prim.GetTypeName()} cannot be cut; move it out of the opening, or deactivate it")
    taking = []
    for row, box in boxes.items():
        faces = cut_box(_to_box(_world_of(prim), box, data.points), data.counts, data.indices)
        if faces is not None:
            data = data.after(faces)
            taking.append(row)
    return data.as_cut(prim.GetPath(), frozenset(taking)) if taking else None


@dataclass(frozen=True, eq=False)
class _MeshData:
    """Arrays of a mesh: values by vertex, by corner and by face, under the names of their attributes."""

    points: Floats
    counts: NDArray[np.int64]
    indices: NDArray[np.int64]
    by_vertex: dict[str, NDArray[Any]]
    by_corner: dict[str, NDArray[Any]]
    by_face: dict[str, NDArray[Any]]
    indexed: tuple[str, ...]
    face: NDArray[np.int64]  # the original face of each
    subsets: dict[Sdf.Path, NDArray[np.int64]]

    @classmethod
    def of(cls, mesh: UsdGeom.Mesh) -> _MeshData:
        """Read a mesh without subdivision."""
        if mesh.GetSubdivisionSchemeAttr().Get() != UsdGeom.Tokens.none:
            raise ValueError('a subdivision surface cannot be cut; give the mesh subdivisionScheme = "none"')
        for attribute in (mesh.GetPointsAttr(), mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()):
            if not attribute.Get(_NOW):
                raise ValueError(f"{attribute.GetName()} is empty")
            if attribute.ValueMightBeTimeVarying():
                raise ValueError("a mesh with time samples cannot be cut")
        counts = np.array(mesh.GetFaceVertexCountsAttr().Get(_NOW), np.int64)
        indices = np.array(mesh.GetFaceVertexIndicesAttr().Get(_NOW), np.int64)
        points = np.array(mesh.GetPointsAttr().Get(_NOW))
        groups: dict[str, dict[str, NDArray[Any]]] = {"vertex": {"points": points}, "faceVarying": {}, "uniform": {}}
        groups["varying"] = groups["vertex"]
        normals = mesh.GetNormalsAttr().Get(_NOW)
        if normals:
            groups.get(str(mesh.GetNormalsInterpolation()), {})["normals"] = np.array(normals)
        indexed = []
        for primvar in UsdGeom.PrimvarsAPI(mesh).GetPrimvarsWithValues():
            flat = np.array(primvar.ComputeFlattened(_NOW))
            group = groups.get(str(primvar.GetInterpolation()))
            if group is not None:
                size = primvar.GetElementSize()
                group[primvar.GetName()] = flat.reshape(-1, size, *flat.shape[1:]) if size > 1 else flat
                if primvar.IsIndexed():
                    indexed.append(str(primvar.GetPrimvarName()))
        subsets = {
            each.GetPath(): np.array(each.GetIndicesAttr().Get(_NOW), np.int64)
            for each in UsdGeom.Subset.GetAllGeomSubsets(mesh)
            if each.GetElementTypeAttr().Get() == UsdGeom.Tokens.face
        }
        drawn = np.setdiff1d(np.arange(len(counts)), mesh.GetHoleIndicesAttr().Get(_NOW) or ())
        corners = np.flatnonzero(np.isin(np.repeat(np.arange(len(counts)), counts), drawn))
        return cls(
            points.astype(np.float64),
            counts[drawn],
            indices[corners],
            groups["vertex"],
            {name: values[corners] for name, values in groups["faceVarying"].items()},
            {name: values[drawn] for name, values in groups["uniform"].items()},
            tuple(indexed),
            drawn,
            subsets,
        )

    @classmethod
    def of_shape(cls, prim: Usd.Prim) -> _MeshData:
        """Read a cube, sphere, cylinder and so on as triangles."""
        shape = read_gprim(prim, _NOW, StageReport("opening"))
        if shape is None or shape.normals is None:
            raise ValueError(f"its size is not valid for a {prim.GetTypeName()}")
        vertex = {"points": shape.positions, "normals": shape.normals}
        if shape.uv is not None:
            vertex["primvars:st"] = shape.uv
        counts = np.full(len(shape.triangles), 3, np.int64)
        indices = shape.triangles.reshape(-1).astype(np.int64)
        return cls(shape.positions.astype(float), counts, indices, vertex, {}, {}, (), np.arange(len(counts)), {})

    def after(self, faces: CutFaces) -> _MeshData:
        """Return the mesh that a cut leaves: its old vertices, then those that the cut made."""
        new = faces.is_new
        made = CutFaces(faces.counts, faces.face, self.indices[faces.corners[new]], faces.weights[new])
        vertex = {name: np.concatenate([values, made.blend(values)]) for name, values in self.by_vertex.items()}
        indices = self.indices[faces.corners[:, 0]]
        indices[new] = len(self.points) + np.arange(int(new.sum()))
        used, indices = np.unique(indices, return_inverse=True)
        vertex = {name: values[used] for name, values in vertex.items()}
        return _MeshData(
            vertex["points"].astype(np.float64),
            faces.counts,
            indices.reshape(-1).astype(np.int64),
            vertex,
            {name: faces.blend(values) for name, values in self.by_corner.items()},
            {name: values[faces.face] for name, values in self.by_face.items()},
            self.indexed,
            self.face[faces.face],
            self.subsets,
        )

    def as_cut(self, path: Sdf.Path, boxes: frozenset[int]) -> GprimCut:
        """Return the arrays as the new values of a mesh's attributes; boxes: of a `GprimCut`."""
        if not len(self.counts):
            return GprimCut(path, boxes)
        values = {**self.by_vertex, **self.by_corner, **self.by_face}
        if "normals" in values:
            lengths = np.linalg.norm(values["normals"], axis=-1, keepdims=True)
            values["normals"] = (values["normals"] / np.maximum(lengths, 1e-12)).astype(values["normals"].dtype)
        values["faceVertexCounts"] = self.counts.astype(np.int32)
        values["faceVertexIndices"] = self.indices.astype(np.int32)
        values["extent"] = np.array([self.points.min(axis=0), self.points.max(axis=0)], np.float32)
        subsets = {
            subset: np.flatnonzero(np.isin(self.face, faces)).astype(np.int32) for subset, faces in self.subsets.items()
        }
        return GprimCut(path, boxes, values, self.indexed, subsets)


def _to_vt(array: NDArray[Any], kind: Sdf.ValueTypeName) -> Any:
    """Return an array as USD takes it for an attribute of a type."""
    whole = kind.type.pythonClass
    like = np.array(whole(1))
    if like.dtype.kind not in "biuf":
        return whole(array.tolist())
    return whole.FromNumpy(np.ascontiguousarray(array.reshape(-1, *like.shape[1:]), like.dtype))
