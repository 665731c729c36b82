# SPDX-License-Identifier: Apache-2.0
"""UsdLux's ShapingAPI: cones, focus and IES profiles.

Also holds `light_input`, which reads inputs of current and old files, and `report_unsupported`, which reports controls
of lights that are not rendered.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux

from tiscene.scene.description import Shaping
from tiscene.usd.core.prims import type_of
from tiscene.usd.core.report import StageReport
from tiscene.usd.lights.ies import read_ies
from tiscene.usd.lights.light_linking import LINKS, is_restricted, links_of
from tiscene.usd.materials.image import read_file
from tiscene.usd.materials.texture import TextureTable

# Attributes of renderers that hide a prim from the camera where they are false, 0 or "-primary".
CAMERA_VISIBILITY = (
    "visibleInPrimaryRay",
    "primvars:ri:attributes:visibility:camera",
    "ri:attributes:visibility:camera",
    "primvars:arnold:visibility:camera",
    "primvars:arnold:camera",
    "primvars:karma:light:renderlightgeo",
    "primvars:karma:object:rendervisibility",
    "primvars:cycles:object:visibility:camera",
    "primvars:cycles:object:use_camera_visibility",
)
_ONE_SIDED_TYPES = ("RectLight", "DiskLight")  # emit within 90 degrees of their axis anyway
_NOT_OF_MESHES = ("shaping:cone:angle", "shaping:cone:softness", "shaping:focus", "shaping:ies:file", "shadow:enable")
_NOT_APPLIED = ("shadow:distance", "shadow:color")  # to any light
_UNSHAPED_TYPES = ("DistantLight", "DomeLight", "DomeLight_1", "GeometryLight")


def light_input(prim: Usd.Prim, name: str, time: Usd.TimeCode, default: Any) -> Any:
    """Return an input's value, or the default if it has none.

    Files older than USD 21.02 authored lights' inputs without the prefix "inputs:", which is accepted.
    """
    attribute = prim.GetAttribute(f"inputs:{name}")
    if not (attribute and attribute.HasAuthoredValue()):
        older = prim.GetAttribute(name)
        if older and older.HasAuthoredValue():
            attribute = older
    value = attribute.Get(time) if attribute else None
    return default if value is None else value


def read_shaping(
    prim: Usd.Prim, time: Usd.TimeCode, textures: TextureTable, report: StageReport, *, mirrored: bool = False
) -> Shaping | None:
    """Read the shaping of a light; None if it has no effect.

    Args:
        prim: the light.
        time: when to evaluate attributes.
        textures: an IES profile becomes one of its rows.
        report: collects problems and omissions.
        mirrored: whether the light's x axis is flipped.
    """
    if not prim.HasAPI(UsdLux.ShapingAPI):
        return None
    angle, softness, focus = (
        float(light_input(prim, f"shaping:{name}", time, default))
        for name, default in (("cone:angle", 90.0), ("cone:softness", 0.0), ("focus", 0.0))
    )
    tint = tuple(float(c) for c in light_input(prim, "shaping:focusTint", time, (0.0, 0.0, 0.0)))
    if not all(math.isfinite(number) for number in (angle, softness, focus, *tint)) or len(tint) != 3:
        report.problem(prim.GetPath(), "shaping", "it has values that are not finite numbers")
        return None
    profile = _profile(prim, time, textures, report, mirrored)
    full_angle = 90.0 if type_of(prim) in _ONE_SIDED_TYPES else 180.0
    if type_of(prim) in _UNSHAPED_TYPES or (
        profile is None and focus <= 0.0 and angle >= full_angle and (softness <= 0.0 or angle > 180.0)
    ):
        return None
    return Shaping(
        math.radians(min(max(angle, 0.0), 180.0)),
        min(max(softness, 0.0), 1.0),
        max(focus, 0.0),
        (tint[0], tint[1], tint[2]),
        profile,
    )


def _profile(
    prim: Usd.Prim, time: Usd.TimeCode, textures: TextureTable, report: StageReport, mirrored: bool
) -> int | None:
    """Return the texture row of a light's IES profile; None if it has none or it cannot be read (reported)."""
    asset = light_input(prim, "shaping:ies:file", time, None)
    if not isinstance(asset, Sdf.AssetPath) or not asset.path:
        return None
    if asset.resolvedPath and not report.root.contains(str(asset.resolvedPath)):
        report.refuse(prim.GetPath(), "light", report.root.refusal(str(asset.resolvedPath)))
        return None
    scale = float(light_input(prim, "shaping:ies:angleScale", time, 0.0))
    normalize = bool(light_input(prim, "shaping:ies:normalize", time, False))
    try:
        if not asset.resolvedPath:
            raise ValueError("there is no such file")
        profile = read_ies(read_file(str(asset.resolvedPath)))
    except (OSError, ValueError) as error:
        text = f"IES profile @{asset.path}@ cannot be read ({error}); the light is rendered without it"
        report.omission(prim.GetPath(), text)
        return None
    key = f"{asset.resolvedPath} {scale} {normalize} {mirrored}"
    image = profile.image(scale, normalize, mirrored=mirrored)
    return textures.add_image(key, Path(asset.path).name, image, "raw", ("repeat", "clamp"))


