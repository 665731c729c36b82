# SPDX-License-Identifier: Apache-2.0
"""The shipped object templates: models centered at their bounding box, each in a folder of its own.

Variant sets on the root: `color` selects the parts' materials; `appearance` is photoreal, untextured or primitives.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from pxr import Kind, Usd, UsdGeom, UsdPhysics, UsdSemantics

from usd_scenes.author import usd_writer as usd
from usd_scenes.author.kitchen_templates import ENAMELS, KITCHEN_AND_HALL
from usd_scenes.author.model import Model, make_model
from usd_scenes.author.models import (
    bath,
    cutlery,
    desk,
    kitchen,
    lamps,
    pillows,
    plants,
    seating,
    small,
    tableware,
    toys,
)
from usd_scenes.author.polygon_mesh import PolygonMesh
from usd_scenes.author.shapes import circle, cylinder, fillet, lathe, rounded_box, sphere, sweep
from usd_scenes.author.template_model import TemplateModel, replacing, shades

MATTE_COLORS = ("red", "orange", "yellow", "green", "teal", "blue", "white")
APPEARANCES = ("photoreal", "untextured", "primitives")


def _primitive(name: str, color: str, make: Callable[[], PolygonMesh]) -> TemplateModel:
    """Return the template of a matte primitive in all colors, `color` first."""
    colors = {color: "Matte" + color.title(), **{each: "Matte" + each.title() for each in MATTE_COLORS}}
    return TemplateModel(
        name,
        lambda _: make_model(name, name.lower(), ("Body", colors[color], make())),
        replacing(colors[color], **colors),
        elementary=True,
    )


def _cone() -> PolygonMesh:
    """Build a cone of radius 0.2 m and height 0.5 m with a rounded edge."""
    return lathe(fillet([[0.0, -0.25], [0.2, -0.25], [0.006, 0.25], [0.0, 0.25]], [0.0, 0.006, 0.004, 0.0], 4), 64)


def _capsule() -> PolygonMesh:
    """Build a capsule of radius 0.14 m and total height 0.56 m."""
    angle = np.linspace(0.0, np.pi / 2.0, 13)
    top = 0.14 * np.stack([np.cos(angle).clip(0.0), np.sin(angle)], axis=-1) + (0.0, 0.14)
    return lathe(np.concatenate([(top * (1.0, -1.0))[::-1], top]), 64)


def _torus() -> PolygonMesh:
    """Build a torus of radii 0.19 m and 0.07 m."""
    return sweep(np.insert(circle(0.19, 64), 1, 0.0, axis=1), circle(0.07, 28), closed=True)


def _novel(name: str) -> Model:
    """Build a hardback with a gilt frame and title on its front."""
    book = small.book(name, 0, 0.15, 0.22, 0.034)
    lines = [
        (0.118, 0.0012, 0.0, 0.094),
        (0.118, 0.0012, 0.0, -0.094),
        (0.0012, 0.188, 0.0585, 0.0),
        (0.0012, 0.188, -0.0585, 0.0),
    ]
    lines += [(0.074, 0.0085, 0.0, -0.055), (0.052, 0.0085, 0.0, -0.040), (0.034, 0.0045, 0.0, 0.072)]
    gilt = [rounded_box((width, 0.0003, depth), 0.0001).translated(x, 0.0341, z) for width, depth, x, z in lines]
    gilt.append(lathe(fillet([[0.016, 0.0], [0.020, 0.0003], [0.024, 0.0]], 0.0), 40).translated(0.0, 0.0340, 0.016))
    return make_model(
        name, "book", *((part.name, part.material, part.mesh) for part in book.parts), ("Gilt", "Brass", gilt)
    )


def _glazes(color: str) -> dict[str, dict[str, str]]:
    """Return the colors of pottery; `color`, the model's own, is first."""
    glazes = {"stoneware": "Stoneware", "blue": "BlueGlaze", "cream": "CreamGlaze", "green": "GreenGlaze"}
    return replacing(glazes[color], **{color: glazes[color]} | glazes)


CUTLERY = replacing("Steel", steel="Steel", gold="Brass", black="BlackSteel")

