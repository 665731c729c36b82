# SPDX-License-Identifier: Apache-2.0
"""Render the pictures of docs/importing.md: `TISCENE_PATH=assets python -m docs.tools.imported_models [NAME ...]`.

NAME: "sitting", "dining" or "catalog"; by default all. The folder assets holds the models that the page imports: Sweet
Home 3D's furniture of license CC0, and the jar of `usd_scenes.author.jar`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

import tiscene as ts
from docs.tools.template_sheet import DOCS, photograph, save, sheet_of
from tiscene.catalog import find_template
from tiscene.cli.terminal import note
from tiscene.usd.read.template import read_template

IMAGES = DOCS / "images" / "imported"
WIDTH, HEIGHT, SPP = 960, 720, 48
CATALOG = """
    winchester_armchair_01 winchester_sofa_01 armchair_02 relax_chair_01 couch_01 grand_piano_01 electric_guitar_01
    desk_lamp_01 orchids_01 little_plant_01 decorative_plant_01 plant_01 plant_02 cactus_01 stool_01 stool_02
    oak_chair_01 osaka_chair_01 handbag_01 coffee_cup_01 rocking_horse_01 barrel_01 basketball_01 table_fan_01
"""


def standing(name: str, x: float, z: float, yaw: float, y: float = 0.0) -> ts.Object:
    """Return an object that stands on a surface.

    Args:
        name: name of the template.
        x: m.
        z: m.
        yaw: degrees about y.
        y: height of the surface, m.
    """
    low, _ = read_template(find_template(name)).description.bounds()
    return ts.Object(name.lower().replace(" ", "_"), name, (x, y - float(low[1]), z), (0.0, yaw, 0.0))


def room(camera: str, *objects: ts.Object) -> np.ndarray:
    """Render the living room with additional objects, uint8 [HEIGHT, WIDTH, 3]."""
    scenario = ts.Scenario("room_02", list(objects))
    size = {"width": WIDTH, "height": HEIGHT}
    stream = ts.Stream(scenario, **size, quality="photo", spp=SPP, buffers=("rgb",), camera=camera)
    return np.asarray(stream[0].rgb)


def sitting() -> np.ndarray:
    """Render the seating area."""
    return room(
        "Main",
        standing("Winchester Armchair 01", -1.98, -1.80, 52.0),
        standing("Electric Guitar 01", 0.62, -5.62, 4.0),
        standing("Orchids 01", -1.63, -4.14, 20.0, 0.412),
        standing("Rocking Horse 01", -0.35, -2.05, -30.0),
        standing("Basketball 01", 0.95, -2.75, 0.0),
        standing("Jar 01", -2.98, -5.60, 0.0),
    )


def dining() -> np.ndarray:
    """Render the dining area."""
    return room(
        "Dining",
        standing("Grand Piano 01", -0.35, -1.75, 35.0),
        standing("Stool 02", 0.62, -0.85, -140.0),
        standing("Plant 02", 0.62, -5.45, 0.0),
        standing("Coffee Cup 01", 1.70, -2.02, 30.0, 0.75),
    )


def catalog() -> np.ndarray:
    """Render a contact sheet of the templates in CATALOG."""
    folders = CATALOG.split()
    tiles = [(folder.replace("_", " ").title(), photograph(folder, 232, spp=24)) for folder in folders]
    return sheet_of(tiles, 8)


PICTURES: dict[str, Callable[[], np.ndarray]] = {"sitting": sitting, "dining": dining, "catalog": catalog}


if __name__ == "__main__":
    for name in sys.argv[1:] or PICTURES:
        save(IMAGES / f"{name}.jpg", PICTURES[name]())
        note(f"{name}.jpg")
