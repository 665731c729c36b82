# SPDX-License-Identifier: Apache-2.0
"""Small rooms of cubes, written as USD stages."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tests.usd.helpers import write
from tiscene.scene.camera import Vector3

SMALL = ("Ball 01", "Cup 01", "Dish 01")  # templates
# Center and half the size of each wall: a room 8 m wide and long, 4 m high, with a screen across the view.
WALLS = {
    "Floor": ((0, -0.05, 0), (4, 0.05, 4)),
    "Ceiling": ((0, 4.05, 0), (4, 0.05, 4)),
    "Screen": ((1.5, 1.5, -0.5), (1.5, 1.5, 0.05)),
}
# Centers of boxes of 0.2 m on a floor and a low table, by name, m. All but the last are rigid bodies.
BOXES = {
    "A": (-0.6, 0.1, 0),
    "B": (-0.3, 0.1, 0),
    "OnTable": (0.8, 0.5, 0),
    "OnBox": (-0.3, 0.3, 0),
    "Fixed": (0, 0.1, 0),
}


def write_room(folder: Path, eye: Vector3, cubes: Mapping[str, tuple[Vector3, Vector3]], more: str = "") -> str:
    """Write a room and return its path.

    Args:
        folder: existing folder.
        eye: position of the camera, which looks down -Z, m.
        cubes: center and half the size of each cube by name, m.
        more: further prims of the room, as text.
    """
    body = f"""
def Xform "Room" {{
    def Camera "Eye" {{
        float2 clippingRange = (0.1, 100)
        float focalLength = 0.2
        float verticalAperture = 0.24
        float horizontalAperture = 0.32
        double3 xformOp:translate = {eye}
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
    {"".join(cube(name, *place) for name, place in cubes.items())}
    {more}
}}
"""
    return str(write(folder, body, name="room.usda", more='defaultPrim = "Room"'))


def write_room_of_boxes(folder: Path) -> str:
    """Write a room with a floor, a low table and `BOXES`, and return its path."""
    boxes = (
        cube(name, at, (0.1, 0.1, 0.1), "" if name == "Fixed" else "PhysicsRigidBodyAPI") for name, at in BOXES.items()
    )
    sun = '\ndef DistantLight "Sun"\n{\n    float inputs:intensity = 2\n}'
    floor, table = ((0, -0.05, 0), (3, 0.05, 3)), ((0.8, 0.2, 0), (0.4, 0.2, 0.4))
    return write_room(folder, (0, 1, 2.5), {"Floor": floor, "Table": table}, "".join(boxes) + sun)


def cube(name: str, center: Vector3, half: Vector3, schema: str = "", purpose: str = "default") -> str:
    """Return a cube as text; `schema` is an API schema to apply."""
    api = f'(prepend apiSchemas = ["{schema}"])' if schema else ""
    return f"""
    def Cube "{name}" {api}
    {{
        uniform token purpose = "{purpose}"
        double3 xformOp:translate = {center}
        double3 xformOp:scale = {half}
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }}"""
