# SPDX-License-Identifier: Apache-2.0
"""Models of other people as templates: one folder each, with geometry, textures, label, colliders and license."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdPhysics, UsdSemantics, UsdShade, UsdUtils, Vt

from tiscene.errors import ArgumentError, ExportError, MissingFile, StageError
from tiscene.usd.core.report import error_lines
from tiscene.usd.core.stage import open_stage, quiet, readable, reading_time
from tiscene.usd.importers.materials import define_look
from tiscene.usd.importers.mesh_file import CONVENTIONS, Piece, load_model
from tiscene.usd.read.template import root_prim

USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
LICENCE_FILES = re.compile(r"(licen[cs]e|copying|credits?|attribution).*", re.IGNORECASE)
_Z_TO_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class Credit:
    """Who made a model, and under which terms: kept in the template's layer as customLayerData `import`."""

    source: str = ""
    license: str = ""
    author: str = ""


def import_asset(
    path: str | Path,
    folder: str | Path,
    *,
    name: str = "",
    label: str = "",
    unit: float | None = None,
    up_axis: str | None = None,
    centered: bool = True,
    license: str = "",
    author: str = "",
) -> Path:
    """Make a template of a model file (OBJ, glTF, PLY, STL, any USD). Returns the file `folder`/template.usda.

    name: its displayName; "" for the file's. label: its semantic class; "" for what a USD file says, else none.
    unit: meters per unit of the file, up_axis: "Y" or "Z"; None for what its format means (a USD file knows).
    centered: the template's origin is the center of its box; else that of the file.
    license: its text; "" for that of the license files beside it.
    Raises MissingFile, ArgumentError, StageError and ExportError. What the file lacks is named in a StageWarning.
    """
    path, folder = Path(path), Path(folder)
    suffix = path.suffix.lower()
    if not path.is_file():
        raise MissingFile(f"no file {str(path)!r}")
    if unit is not None and not 0.0 < unit < np.inf:
        raise ArgumentError(f"unit={unit}: must be a positive number of meters")
    if up_axis not in (None, "Y", "Z"):
        raise ArgumentError(f"up_axis={up_axis!r}: must be 'Y' or 'Z'")
    name = name or path.stem
    credit = Credit(path.name, license or license_beside(path), author)
    if suffix in USD_SUFFIXES:
        if unit is not None or up_axis is not None:
            raise ArgumentError(f"{path.name} says its unit and its up axis itself")
        return _import_usd(path, folder, name, label, centered, credit)
    if suffix not in CONVENTIONS:
        known = ", ".join((*CONVENTIONS, *USD_SUFFIXES, ".sh3f"))
        raise ArgumentError(f"{path.name}: a {suffix or 'nameless kind of'} file cannot be imported; {known} can")
    files = {each.relative_to(path.parent).as_posix(): each for each in _siblings(path)}
    pieces = load_model(path.name, _Bytes(files))
    usual_unit, usual_up = CONVENTIONS[suffix]
    matrix = (usual_unit if unit is None else unit) * (_Z_TO_Y if (up_axis or usual_up) == "Z" else np.eye(3))
    return write_template(pieces, folder, name, label, matrix, credit, centered=centered)


def license_beside(path: Path) -> str:
    """The text of the license files in a model's folder."""
    found = [each for each in _listed(path.parent) if LICENCE_FILES.fullmatch(each.name) and os.path.isfile(each)]
    texts = (each.read_text("utf-8", "replace") for each in found if each.suffix.lower() in ("", ".txt", ".md"))
    return "\n\n".join(texts)


def write_template(
    pieces: list[Piece],
    folder: Path,
    name: str,
    label: str,
    matrix: NDArray[np.float64],
    credit: Credit,
    *,
    centered: bool = True,
    size: NDArray[np.float64] | None = None,
    movable: bool = True,
) -> Path:
    """Author a template of some pieces. matrix: [3, 3], to meters with y up. size: of its box then, m; None: as it is.

    Raises ExportError.
    """
    points = [piece.points @ matrix.T for piece in pieces]
    low, high = np.min([p.min(axis=0) for p in points], axis=0), np.max([p.max(axis=0) for p in points], axis=0)
    stretch = np.ones(3) if size is None else size / np.where(high - low > 1e-9, high - low, size)
    center = 0.5 * (low + high) if centered else np.zeros(3)
    points = [(p - center) * stretch for p in points]
    turn = np.linalg.inv(stretch[:, None] * matrix)  # normals, as rows
    identifier = Tf.MakeValidIdentifier(re.sub(r"\W+", "", name.title()) or "Model")
    stage = _new_stage(identifier, name, label, credit, movable=movable)
    root = Sdf.Path(f"/{identifier}")
    with _writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        UsdGeom.Scope.Define(stage, root.AppendChild("Looks"))
        UsdGeom.Xform.Define(stage, root.AppendChild("Geometry"))
        for piece, moved in zip(pieces, points, strict=True):
            child = _unused(stage, root.AppendPath("Geometry"), piece.name)
            mesh = _define_mesh(stage, child, piece, moved, piece.normals @ turn, np.linalg.det(matrix) < 0.0)
            UsdPhysics.CollisionAPI.Apply(mesh.GetPrim())
            UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim()).CreateApproximationAttr(UsdPhysics.Tokens.convexHull)
            if piece.colors is None:
                look = _unused(stage, root.AppendPath("Looks"), piece.look.name)
                material = define_look(stage, look, piece.look, folder)
                UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
        box = np.stack(
            [np.min([p.min(axis=0) for p in points], axis=0), np.max([p.max(axis=0) for p in points], axis=0)]
        )
        extents = [Gf.Vec3f(*corner) for corner in box.tolist()]
        UsdGeom.ModelAPI.Apply(stage.GetPrimAtPath(root)).SetExtentsHint(Vt.Vec3fArray(extents))
        return _save(stage, folder, root)


