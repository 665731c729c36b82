# SPDX-License-Identifier: Apache-2.0
"""A room in the making: things put in their places, lights, cameras; then one scene.usda and its crates of shapes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
from pxr import Gf, Kind, Usd, UsdGeom, UsdLux, UsdPhysics

from usd_scenes.author import templates
from usd_scenes.author import usd_writer as usd
from usd_scenes.author.model import Model
from usd_scenes.author.polygon_mesh import rotation

Vector3 = tuple[float, float, float]
ORIGIN: Vector3 = (0.0, 0.0, 0.0)
LIGHTING = ("day", "evening", "night")
WARM_WHITE: Vector3 = (1.0, 0.76, 0.52)  # 3000 K as a camera balanced for 4500 K sees it
# Of the rooms with open windows: intensity, picture and color of their sky; irradiance, color and angle of their sun.
SKY = (
    {"day": 2.6, "evening": 1.1, "night": 0.10},
    {"day": "afternoon_sky.hdr", "evening": "dusk_sky.hdr", "night": "dusk_sky.hdr"},
    {"day": (1.0, 1.0, 1.0), "evening": (1.0, 1.0, 1.0), "night": (0.16, 0.34, 1.0)},
)
SUNLIGHT = (
    {"day": 5.5, "evening": 1.6, "night": 0.012},
    {"day": (1.0, 0.86, 0.68), "evening": (1.0, 0.60, 0.32), "night": (0.45, 0.62, 1.0)},
    {"day": 0.8, "evening": 1.2, "night": 0.8},
)
T = TypeVar("T")
Varied: TypeAlias = T | Mapping[str, T]
"""One value, or one for each of LIGHTING."""


def by_lighting(value: Varied[T]) -> dict[str, T]:
    return {name: value[name] if isinstance(value, Mapping) else value for name in LIGHTING}


class Room:
    """Collects and writes a scene. name: of the default prim. folder: of the scene, beside templates and textures."""

    def __init__(self, name: str, folder: str) -> None:
        self.name, self.folder = name, folder
        self.stage, self.root = usd.new_stage(name, Kind.Tokens.assembly)
        self.stage.GetRootLayer().comment = f"{folder}: written by usd_scenes.author."
        self._things: dict[str, Model] = {}
        self._bindings: list[tuple[Model, str]] = []
        self._arcs: list[usd.Arc] = []
        self._templates: list[str] = []
        self._glows: dict[str, Varied[float]] = {}
        self._varied: list[tuple[Usd.Attribute, dict[str, Any]]] = []

    def put(
        self, where: str, thing: Model, at: Vector3 = ORIGIN, turn: Vector3 = ORIGIN, name: str | None = None
    ) -> None:
        """A component below group `where`. turn: degrees about x, then y, then z. name: default the thing's."""
        self._things[thing.name] = thing
        prim = self._component(where, name or thing.name, at, turn)
        usd.label(prim, thing.label)
        self._bindings.append((thing, str(prim.GetPath())))

    def put_template(
        self, where: str, name: str, folder: str, at: Vector3, turn: Vector3 = ORIGIN, color: str | None = None
    ) -> None:
        """A template by reference, lowered or lifted so that it rests at the height of `at` as it is turned."""
        thing = templates.build(folder)
        matrix = rotation("z", turn[2]) @ rotation("y", turn[1]) @ rotation("x", turn[0])
        lowest = min(float((part.mesh.points @ matrix.T)[:, 1].min()) for part in thing.parts)
        prim = self._component(where, name, (at[0], at[1] - lowest, at[2]), turn)
        asset = f"../templates/{folder}/template.usda"
        self._arcs.append(usd.Arc(str(prim.GetPath()), asset, payload=False))
        self._templates.append(str(prim.GetPath()))
        prim.SetInstanceable(True)
        if color is not None:
            if color not in templates.TEMPLATES[folder].colors:
                raise ValueError(f"{folder} comes in {', '.join(templates.TEMPLATES[folder].colors)}, not in {color}")
            prim.GetVariantSets().SetSelection("color", color)

    def _component(self, where: str, name: str, at: Vector3, turn: Vector3) -> Usd.Prim:
        parent = f"/{self.name}/{where}"
        if not self.stage.GetPrimAtPath(parent):
            usd.group(self.stage, parent)
        path = f"{parent}/{name}"
        if self.stage.GetPrimAtPath(path):
            raise ValueError(f"{self.folder}: {path} is there already")
        xform = UsdGeom.Xform.Define(self.stage, path)
        Usd.ModelAPI(xform.GetPrim()).SetKind(Kind.Tokens.component)
        _place(xform, at, turn)
        return xform.GetPrim()

    def pane(self, window: str, width: float, height: float, thickness: float) -> None:
        """What keeps things in where a window is open: a collider in its frame that nobody sees.

        window: a component whose origin is the lower middle of an opening in the wall's inner face, z into the room.
        """
        pane = UsdGeom.Cube.Define(self.stage, f"/{self.name}/{window}/Pane")
        pane.CreatePurposeAttr(UsdGeom.Tokens.guide)
        pane.CreateSizeAttr(1.0)
        pane.CreateExtentAttr([Gf.Vec3f(-0.5), Gf.Vec3f(0.5)])
        inner, outer = 0.62 * thickness, thickness
        pane.AddTranslateOp().Set(Gf.Vec3d(0.0, round(height / 2.0, 5), round(-(inner + outer) / 2.0, 5)))
        pane.AddScaleOp().Set(Gf.Vec3f(*(round(side, 5) for side in (width, height, outer - inner))))
        UsdPhysics.CollisionAPI.Apply(pane.GetPrim())

    def dome(
        self,
        name: str,
        intensity: Varied[float],
        texture: Varied[str] | None = None,
        color: Varied[Vector3] = (1.0, 1.0, 1.0),
        turn: float = 0.0,
    ) -> None:
        """The surroundings; texture: a latlong picture in `usd_scenes/textures`; turn: degrees about y."""
        light = UsdLux.DomeLight.Define(self.stage, self._light(name))
        self._set(light.CreateIntensityAttr(), intensity)
        self._set_color(light.CreateColorAttr(), color)
        if texture is not None:
            files = {key: f"../textures/{file}" for key, file in by_lighting(texture).items()}
            self._set(light.CreateTextureFileAttr(), files if isinstance(texture, Mapping) else files["day"])
            light.CreateTextureFormatAttr(UsdLux.Tokens.latlong)
        _place(UsdGeom.Xformable(light), ORIGIN, (0.0, turn, 0.0))

    def portal(self, dome: str, name: str, width: float, height: float, at: Vector3, turn: Vector3) -> None:
        """An opening by which a dome's light enters along the portal's -z; `at` is its middle."""
        portal = UsdLux.PortalLight.Define(self.stage, self._light(name))
        portal.CreateWidthAttr(width)
        portal.CreateHeightAttr(height)
        portal.CreateExtentAttr([Gf.Vec3f(-width / 2.0, -height / 2.0, 0.0), Gf.Vec3f(width / 2.0, height / 2.0, 0.0)])
        _place(UsdGeom.Xformable(portal), at, turn)
        UsdLux.DomeLight.Get(self.stage, self._light(dome)).CreatePortalsRel().AddTarget(portal.GetPath())

    def sun(
        self,
        name: str,
        towards: Varied[Vector3],
        irradiance: Varied[float],
        color: Varied[Vector3],
        angle: Varied[float],
    ) -> None:
        """A distant light; towards: where it is; angle: of its disc, degrees."""
        light = UsdLux.DistantLight.Define(self.stage, self._light(name))
        self._set(light.CreateIntensityAttr(), irradiance)
        light.CreateNormalizeAttr(True)
        self._set(light.CreateAngleAttr(), angle)
        self._set_color(light.CreateColorAttr(), color)
        turns = {key: _sun_turn(place) for key, place in by_lighting(towards).items()}
        _place(UsdGeom.Xformable(light), ORIGIN, turns["day"])
        if isinstance(towards, Mapping):
            values = {key: Gf.Vec3f(*(round(angle, 4) + 0.0 for angle in turn)) for key, turn in turns.items()}
            self._set(light.GetPrim().GetAttribute("xformOp:rotateXYZ"), values)

    def bulb(
        self, name: str, at: Vector3, radius: float, radiance: Varied[float], color: Varied[Vector3] = WARM_WHITE
    ) -> None:
        """A small sphere of light."""
        light = UsdLux.SphereLight.Define(self.stage, self._light(name))
        light.CreateRadiusAttr(radius)
        self._set(light.CreateIntensityAttr(), radiance)
        self._set_color(light.CreateColorAttr(), color)
        light.CreateExtentAttr([Gf.Vec3f(-radius), Gf.Vec3f(radius)])
        _place(UsdGeom.Xformable(light), at, ORIGIN)

    def panel(
        self,
        name: str,
        width: float,
        height: float,
        at: Vector3,
        turn: Vector3,
        radiance: Varied[float],
        color: Varied[Vector3] = (1.0, 1.0, 1.0),
        texture: str | None = None,
        diffuse: Varied[float] | None = None,
    ) -> None:
        """A rectangle of light that shines along its -z; texture: a picture of it in `usd_scenes/textures`.

        diffuse: how many times as bright what it lights is as its own look would make it (`inputs:diffuse`).
        """
        light = UsdLux.RectLight.Define(self.stage, self._light(name))
        light.CreateWidthAttr(width)
        light.CreateHeightAttr(height)
        self._set(light.CreateIntensityAttr(), radiance)
        self._set_color(light.CreateColorAttr(), color)
        if texture is not None:
            light.CreateTextureFileAttr(f"../textures/{texture}")
        if diffuse is not None:
            self._set(light.CreateDiffuseAttr(), diffuse)
        light.CreateExtentAttr([Gf.Vec3f(-width / 2.0, -height / 2.0, 0.0), Gf.Vec3f(width / 2.0, height / 2.0, 0.0)])
        _place(UsdGeom.Xformable(light), at, turn)

    def glow(self, look: str, strength: Varied[float]) -> None:
        """How much of its emission a look has in this room: a lamp's shade, with its bulb."""
        self._glows[look] = strength

    def _set(self, attribute: Usd.Attribute, value: Any) -> None:
        """A value now, or one for each lighting when variants are written: a local one would win over them."""
        if isinstance(value, Mapping):
            attribute.Clear()
            self._varied.append((attribute, by_lighting(value)))
        else:
            attribute.Set(value)

    def _set_color(self, attribute: Usd.Attribute, color: Varied[Vector3]) -> None:
        colors = {key: Gf.Vec3f(*value) for key, value in by_lighting(color).items()}
        self._set(attribute, colors if isinstance(color, Mapping) else colors["day"])

    def _light(self, name: str) -> str:
        parent = f"/{self.name}/Lights"
        if not self.stage.GetPrimAtPath(parent):
            UsdGeom.Scope.Define(self.stage, parent)
        return f"{parent}/{name}"

    def camera(
        self,
        name: str,
        at: Vector3,
        target: Vector3 | None = None,
        *,
        turn: Vector3 | None = None,
        fov: float = 60.0,
        exposure: Varied[float] = 0.0,
        f_stop: float = 0.0,
        focus: float | None = None,
    ) -> None:
        """A 4:3 camera that looks at `target` or is turned by `turn` (degrees about x, then y). fov: vertical, degrees.

        Apertures and focal length are tenths of a meter here, as UsdGeomCamera has it: a 24 mm high sensor.
        """
        parent = f"/{self.name}/Cameras"
        if not self.stage.GetPrimAtPath(parent):
            UsdGeom.Scope.Define(self.stage, parent)
        camera = UsdGeom.Camera.Define(self.stage, f"{parent}/{name}")
        camera.CreateHorizontalApertureAttr(0.32)
        camera.CreateVerticalApertureAttr(0.24)
        camera.CreateFocalLengthAttr(0.12 / math.tan(math.radians(fov) / 2.0))
        camera.CreateClippingRangeAttr(Gf.Vec2f(0.1, 100.0))
        self._set(camera.CreateExposureAttr(), exposure)
        if f_stop > 0.0:
            camera.CreateFStopAttr(f_stop)
        if target is not None:
            turn = _look(at, target)
            focus = focus or math.dist(at, target)
        camera.CreateFocusDistanceAttr(focus or 3.0)
        _place(camera, at, turn or ORIGIN)

    def write(self, packages: Path) -> None:
        """scene.usda, geometry.usdc and primitives.usdc below `packages`/`folder`."""
        target = packages / self.folder
        looks = f"/{self.name}/Looks"
        names = {part.look for thing in self._things.values() for part in thing.parts}
        if self._things:
            usd.write_geometry(target / "geometry.usdc", self._things.values(), UsdPhysics.Tokens.none)
            usd.write_primitives(target / "primitives.usdc", self._things.values())
            usd.define_looks(self.stage, looks, names, "../textures")
            for thing, path in self._bindings:
                usd.bind(self.stage, thing, path, looks)
            self._apply_glows(looks)
        for lighting in usd.variants(self.root, "lighting", LIGHTING):
            for attribute, values in self._varied:
                prim = self.stage.GetPrimAtPath(attribute.GetPrimPath())
                prim.GetAttribute(attribute.GetName()).Set(values[lighting])
        arcs = list(self._arcs)
        for appearance in usd.variants(self.root, "appearance", templates.APPEARANCES):
            usd.connect_looks(self.stage, looks, names, "Surface" if appearance == "photoreal" else "Plain")
            for path in self._templates:
                self.stage.GetPrimAtPath(path).GetVariantSets().SetSelection("appearance", appearance)
            for thing, path in self._bindings:
                file = "./primitives.usdc" if appearance == "primitives" else "./geometry.usdc"
                inside = path.replace(f"/{self.name}/", f"/{self.name}{{appearance={appearance}}}", 1)
                arcs.append(usd.Arc(inside, file, f"/Geometry/{thing.name}"))
        usd.save(self.stage, target / "scene.usda", arcs)

    def _apply_glows(self, looks: str) -> None:
        for look, strength in self._glows.items():
            for shader in ("Surface", "Plain"):
                attribute = self.stage.GetPrimAtPath(f"{looks}/{look}/{shader}").GetAttribute("inputs:emissiveColor")
                full = attribute.Get()
                values = {key: Gf.Vec3f(*(full * value)) for key, value in by_lighting(strength).items()}
                self._set(attribute, values)


def _sun_turn(towards: Vector3) -> Vector3:
    x, y, z = towards
    return (-math.degrees(math.atan2(y, math.hypot(x, z))), math.degrees(math.atan2(x, z)), 0.0)


def _look(at: Vector3, target: Vector3) -> Vector3:
    """Degrees about x, then y, that turn -z from `at` to `target`."""
    x, y, z = np.subtract(target, at).tolist()
    return (math.degrees(math.atan2(y, math.hypot(x, z))), math.degrees(math.atan2(-x, -z)), 0.0)


def _place(xform: UsdGeom.Xformable, at: Vector3, turn: Vector3) -> None:
    """Written rounded, in a fixed order; what is zero is left out."""
    if any(at):
        xform.AddTranslateOp().Set(Gf.Vec3d(*(round(value, 5) + 0.0 for value in at)))
    if any(turn):
        xform.AddRotateXYZOp().Set(Gf.Vec3f(*(round(value, 4) + 0.0 for value in turn)))
