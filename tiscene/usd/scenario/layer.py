# SPDX-License-Identifier: Apache-2.0
"""OverLayer: a new layer over a scene, with objects that reference their templates, cameras, and their poses."""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdUtils

from tiscene import catalog
from tiscene.errors import ArgumentError, ExportError
from tiscene.scene.camera import Camera
from tiscene.scene.description import Matrix
from tiscene.usd.core.layers import catalog_path, has_file, write_layer
from tiscene.usd.core.pose import PoseOperations, pose_operations, read_pose
from tiscene.usd.core.prims import FALLBACK_TYPES, identifier, unused_path
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import spaced, uninstance
from tiscene.usd.core.stage import Variants, changes_over_time, open_stage, reading_time, select_variants
from tiscene.usd.core.transform import to_matrix
from tiscene.usd.core.units import Units
from tiscene.usd.read.template import TEMPLATES_PRIM, display_name, root_prim
from tiscene.usd.referencing.conversion import Conversion
from tiscene.usd.referencing.convert import convert

_APERTURE = 0.024  # m, vertical aperture of written cameras
_METADATA = (  # that USD reads from the root layer only
    "defaultPrim",
    "timeCodesPerSecond",
    "framesPerSecond",
    "startTimeCode",
    "endTimeCode",
    "kilogramsPerUnit",
    "renderSettingsPrimPath",
    FALLBACK_TYPES,
    "expressionVariables",
)


