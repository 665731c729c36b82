"""A room in the making: things put in their places, lights, cameras; then one scene.usda and one crate of meshes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from pxr import Gf, Kind, Usd, UsdGeom, UsdLux, UsdPhysics

from usd_scenes.author import stage as usd
from usd_scenes.author import templates
from usd_scenes.author.mesh import rotation
from usd_scenes.author.thing import Thing

Vector3 = tuple[float, float, float]
ORIGIN: Vector3 = (0.0, 0.0, 0.0)


class Room:
    """Collects and writes a scene. name: of the default prim. folder: of the scene, beside templates and textures."""

    def __init__(self, name: str, folder: str) -> None:
        self.name, self.folder = name, folder
        self.stage, self.root = usd.new_stage(name, Kind.Tokens.assembly)
        self.stage.GetRootLayer().comment = f"{folder}: written by usd_scenes.author."
        self._things: dict[str, Thing] = {}
        self._bindings: list[tuple[Thing, str]] = []
        self._arcs: list[usd.Arc] = []

    def put(
        self, where: str, thing: Thing, at: Vector3 = ORIGIN, turn: Vector3 = ORIGIN, name: str | None = None
    ) -> None:
        """A component below group `where`. turn: degrees about x, then y, then z. name: default the thing's."""
        self._things[thing.name] = thing
        prim = self._component(where, name or thing.name, at, turn)
        usd.label(prim, thing.label)
        self._arcs.append(usd.Arc(str(prim.GetPath()), "./geometry.usdc", f"/Geometry/{thing.name}"))
        self._bindings.append((thing, str(prim.GetPath())))

    def put_template(self, where: str, name: str, folder: str, at: Vector3, turn: Vector3 = ORIGIN) -> None:
        """A template by reference, lowered or lifted so that it rests at the height of `at` as it is turned."""
        thing = templates.build(folder)
        matrix = rotation("z", turn[2]) @ rotation("y", turn[1]) @ rotation("x", turn[0])
        lowest = min(float((part.mesh.points @ matrix.T)[:, 1].min()) for part in thing.parts)
        prim = self._component(where, name, (at[0], at[1] - lowest, at[2]), turn)
        asset = f"../templates/{folder}/template.usda"
        self._arcs.append(usd.Arc(str(prim.GetPath()), asset, payload=False))
        prim.SetInstanceable(True)

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

    def dome(self, name: str, intensity: float, texture: str | None = None, color: Vector3 = (1.0, 1.0, 1.0)) -> None:
        """The surroundings; texture: a latlong picture in `usd_scenes/textures`."""
        light = UsdLux.DomeLight.Define(self.stage, self._light(name))
        light.CreateIntensityAttr(intensity)
        light.CreateColorAttr(Gf.Vec3f(*color))
        if texture is not None:
            light.CreateTextureFileAttr(f"../textures/{texture}")
            light.CreateTextureFormatAttr(UsdLux.Tokens.latlong)

    def portal(self, dome: str, name: str, width: float, height: float, at: Vector3, turn: Vector3) -> None:
        """An opening by which a dome's light enters along the portal's -z; `at` is its middle."""
        portal = UsdLux.PortalLight.Define(self.stage, self._light(name))
        portal.CreateWidthAttr(width)
        portal.CreateHeightAttr(height)
        portal.CreateExtentAttr([Gf.Vec3f(-width / 2.0, -height / 2.0, 0.0), Gf.Vec3f(width / 2.0, height / 2.0, 0.0)])
        _place(UsdGeom.Xformable(portal), at, turn)
        UsdLux.DomeLight.Get(self.stage, self._light(dome)).CreatePortalsRel().AddTarget(portal.GetPath())

    def sun(self, name: str, towards: Vector3, irradiance: float, color: Vector3, angle: float) -> None:
        """A distant light; towards: where it is; angle: of its disc, degrees."""
        light = UsdLux.DistantLight.Define(self.stage, self._light(name))
        light.CreateIntensityAttr(irradiance)
        light.CreateNormalizeAttr(True)
        light.CreateAngleAttr(angle)
        light.CreateColorAttr(Gf.Vec3f(*color))
        x, y, z = towards
        pitch, yaw = math.degrees(math.atan2(y, math.hypot(x, z))), math.degrees(math.atan2(x, z))
        _place(UsdGeom.Xformable(light), ORIGIN, (-pitch, yaw, 0.0))

    def bulb(self, name: str, at: Vector3, radius: float, radiance: float, color: Vector3) -> None:
        """A small sphere of light."""
        light = UsdLux.SphereLight.Define(self.stage, self._light(name))
        light.CreateRadiusAttr(radius)
        light.CreateIntensityAttr(radiance)
        light.CreateColorAttr(Gf.Vec3f(*color))
        light.CreateExtentAttr([Gf.Vec3f(-radius), Gf.Vec3f(radius)])
        _place(UsdGeom.Xformable(light), at, ORIGIN)

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
        exposure: float = 0.0,
        f_stop: float = 0.0,
        focus: float | None = None,
    ) -> None:
        """A 4:3 camera that looks at `target` or is turned by `turn` (degrees about x, then y). fov: vertical, degrees.

        Apertures and focal length are tenths of a metre here, as UsdGeomCamera has it: a 24 mm high sensor.
        """
        parent = f"/{self.name}/Cameras"
        if not self.stage.GetPrimAtPath(parent):
            UsdGeom.Scope.Define(self.stage, parent)
        camera = UsdGeom.Camera.Define(self.stage, f"{parent}/{name}")
        camera.CreateHorizontalApertureAttr(0.32)
        camera.CreateVerticalApertureAttr(0.24)
        camera.CreateFocalLengthAttr(0.12 / math.tan(math.radians(fov) / 2.0))
        camera.CreateClippingRangeAttr(Gf.Vec2f(0.1, 100.0))
        camera.CreateExposureAttr(exposure)
        if f_stop > 0.0:
            camera.CreateFStopAttr(f_stop)
        if target is not None:
            turn = _look(at, target)
            focus = focus or math.dist(at, target)
        camera.CreateFocusDistanceAttr(focus or 3.0)
        _place(camera, at, turn or ORIGIN)

    def write(self, packages: Path) -> None:
        """scene.usda and geometry.usdc below `packages`/`folder`."""
        target = packages / self.folder
        if self._things:
            usd.write_geometry(target / "geometry.usdc", self._things.values(), UsdPhysics.Tokens.none)
            looks = f"/{self.name}/Looks"
            names = (part.look for thing in self._things.values() for part in thing.parts)
            usd.define_looks(self.stage, looks, names, "../textures")
            for thing, path in self._bindings:
                usd.bind(self.stage, thing, path, looks)
        usd.save(self.stage, target / "scene.usda", self._arcs)


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
