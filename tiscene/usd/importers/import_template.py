# SPDX-License-Identifier: Apache-2.0
"""Import of model files as object templates.

A template is a folder with template.usda, its geometry and its textures. It has a semantic label, colliders and the
model's license, is in meters with y up, and is usually centered at its bounding box.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdPhysics, UsdSemantics, UsdShade, UsdUtils, Vt

from tiscene.errors import ArgumentError, ExportError, MissingFile, StageError
from tiscene.usd.core.broken_prims import deactivate_broken
from tiscene.usd.core.package import split_package
from tiscene.usd.core.prims import DRAWN_PURPOSES, FALLBACK_TYPES, unused_path
from tiscene.usd.core.report import StageReport, error_lines
from tiscene.usd.core.stage import open_stage, quiet, readable, reading_time
from tiscene.usd.importers.imported_mesh import ImportedMesh
from tiscene.usd.importers.imported_mesh_writer import author_samples, define_mesh
from tiscene.usd.importers.materials import define_material
from tiscene.usd.importers.mesh_file import CONVENTIONS, LazyFiles, load_model
from tiscene.usd.read.template import root_prim
from tiscene.usd.referencing.conversion import Conversion
from tiscene.usd.referencing.convert import convert
from tiscene.usd.referencing.forwarded_variants import forward_variants

USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
LICENSE_FILES = re.compile(r"(licen[cs]e|copying|credits?|attribution).*", re.IGNORECASE)
_Z_TO_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class Credit:
    """Origin of a model, kept in the template's layer as customLayerData `import`.

    Attributes:
        source: the file it was imported from.
        license: text of its license.
        author: its author.
    """

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
    """Import a model file (OBJ, glTF, PLY, STL, any USD) as a template.

    Missing textures and unsupported features of the file are named in a StageWarning.

    Args:
        path: the model file.
        folder: folder of the template; created if needed.
        name: displayName of the template; "" for the file's name.
        label: semantic class; "" for the USD file's own, or none.
        unit: meters per unit of the file; None for its format's convention. Not for USD files, which define it.
        up_axis: "Y" or "Z"; None for its format's convention. Not for USD files, which define it.
        centered: whether the template's origin is the center of its bounding box, rather than the file's origin.
        license: text of the license; "" for the license files beside the model.
        author: the model's author.

    Returns:
        The file `folder`/template.usda.

    Raises:
        MissingFile: there is no file at `path`.
        ArgumentError: an argument is invalid, or the format is not supported.
        StageError: the file cannot be read.
        ExportError: the template cannot be written.
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
            raise ArgumentError(
                f"{path.name} is a USD file, which defines its unit and up axis: leave out unit and up_axis"
            )
        report = StageReport(str(path))
        file = _import_usd(path, folder, name, label, centered, credit, report)
        report.warn()
        return file
    if suffix not in CONVENTIONS:
        known = ", ".join((*CONVENTIONS, *USD_SUFFIXES, ".sh3f"))
        raise ArgumentError(
            f"{path.name}: files of type {suffix or 'unknown'} cannot be imported; expected one of {known}"
        )
    readers = {each.relative_to(path.parent).as_posix(): each.read_bytes for each in _siblings(path)}
    meshes = load_model(path.name, LazyFiles(readers, path.parent))
    default_unit, default_up = CONVENTIONS[suffix]
    matrix = (default_unit if unit is None else unit) * (_Z_TO_Y if (up_axis or default_up) == "Z" else np.eye(3))
    return write_template(meshes, folder, name, label, matrix, credit, centered=centered)


def license_beside(path: Path) -> str:
    """Return the text of the license files in a model's folder; "" if there are none."""
    found = [each for each in _listed(path.parent) if LICENSE_FILES.fullmatch(each.name) and os.path.isfile(each)]
    texts = (each.read_text("utf-8", "replace") for each in found if each.suffix.lower() in ("", ".txt", ".md"))
    return "\n\n".join(texts)