class OverLayer:
    """A new layer with a scene as its sublayer, made in memory. `export` writes it, with asset paths that travel.

    Attributes:
        layer: the layer.
        stage: the scene with the layer on top.
        below: the scene alone.
        units: unit of length of the scene.
        up_axis: "Y" or "Z", as of the scene.
        root: path of the Scope that holds the new prims.
    """

    def __init__(self, scene: str, name: str, variants: Variants | None = None) -> None:
        """Create the layer.

        Args:
            scene: name or file of the scene.
            name: name of the new root prim; a number is appended if the scene has a prim of that name.
            variants: variant selections, `{"/Room{lighting}": "night"}`, which are authored in the layer.

        Raises:
            SceneNotFound, MissingFile, StageError: the scene cannot be read.
            UnknownName: a variant that the scene does not have.
        """
        file = catalog.find_scene(scene).resolve()
        below = open_stage(file, variants)
        self.layer = Sdf.Layer.CreateAnonymous(".usda")
        self.layer.subLayerPaths.append(str(file))
        for key in _METADATA:
            if below.GetRootLayer().pseudoRoot.HasInfo(key):
                self.layer.pseudoRoot.SetInfo(key, below.GetRootLayer().pseudoRoot.GetInfo(key))
        self.stage = Usd.Stage.Open(self.layer)
        select_variants(self.stage, variants or {}, self.layer)
        UsdGeom.SetStageMetersPerUnit(self.stage, UsdGeom.GetStageMetersPerUnit(below))
        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.GetStageUpAxis(below))
        self.units = Units.of(self.stage)
        self.up_axis = str(UsdGeom.GetStageUpAxis(self.stage))
        self.root = self._scope(self.unused_path(Sdf.Path.absoluteRootPath, name))
        self._templates = {
            display_name(prim) or spaced(prim.GetName()): prim.GetPath()
            for folder in [below.GetPrimAtPath(TEMPLATES_PRIM)]
            if folder and folder.IsAbstract()
            for prim in folder.GetAllChildren()
        }
        self.below = below
        self._hidden: set[str] = set()
        self._start = below.GetStartTimeCode()  # time code of frame 0

    def set_time(self, first: float, last: float, rate: float) -> None:
        """Set the range of time codes, and their rate per second. The scene starts at time code 0, wherever it does."""
        self.stage.SetStartTimeCode(first)
        self.stage.SetEndTimeCode(last)
        self.stage.SetTimeCodesPerSecond(rate)
        self.stage.SetFramesPerSecond(rate)
        self._start = 0.0
        self.layer.subLayerOffsets[0] = self._at_start(self.below)

    def _at_start(self, stage: Usd.Stage) -> Sdf.LayerOffset:
        """Return the offset by which another stage starts at frame 0; none if nothing on it changes."""
        if not changes_over_time(stage):
            return Sdf.LayerOffset()
        rate = self.stage.GetTimeCodesPerSecond() / stage.GetTimeCodesPerSecond()
        return Sdf.LayerOffset(self._start - stage.GetStartTimeCode() * rate)

    def unused_path(self, folder: Sdf.Path, name: str) -> Sdf.Path:
        """Return a path for a new prim below `folder`, named as closely to `name` as USD allows."""
        return unused_path(self.stage, folder, identifier(name))

    def folder(self, name: str) -> Sdf.Path:
        """Return the path of a Scope below the root prim, which is created if needed."""
        path = self.root.AppendChild(name)
        return path if self.stage.GetPrimAtPath(path) else self._scope(path)

    def editable(self, path: str) -> Usd.Prim | None:
        """Return a prim of the scene to override, None if there is none.

        An instance that it is in becomes a plain prim, which still is an object of its own if it was one.
        """
        if not Sdf.Path.IsValidPathString(path):
            return None
        at_path = functools.partial(self.stage.GetPrimAtPath, path)
        uninstance(self.stage, lambda: [prim for prim in [at_path()] if prim and prim.IsInstanceProxy()])
        return at_path() or None

    def define_object(
        self, name: str, template: str, *, euler: bool = False, scale: Sequence[float] = (1.0, 1.0, 1.0)
    ) -> tuple[Usd.Prim, PoseOperations]:
        """Create a prim that references a template.

        A prim of the stage that serves as a template is hidden: the object replaces it.

        Args:
            name: name of the object.
            template: name, file, or path of a prim on the stage.
            euler: whether its rotation is written as Euler angles, else as a quaternion.
            scale: along its own axes.

        Returns:
            The prim, and the operations to write its pose to.

        Raises:
            TemplateNotFound, MissingFile, StageError: the template cannot be read.
            ArgumentError: the template has no prim to reference.
        """
        prim = self.stage.DefinePrim(self.unused_path(self.folder("Objects"), name))
        references = prim.GetReferences()
        stretch = np.eye(4)
        if catalog.is_prim_path(template):
            references.AddInternalReference(template)
            stretch = self._hide(template)
            prim.CreateAttribute("visibility", Sdf.ValueTypeNames.Token, False).Set(UsdGeom.Tokens.inherited)
        elif template in self._templates:
            references.AddInternalReference(self._templates[template])
            stretch = self._own_stretch(self.below.GetPrimAtPath(self._templates[template]))
        else:
            file = catalog.find_template(template).resolve()
            below = open_stage(file)
            root = root_prim(below)
            if root is None:
                raise ArgumentError(f"template {template!r}: {file.name} has no default prim to reference")
            references.AddReference(str(file), root.GetPath(), self._at_start(below))
            for variant_set, variant in catalog.template_variants(template)[1].items():
                prim.GetVariantSets().SetSelection(variant_set, variant)
            report = StageReport(str(file))
            convert(prim, Conversion.between(below, self.stage), report)
            report.warn()
            stretch = self._own_stretch(root)
        if not prim.IsA(UsdGeom.Xformable):  # a template may be a single mesh, or a prim without type
            prim.SetTypeName("Xform")
        if not prim.HasMetadata("kind"):
            Usd.ModelAPI(prim).SetKind("component")
        return prim, pose_operations(prim, euler=euler, scale=scale, stretch=stretch)

    def _own_stretch(self, root: Usd.Prim) -> Matrix:
        """Return the linear part of a template's own transform, its unit and up axis converted to the scene's."""
        stage = root.GetStage()
        stretch = np.eye(4)
        if root.IsA(UsdGeom.Xformable):
            local = UsdGeom.Xformable(root).GetLocalTransformation(reading_time(stage, None))
            stretch[:3, :3] = to_matrix(local, 1.0)[:3, :3]
        up_axis = str(UsdGeom.GetStageUpAxis(stage))
        if up_axis != self.up_axis:
            sign = 1.0 if self.up_axis == "Z" else -1.0
            stretch = np.array([[1, 0, 0, 0], [0, 0, -sign, 0], [0, sign, 0, 0], [0, 0, 0, 1.0]]) @ stretch
        stretch[:3, :3] *= Units.of(stage).meters / self.units.meters
        return stretch

    def _hide(self, path: str) -> Matrix:
        """Hide a prim of the scene and return its scale and stretch."""
        prim = self.below.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
        pose = read_pose(prim, reading_time(self.below, None), self.units) if prim else "it does not exist"
        if isinstance(pose, str):
            raise ArgumentError(f"the stage's prim {path!r} cannot serve as a template: {pose}")
        if path not in self._hidden:
            UsdGeom.Imageable(self.stage.OverridePrim(path)).CreateVisibilityAttr(UsdGeom.Tokens.invisible)
            self._hidden.add(path)
        stretch: Matrix = np.diag([*pose.scale, 1.0]) @ pose.stretch
        return stretch

    def define_camera(self, camera: Camera) -> tuple[Usd.Prim, PoseOperations]:
        """Create a camera with the lens of another; return its prim and the operations to write its pose to."""
        path = self.unused_path(self.folder("Cameras"), camera.name)
        prim = UsdGeom.Camera.Define(self.stage, path).GetPrim()
        if camera.orthographic_height is not None:
            UsdGeom.Camera(prim).CreateProjectionAttr(UsdGeom.Tokens.orthographic)
        for name, value in self._lens(camera).items():
            prim.GetAttribute(name).Set(value)
        return prim, pose_operations(prim, euler=False)

    def write_lens(self, prim: Usd.Prim, cameras: Mapping[int, Camera]) -> None:
        """Write the lens of a camera as time samples of what varies; `cameras`: it at each time code."""
        lenses = {time: self._lens(camera) for time, camera in cameras.items()}
        for name in sorted(set().union(*lenses.values())):
            values = {time: lens.get(name, 0.0) for time, lens in lenses.items()}  # 0: not authored
            if len(set(map(str, values.values()))) > 1:
                for time, value in values.items():
                    prim.GetAttribute(name).Set(value, Usd.TimeCode(time))

    def _lens(self, camera: Camera) -> dict[str, Any]:
        """Return the values of a camera's attributes."""
        per_meter = 1.0 / self.units.meters
        height = _APERTURE * per_meter * 10.0  # apertures and focal length are in tenths of a stage unit
        focal_length = height / (2.0 * math.tan(0.5 * camera.vertical_fov))
        if camera.orthographic_height is not None:
            height = camera.orthographic_height * per_meter * 10.0
        lens: dict[str, Any] = {
            "verticalAperture": height,
            "horizontalAperture": height * (camera.aspect or 4.0 / 3.0),
            "focalLength": focal_length,
        }
        if any(camera.aperture_offset):
            unit = focal_length if camera.orthographic_height is None else per_meter * 10.0
            lens["horizontalApertureOffset"], lens["verticalApertureOffset"] = (
                offset * unit for offset in camera.aperture_offset
            )
        lens["focusDistance"] = camera.focus_distance * per_meter
        if camera.lens_radius > 0.0:
            lens["fStop"] = focal_length / 10.0 / (2.0 * camera.lens_radius * per_meter)
        lens["clippingRange"] = Gf.Vec2f(camera.near * per_meter, camera.far * per_meter)
        if camera.shutter_open or camera.shutter_close:
            lens |= {"shutter:open": camera.shutter_open, "shutter:close": camera.shutter_close}
        if camera.exposure is not None:
            lens["exposure"] = camera.exposure
        return lens

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the layer to a file.

        Files of the catalog are referred to by their paths in it, such as `room_02/scene.usda`, which USD looks for in
        the folders of its search path; other files by paths relative to this one.

        Args:
            path: file that ends in .usda, .usdc or .usd.

        Raises:
            ArgumentError: another suffix, or a file of the scene or of a template, which would be lost.
            ExportError: the file cannot be written.
        """
        path = Path(path)
        if path.suffix.lower() not in catalog.LAYER_SUFFIXES:
            raise ArgumentError(
                f"path={str(path)!r}: a USD layer is a file that ends in {', '.join(catalog.LAYER_SUFFIXES)}"
            )
        if has_file(self.stage, path):
            raise ArgumentError(
                f"path={str(path)!r}: is a file of the scene, to which the layer refers; write another file"
            )
        folder = path.resolve().parent
        copy = Sdf.Layer.CreateAnonymous(path.suffix)
        copy.TransferContent(self.layer)
        UsdUtils.ModifyAssetPaths(copy, lambda asset: _portable(asset, folder))
        copy.subLayerOffsets[0] = self.layer.subLayerOffsets[0]  # which USD drops with the path
        if not folder.is_dir():
            raise ExportError(f"cannot write {str(path)!r}: there is no folder {str(folder)!r}")
        write_layer(copy, path)

    def _scope(self, path: Sdf.Path) -> Sdf.Path:
        return self.stage.DefinePrim(path, "Scope").GetPath()


def _portable(asset: str, folder: Path) -> str:
    """Return an absolute path as one in the catalog, else relative to a folder; unchanged if it is on another drive."""
    name = catalog_path(Path(asset))
    if name is not None and catalog_path(folder) is None:
        return name
    try:
        relative = Path(os.path.relpath(asset, folder)).as_posix()
    except ValueError:
        return asset
    return relative if relative.startswith(".") else f"./{relative}"
