"""The templates: things that can be spawned, each about the centre of its bounding box, in a folder of its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from pxr import Kind, UsdGeom, UsdPhysics

from usd_scenes.author import stage as usd
from usd_scenes.author.mesh import Mesh
from usd_scenes.author.shapes import circle, cylinder, fillet, lathe, rounded_box, sphere, sweep
from usd_scenes.author.soft import pillow
from usd_scenes.author.thing import Thing, thing
from usd_scenes.author.things import cutlery, seating, small, tableware


def _primitive(name: str, look: str, make: Callable[[], Mesh]) -> Callable[[], Thing]:
    return lambda: thing(name, name.lower(), ("Body", look, make()))


def _cone() -> Mesh:
    return lathe(fillet([[0.0, -0.25], [0.2, -0.25], [0.006, 0.25], [0.0, 0.25]], [0.0, 0.006, 0.004, 0.0], 4), 64)


def _capsule() -> Mesh:
    angle = np.linspace(0.0, np.pi / 2.0, 13)
    top = 0.14 * np.stack([np.cos(angle).clip(0.0), np.sin(angle)], axis=-1) + (0.0, 0.14)
    return lathe(np.concatenate([(top * (1.0, -1.0))[::-1], top]), 64)


def _torus() -> Mesh:
    angle = np.arange(64) * (2.0 * np.pi / 64)
    ring = 0.19 * np.stack([np.cos(angle), 0.0 * angle, np.sin(angle)], axis=-1)
    return sweep(ring, circle(0.07, 28), closed=True)


def _painted_pillow() -> Thing:
    """A cotton pillow that a child has painted, 0.45 m; the picture on either side."""
    cover = pillow(0.45, 0.45, 0.16, 3, 40, 0.004).with_uv(scale=1.0 / 0.45)
    return thing("Pillow01", "pillow", ("Cover", "ScribbleCotton", cover))


TEMPLATES: dict[str, Callable[[], Thing]] = {
    "cylinder": _primitive("Cylinder", "MatteBlue", lambda: cylinder(0.15, 0.5, 0.006, 64)),
    "cube": _primitive("Cube", "MatteRed", lambda: rounded_box((0.4, 0.4, 0.4), 0.008, 3)),
    "sphere": _primitive("Sphere", "MatteYellow", lambda: sphere(0.2, 64)),
    "capsule": _primitive("Capsule", "MatteGreen", _capsule),
    "cone": _primitive("Cone", "MatteOrange", _cone),
    "torus": _primitive("Torus", "MatteTeal", _torus),
    "chair_01": lambda: seating.chair("Chair01"),
    "pillow_01": _painted_pillow,
    "dish_01": lambda: tableware.dish("Dish01"),
    "bowl_01": lambda: tableware.bowl("Bowl01"),
    "cup_01": lambda: tableware.cup("Cup01"),
    "ewer_01": lambda: tableware.ewer("Ewer01"),
    "book_01": lambda: small.book("Book01", 0, 0.15, 0.22, 0.034),
    "candle_01": lambda: small.candle("Candle01"),
    "fork_01": lambda: cutlery.fork("Fork01"),
    "spoon_01": lambda: cutlery.spoon("Spoon01"),
    "statue_01": lambda: small.sculpture("Statue01"),
    "laptop_01": lambda: small.laptop("Laptop01"),
    "remote_controller_01": lambda: small.remote("RemoteController01"),
    "ball_01": lambda: small.beach_ball("Ball01"),
    "tennis_racket_01": lambda: small.tennis_racket("TennisRacket01"),
    "armchair_01": lambda: seating.armchair("Armchair01"),
    "pouf_01": lambda: seating.pouf("Pouf01"),
}


def build(folder: str) -> Thing:
    """The template of that folder, about the centre of its bounding box."""
    return TEMPLATES[folder]().centred()


def write(folder: str, packages: Path) -> None:
    """Writes template.usda and geometry.usdc below `packages`/templates/`folder`."""
    thing_ = build(folder)
    target = packages / "templates" / folder
    usd.write_geometry(target / "geometry.usdc", [thing_], UsdPhysics.Tokens.convexHull)
    stage, root = usd.new_stage(thing_.name, Kind.Tokens.component)
    stage.GetRootLayer().comment = f"{thing_.name}: written by usd_scenes.author."
    usd.label(root, thing_.label)
    UsdPhysics.RigidBodyAPI.Apply(root).CreateKinematicEnabledAttr(True)
    low, high = np.round(thing_.bounds, 5).tolist()
    UsdGeom.ModelAPI.Apply(root).SetExtentsHint([low, high])
    looks = f"/{thing_.name}/Looks"
    usd.define_looks(stage, looks, (part.look for part in thing_.parts), "../../textures")
    usd.bind(stage, thing_, f"/{thing_.name}", looks)
    usd.save(
        stage, target / "template.usda", [usd.Arc(f"/{thing_.name}", "./geometry.usdc", f"/Geometry/{thing_.name}")]
    )