TEMPLATES: dict[str, TemplateModel] = {
    "chair_01": TemplateModel(
        "Chair01",
        seating.chair,
        replacing("Chestnut", chestnut="Chestnut", oak="Oak", walnut="Walnut", white="TrimPaint"),
    ),
    "chair_02": TemplateModel("Chair02", seating.shell_chair, shades("Shell", "white", "teal", "mustard", "black")),
    "armchair_01": TemplateModel(
        "Armchair01",
        seating.armchair,
        {"cognac": {}, "black": {"Leather": "LeatherBlack"}, "green": {"Leather": "LeatherGreen", "Walnut": "Oak"}},
    ),
    "sofa_01": TemplateModel(
        "Sofa01",
        seating.settee,
        {
            "gray": {},
            "mustard": {"SofaWool": "Mustard", "Mustard": "Cream"},
            "rust": {"SofaWool": "Rust", "Mustard": "Cream"},
            "slate": {"SofaWool": "ThrowWool"},
        },
    ),
    "pillow_01": TemplateModel(
        "Pillow01",
        pillows.painted_pillow,
        replacing(
            "ScribbleCotton", painted="ScribbleCotton", mustard="PillowMustard", teal="PillowTeal", rust="PillowRust"
        ),
    ),
    "pouf_01": TemplateModel(
        "Pouf01", seating.pouf, replacing("ThrowWool", slate="ThrowWool", cream="Cream", mustard="Mustard", rust="Rust")
    ),
    "lamp_floor_01": TemplateModel(
        "LampFloor01",
        lamps.tripod_lamp,
        {
            "linen": {},
            "red": {"LampShade": "ShadeRed", "Oak": "Walnut"},
            "blue": {"LampShade": "ShadeBlue", "Oak": "BlackMetal"},
        },
    ),
    "painting_01": TemplateModel(
        "Painting01",
        small.hanging_picture,
        {
            "landscape": {},
            "coast": {"Landscape": "Coast", "Oak": "BlackMetal"},
            "abstract": {"Landscape": "AbstractWarm", "Oak": "Walnut"},
        },
    ),
    "statue_01": TemplateModel(
        "Statue01",
        small.sculpture,
        {
            "stone": {},
            "bronze": {"PaleStone": "Bronze"},
            "black": {"PaleStone": "BlackMetal", "BlackMetal": "PaleStone"},
        },
    ),
    "plant_01": TemplateModel(
        "Plant01", plants.snake_plant, replacing("Terracotta", clay="Terracotta", white="Porcelain", blue="BlueGlaze")
    ),
    "dish_01": TemplateModel(
        "Dish01",
        tableware.dish,
        {
            "blue": {},
            "green": {"BlueGlaze": "GreenGlaze"},
            "stoneware": {"Porcelain": "Stoneware", "BlueGlaze": "CreamGlaze"},
        },
    ),
    "bowl_01": TemplateModel("Bowl01", tableware.bowl, _glazes("stoneware")),
    "cup_01": TemplateModel("Cup01", tableware.cup, _glazes("blue")),
    "ewer_01": TemplateModel("Ewer01", tableware.ewer, _glazes("cream")),
    "fork_01": TemplateModel("Fork01", cutlery.fork, CUTLERY),
    "spoon_01": TemplateModel("Spoon01", cutlery.spoon, CUTLERY),
    "pot_01": TemplateModel("Pot01", kitchen.pot, ENAMELS | {"steel": {"EnamelRed": "Steel"}}),
    "candle_01": TemplateModel(
        "Candle01", small.candle, replacing("Candle", ivory="Candle", red="CandleRed", green="CandleGreen")
    ),
    "book_01": TemplateModel(
        "Book01",
        _novel,
        replacing("Spines", red="SpinesRed", blue="SpinesBlue", green="SpinesGreen", cream="SpinesCream"),
    ),
    "laptop_01": TemplateModel(
        "Laptop01",
        small.laptop,
        {
            "silver": {},
            "graphite": {"Aluminium": "Graphite", "Steel": "Graphite"},
            "gold": {"Aluminium": "RoseGold", "Steel": "RoseGold"},
        },
    ),
    "cellphone_01": TemplateModel(
        "Cellphone01",
        desk.cellphone,
        {
            "graphite": {},
            "rose": {"PhoneCase": "PhoneRose", "Aluminium": "PhoneRose"},
            "silver": {"PhoneCase": "PhoneSilver"},
        },
    ),
    "remote_controller_01": TemplateModel(
        "RemoteController01",
        small.remote,
        {
            "black": {},
            "white": {"BlackPlastic": "WhitePlastic"},
            "gray": {"BlackPlastic": "GrayPlastic", "GrayPlastic": "BlackPlastic"},
        },
    ),
    "pen_01": TemplateModel("Pen01", desk.pen, shades("Pen", "blue", "red", "green")),
    "alarm_clock_01": TemplateModel("AlarmClock01", desk.alarm_clock, ENAMELS),
    "box_01": TemplateModel(
        "Box01",
        desk.cardboard_box,
        {
            "brown": {},
            "white": {"Cardboard": "CardboardWhite"},
            "blue": {"Cardboard": "CardboardBlue", "BlackPlastic": "WhitePlastic"},
        },
    ),
    "recycle_bin_02": TemplateModel("RecycleBin02", desk.recycle_bin, shades("Bin", "blue", "green", "gray")),
    "towel_01": TemplateModel("Towel01", bath.towel, shades("Towel", "blue", "white", "rose", "sage")),
    "toilet_paper_01": TemplateModel(
        "ToiletPaper01", bath.toilet_paper, replacing("Tissue", white="Tissue", peach="TissuePeach", blue="TissueBlue")
    ),
    "soap_01": TemplateModel("Soap01", bath.soap, shades("Soap", "green", "pink", "ivory")),
    "plunger_01": TemplateModel("Plunger01", bath.plunger, shades("Rubber", "red", "black", "green")),
    "tennis_racket_01": TemplateModel(
        "TennisRacket01",
        small.tennis_racket,
        {
            "red": {},
            "blue": {"RacketFrame": "RacketBlue"},
            "black": {"RacketFrame": "RacketBlack", "RacketWhite": "RacketLime"},
        },
    ),
    "ball_01": TemplateModel(
        "Ball01",
        small.beach_ball,
        {
            "primary": {},
            "pastel": {"BallRed": "BallPink", "BallBlue": "BallMint", "BallYellow": "BallSky"},
            "red": {"BallBlue": "BallRed", "BallYellow": "BallRed"},
        },
        elementary=True,
    ),
    "teddy_bear_01": TemplateModel(
        "TeddyBear01",
        toys.teddy_bear,
        {
            "brown": {},
            "cream": {"PlushBrown": "PlushCream", "RibbonRed": "RibbonBlue"},
            "gray": {"PlushBrown": "PlushGray", "PlushTan": "PlushCream"},
        },
    ),
    "cube": _primitive("Cube", "red", lambda: rounded_box((0.4, 0.4, 0.4), 0.008, 3)),
    "sphere": _primitive("Sphere", "yellow", lambda: sphere(0.2, 64)),
    "cylinder": _primitive("Cylinder", "blue", lambda: cylinder(0.15, 0.5, 0.006, 64)),
    "capsule": _primitive("Capsule", "green", _capsule),
    "cone": _primitive("Cone", "orange", _cone),
    "torus": _primitive("Torus", "teal", _torus),
    **KITCHEN_AND_HALL,
}


