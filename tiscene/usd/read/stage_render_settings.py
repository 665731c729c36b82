# SPDX-License-Identifier: Apache-2.0
"""UsdRender: the camera, the resolution and how cameras make images, as a stage's RenderSettings author them.

RenderProducts override the settings that they author themselves; the first product counts. Values that are not authored
are left to the caller: USD's fallback resolution is not the author's choice.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Gf, Usd, UsdGeom, UsdRender

from tiscene.usd.core.report import StageReport
from tiscene.usd.core.stage import Variants, open_stage, quiet, readable

DEFAULT_POLICY = "expandAperture"
POLICIES = ("expandAperture", "cropAperture", "adjustApertureWidth", "adjustApertureHeight")


@dataclass(frozen=True)
class StageRenderSettings:
    """What a stage says about its image.

    Attributes:
        camera: path of the camera prim; "" if not authored.
        resolution: width and height, px; None if not authored.
        policy: aspectRatioConformPolicy, how a camera frames images of another shape than its aperture.
        has_depth_of_field: whether the lenses of cameras blur.
        has_motion_blur: whether the shutters of cameras are open for a time.
    """

    camera: str = ""
    resolution: tuple[int, int] | None = None
    policy: str = DEFAULT_POLICY
    has_depth_of_field: bool = True
    has_motion_blur: bool = True

    def main_first(self, cameras: list[Any], path_of: Any) -> list[Any]:
        """Return cameras with the main one first.

        Args:
            cameras: cameras of any type.
            path_of: function that returns the path of one.
        """
        return sorted(cameras, key=lambda each: str(path_of(each)) != self.camera)


def stage_resolution(path: str | Path, variants: Variants | None = None) -> tuple[int, int] | None:
    """Return the width and height in px that a stage's RenderSettings author; None: none. Reads no geometry.

    Raises:
        MissingFile, StageError, UnknownName (variants): the stage cannot be opened.
    """
    with quiet(), readable(path):
        return read_render_settings(open_stage(path, variants)).resolution


def read_render_settings(stage: Usd.Stage, report: StageReport | None = None) -> StageRenderSettings:
    """Read the RenderSettings that the stage's metadata names, else the only one on the stage.

    Args:
        stage: the stage.
        report: receives settings that are not applied; None: nothing is reported.
    """
    report = report or StageReport("")
    settings = UsdRender.Settings.GetStageRenderSettings(stage)
    if not settings:
        found = [prim for prim in stage.Traverse() if prim.IsA(UsdRender.Settings)]
        if len(found) != 1:
            return StageRenderSettings()
        settings = UsdRender.Settings(found[0])
    products = [stage.GetPrimAtPath(path) for path in settings.GetProductsRel().GetForwardedTargets()]
    prims = [*(prim for prim in products[:1] if prim), settings.GetPrim()]

    def authored(name: str) -> Any:
        values = (prim.GetAttribute(name).Get() for prim in prims if prim.GetAttribute(name).HasAuthoredValue())
        return next(values, None)

    targets = [prim.GetRelationship("camera").GetForwardedTargets() for prim in prims]
    camera = next((stage.GetPrimAtPath(each[0]) for each in targets if each), None)
    path = settings.GetPath()
    if camera is not None and not (camera and camera.IsA(UsdGeom.Camera)):
        report.omission(path, "the camera of the RenderSettings does not exist; the stage's first one is used")
        camera = None
    policy = str(authored("aspectRatioConformPolicy") or DEFAULT_POLICY)
    if policy not in POLICIES:
        report.omission(path, f"aspectRatioConformPolicy {policy!r} is not applied; {DEFAULT_POLICY} is used")
    if authored("pixelAspectRatio") not in (None, 1.0):
        report.omission(path, "pixelAspectRatio is not applied: pixels are square")
    if authored("dataWindowNDC") not in (None, Gf.Vec4f(0, 0, 1, 1)):
        report.omission(path, "dataWindowNDC is not applied: the whole image is rendered")
    purposes = authored("includedPurposes")
    if purposes is not None and set(purposes) != {"default", "render"}:
        report.omission(path, "includedPurposes is not applied: prims of the purposes default and render are drawn")
    size = authored("resolution")
    valid = isinstance(size, Gf.Vec2i) and min(size) >= 1
    if size is not None and not valid:
        text = f"the resolution {size} of the RenderSettings is not used: it must be two positive integers"
        report.omission(path, text)
    return StageRenderSettings(
        str(camera.GetPath()) if camera else "",
        (int(size[0]), int(size[1])) if valid else None,
        policy if policy in POLICIES else DEFAULT_POLICY,
        not authored("disableDepthOfField"),
        not (authored("disableMotionBlur") or authored("instantaneousShutter")),
    )