@contextlib.contextmanager
def _writing(folder: Path) -> Iterator[None]:
    """Failures of writing into a folder as ExportError."""
    try:
        yield
    except OSError as error:
        raise ExportError(f"{folder} cannot be written: {error}") from error
    except Tf.ErrorException as error:
        raise ExportError(f"{folder} cannot be written: {' '.join(error_lines(error))}") from error


def _save(stage: Usd.Stage, folder: Path, root: Sdf.Path) -> Path:
    """Geometry as a crate, the rest readable."""
    crate = Sdf.Layer.CreateAnonymous(".usdc")
    geometry = root.AppendChild("Geometry")
    inner = Usd.Stage.Open(crate)
    UsdGeom.SetStageMetersPerUnit(inner, 1.0)
    UsdGeom.SetStageUpAxis(inner, UsdGeom.Tokens.y)
    inner.SetDefaultPrim(UsdGeom.Xform.Define(inner, "/Geometry").GetPrim())
    layer = stage.GetRootLayer()
    Sdf.CopySpec(layer, geometry, crate, Sdf.Path("/Geometry"))
    readable_bindings = {
        str(prim.GetPath()): UsdShade.MaterialBindingAPI(prim).GetDirectBindingRel().GetTargets()
        for prim in Usd.PrimRange(stage.GetPrimAtPath(geometry))
        if prim.IsA(UsdGeom.Mesh)
    }
    for path in readable_bindings:  # a crate knows no materials outside it
        spec = crate.GetPrimAtPath(path.replace(str(geometry), "/Geometry", 1))
        if "material:binding" in spec.relationships:
            del spec.properties["material:binding"]
    stage.RemovePrim(geometry)
    holder = UsdGeom.Xform.Define(stage, geometry)
    crate.Export(str(folder / "geometry.usdc"))
    file = folder / "template.usda"
    layer.Export(str(file))
    saved = Usd.Stage.Open(str(file))
    saved.Reload()
    saved.GetPrimAtPath(holder.GetPath()).GetReferences().AddReference("./geometry.usdc")
    for path, targets in readable_bindings.items():
        if targets:
            saved.OverridePrim(path).CreateRelationship("material:binding", False).SetTargets(targets)
    saved.GetRootLayer().Save()
    return file


def _new_stage(identifier: str, name: str, label: str, credit: Credit, *, movable: bool = True) -> Usd.Stage:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    root = UsdGeom.Xform.Define(stage, f"/{identifier}").GetPrim()
    stage.SetDefaultPrim(root)
    root.SetDisplayName(name)
    Usd.ModelAPI(root).SetKind("component")
    if label:
        UsdSemantics.LabelsAPI.Apply(root, "class").CreateLabelsAttr([label])
    if movable:
        UsdPhysics.RigidBodyAPI.Apply(root).CreateKinematicEnabledAttr(True)
    kept = {key: text for key, text in vars(credit).items() if text}
    stage.GetRootLayer().customLayerData = {"import": kept}
    return stage


def _define_mesh(
    stage: Usd.Stage, path: Sdf.Path, piece: Piece, points: NDArray[Any], normals: NDArray[Any], mirrored: bool
) -> UsdGeom.Mesh:
    triangles = piece.triangles[:, ::-1] if mirrored else piece.triangles
    normals = normals[:, ::-1] if mirrored else normals
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreatePointsAttr(_vectors(points))
    mesh.CreateExtentAttr(_vectors(np.stack([points.min(axis=0), points.max(axis=0)])))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(triangles), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(triangles, np.int32).reshape(-1)))
    flat = normals.reshape(-1, 3)
    mesh.CreateNormalsAttr(_vectors(flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-30)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.faceVarying)
    api = UsdGeom.PrimvarsAPI(mesh)
    if piece.uv is not None:
        kind = Sdf.ValueTypeNames.TexCoord2fArray
        uv = Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(piece.uv, np.float32))
        api.CreatePrimvar("st", kind, UsdGeom.Tokens.vertex).Set(uv)
    if piece.colors is not None:
        api.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex).Set(
            _vectors(piece.colors)
        )
    return mesh


