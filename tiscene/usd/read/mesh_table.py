# SPDX-License-Identifier: Apache-2.0
"""MeshTable: triangle meshes of gprims, read once however many instances share them, with a material per triangle."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdShade

from tiscene.errors import counted
from tiscene.scene.affine_maps import with_origin
from tiscene.scene.camera import Vector3
from tiscene.scene.description import Matrix, Mesh
from tiscene.scene.skinned_deformation import SkinnedDeformation
from tiscene.usd.core.content import content_digest
from tiscene.usd.core.prims import ALSO_ABSTRACT, type_of
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import shared_path
from tiscene.usd.core.transform import MAX_COORDINATE
from tiscene.usd.core.value_times import time_code_number
from tiscene.usd.geometry import gprim
from tiscene.usd.geometry.curves import read_curves, read_points
from tiscene.usd.geometry.deforming import deformation_of, shape_times, with_shape_samples
from tiscene.usd.geometry.gprim import read_gprim
from tiscene.usd.geometry.mesh import face_count, read_mesh
from tiscene.usd.geometry.point_primvars import EnclosingInstancers
from tiscene.usd.geometry.primvar import SECOND_UV, UV, array_of, outside
from tiscene.usd.geometry.recentering import far_center, recentered
from tiscene.usd.geometry.skinned_mesh import content_of
from tiscene.usd.geometry.skinning import skin_of
from tiscene.usd.geometry.tet_mesh import read_tet_mesh
from tiscene.usd.geometry.topology_spans import TopologySpan, topology_spans
from tiscene.usd.geometry.triangulate import cross
from tiscene.usd.geometry.vertex_weld import WeldedMesh
from tiscene.usd.lights.light_linking import links_of
from tiscene.usd.lights.shaping import is_seen_by_camera
from tiscene.usd.materials.material import Binding, MaterialTableBuilder

Partition = tuple[tuple[str, ...], NDArray[np.int32] | None]  # names of parts, and the part of each face
Subsets = Sequence[tuple[Binding, NDArray[np.int64]]]  # a material, and the faces that have it
MAX_TRIANGLES = 50_000_000  # of one gprim whose topology changes, at all times: 20 to 30 bytes each in a description

_READERS = dict.fromkeys(gprim.TYPES, read_gprim) | {
    "BasisCurves": read_curves,
    "Points": read_points,
    "TetMesh": read_tet_mesh,
}


def is_drawable(prim: Usd.Prim) -> bool:
    """Return whether a prim is of a type that a MeshTable reads."""
    return bool(prim.IsA(UsdGeom.Mesh)) or type_of(prim) in _READERS


class MeshTable:
    """Reads gprims as meshes. Instances of one prototype share a mesh, and so do equal meshes.

    Attributes:
        meshes: the meshes so far; a mesh is referred to by its row.
        of_points: by row, the primvars of color and opacity that materials read and that points of instancers give,
            "" for none. Other meshes are not among the keys.
    """

    def __init__(
        self,
        materials: MaterialTableBuilder,
        time: Usd.TimeCode,
        report: StageReport,
        meters_per_unit: float,
        instancers: EnclosingInstancers,
    ) -> None:
        """Start an empty table.

        Args:
            materials: resolves material bindings.
            time: time code to read at.
            report: receives problems and omissions.
            meters_per_unit: meters per stage unit.
            instancers: those whose prototypes are being read.
        """
        self.meshes: list[Mesh] = []
        self.of_points: dict[int, tuple[str, str]] = {}
        self._instancers = instancers
        self._materials = materials
        self._time = time
        self._report = report
        self._meters = meters_per_unit
        self._spans: dict[Any, list[TopologySpan]] = {}
        self._times: dict[Any, dict[TopologySpan, list[float]]] = {}
        self._partitions: dict[Any, Partition] = {}
        self._surfaces: dict[Any, WeldedMesh | None] = {}
        self._rows: dict[Any, int | None] = {}
        self._rows_by_content: dict[bytes, int] = {}
        self._shapes: dict[Any, int] = {}  # numbers of the shapes whose topology changes

    def rows(self, prim: Usd.Prim, emitter: Binding | None = None) -> list[tuple[int, TopologySpan]]:
        """Return the rows of a gprim's meshes, each with when it is shown: one mesh, unless its topology changes.

        Empty, with the reason reported, if it has no triangles.

        Args:
            prim: the gprim.
            emitter: material of a mesh light, instead of the bound one.
        """
        spans = self.spans(prim)
        with self._report.over_times() if len(spans) > 1 else contextlib.nullcontext():
            return self._read_rows(prim, emitter, spans)

    def _read_rows(
        self, prim: Usd.Prim, emitter: Binding | None, spans: Sequence[TopologySpan]
    ) -> list[tuple[int, TopologySpan]]:
        result: list[tuple[int, TopologySpan]] = []
        triangles = 0
        for span in spans:
            # The first topology and that of the initial time are always there: objects collide with them.
            changes = bool(result) and not self.is_initial(prim, span)
            row = self._row(prim, emitter, span, changes)
            if row is None:
                continue
            result.append((row, span))
            triangles += len(self.meshes[row].triangles)
            if triangles > MAX_TRIANGLES and span.end < math.inf:
                text = f"a {prim.GetTypeName()} whose topology changes keeps the one that it has after"
                self._report.omission(prim.GetPath(), f"{text} {MAX_TRIANGLES:,} triangles of all times together")
                result[-1] = row, replace(span, end=math.inf)
                break
        return result

    def spans(self, prim: Usd.Prim) -> list[TopologySpan]:
        """Return the spans of a gprim's topology."""
        source = shared_path(prim)
        if source not in self._spans:
            self._spans[source] = topology_spans(prim, self._time, self._report)
        return self._spans[source]

    def shape_times(self, prim: Usd.Prim) -> dict[TopologySpan, list[float]]:
        """Return the time codes of each span of a gprim's topology at which its shape is authored."""
        source = shared_path(prim)
        if source not in self._times:
            self._times[source] = shape_times(prim, self.spans(prim), self._report)
        return self._times[source]

    def is_initial(self, prim: Usd.Prim, span: TopologySpan) -> bool:
        """Return whether a span of a gprim's topology holds the time that the stage is read at."""
        return span.holds(time_code_number(prim, self._time))

    def _row(self, prim: Usd.Prim, emitter: Binding | None, span: TopologySpan, changes: bool) -> int | None:
        whole = emitter or self._materials.binding(prim, prim)
        subsets = [] if emitter else self._subsets(prim, whole, span.code)
        if not is_seen_by_camera(prim, self._time):
            whole = self._materials.unseen(whole)
            subsets = [(self._materials.unseen(binding), faces) for binding, faces in subsets]
        bindings = (whole, *(binding for binding, _ in subsets))
        links = links_of(self._report)
        link_class = 0 if links is None else links.class_of(prim)
        key: Any = (shared_path(prim), bindings, id(skin_of(prim, self._report)), link_class)
        if (key, span) not in self._rows:
            surface = self._surface(prim, bindings, subsets, span)
            shape = self._shapes.setdefault(key, len(self._shapes) + 1) if changes else 0
            added = None if surface is None else self._add(prim, surface, whole, subsets, link_class, span, shape)
            self._rows[key, span] = added
            of_points = self._of_points(prim, bindings)
            if added is not None and any(of_points):
                self.of_points[added] = of_points
        return self._rows[key, span]

    def _of_points(self, prim: Usd.Prim, bindings: Sequence[Binding]) -> tuple[str, str]:
        """Return which primvars of color and opacity points of instancers give to the materials of a gprim."""
        colors, opacities = ([getattr(each.primvars, kind) for each in bindings] for kind in ("color", "opacity"))
        found = []
        for names in (colors, opacities):
            distinct = list(dict.fromkeys(filter(None, names)))
            given = [name for name in distinct if self._instancers.source(prim, name) is not None]
            if given and len(distinct) > 1:
                text = f"materials of one mesh read {' and '.join(distinct)}: all have {given[0]} of its points"
                self._report.omission(prim.GetPath(), text)
            found.append(given[0] if given else "")
        return found[0], found[1]

    def placed(self, row: int, matrices: Matrix) -> Matrix:
        """Return the transforms [..., 4, 4] of a mesh, by its row, from those of its prim."""
        return with_origin(matrices, -np.array(self.meshes[row].origin))

    def subset_names(self, prim: Usd.Prim) -> tuple[str, ...]:
        """Return the names of a gprim's parts: its subsets, then "" for the faces in none of them."""
        partitions = [self._parts(prim, span.code)[0] for span in self.spans(prim)]
        return max(partitions, key=len)  # some may have no faces that are in none of them

    def _parts(self, prim: Usd.Prim, time: Usd.TimeCode) -> Partition:
        """Return the names of a gprim's parts at a time, and the part of each face (None: there is one part).

        Subsets of other families are preferred to those that bind materials. Of overlapping subsets the last counts.
        Those that refer to missing faces are left out.
        """
        key = shared_path(prim), time
        if key not in self._partitions:
            self._partitions[key] = self._read_parts(prim, time)
        return self._partitions[key]

    def _read_parts(self, prim: Usd.Prim, time: Usd.TimeCode) -> Partition:
        children = prim.GetFilteredChildren(ALSO_ABSTRACT) if prim.IsA(UsdGeom.Mesh) else ()
        subsets = [UsdGeom.Subset(child) for child in children if child.IsA(UsdGeom.Subset)]
        subsets = [each for each in subsets if each.GetElementTypeAttr().Get() == UsdGeom.Tokens.face]
        material = UsdShade.Tokens.materialBind
        subsets = [each for each in subsets if each.GetFamilyNameAttr().Get() != material] or subsets
        faces = face_count(prim, time) if subsets else 0
        found = [(each, indices) for each in subsets if (indices := self._subset_faces(each, faces, time)) is not None]
        if not found:
            return ("",), None
        part_of_face = np.full(faces, len(found), dtype=np.int32)
        for number, (_, indices) in enumerate(found):
            part_of_face[indices] = number
        names = tuple(subset.GetPrim().GetName() for subset, _ in found)
        return (*names, "") if (part_of_face == len(found)).any() else names, part_of_face

    def area(self, prim: Usd.Prim, matrix: Matrix, time: float | None = None) -> float:
        """Return the total area of a gprim's triangles, in squared stage units.

        Args:
            prim: the gprim.
            matrix: 3x3 by which they are transformed.
            time: time code of their positions; None: as they are read.
        """
        spans = self.spans(prim)
        span = next((each for each in spans if time is not None and each.holds(time)), spans[0])
        surface = self._surface(prim, (Binding(-1),), [], span)
        if surface is None:
            return 0.0
        positions = surface.positions if time is None else surface.positions_at(time)
        a, b, c = (positions[surface.triangles[:, corner]].astype(np.float64) @ matrix.T for corner in range(3))
        return float(np.linalg.norm(cross(b - a, c - a), axis=1).sum() / 2.0)

    def _subsets(self, prim: Usd.Prim, whole: Binding, time: Usd.TimeCode) -> Subsets:
        """Return the faces with a material of their own: by displayColor, or subsets of the family materialBind."""
        found: list[tuple[Binding, NDArray[np.int64]]] = []
        if whole.is_display_color and not whole.primvars.has_more_than_uv:
            found += self._materials.by_element(prim, time)
        if not prim.GetFilteredChildren(ALSO_ABSTRACT):
            return found
        faces = face_count(prim, time)
        for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
            if not prim.IsA(UsdGeom.Mesh):
                self._report.omission(subset.GetPath(), f"a material of a part of a {type_of(prim)} is not applied")
                continue
            if subset.GetElementTypeAttr().Get() != UsdGeom.Tokens.face:
                self._report.omission(subset.GetPath(), "a material bound to points or edges is not applied")
                continue
            indices = self._subset_faces(subset, faces, time)
            if indices is not None:
                found.append((self._materials.binding(subset.GetPrim(), prim), indices))
            for primvar in UsdGeom.PrimvarsAPI(subset).GetAuthoredPrimvars():
                text = f"primvars:{primvar.GetPrimvarName()} of a subset is not read: its mesh's is"
                self._report.omission(subset.GetPath(), text)
        return found

    def _subset_faces(self, subset: UsdGeom.Subset, faces: int, time: Usd.TimeCode) -> NDArray[np.int64] | None:
        """Return the faces of a subset of a mesh of `faces`; None, with the problem reported, if it has not all.

        Of a mesh whose topology changes, those that it has. (Blender writes the subsets of the first time alone.)
        """
        indices = array_of(subset.GetIndicesAttr(), time, np.int64)
        worst = outside(indices, faces)
        if worst is None:
            return indices
        if not self.spans(subset.GetPrim().GetParent())[0].is_whole:
            text = "a subset refers to faces that its mesh has only at other times; at each time, the others are used"
            self._report.omission(subset.GetPath(), text)
            return indices[(indices >= 0) & (indices < faces)]
        text = f"refers to face {worst}, but the mesh has {counted(faces, 'face')} (0-{faces - 1})"
        self._report.problem(subset.GetPath(), "subset", text)
        return None

    def _surface(
        self, prim: Usd.Prim, bindings: tuple[Binding, ...], subsets: Subsets, span: TopologySpan
    ) -> WeldedMesh | None:
        """Return a gprim's triangles, read once per prototype, span and selection of texture coordinates."""
        wanted = tuple(dict.fromkeys(binding.primvars for binding in bindings))
        of_face = None
        source, skin = shared_path(prim), skin_of(prim, self._report)
        key: Any = (source, wanted, id(skin), span)
        if len(wanted) > 1:
            key = (source, bindings, id(skin), span)
            of_face = np.full(face_count(prim, span.code), wanted.index(bindings[0].primvars))
            for binding, indices in subsets:
                of_face[indices] = wanted.index(binding.primvars)
        if key not in self._surfaces:
            if not span.is_whole:  # their surfaces are large, and used one after another
                self._surfaces = {known: each for known, each in self._surfaces.items() if known[-1].is_whole}
            times = [] if skin is not None else self.shape_times(prim)[span]
            if prim.IsA(UsdGeom.Mesh):
                surface = read_mesh(prim, span.code, self._report, wanted, of_face, times)
            else:
                read = partial(_READERS[type_of(prim)], names=wanted[0])
                if prim.IsA(UsdGeom.BasisCurves):
                    read = partial(read, before={})
                surface = read(prim, span.code, self._report)
                if times and surface is not None:
                    surface = with_shape_samples(prim, surface, times, self._report, read)
            self._surfaces[key] = surface
        return self._surfaces[key]

    def _add(
        self,
        prim: Usd.Prim,
        surface: WeldedMesh,
        whole: Binding,
        subsets: Subsets,
        link_class: int,
        span: TopologySpan,
        shape: int,
    ) -> int | None:
        self._report.budget.add_mesh(len(surface.triangles))
        materials = np.full(len(surface.triangles), whole.row, dtype=np.int32)
        if subsets:
            of_face = np.full(int(surface.face.max()) + 1, whole.row, dtype=np.int32)
            for binding, indices in subsets:
                of_face[indices[indices < len(of_face)]] = binding.row
            materials = of_face[surface.face]
        with np.errstate(over="ignore"):
            positions = surface.positions * np.float32(self._meters)
        if not np.abs(positions).max(initial=0.0) <= MAX_COORDINATE:
            self._report.problem(prim.GetPath(), "geometry", f"its points reach farther than {MAX_COORDINATE:g} m")
            return None
        origin: Vector3 = (0.0, 0.0, 0.0)
        center = far_center(surface, self._meters)
        if center.any():
            surface = recentered(surface, center)
            positions = surface.positions * np.float32(self._meters)
            x, y, z = (-self._meters * center).tolist()
            origin = (x, y, z)
        part_of_face = self._parts(prim, span.code)[1]
        parts = None if part_of_face is None else part_of_face[surface.face]
        deformation = deformation_of(surface, prim.GetStage(), self._meters)
        uv, second_uv, colors = surface.uv, None, None
        if uv is not None and uv.shape[1] > 2:
            uv, second_uv, colors = (np.ascontiguousarray(uv[:, each]) for each in (UV, SECOND_UV, slice(4, 8)))
        if deformation is not None or colors is not None:
            shape = 0
        values: list[Any] = [positions, surface.triangles, materials, surface.normals, surface.uv, parts]
        values += [link_class, origin, shape]
        if isinstance(deformation, SkinnedDeformation):
            values.append(content_of(deformation))
        elif deformation is not None:
            values += [deformation.times, deformation.positions, deformation.normals]
        content = content_digest(values)
        if content not in self._rows_by_content:
            self._rows_by_content[content] = len(self.meshes)
            faces = surface.triangles, materials, surface.normals, uv, parts
            others = deformation, second_uv, colors, link_class, origin
            self.meshes.append(Mesh(prim.GetName(), positions, *faces, *others, shape=shape))
        return self._rows_by_content[content]
