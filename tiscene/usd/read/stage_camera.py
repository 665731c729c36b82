# SPDX-License-Identifier: Apache-2.0
"""UsdGeomCamera: apertures and focal length are in tenths of a scene unit, distances in scene units."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

from pxr import Sdf, Usd, UsdGeom

from tiscene.errors import ArgumentError
from tiscene.scene.camera import Camera, quaternion_from_matrix
from tiscene.scene.description import Matrix
from tiscene.scene.lens_keyframes import LensKeyframes
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.time_samples import in_seconds
from tiscene.usd.core.transform import unmirrored, unscaled
from tiscene.usd.core.value_times import dense_times, is_time_varying, value_at, value_times
from tiscene.usd.geometry.primvar import token_of
from tiscene.usd.read.stage_render_settings import StageRenderSettings

_MAX_APERTURE = 1e6  # in focal lengths: a field of view of 180 degrees but for 0.0002
_EXPOSURE_ATTRIBUTES = ("exposure", "exposure:iso", "exposure:time", "exposure:fStop", "exposure:responsivity")
_LINEAR_ATTRIBUTES = ("focusDistance", "clippingRange", "shutter:open", "shutter:close", "exposure")
_LENS_ATTRIBUTES = (
    *_LINEAR_ATTRIBUTES,
    *("focalLength", "fStop", "horizontalAperture", "verticalAperture"),
    *("horizontalApertureOffset", "verticalApertureOffset"),
    *_EXPOSURE_ATTRIBUTES[1:],
)
_LENS_MODELS = ("cameraProjectionType", "omni:lensdistortion:model")  # Omniverse's attributes, older and newer
_OPTIONAL = ("aspect", "exposure")  # of a `Camera`; None says that the stage has no valid value


def read_camera(
    prim: Usd.Prim,
    world_from_prim: Matrix,
    time: Usd.TimeCode,
    meters_per_unit: float,
    report: StageReport,
    settings: StageRenderSettings,
) -> Camera | None:
    """Read a camera, with keyframes of its lens if that has time samples and the stage plays.

    Args:
        prim: the camera.
        world_from_prim: float64 4x4, m.
        time: time code of frame 0.
        meters_per_unit: meters per stage unit.
        report: receives problems and omissions.
        settings: what the stage's RenderSettings say.

    Returns:
        The camera. Its exposure is None if no exposure attribute is authored: the stream meters it. None, with a
        problem reported, for an invalid camera.
    """
    camera = _CameraReader(prim, time, meters_per_unit, report, settings).read(world_from_prim)
    if is_time_varying(prim.GetAttribute("projection")):
        report.frozen(prim.GetPath(), "projection of a camera")
    varying = [name for name in _LENS_ATTRIBUTES if is_time_varying(prim.GetAttribute(name))]
    if camera is None or not varying or not report.reads_animation:
        return camera
    times: set[float] = set()
    for name in varying:
        samples = value_times(prim.GetAttribute(name))  # focal length / aperture, for one, is not linear between them
        times.update(samples if name in _LINEAR_ATTRIBUTES else dense_times(samples, prim.GetStage()))
    start, ignored = prim.GetStage().GetStartTimeCode(), StageReport("")
    codes = sorted({max(code, start) for code in times})
    lenses = {}
    for code in codes:
        lens = _CameraReader(prim, Usd.TimeCode(code), meters_per_unit, ignored, settings).read(world_from_prim)
        if lens is not None and _authored(lens) == _authored(camera):
            lenses[code] = lens
    if len(lenses) < len(codes):
        text = "a camera's lens is not valid at some time samples; those before and after them are used"
        report.omission(prim.GetPath(), text)
    return replace(camera, lens=_keyframes(list(lenses.values()), in_seconds(prim.GetStage(), list(lenses)).tolist()))


def _authored(camera: Camera) -> list[Any]:
    """Return what two lenses must have in common to be keyframes of one camera."""
    return [camera.orthographic_height is None, *(getattr(camera, name) is None for name in _OPTIONAL)]


def _keyframes(lenses: Sequence[Camera], seconds: Sequence[float]) -> LensKeyframes | None:
    """Return the keyframes of a camera's lens at some times; None if nothing varies."""
    names = [each.name for each in fields(LensKeyframes) if each.name != "times"]
    values = {name: [getattr(lens, name) for lens in lenses] for name in names}
    varying = {name: each for name, each in values.items() if any(value != each[0] for value in each)}
    return LensKeyframes(seconds, **varying) if varying else None