def _vectors(values: NDArray[Any]) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, np.float32))


def _unused(stage: Usd.Stage, folder: Sdf.Path, name: str) -> Sdf.Path:
    identifier = Tf.MakeValidIdentifier(re.sub(r"\W+", "_", name) or "Part")
    path, number = folder.AppendChild(identifier), 1
    while stage.GetPrimAtPath(path):
        number += 1
        path = folder.AppendChild(f"{identifier}_{number}")
    return path


def _import_usd(path: Path, folder: Path, name: str, label: str, centered: bool, credit: Credit) -> Path:
    """A template that refers to a copy of a USD file and of all it needs, in meters, y up and about its center."""
    with quiet(), readable(path):
        source = open_stage(path)
        prim = root_prim(source)
        if not prim:
            raise StageError(
                str(path), ["</> template: the file has no default prim, so that it is unclear what it is"]
            )
        meters = float(UsdGeom.GetStageMetersPerUnit(source))
        matrix = meters * (_Z_TO_Y if UsdGeom.GetStageUpAxis(source) == UsdGeom.Tokens.z else np.eye(3))
        cache = UsdGeom.BBoxCache(reading_time(source, None), [UsdGeom.Tokens.default_, UsdGeom.Tokens.render])
        box = cache.ComputeWorldBound(prim).ComputeAlignedRange()
        center = np.array(box.GetMidpoint()) if centered and not box.IsEmpty() else np.zeros(3)
        with _writing(folder):
            _copy(path, folder / "source")
        identifier = Tf.MakeValidIdentifier(re.sub(r"\W+", "", name.title()) or "Model")
        stage = _new_stage(identifier, name, label, credit)
        child = UsdGeom.Xform.Define(stage, f"/{identifier}/Source")
        placed = np.eye(4)
        placed[:3, :3] = matrix.T  # rows, as USD has it
        placed[3, :3] = -matrix @ center
        child.AddTransformOp().Set(Gf.Matrix4d(*placed.reshape(-1).tolist()))
        child.GetPrim().CreateAttribute("xformOpOrder", Sdf.ValueTypeNames.TokenArray, False)
        inner = stage.DefinePrim(f"/{identifier}/Source/Asset")
        inner.GetReferences().AddReference(f"./source/{path.name}", prim.GetPath())
        _hand_on_variants(prim, stage.GetDefaultPrim(), inner)
        file = folder / "template.usda"
        with _writing(folder):
            stage.GetRootLayer().Export(str(file))
        return file


def _hand_on_variants(source: Usd.Prim, root: Usd.Prim, inner: Usd.Prim) -> None:
    """Give the template's root the variant sets of a model, each of whose variants selects the model's own."""
    sets = source.GetVariantSets()
    for name in sets.GetNames():
        own, chosen = root.GetVariantSets().AddVariantSet(name), sets.GetVariantSelection(name)
        for variant in sets.GetVariantSet(name).GetVariantNames():
            own.AddVariant(variant)
            own.SetVariantSelection(variant)
            with own.GetVariantEditContext():
                inner.GetVariantSets().SetSelection(name, variant)
        if chosen:
            own.SetVariantSelection(chosen)
        else:
            own.ClearVariantSelection()


def _copy(path: Path, folder: Path) -> None:
    """Copy a USD file, and the files that it refers to, to a folder; what is there goes once the copy is whole."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".source-", dir=folder.parent) as beside:
        fresh = Path(beside, folder.name)
        fresh.mkdir()
        if path.suffix.lower() == ".usdz":
            shutil.copy(path, fresh)
        elif not UsdUtils.LocalizeAsset(Sdf.AssetPath(str(path.resolve())), str(fresh)):
            raise StageError(str(path), ["</> template: USD cannot copy it and the files that it refers to"])
        shutil.rmtree(folder, ignore_errors=True)
        fresh.rename(folder)


def _siblings(path: Path) -> list[Path]:
    """The files in a model's folder and the folders in it, not further down: a model does not refer further."""
    own = _listed(path.parent)
    return [each for each in (*own, *(inner for folder in own for inner in _listed(folder))) if os.path.isfile(each)]


def _listed(folder: Path) -> list[Path]:
    """What is in a folder, sorted; nothing for what is none, or may not be listed."""
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []


class _Bytes(Mapping[str, bytes]):
    """Files that are read when they are asked for."""

    def __init__(self, files: Mapping[str, Path]) -> None:
        self._files = files

    def __getitem__(self, name: str) -> bytes:
        return self._files[name].read_bytes()

    def __iter__(self) -> Any:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)