def is_seen_by_camera(prim: Usd.Prim, time: Usd.TimeCode) -> bool:
    """Return whether the camera sees a light or gprim: False if a renderer's visibility attribute says so.

    UsdLux has no such attribute; those of RenderMan, Arnold, Karma, Cycles and Omniverse are read. Those that are
    primvars are inherited.
    """
    primvars = UsdGeom.PrimvarsAPI(prim)
    for name in CAMERA_VISIBILITY:
        is_primvar = name.startswith("primvars:")
        attribute = primvars.FindPrimvarWithInheritance(name).GetAttr() if is_primvar else prim.GetAttribute(name)
        value = attribute.Get(time) if attribute and attribute.HasAuthoredValue() else None
        if isinstance(value, str):
            if "-primary" in value.replace("&", " ").split():
                return False
        elif value is not None and not (value[0] if hasattr(value, "__len__") and len(value) else value):
            return False
    return True


def _differing(prim: Usd.Prim, time: Usd.TimeCode) -> dict[str, list[str]]:
    """Return the authored inputs of a light that would change its light, by their schema; defaults are left out.

    Some programs author all inputs, with a cone of 180 degrees where there is none.
    """

    def number(name: str, default: float) -> float:
        value = light_input(prim, name, time, default)
        return float(value) if isinstance(value, bool | int | float) else default

    angle, softness = number("shaping:cone:angle", 90.0), number("shaping:cone:softness", 0.0)
    shaping = {
        "shaping:cone:angle": angle != 90.0 and angle < 180.0,
        "shaping:cone:softness": softness > 0.0 and angle < 180.0,
        "shaping:focus": number("shaping:focus", 0.0) > 0.0,
        "shaping:ies:file": bool(getattr(light_input(prim, "shaping:ies:file", time, None), "path", "")),
    }
    color = light_input(prim, "shadow:color", time, None)
    shadow = {
        "shadow:enable": not number("shadow:enable", 1.0),
        "shadow:color": isinstance(color, Gf.Vec3f) and any(color),
        "shadow:distance": number("shadow:distance", -1.0) >= 0.0,
    }
    shaping = {} if type_of(prim) in _UNSHAPED_TYPES else shaping
    schemas = {"ShapingAPI": shaping, "ShadowAPI": shadow}
    return {schema: [name for name, differs in inputs.items() if differs] for schema, inputs in schemas.items()}


def report_unsupported(prim: Usd.Prim, time: Usd.TimeCode, report: StageReport) -> None:
    """Report the authored controls of a light that have no effect."""
    path = prim.GetPath()
    for schema, names in _differing(prim, time).items():
        if names and not prim.HasAPI(schema):
            listed = ", ".join(f"inputs:{name}" for name in names)
            text = f"{listed} of a light: no effect without {schema}; add it to the prim's apiSchemas"
            report.omission(path, text)
            continue
        if prim.IsA(UsdGeom.Gprim) and (applied := [name for name in names if name in _NOT_OF_MESHES]):
            report.omission(path, f"{', '.join(applied)} of a mesh light is not applied")
        for name in _NOT_APPLIED:
            if name in names:
                report.omission(path, f"a light's {name} is not applied")
    if UsdLux.LightAPI(prim).GetFiltersRel().GetTargets():
        report.omission(path, "light filters are not applied")
    links = links_of(report)
    for name, field in LINKS.items():
        if is_restricted(prim, name) and (links is None or field not in links.of_light(prim)):
            report.omission(path, f"{name} is not applied to a mesh light or a template's light: it lights all objects")
    for attribute in prim.GetAuthoredAttributes():
        if attribute.GetName().startswith("inputs:") and attribute.GetConnections():
            report.omission(path, f"the connection of a light's {attribute.GetName()} is not read")
