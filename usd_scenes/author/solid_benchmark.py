# SPDX-License-Identifier: Apache-2.0
"""solid_benchmark: a plain room, 6 × 5 × 3 m (x from -3 to 3, z from -4 to 1), with three solids on its floor."""

from __future__ import annotations

from usd_scenes.author.model import Model, make_model
from usd_scenes.author.models import bathroom, building
from usd_scenes.author.polygon_mesh import PolygonMesh
from usd_scenes.author.room import WARM_WHITE, Room
from usd_scenes.author.shapes import cylinder, rounded_box, sphere

LEFT, RIGHT, FAR, NEAR, HEIGHT = -3.0, 3.0, -4.0, 1.0, 3.0
WALL = 0.2


def build() -> Room:
    """Build the scene."""
    room = Room("SolidBenchmark", "solid_benchmark")
    corners = [(LEFT, FAR), (RIGHT, FAR), (RIGHT, NEAR), (LEFT, NEAR)]
    center = (0.0, 0.0, (FAR + NEAR) / 2.0)
    floor = rounded_box((RIGHT - LEFT, 0.1, NEAR - FAR), 0.002).translated(0.0, -0.05, 0.0)
    room.put("Building", make_model("Floor", "floor", ("Floor", "PlainFloor", floor)), center)
    room.put("Building", building.ceiling(RIGHT - LEFT, NEAR - FAR, HEIGHT), center)
    materials = {
        "WallFar": "PlainWall",
        "WallRight": "PlainWallWarm",
        "WallNear": "PlainWall",
        "WallLeft": "PlainWallCool",
    }
    for index, (name, material) in enumerate(materials.items()):
        room.put("Building", building.wall(name, corners[index], corners[(index + 1) % 4], HEIGHT, WALL, material))
    room.put("Solids", _solid("Sphere", "MatteYellow", sphere(0.36, 64)), (-1.15, 0.36, -2.45))
    room.put("Solids", _solid("Cylinder", "MatteBlue", cylinder(0.25, 0.95, 0.006, 64)), (0.0, 0.475, -2.95))
    room.put(
        "Solids",
        _solid("Cube", "MatteRed", rounded_box((0.62, 0.62, 0.62), 0.006, 3)),
        (1.15, 0.31, -2.35),
        (0.0, 28.0, 0.0),
    )
    room.put("Building", bathroom.globe_lamp("CeilingLamp", 0.12), (2.1, HEIGHT, -3.2))
    _light(room)
    exposure = {"day": 1.2, "evening": 1.7, "night": 2.3}
    room.camera("Main", (0.0, 1.45, 0.75), (0.0, 0.62, -2.6), fov=50.0, exposure=exposure)
    room.camera("Agent", (0.0, 2.0, 0.6), turn=(-20.0, 0.0, 0.0), fov=60.0, exposure=exposure)
    room.camera("Left", (-2.7, 1.7, 0.2), (0.5, 0.45, -2.8), fov=52.0, exposure=exposure)
    room.camera("Right", (2.7, 1.1, -0.3), (-0.6, 0.45, -2.8), fov=50.0, exposure=exposure)
    return room


def _solid(name: str, material: str, mesh: PolygonMesh) -> Model:
    """Return a model of one part."""
    return make_model(name, name.lower(), ("Body", material, mesh))


def _light(room: Room) -> None:
    """Define a bright ceiling panel for day, a low warm panel for evening, and a lamp for night."""
    room.panel(
        "Daylight",
        2.4,
        1.8,
        (-0.8, HEIGHT - 0.004, -1.7),
        (-90.0, 0.0, 0.0),
        {"day": 3.6, "evening": 0.5, "night": 0.02},
        {"day": (1.0, 0.98, 0.95), "evening": (0.60, 0.72, 1.0), "night": (0.5, 0.65, 1.0)},
    )
    room.panel(
        "EveningLight",
        1.2,
        1.0,
        (LEFT + 0.004, 1.5, -0.6),
        (0.0, -90.0, 0.0),
        {"day": 0.0, "evening": 4.5, "night": 0.0},
        (1.0, 0.60, 0.30),
    )
    room.bulb("LampLight", (2.1, HEIGHT - 0.21, -3.2), 0.1205, {"day": 0.5, "evening": 2.0, "night": 10.0}, WARM_WHITE)