class _CameraReader:
    """Reads a camera at a time code; arguments as of `read_camera`. Values that cannot be used are left out."""

    def __init__(
        self,
        prim: Usd.Prim,
        time: Usd.TimeCode,
        meters_per_unit: float,
        report: StageReport,
        settings: StageRenderSettings,
    ) -> None:
        self._prim, self._time, self._meters = prim, time, meters_per_unit
        self._report, self._settings = report, settings
        projection = token_of(UsdGeom.Camera(prim).GetProjectionAttr(), time, report)
        self._is_orthographic = projection == UsdGeom.Tokens.orthographic
        self._aperture = self._number("verticalAperture")
        self._focal_length = 1.0 if self._is_orthographic else self._number("focalLength")  # 1: unused

    def read(self, world_from_prim: Matrix) -> Camera | None:
        """Return the camera; None, with a problem reported, for an invalid one."""
        upright = unmirrored(world_from_prim)
        if upright is not world_from_prim:
            self._omit("the image of a mirrored camera is not mirrored")
        pose = unscaled(upright)
        fault = "its transform is singular or not finite" if pose is None else self._fault()
        if pose is not None and not fault:
            (x, y, z), rotation = pose[:3, 3].tolist(), quaternion_from_matrix(pose[:3, :3])
            try:
                return Camera((x, y, z), rotation, name=self._prim.GetName(), **self._fields())
            except ArgumentError as error:
                fault = str(error)
        self._report.problem(self._prim.GetPath(), "camera", fault)
        return None

    def _number(self, name: str) -> float:
        value = value_at(self._prim.GetAttribute(name), self._time)
        return math.nan if value is None else float(value)

    def _omit(self, text: str) -> None:
        self._report.omission(self._prim.GetPath(), text)

    def _exposure_scale(self) -> float | None:
        """Return the linear exposure scale; None if no exposure attribute is authored."""
        if not any(self._prim.GetAttribute(name).HasAuthoredValue() for name in _EXPOSURE_ATTRIBUTES):
            return None
        return exposure_scale(*map(self._number, _EXPOSURE_ATTRIBUTES))

    def _fault(self) -> str:
        """Return why there is no camera, "" if there is one."""
        if not (0.0 < self._aperture < math.inf and 0.0 < self._focal_length < math.inf):
            values = f"verticalAperture {self._aperture} and focalLength {self._focal_length}"
            return f"{values} must be positive numbers"
        scale = self._exposure_scale()
        if scale is not None and not 0.0 < scale < math.inf:
            return f"its exposure attributes scale the image by {scale}"
        return ""

    def _fields(self) -> dict[str, Any]:
        """Return the fields, without those that keep their defaults; report what is not applied."""
        self._report_unapplied()
        fields = self._view() | self._framing() | self._focus() | self._clipping() | self._shutter()
        scale = self._exposure_scale()
        return fields if scale is None else fields | {"exposure": math.log2(scale)}

    def _view(self) -> dict[str, Any]:
        if self._is_orthographic:
            return {"orthographic_height": self._aperture / 10.0 * self._meters}
        return {"vertical_fov": 2.0 * math.atan(self._aperture / (2.0 * self._focal_length))}

    def _framing(self) -> dict[str, Any]:
        """Return the proportions of the aperture, and where the image is in it."""
        found: dict[str, Any] = {}
        x, y = self._number("horizontalApertureOffset"), self._number("verticalApertureOffset")
        unit = self._aperture if self._is_orthographic else self._focal_length
        if abs(x) <= _MAX_APERTURE * unit and abs(y) <= _MAX_APERTURE * unit:
            scale = self._meters / 10.0 if self._is_orthographic else 1.0 / self._focal_length
            found["aperture_offset"] = (x * scale, y * scale)
        else:
            self._omit(f"a camera's aperture offset of {x:g}, {y:g} is not used: it is too large")
        if self._settings.policy == "adjustApertureWidth":  # keeps the height in all images
            return found
        width = self._number("horizontalAperture")
        if 0.0 < width < math.inf and (self._is_orthographic or width <= _MAX_APERTURE * self._focal_length):
            return found | {"aspect": width / self._aperture, "conform": self._settings.policy}
        allowed = f"positive, and at most {_MAX_APERTURE:g} focal lengths"
        self._omit(f"a camera's horizontalAperture of {width:g} is not used: it must be {allowed}")
        return found

    def _focus(self) -> dict[str, Any]:
        found = {}
        f_stop, distance = self._number("fStop"), self._number("focusDistance")
        has_blur = not self._is_orthographic and self._settings.has_depth_of_field
        if has_blur and f_stop > 0.0 and distance > 0.0:
            found["lens_radius"] = self._focal_length / 10.0 * self._meters / (2.0 * f_stop)
        if distance > 0.0:
            found["focus_distance"] = distance * self._meters
        return found

    def _clipping(self) -> dict[str, Any]:
        clipping = UsdGeom.Camera(self._prim).GetClippingRangeAttr()
        if not clipping.HasAuthoredValue():
            return {}
        near, far = (float(distance) * self._meters for distance in value_at(clipping, self._time))
        if 0.0 < near < far:
            return {"near": near, "far": far}
        self._omit(f"a camera's clippingRange of {near:g} to {far:g} m is not used")
        return {}

    def _report_unapplied(self) -> None:
        if UsdGeom.Camera(self._prim).GetClippingPlanesAttr().Get(self._time):
            self._omit("clippingPlanes of a camera cut nothing")
        for name in _LENS_MODELS:
            model = self._prim.GetAttribute(name).Get(self._time)
            if model is not None and model != "pinhole":
                self._omit(f"the lens of a camera with the {name} {str(model)!r} is drawn without distortion")
        if any(str(each).startswith("BackPlateAPI:") for each in self._prim.GetAppliedSchemas()):
            self._omit("back plates of a camera are not drawn")

    def _shutter(self) -> dict[str, Any]:
        if not self._settings.has_motion_blur:
            return {"shutter_open": 0.0, "shutter_close": 0.0}
        opens, closes = self._number("shutter:open"), self._number("shutter:close")
        if -1.0 <= opens <= closes <= 1.0:
            return {"shutter_open": opens, "shutter_close": closes}
        self._omit(f"a camera's shutter from {opens:g} to {closes:g} frames is not used: at most -1 to 1")
        return {}


def exposure_scale(exposure: float, iso: float, time: float, f_stop: float, responsivity: float) -> float:
    """Return UsdGeomCamera's linear exposure scale: 1 for the defaults, NaN or infinity for invalid values."""
    try:
        return responsivity * time * iso / 100.0 * math.exp2(exposure) / (f_stop * f_stop)
    except (OverflowError, ZeroDivisionError):
        return math.nan


def unique_names(paths: Sequence[Sdf.Path]) -> dict[Sdf.Path, str]:
    """Return different names for cameras, by path.

    Of several prims with the same name, the one nearest to the stage's root keeps it. The others are named by their
    paths, from the first prim in which the paths of all of them differ: "kitchen/Cameras/Main".

    Args:
        paths: of the cameras, the main one first.
    """
    groups: dict[str, list[Sdf.Path]] = {}
    for path in paths:
        groups.setdefault(path.name, []).append(path)
    names: dict[Sdf.Path, str] = {}
    for name, same in groups.items():
        shared = functools.reduce(lambda a, b: a.GetCommonPrefix(b), same)
        keeper = min(same, key=lambda path: path.pathElementCount)
        names |= {path: name if path == keeper else str(path.MakeRelativePath(shared)) for path in same}
    return names
