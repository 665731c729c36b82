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
    camera = _read_at(prim, world_from_prim, time, meters_per_unit, report, settings)
    if is_time_varying(prim.GetAttribute("projection")):
        report.frozen(prim.GetPath(), "projection of a camera")
    varying = [name for name in _LENS_ATTRIBUTES if is_time_varying(prim.GetAttribute(name))]
    if camera is None or not varying or not report.reads_animation:
        return camera
    times: set[float] = set()
    for name in varying:
        samples = value_times(prim.GetAttribute(name))
        times.update(samples if name in _LINEAR_ATTRIBUTES else dense_times(samples))  # such as focal length / aperture
    start, ignored = prim.GetStage().GetStartTimeCode(), StageReport("")
    codes = sorted({max(code, start) for code in times})
    lenses = {}
    for code in codes:
        lens = _read_at(prim, world_from_prim, Usd.TimeCode(code), meters_per_unit, ignored, settings)
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


def _read_at(
    prim: Usd.Prim,
    world_from_prim: Matrix,
    time: Usd.TimeCode,
    meters_per_unit: float,
    report: StageReport,
    settings: StageRenderSettings,
) -> Camera | None:
    """Read a camera at a time code; arguments as of `read_camera`."""
    path = prim.GetPath()
    camera = UsdGeom.Camera(prim)

    def number(name: str) -> float:
        value = value_at(prim.GetAttribute(name), time)
        return math.nan if value is None else float(value)

    orthographic = token_of(camera.GetProjectionAttr(), time, report) == UsdGeom.Tokens.orthographic
    upright = unmirrored(world_from_prim)
    if upright is not world_from_prim:
        report.omission(path, "the image of a mirrored camera is not mirrored")
    pose = unscaled(upright)
    if pose is None:
        report.problem(path, "camera", "its transform is singular or not finite")
        return None
    aperture, focal_length = number("verticalAperture"), number("focalLength")
    if orthographic:
        focal_length = 1.0  # unused
    if not (aperture > 0.0 and focal_length > 0.0 and math.isfinite(aperture) and math.isfinite(focal_length)):
        text = f"verticalAperture {aperture} and focalLength {focal_length} must be positive numbers"
        report.problem(path, "camera", text)
        return None
    optional: dict[str, Any] = {}
    offset = number("horizontalApertureOffset"), number("verticalApertureOffset")
    if all(abs(each) <= _MAX_APERTURE * (aperture if orthographic else focal_length) for each in offset):
        scale = meters_per_unit / 10.0 if orthographic else 1.0 / focal_length
        optional["aperture_offset"] = (offset[0] * scale, offset[1] * scale)
    else:
        report.omission(
            path, f"a camera's aperture offset of {offset[0]:g}, {offset[1]:g} is not used: it is too large"
        )
    width = number("horizontalAperture")
    if settings.policy != "adjustApertureWidth":  # that policy keeps the height in all images
        if 0.0 < width < math.inf and (orthographic or width <= _MAX_APERTURE * focal_length):
            optional.update(aspect=width / aperture, conform=settings.policy)
        else:
            allowed = f"positive, and at most {_MAX_APERTURE:g} focal lengths"
            report.omission(path, f"a camera's horizontalAperture of {width:g} is not used: it must be {allowed}")
    f_stop, focus = number("fStop"), number("focusDistance")
    if orthographic:
        optional["orthographic_height"] = aperture / 10.0 * meters_per_unit
    elif f_stop > 0.0 and focus > 0.0 and settings.has_depth_of_field:
        optional["lens_radius"] = focal_length / 10.0 * meters_per_unit / (2.0 * f_stop)
    if focus > 0.0:
        optional["focus_distance"] = focus * meters_per_unit
    clipping = camera.GetClippingRangeAttr()
    if clipping.HasAuthoredValue():
        near, far = (float(distance) * meters_per_unit for distance in value_at(clipping, time))
        if 0.0 < near < far:
            optional.update(near=near, far=far)
        else:
            report.omission(path, f"a camera's clippingRange of {near:g} to {far:g} m is not used")
    if camera.GetClippingPlanesAttr().Get(time):
        report.omission(path, "clippingPlanes of a camera cut nothing")
    for name in _LENS_MODELS:
        model = prim.GetAttribute(name).Get(time)
        if model is not None and model != "pinhole":
            report.omission(path, f"the lens of a camera with the {name} {str(model)!r} is drawn without distortion")
    if any(str(each).startswith("BackPlateAPI:") for each in prim.GetAppliedSchemas()):
        report.omission(path, "back plates of a camera are not drawn")
    shutter_open, shutter_close = number("shutter:open"), number("shutter:close")
    if not settings.has_motion_blur:
        shutter_open = shutter_close = 0.0
    if -1.0 <= shutter_open <= shutter_close <= 1.0:
        optional.update(shutter_open=shutter_open, shutter_close=shutter_close)
    else:
        text = f"a camera's shutter from {shutter_open:g} to {shutter_close:g} frames is not used: at most -1 to 1"
        report.omission(path, text)
    if any(prim.GetAttribute(name).HasAuthoredValue() for name in _EXPOSURE_ATTRIBUTES):
        scale = exposure_scale(*(number(name) for name in _EXPOSURE_ATTRIBUTES))
        if not (scale > 0.0 and math.isfinite(scale)):
            report.problem(path, "camera", f"its exposure attributes scale the image by {scale}")
            return None
        optional["exposure"] = math.log2(scale)
    try:
        return Camera(
            position=(float(pose[0, 3]), float(pose[1, 3]), float(pose[2, 3])),
            rotation=quaternion_from_matrix(pose[:3, :3]),
            vertical_fov=Camera.vertical_fov if orthographic else 2.0 * math.atan(aperture / (2.0 * focal_length)),
            name=prim.GetName(),
            **optional,
        )
    except ArgumentError as error:
        report.problem(path, "camera", str(error))
        return None


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