def build(folder: str) -> Model:
    """Build the template of a folder in its first color, centered at its bounding box."""
    template = TEMPLATES[folder]
    return template.colored(next(iter(template.colors)))


def facts(file: Path) -> tuple[str, list[float], list[str]]:
    """Return the label, size (x, y, z, m) and names of parts of a written template."""
    stage = Usd.Stage.Open(str(file))
    root = stage.GetDefaultPrim()
    (label,) = UsdSemantics.LabelsAPI(root, "class").GetLabelsAttr().Get()
    low, high = UsdGeom.ModelAPI(root).GetExtentsHint()
    return label, list(high - low), [prim.GetName() for prim in root.GetChildren() if prim.IsA(UsdGeom.Mesh)]


def write(folder: str, packages: Path) -> None:
    """Write template.usda, geometry.usdc and primitives.usdc below `packages`/templates/`folder`."""
    template = TEMPLATES[folder]
    colored = {color: template.colored(color) for color in template.colors}
    model = next(iter(colored.values()))
    target = packages / "templates" / folder
    usd.write_geometry(target / "geometry.usdc", [model], UsdPhysics.Tokens.convexHull)
    if not template.elementary:
        usd.write_primitives(target / "primitives.usdc", [model])
    stage, root = usd.new_stage(model.name, Kind.Tokens.component)
    stage.GetRootLayer().comment = f"{model.name}: written by usd_scenes.author."
    usd.label(root, model.label)
    UsdPhysics.RigidBodyAPI.Apply(root).CreateKinematicEnabledAttr(True)
    low, high = np.round(model.bounds, 5).tolist()
    UsdGeom.ModelAPI.Apply(root).SetExtentsHint([low, high])
    scope = f"/{model.name}/Looks"
    names = {part.material for each in colored.values() for part in each.parts}
    usd.define_materials(stage, scope, names, "../../textures")
    for color in usd.variants(root, "color", colored):
        usd.bind(stage, colored[color], f"/{model.name}", scope)
    for appearance in usd.variants(root, "appearance", APPEARANCES):
        usd.connect_materials(stage, scope, names, "Surface" if appearance == "photoreal" else "Plain")
    arcs = []
    for appearance in APPEARANCES:
        use_primitives = appearance == "primitives" and not template.elementary
        file = "./primitives.usdc" if use_primitives else "./geometry.usdc"
        where = f"/{model.name}{{appearance={appearance}}}"
        arcs.append(usd.Arc(where, file, f"/Geometry/{model.name}"))
    usd.save(stage, target / "template.usda", arcs)
