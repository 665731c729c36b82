# SPDX-License-Identifier: Apache-2.0
"""`Room` collects a scene (models in place, lights, cameras, variants) and writes scene.usda with its crates."""

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
WARM_WHITE: Vector3 = (1.0, 0.76, 0.52)  # 3000 K seen by a camera balanced for 4500 K
# Sky (intensity, texture, color) and sun (irradiance, color, angle) of the rooms with windows, by lighting.
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
"""One value, or one for each name in LIGHTING."""


def by_lighting(value: Varied[T]) -> dict[str, T]:
    """Return a value for each lighting."""
    return {name: value[name] if isinstance(value, Mapping) else value for name in LIGHTING}


class Room:
    """A scene to author.

    Args:
        name: name of the default prim.
        folder: folder of the scene, beside templates and textures.
    """

    def __init__(self, name: str, folder: str) -> None:
        self.name, self.folder = name, folder
        self.stage, self.root = usd.new_stage(name, Kind.Tokens.assembly)
        self.stage.GetRootLayer().comment = f"{folder}: written by usd_scenes.author."
        self._models: dict[str, Model] = {}
        self._bindings: list[tuple[Model, str]] = []
        self._arcs: list[usd.Arc] = []
        self._templates: list[str] = []
        self._emission_factors: dict[str, Varied[float]] = {}
        self._varied: list[tuple[Usd.Attribute, dict[str, Any]]] = []

    def put(
        self, where: str, model: Model, at: Vector3 = ORIGIN, turn: Vector3 = ORIGIN, name: str | None = None
    ) -> None:
        """Place a model.

        Args:
            where: name of the group to place it in.
            model: the model.
            at: position, m.
            turn: rotation about x, then y, then z, degrees.
            name: prim name; None for the model's.
        """
        self._models[model.name] = model
        prim = self._component(where, name or model.name, at, turn)
        usd.label(prim, model.label)
        self._bindings.append((model, str(prim.GetPath())))

    def put_template(
        self, where: str, name: str, folder: str, at: Vector3, turn: Vector3 = ORIGIN, color: str | None = None
    ) -> None:
        """Place a template by reference, so that its lowest point is at the height of `at`.

        Args:
            where: name of the group to place it in.
            name: prim name.
            folder: the template's folder.
            at: position, m.
            turn: rotation about x, then y, then z, degrees.
            color: variant of color; None for the first.
        """
        model = templates.build(folder)
        matrix = rotation("z", turn[2]) @ rotation("y", turn[1]) @ rotation("x", turn[0])
        lowest = min(float((part.mesh.points @ matrix.T)[:, 1].min()) for part in model.parts)
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
        """Define an Xform of kind component below a group."""
        parent = f"/{self.name}/{where}"
        if not self.stage.GetPrimAtPath(parent):
            usd.group(self.stage, parent)
        path = f"{parent}/{name}"
        if self.stage.GetPrimAtPath(path):
            raise ValueError(f"{self.folder}: {path} exists already; give each component its own name")
        xform = UsdGeom.Xform.Define(self.stage, path)
        Usd.ModelAPI(xform.GetPrim()).SetKind(Kind.Tokens.component)
        _place(xform, at, turn)
        return xform.GetPrim()

    def pane(self, window: str, width: float, height: float, thickness: float) -> None:
        """Define an invisible collider in an open window, which keeps objects inside.

        Args:
            window: a component at the lower middle of an opening in the wall's inner face, its z into the room.
            width: width of the opening, m.
            height: height of the opening, m.
            thickness: thickness of the wall, m.
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
        """Define a dome light.

        Args:
            name: prim name.
            intensity: radiance factor.
            texture: a latlong image in `usd_scenes/textures`.
            color: linear color.
            turn: rotation about y, degrees.
        """
        light = UsdLux.DomeLight.Define(self.stage, self._light_path(name))
        self._set(light.CreateIntensityAttr(), intensity)
        self._set_color(light.CreateColorAttr(), color)
        if texture is not None:
            files = {key: f"../textures/{file}" for key, file in by_lighting(texture).items()}
            self._set(light.CreateTextureFileAttr(), files if isinstance(texture, Mapping) else files["day"])
            light.CreateTextureFormatAttr(UsdLux.Tokens.latlong)
        _place(UsdGeom.Xformable(light), ORIGIN, (0.0, turn, 0.0))

    def portal(self, dome: str, name: str, width: float, height: float, at: Vector3, turn: Vector3) -> None:
        """Define a portal of a dome: an opening centered at `at`, through which light enters along its -z."""
        portal = UsdLux.PortalLight.Define(self.stage, self._light_path(name))
        portal.CreateWidthAttr(width)
        portal.CreateHeightAttr(height)
        portal.CreateExtentAttr([Gf.Vec3f(-width / 2.0, -height / 2.0, 0.0), Gf.Vec3f(width / 2.0, height / 2.0, 0.0)])
        _place(UsdGeom.Xformable(portal), at, turn)
        UsdLux.DomeLight.Get(self.stage, self._light_path(dome)).CreatePortalsRel().AddTarget(portal.GetPath())

    def sun(
        self,
        name: str,
        towards: Varied[Vector3],
        irradiance: Varied[float],
        color: Varied[Vector3],
        angle: Varied[float],
    ) -> None:
        """Define a distant light in the direction `towards`; `angle` is the diameter of its disc, degrees."""
        light = UsdLux.DistantLight.Define(self.stage, self._light_path(name))
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
        """Define a small sphere light."""
        light = UsdLux.SphereLight.Define(self.stage, self._light_path(name))
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
        """Define a rectangular light that emits along its -z.

        Args:
            name: prim name.
            width: m.
            height: m.
            at: its center, m.
            turn: rotation about x, then y, then z, degrees.
            radiance: emitted radiance.
            color: linear color.
            texture: an image in `usd_scenes/textures`.
            diffuse: multiplier of its diffuse illumination (`inputs:diffuse`).
        """
        light = UsdLux.RectLight.Define(self.stage, self._light_path(name))
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

    def scale_emission(self, material: str, factor: Varied[float]) -> None:
        """Scale the emission of a material in this room, such as that of a lamp shade with its bulb."""
        self._emission_factors[material] = factor

    def _set(self, attribute: Usd.Attribute, value: Any) -> None:
        """Set an attribute, or defer values by lighting to the variants, which a local opinion would override."""
        if isinstance(value, Mapping):
            attribute.Clear()
            self._varied.append((attribute, by_lighting(value)))
        else:
            attribute.Set(value)

    def _set_color(self, attribute: Usd.Attribute, color: Varied[Vector3]) -> None:
        """Set a color attribute as `_set` does."""
        colors = {key: Gf.Vec3f(*value) for key, value in by_lighting(color).items()}
        self._set(attribute, colors if isinstance(color, Mapping) else colors["day"])

    def _light_path(self, name: str) -> str:
        """Return the path of a light; define the Scope of lights if needed."""
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
        """Define a 4:3 camera with a sensor 24 mm high.

        UsdGeomCamera's apertures and focal length are in tenths of the stage's unit, the meter.

        Args:
            name: prim name.
            at: position, m.
            target: point to look at; None to use `turn`.
            turn: rotation about x, then y, degrees.
            fov: vertical field of view, degrees.
            exposure: exposure compensation, stops.
            f_stop: 0 for a pinhole camera.
            focus: focus distance, m; None for the distance to `target`, else 3.
        """
        parent = f"/{self.name}/Cameras"
        if not self.stage.GetPrimAtPath(parent):
            UsdGeom.Scope.Define(self.stage, parent)
            usd.define_render_settings(self.stage)
        camera = UsdGeom.Camera.Define(self.stage, f"{parent}/{name}")
        camera.CreateHorizontalApertureAttr(0.32)
        camera.CreateVerticalApertureAttr(0.24)
        camera.CreateFocalLengthAttr(0.12 / math.tan(math.radians(fov) / 2.0))
        camera.CreateClippingRangeAttr(Gf.Vec2f(0.1, 100.0))
        self._set(camera.CreateExposureAttr(), exposure)
        if f_stop > 0.0:
            camera.CreateFStopAttr(f_stop)
        if target is not None:
            turn = _rotation_towards(at, target)
            focus = focus or math.dist(at, target)
        camera.CreateFocusDistanceAttr(focus or 3.0)
        _place(camera, at, turn or ORIGIN)

    def write(self, packages: Path) -> None:
        """Write scene.usda, geometry.usdc and primitives.usdc below `packages`/`folder`."""
        target = packages / self.folder
        scope = f"/{self.name}/Looks"
        names = {part.material for model in self._models.values() for part in model.parts}
        if self._models:
            usd.write_geometry(target / "geometry.usdc", self._models.values(), UsdPhysics.Tokens.none)
            usd.write_primitives(target / "primitives.usdc", self._models.values())
            usd.define_materials(self.stage, scope, names, "../textures")
            for model, path in self._bindings:
                usd.bind(self.stage, model, path, scope)
            self._apply_emission_factors(scope)
        for lighting in usd.variants(self.root, "lighting", LIGHTING):
            for attribute, values in self._varied:
                prim = self.stage.GetPrimAtPath(attribute.GetPrimPath())
                prim.GetAttribute(attribute.GetName()).Set(values[lighting])
        arcs = list(self._arcs)
        for appearance in usd.variants(self.root, "appearance", templates.APPEARANCES):
            usd.connect_materials(self.stage, scope, names, "Surface" if appearance == "photoreal" else "Plain")
            for path in self._templates:
                self.stage.GetPrimAtPath(path).GetVariantSets().SetSelection("appearance", appearance)
            for model, path in self._bindings:
                file = "./primitives.usdc" if appearance == "primitives" else "./geometry.usdc"
                inside = path.replace(f"/{self.name}/", f"/{self.name}{{appearance={appearance}}}", 1)
                arcs.append(usd.Arc(inside, file, f"/Geometry/{model.name}"))
        usd.save(self.stage, target / "scene.usda", arcs)

    def _apply_emission_factors(self, scope: str) -> None:
        """Scale the emissive colors of materials by their factors."""
        for material, factor in self._emission_factors.items():
            for shader in ("Surface", "Plain"):
                attribute = self.stage.GetPrimAtPath(f"{scope}/{material}/{shader}").GetAttribute(
                    "inputs:emissiveColor"
                )
                full = attribute.Get()
                values = {key: Gf.Vec3f(*(full * value)) for key, value in by_lighting(factor).items()}
                self._set(attribute, values)


def _sun_turn(towards: Vector3) -> Vector3:
    """Return the rotation about x, then y, degrees, that turns +z towards a direction."""
    x, y, z = towards
    return (-math.degrees(math.atan2(y, math.hypot(x, z))), math.degrees(math.atan2(x, z)), 0.0)


def _rotation_towards(at: Vector3, target: Vector3) -> Vector3:
    """Return the rotation about x, then y, degrees, that turns -z from `at` to `target`."""
    x, y, z = np.subtract(target, at).tolist()
    return (math.degrees(math.atan2(y, math.hypot(x, z))), math.degrees(math.atan2(-x, -z)), 0.0)


def _place(xform: UsdGeom.Xformable, at: Vector3, turn: Vector3) -> None:
    """Author a rounded translation and rotation; zero ones are left out."""
    if any(at):
        xform.AddTranslateOp().Set(Gf.Vec3d(*(round(value, 5) + 0.0 for value in at)))
    if any(turn):
        xform.AddRotateXYZOp().Set(Gf.Vec3f(*(round(value, 4) + 0.0 for value in turn)))