def write_template(
    meshes: list[ImportedMesh],
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
    """Author a template of meshes.

    Args:
        meshes: its geometry and materials.
        folder: folder of the template; created if needed.
        name: its displayName.
        label: semantic class; "" for none.
        matrix: 3x3, from the meshes' space to meters with y up.
        credit: origin of the model.
        centered: whether the origin is the center of the bounding box.
        size: size that the bounding box is stretched to, [3], m; None keeps it.
        movable: whether the template is a rigid body.

    Returns:
        The file `folder`/template.usda.

    Raises:
        ExportError: it cannot be written.
    """
    points = [mesh.points @ matrix.T for mesh in meshes]
    low, high = _bounds(points)
    stretch = np.ones(3) if size is None else size / np.where(high - low > 1e-9, high - low, size)
    center = 0.5 * (low + high) if centered else np.zeros(3)
    points = [(p - center) * stretch for p in points]
    normal_matrix = np.linalg.inv(stretch[:, None] * matrix)  # for normals as rows
    stage = _new_stage(name, label, credit, movable=movable)
    root = stage.GetDefaultPrim().GetPath()
    with _writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        UsdGeom.Scope.Define(stage, root.AppendChild("Looks"))
        UsdGeom.Xform.Define(stage, root.AppendChild("Geometry"))
        for imported, placed in zip(meshes, points, strict=True):
            child = unused_path(stage, root.AppendChild("Geometry"), _identifier(imported.name))
            is_mirrored = bool(np.linalg.det(matrix) < 0.0)
            mesh = define_mesh(stage, child, imported, placed, imported.normals @ normal_matrix, is_mirrored)
            if imported.samples is not None:
                moved = (imported.samples.points @ matrix.T - center) * stretch
                author_samples(mesh, imported, moved, imported.samples.normals @ normal_matrix, is_mirrored)
            UsdPhysics.CollisionAPI.Apply(mesh.GetPrim())
            UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim()).CreateApproximationAttr(UsdPhysics.Tokens.convexHull)
            if imported.colors is None or imported.material.vertex_inputs:
                path = unused_path(stage, root.AppendChild("Looks"), _identifier(imported.material.name))
                material = define_material(stage, path, imported.material, folder)
                UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
        extents = [Gf.Vec3f(*corner.tolist()) for corner in _bounds(points)]
        UsdGeom.ModelAPI.Apply(stage.GetPrimAtPath(root)).SetExtentsHint(Vt.Vec3fArray(extents))
        return _save(stage, folder, root)


