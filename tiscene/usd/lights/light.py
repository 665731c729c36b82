# SPDX-License-Identifier: Apache-2.0
"""UsdLux lights as the scene description's lights, in radiometric units.

`LightReader` evaluates emission as UsdLux documents it: intensity · 2^exposure · color · color temperature, optionally
divided by the light's area (`normalize`). Sizes are multiplied by the transform's scale and converted to meters.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom, UsdLux

from tiscene.scene.color import LUMINANCE
from tiscene.scene.description import (
    Color,
    CylinderLight,
    DiskLight,
    DistantLight,
    DomeLight,
    Light,
    Matrix,
    Portal,
    RectLight,
    SphereLight,
)
from tiscene.scene.lights.light_kinds import UsdLightInputs, usd_reader
from tiscene.usd.core.prims import type_of
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.transform import is_mirroring, is_sheared, scale_along, to_matrix, unmirrored, unscaled
from tiscene.usd.lights.light_linking import links_of
from tiscene.usd.lights.shaping import is_seen_by_camera, light_input, read_shaping, report_unsupported
from tiscene.usd.materials.texture import TextureTable

EMISSION = ("intensity", "exposure", "color", "colorTemperature")  # inputs that may be animated
_WRAPS = {"RectLight": ("clamp", "clamp"), "DomeLight": ("repeat", "clamp"), "DomeLight_1": ("repeat", "clamp")}
_POINT_RADIUS = 0.001  # m; radius of spheres and cylinders treated as points and lines
_Y_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # +y to +z, +z to -y


class LightReader:
    """Reads UsdLux prims into `lights`.

    Args:
        textures: table for textures of rect and dome lights and for IES profiles.
        time: when to evaluate attributes.
        report: collects problems and omissions.
        meters_per_unit: the stage's metersPerUnit.
        up_axis: the stage's upAxis, "Y" or "Z".

    Attributes:
        lights: the lights read so far.
        any_off: whether one emits nothing, or was said to be invisible.
    """

    def __init__(
        self, textures: TextureTable, time: Usd.TimeCode, report: StageReport, meters_per_unit: float, up_axis: str
    ) -> None:
        self.lights: list[Light] = []
        self.any_off = False
        self._textures = textures
        self._time = time
        self._report = report
        self._meters = meters_per_unit
        self._up_axis = up_axis

    def at(self, time: Usd.TimeCode) -> LightReader:
        """Return a reader of the same stage at another time, without lights so far."""
        return LightReader(self._textures, time, self._report, self._meters, self._up_axis)

    def local_to_world(self, prim: Usd.Prim) -> Matrix:
        """Return the world transform of a prim at the time that this reader reads, float64 4x4, m."""
        return self.in_meters(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(self._time))

    def in_meters(self, matrix: Gf.Matrix4d) -> Matrix:
        """Return a transform of the stage, float64 4x4, m."""
        return to_matrix(matrix, self._meters)

    def rename_last(self, suffix: str) -> None:
        """Append a suffix to the name and path of the light read last."""
        light = self.lights[-1]
        self.lights[-1] = dataclasses.replace(light, name=light.name + suffix, prim_path=light.prim_path + suffix)

    def add(self, prim: Usd.Prim, world_from_prim: NDArray[np.float64]) -> None:
        """Read a light; `world_from_prim` is 4x4 for column vectors, its translation in meters."""
        path = prim.GetPath()
        emission = self._emission(prim)
        if emission is None or not (any(emission) or self._is_animated(prim)):
            self.any_off = self.any_off or emission is not None
            return
        report_unsupported(prim, self._time, self._report)
        mirrored = self._is_mirrored(prim, world_from_prim)
        pose = unscaled(unmirrored(world_from_prim) if mirrored else world_from_prim)
        if pose is None:
            self._report.problem(path, "light", "its transform is singular or not finite")
            return
        kind = type_of(prim)
        if is_sheared(world_from_prim):
            self._report.omission(path, "a light's shear is not applied")
        scale = scale_along(world_from_prim, pose).tolist()
        reader = {
            "RectLight": self._rect,
            "DiskLight": self._disk,
            "SphereLight": self._sphere,
            "CylinderLight": self._cylinder,
            "DistantLight": self._distant,
            "DomeLight": self._dome,
            "DomeLight_1": self._dome,
        }.get(kind) or self._registered(kind)
        if reader is None:
            self._report.omission(path, f"lights of type {kind or 'LightAPI'} are not supported")
            return
        light = reader(prim, pose, emission, scale)
        controls = None if light is None else self._controls(prim, mirrored)
        if light is not None and controls is not None:
            self.lights.append(dataclasses.replace(light, **controls))

    def _is_mirrored(self, prim: Usd.Prim, matrix: Matrix) -> bool:
        """Return whether a transform mirrors a light's texture or IES profile; other lights look the same mirrored."""
        files = (self._input(prim, name, None) for name in ("texture:file", "shaping:ies:file"))
        return any(getattr(each, "path", "") for each in files) and is_mirroring(matrix)

    def _controls(self, prim: Usd.Prim, mirrored: bool) -> dict[str, Any] | None:
        """Read the controls common to all types: diffuse and specular multipliers, texture, shaping, shadows.

        None, with a problem reported, for multipliers that are negative or not finite.
        """
        diffuse, specular = (self._float(prim, name, 1.0) for name in ("diffuse", "specular"))
        if not (0.0 <= diffuse < math.inf and 0.0 <= specular < math.inf):
            text = f"diffuse {diffuse} and specular {specular} must be finite, and not below 0"
            self._report.problem(prim.GetPath(), "light", text)
            return None
        shadows = not prim.HasAPI(UsdLux.ShadowAPI) or bool(self._input(prim, "shadow:enable", True))
        texture = {"texture": self._texture(prim, mirrored)} if type_of(prim) in _WRAPS else {}
        shaping = read_shaping(prim, self._time, self._textures, self._report, mirrored=mirrored)
        links = links_of(self._report)
        controls: dict[str, Any] = texture if links is None else texture | links.of_light(prim)
        controls |= {"diffuse": diffuse, "specular": specular, "shaping": shaping, "casts_shadows": shadows}
        return controls | {"seen_by_camera": is_seen_by_camera(prim, self._time)}

    def _is_animated(self, prim: Usd.Prim) -> bool:
        """Return whether the emission is animated, so that a light that is dark now may be lit later."""
        return any(prim.GetAttribute(f"inputs:{name}").ValueMightBeTimeVarying() for name in EMISSION)

    def mesh_emission(self, prim: Usd.Prim, area: float) -> Color | None:
        """Read the radiance of a mesh light; None if it emits nothing or is invalid, which is reported.

        Args:
            prim: a mesh with MeshLightAPI.
            area: of its triangles, stage units squared.
        """
        report_unsupported(prim, self._time, self._report)
        for name in ("diffuse", "specular"):
            if self._float(prim, name, 1.0) != 1.0:
                self._report.omission(prim.GetPath(), f"a mesh light's {name} multiplier is not applied")
        emission = self._emission(prim)
        if emission is None:
            return None
        self.any_off = self.any_off or not any(emission)
        return self._normalized(prim, emission, area)

    def _emission(self, prim: Usd.Prim) -> Color | None:
        """Return the radiance before `normalize`, W/(m² sr): intensity · 2^exposure · color · color temperature."""
        intensity = self._float(prim, "intensity", 50000.0 if type_of(prim) == "DistantLight" else 1.0)
        exposure = self._float(prim, "exposure", 0.0)
        color = np.asarray(self._input(prim, "color", (1.0, 1.0, 1.0)), dtype=np.float64)
        if self._input(prim, "enableColorTemperature", False):
            kelvin = self._float(prim, "colorTemperature", 6500.0)
            if math.isfinite(kelvin):
                color = color * color_of_temperature(kelvin)
        with np.errstate(over="ignore"):
            emission = intensity * np.exp2(exposure) * color
        if emission.shape != (3,) or not np.isfinite(emission).all():
            text = f"intensity {intensity}, exposure {exposure}, color {color.tolist()} is not a finite emission"
            self._report.problem(prim.GetPath(), "light", text)
            return None
        if (emission < 0.0).any():
            self._report.omission(prim.GetPath(), "a light's negative emission is treated as 0")
            emission = np.maximum(emission, 0.0)
        r, g, b = emission.tolist()
        return (r, g, b)

    def _registered(self, prim_type: str) -> Callable[..., Light | None] | None:
        """Return the reader of a kind that was registered for prims of that type; None if there is none."""
        reader = usd_reader(prim_type)
        if reader is None:
            return None

        def read(prim: Usd.Prim, pose: NDArray[np.float64], emission: Color, scale: list[float]) -> Light | None:
            path, x, y, z = str(prim.GetPath()), *scale

            def value(name: str, default: Any) -> Any:
                return self._input(prim, name, default)

            return reader(UsdLightInputs(prim.GetName(), path, pose, emission, (x, y, z), self._meters, value))

        return read

    def _rect(self, prim: Usd.Prim, pose: NDArray[np.float64], emission: Color, scale: list[float]) -> Light | None:
        width, height = self._size(prim, "width", 1.0) * scale[0], self._size(prim, "height", 1.0) * scale[1]
        radiance = self._normalized(prim, emission, width * height)
        if radiance is None:
            return None
        size = (width * self._meters, height * self._meters)
        return RectLight(prim.GetName(), str(prim.GetPath()), pose, radiance, *size)

    def _disk(self, prim: Usd.Prim, pose: NDArray[np.float64], emission: Color, scale: list[float]) -> Light | None:
        radius = self._size(prim, "radius", 0.5) * self._mean_scale(prim, scale[:2])
        radiance = self._normalized(prim, emission, math.pi * radius**2)
        if radiance is None:
            return None
        return DiskLight(prim.GetName(), str(prim.GetPath()), pose, radiance, radius * self._meters)

    def _sphere(self, prim: Usd.Prim, pose: NDArray[np.float64], emission: Color, scale: list[float]) -> Light | None:
        radius = self._size(prim, "radius", 0.5) * self._mean_scale(prim, scale)
        as_point = bool(UsdLux.SphereLight(prim).GetTreatAsPointAttr().Get(self._time))
        normalize = bool(self._input(prim, "normalize", False))
        if radius == 0.0 and normalize:  # finite power: use a small sphere
            radius = _POINT_RADIUS / self._meters
        radiance = self._normalized(prim, emission, 4.0 * math.pi * radius**2)
        if radiance is None:
            return None
        meters = radius * self._meters
        if as_point and meters > _POINT_RADIUS:
            radiance = _times(radiance, (meters / _POINT_RADIUS) ** 2)
            meters = _POINT_RADIUS
        return SphereLight(prim.GetName(), str(prim.GetPath()), pose, radiance, meters)

    def _cylinder(self, prim: Usd.Prim, pose: NDArray[np.float64], emission: Color, scale: list[float]) -> Light | None:
        radius = self._size(prim, "radius", 0.5) * self._mean_scale(prim, scale[1:])
        length = self._size(prim, "length", 1.0) * scale[0]
        as_line = bool(UsdLux.CylinderLight(prim).GetTreatAsLineAttr().Get(self._time))
        if radius == 0.0 and self._input(prim, "normalize", False):  # finite power: use a thin cylinder
            radius = _POINT_RADIUS / self._meters
        radiance = self._normalized(prim, emission, 2.0 * math.pi * radius * length)
        if radiance is None:
            return None
        meters = radius * self._meters
        if as_line and meters > _POINT_RADIUS:
            radiance = _times(radiance, meters / _POINT_RADIUS)
            meters = _POINT_RADIUS
        return CylinderLight(prim.GetName(), str(prim.GetPath()), pose, radiance, meters, length * self._meters)

    def _distant(self, prim: Usd.Prim, pose: NDArray[np.float64], emission: Color, scale: list[float]) -> Light:
        """Read a DistantLight.

        A cone of directions with radiance L and half angle t gives a surface facing it the irradiance pi L sin² t.
        """
        half = math.radians(min(max(self._float(prim, "angle", 0.53), 0.0), 360.0)) / 2.0
        if half > math.pi / 2.0:
            self._report.omission(prim.GetPath(), "a DistantLight wider than a hemisphere is clamped to one")
        sine_squared = math.sin(min(half, math.pi / 2.0)) ** 2
        projected = math.pi * sine_squared if half > 0.0 else 1.0
        if self._input(prim, "normalize", False) and half > 0.0:
            projected /= math.pi * (sine_squared if half <= math.pi / 2.0 else 2.0 - math.sin(half) ** 2)
        angle = 2.0 * min(half, math.pi / 2.0)
        return DistantLight(prim.GetName(), str(prim.GetPath()), pose, _times(emission, projected), angle)

    def _dome(self, prim: Usd.Prim, pose: NDArray[np.float64], emission: Color, scale: list[float]) -> Light:
        layout = self._input(prim, "texture:format", "automatic")
        if layout not in ("automatic", "latlong"):
            self._report.omission(
                prim.GetPath(), f"a dome texture of format {layout!r} is not supported and read as latlong"
            )
        pose = pose.copy()
        pose[:3, 3] = 0.0
        if type_of(prim) == "DomeLight_1":
            pole = prim.GetAttribute("poleAxis").Get(self._time) or "scene"
            if pole == "Z" or (pole == "scene" and self._up_axis == "Z"):
                pose = pose @ _Y_TO_Z
        return DomeLight(prim.GetName(), str(prim.GetPath()), pose, emission, portals=self._portals(prim))

    def _portals(self, dome: Usd.Prim) -> tuple[Portal, ...]:
        """Read the PortalLights that a dome's `portals` relationship targets."""
        portals = []
        for path in dome.GetRelationship("portals").GetForwardedTargets():
            prim = dome.GetStage().GetPrimAtPath(path)
            if not prim or not prim.IsA(UsdLux.PortalLight):
                self._report.omission(dome.GetPath(), f"its portal <{path}> is not a PortalLight")
                continue
            matrix = self.local_to_world(prim)
            pose = unscaled(matrix)
            if pose is None:
                self._report.problem(path, "portal", "its transform is singular or not finite")
                continue
            if is_sheared(matrix):
                self._report.omission(path, "a portal's shear is not applied")
            scale = scale_along(matrix, pose) * self._meters
            width, height = (
                float(self._size(prim, "width", 1.0) * scale[0]),
                float(self._size(prim, "height", 1.0) * scale[1]),
            )
            if not (0.0 < width * height < math.inf):
                self._report.problem(path, "portal", f"its size is {width} x {height} m")
                continue
            portals.append(Portal(pose, width, height))
        return tuple(portals)

    def _normalized(self, prim: Usd.Prim, emission: Color, area: float) -> Color | None:
        """Return the radiance after `normalize`; None if the area is 0 or invalid, which is reported.

        Args:
            prim: the light.
            emission: radiance before `normalize`.
            area: in the stage's world space: stage units squared, not square meters.
        """
        if not math.isfinite(area) or area < 0.0 or (area == 0.0 and self._input(prim, "normalize", False)):
            self._report.problem(prim.GetPath(), "light", f"its area is {area}")
            return None
        if area == 0.0:
            self._report.omission(prim.GetPath(), "a light of zero area emits nothing")
            return None
        if not self._input(prim, "normalize", False):
            return emission
        return (emission[0] / area, emission[1] / area, emission[2] / area)

    def _mean_scale(self, prim: Usd.Prim, scale: list[float]) -> float:
        """Return the scale of a round light's radius; uneven scales are averaged, which is reported."""
        if max(scale) > 1.01 * min(scale):
            self._report.omission(prim.GetPath(), "a round light's uneven scale is averaged")
        return sum(scale) / len(scale)

    def _texture(self, prim: Usd.Prim, mirrored: bool) -> int | None:
        """Return the row of a light's texture; None if it has none or, with a report, none that can be read."""
        attribute = prim.GetAttribute("inputs:texture:file")
        if not attribute.HasAuthoredValue():
            attribute = prim.GetAttribute("texture:file")
        asset = attribute.Get(self._time) if attribute else None
        if asset is None or not asset.path:
            return None
        wraps, instead = _WRAPS[type_of(prim)], "the light is rendered without it"
        return self._textures.add(attribute, asset, "auto", *wraps, instead, mirrored=mirrored)

    def _input(self, prim: Usd.Prim, name: str, default: Any) -> Any:
        return light_input(prim, name, self._time, default)

    def _float(self, prim: Usd.Prim, name: str, default: float) -> float:
        return float(self._input(prim, name, default))

    def _size(self, prim: Usd.Prim, name: str, default: float) -> float:
        return abs(self._float(prim, name, default))


def color_of_temperature(kelvin: float) -> NDArray[np.float64]:
    """Return the linear Rec. 709 color of a black body: UsdLux's, relative to that of 6500 K, which is white here.

    Args:
        kelvin: temperature; clamped to 1000..10000.

    Returns:
        float64 [3] of luminance 1.
    """
    clamped = min(max(kelvin, 1000.0), 10000.0)
    color = np.array(UsdLux.BlackbodyTemperatureAsRgb(clamped)) / np.array(UsdLux.BlackbodyTemperatureAsRgb(6500.0))
    return np.asarray(color / (color @ LUMINANCE))


def _times(color: Color, factor: float) -> Color:
    return (color[0] * factor, color[1] * factor, color[2] * factor)