def _bounds(parts: list[NDArray[np.float64]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and highest corner [3] of the box around points, each part [n, 3]."""
    return np.min([each.min(axis=0) for each in parts], axis=0), np.max([each.max(axis=0) for each in parts], axis=0)


@contextlib.contextmanager
def _writing(folder: Path) -> Iterator[None]:
    """Turn failures of writing into a folder into ExportError."""
    try:
        yield
    except OSError as error:
        raise ExportError(f"{folder} cannot be written: {error}") from error
    except Tf.ErrorException as error:
        raise ExportError(f"{folder} cannot be written: {' '.join(error_lines(error))}") from error


def _save(stage: Usd.Stage, folder: Path, root: Sdf.Path) -> Path:
    """Save a template: geometry in geometry.usdc, the rest in template.usda as text. Return the latter."""
    crate = Sdf.Layer.CreateAnonymous(".usdc")
    geometry = root.AppendChild("Geometry")
    inner = Usd.Stage.Open(crate)
    UsdGeom.SetStageMetersPerUnit(inner, 1.0)
    UsdGeom.SetStageUpAxis(inner, UsdGeom.Tokens.y)
    inner.SetDefaultPrim(UsdGeom.Xform.Define(inner, "/Geometry").GetPrim())
    layer = stage.GetRootLayer()
    if layer.HasTimeCodesPerSecond():
        crate.timeCodesPerSecond = layer.timeCodesPerSecond
    Sdf.CopySpec(layer, geometry, crate, Sdf.Path("/Geometry"))
    bindings = {
        str(prim.GetPath()): UsdShade.MaterialBindingAPI(prim).GetDirectBindingRel().GetTargets()
        for prim in Usd.PrimRange(stage.GetPrimAtPath(geometry))
        if prim.IsA(UsdGeom.Mesh)
    }
    for path in bindings:  # the crate must not refer to materials outside it
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
    for path, targets in bindings.items():
        if targets:
            saved.OverridePrim(path).CreateRelationship("material:binding", False).SetTargets(targets)
    saved.GetRootLayer().Save()
    return file


def _new_stage(name: str, label: str, credit: Credit, *, movable: bool = True) -> Usd.Stage:
    """Create a template's stage in memory, with its root prim."""
    identifier = Tf.MakeValidIdentifier(re.sub(r"\W+", "", name.title()) or "Model")
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
    import_data = {key: text for key, text in vars(credit).items() if text}
    stage.GetRootLayer().customLayerData = {"import": import_data}
    return stage


def _identifier(name: str) -> str:
    """Return the name of the prim for a mesh or a material."""
    return str(Tf.MakeValidIdentifier(re.sub(r"\W+", "_", name) or "Part"))


def _import_usd(
    path: Path, folder: Path, name: str, label: str, centered: bool, credit: Credit, report: StageReport
) -> Path:
    """Author a template that references a copy of a USD file, transformed to meters with y up."""
    with quiet(), readable(path):
        source = open_stage(path, report=report)
        prims = Usd.PrimRange.Stage(source, Usd.TraverseInstanceProxies())
        report.raise_problems(anything_left=any(each.IsA(UsdGeom.Boundable) for each in prims))
        prim = root_prim(source)
        if not prim:
            raise StageError(
                str(path), ["</> template: the file has no default prim, so that it is unclear what to import"]
            )
        deactivate_broken(source.GetPseudoRoot(), report)
        report.raise_problems(anything_left=prim.IsActive())
        meters = float(UsdGeom.GetStageMetersPerUnit(source))
        matrix = meters * (_Z_TO_Y if UsdGeom.GetStageUpAxis(source) == UsdGeom.Tokens.z else np.eye(3))
        cache = UsdGeom.BBoxCache(reading_time(source, None), DRAWN_PURPOSES)
        box = cache.ComputeWorldBound(prim).ComputeAlignedRange()
        center = np.array(box.GetMidpoint()) if centered and not box.IsEmpty() else np.zeros(3)
        with _writing(folder):
            _copy_with_dependencies(path, folder / "source", report)
        stage = _new_stage(name, label, credit)
        if fallbacks := source.GetMetadata(FALLBACK_TYPES):
            stage.GetRootLayer().pseudoRoot.SetInfo(FALLBACK_TYPES, fallbacks)
        if source.HasAuthoredTimeCodeRange():  # its animation begins there
            stage.SetTimeCodesPerSecond(source.GetTimeCodesPerSecond())
            stage.SetStartTimeCode(source.GetStartTimeCode())
            stage.SetEndTimeCode(source.GetEndTimeCode())
        child = UsdGeom.Xform.Define(stage, stage.GetDefaultPrim().GetPath().AppendChild("Source"))
        transform = np.eye(4)
        transform[:3, :3] = matrix.T  # USD multiplies row vectors
        transform[3, :3] = -matrix @ center
        conversion = replace(Conversion.between(source, stage), world=Gf.Matrix4d(transform.tolist()))
        child.AddTransformOp().Set(conversion.world)
        child.GetPrim().CreateAttribute("xformOpOrder", Sdf.ValueTypeNames.TokenArray, False)
        inner = stage.DefinePrim(child.GetPath().AppendChild("Asset"))
        inner.GetReferences().AddReference(f"./source/{path.name}", prim.GetPath())
        forward_variants(stage.GetDefaultPrim(), {inner.GetPath(): prim})
        file = folder / "template.usda"
        with _writing(folder):
            stage.GetRootLayer().Export(str(file))
            saved = Usd.Stage.Open(str(file))
            saved.Reload()
            convert(saved.GetPrimAtPath(inner.GetPath()), conversion, report)
            if saved.GetRootLayer().dirty:
                saved.Save()
        return file


def _copy_with_dependencies(path: Path, folder: Path, report: StageReport) -> None:
    """Copy a USD file and its dependencies to a folder, which is replaced only once the copy is complete.

    Dependencies that do not exist are reported.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".source-", dir=folder.parent) as beside:
        fresh = Path(beside, folder.name)
        fresh.mkdir()
        if path.suffix.lower() == ".usdz":
            shutil.copy(path, fresh)
        elif not UsdUtils.LocalizeAsset(Sdf.AssetPath(str(path.resolve())), str(fresh)):
            layers, assets, missing = UsdUtils.ComputeAllDependencies(str(path.resolve()))
            files = {split_package(each)[0] for each in (*(layer.realPath for layer in layers), *assets)}
            if not missing or sum(each.is_file() for each in fresh.rglob("*")) < len(files):
                raise StageError(str(path), ["</> template: USD cannot copy the file and its dependencies"])
            for file in missing:
                report.omission(file, "files that do not exist are not copied into the template")
        shutil.rmtree(folder, ignore_errors=True)
        fresh.rename(folder)


def _siblings(path: Path) -> list[Path]:
    """Return the files in a model's folder and its subfolders, one level deep, where models keep their textures."""
    own = _listed(path.parent)
    return [each for each in (*own, *(inner for folder in own for inner in _listed(folder))) if os.path.isfile(each)]


def _listed(folder: Path) -> list[Path]:
    """Return the sorted entries of a folder; empty for anything else and for folders that may not be listed."""
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []
