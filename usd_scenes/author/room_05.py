# SPDX-License-Identifier: Apache-2.0
"""room_05, a hall of 1.8 × 6 × 2.6 m: x from -0.9 to 0.9, z from -3 to 3, the floor at y = 0.

The glazed front door is in the +z wall; closed doors lead to a room on the left, two on the right, and one at the far
end. The space above the runner is kept free for flying objects.
"""

from __future__ import annotations

from usd_scenes.author.models import bathroom, bedroom, building, entrance, hall, small
from usd_scenes.author.room import ORIGIN, Room

LEFT, RIGHT, FAR, NEAR, HEIGHT = -0.9, 0.9, -3.0, 3.0, 2.6
WALL = 0.12
FRONT_WALL = 0.28
LEFT_DOOR = 1.75  # center along z, in the -x wall
RIGHT_DOORS = (1.75, -0.24)  # centers along z, in the +x wall
CASING = 0.527  # half width of a door with its casing
TOWARDS_RIGHT, TOWARDS_LEFT = (0.0, 90.0, 0.0), (0.0, -90.0, 0.0)
CONSOLE = -0.15  # center along z, at the -x wall
BENCH = -1.75  # center along z, at the -x wall


def build() -> Room:
    """Build the scene."""
    room = Room("Room05", "room_05")
    _shell(room)
    _furniture(room)
    _belongings(room)
    _light(room)
    _cameras(room)
    return room


def _shell(room: Room) -> None:
    width, depth = RIGHT - LEFT, NEAR - FAR
    corners = [(LEFT, FAR), (RIGHT, FAR), (RIGHT, NEAR), (LEFT, NEAR)]
    half, top = entrance.LEAF / 2.0 + 0.07, entrance.TALL + entrance.TRANSOM + 0.14
    front = building.WallOpening(width / 2.0 - half, width / 2.0 + half, -0.01, top)
    room.put("Building", building.planks(width, depth, 53))
    room.put("Building", building.ceiling(width, depth, HEIGHT))
    for index, name in enumerate(("WallEnd", "WallRight", "WallFront", "WallLeft")):
        start, end = corners[index], corners[(index + 1) % 4]
        holes, thick = ([front], FRONT_WALL) if name == "WallFront" else ([], WALL)
        material = "HallPaint" if name == "WallEnd" else "WallPlaster"
        room.put("Building", building.wall(name, start, end, HEIGHT, thick, material, holes, building.FOOTING))
    room.put("Building", building.cornice("Cornice", corners, HEIGHT))
    runs = [
        [(CASING, FAR), (RIGHT, FAR), (RIGHT, RIGHT_DOORS[1] - CASING)],
        [(RIGHT, RIGHT_DOORS[1] + CASING), (RIGHT, RIGHT_DOORS[0] - CASING)],
        [(RIGHT, RIGHT_DOORS[0] + CASING), (RIGHT, NEAR), (half, NEAR)],
        [(-half, NEAR), (LEFT, NEAR), (LEFT, LEFT_DOOR + CASING)],
        [(LEFT, LEFT_DOOR - CASING), (LEFT, FAR), (-CASING, FAR)],
    ]
    room.put("Building", building.skirting("Skirting", runs))
    room.put("Building", building.door("Door"), (LEFT, 0.0, LEFT_DOOR), TOWARDS_RIGHT, "DoorLeft")
    for index, z in enumerate(RIGHT_DOORS):
        room.put("Building", building.door("Door"), (RIGHT, 0.0, z), TOWARDS_LEFT, f"DoorRight{index + 1}")
    room.put("Building", building.door("Door"), (0.0, 0.0, FAR), ORIGIN, "DoorEnd")
    room.put("Building", entrance.front_door("FrontDoor"), (0.0, 0.0, NEAR), (0.0, 180.0, 0.0))
    room.put("Building", building.switch("Switch"), (LEFT, 1.08, LEFT_DOOR + 0.70), TOWARDS_RIGHT, "Switch1")
    room.put("Building", building.switch("Switch"), (0.66, 1.08, FAR), ORIGIN, "Switch2")
    room.put("Building", building.socket("Socket"), (RIGHT, 0.30, -1.9), TOWARDS_LEFT)
    for index, z in enumerate((1.45, -1.55)):
        room.put(
            "Building", bathroom.globe_lamp("CeilingLamp", 0.12), (0.0, HEIGHT, z), ORIGIN, f"CeilingLamp{index + 1}"
        )


def _furniture(room: Room) -> None:
    room.put("Furnishings", building.rug("Runner", 2.9, 0.88, "Runner"), (0.12, 0.0, -0.75), (0.0, 90.0, 0.0))
    room.put("Furnishings", hall.doormat("Doormat"), (0.0, 0.0, NEAR - 0.36))
    room.put("Furniture", hall.console("Console"), (LEFT + 0.017, 0.0, CONSOLE), TOWARDS_RIGHT)
    room.put_template("Furnishings", "Mirror", "mirror_01", (LEFT + 0.015, 1.02, CONSOLE), TOWARDS_RIGHT, "brass")
    room.put("Furniture", bedroom.bench("Bench", 0.95), (LEFT + 0.23, 0.0, BENCH), TOWARDS_RIGHT)
    room.put_template("Furniture", "CoatRack", "coat_rack_01", (LEFT + 0.30, 0.0, 2.62), (0.0, 22.0, 0.0))
    room.put_template("Furniture", "UmbrellaStand", "umbrella_stand_01", (RIGHT - 0.17, 0.0, 2.66), (0.0, 60.0, 0.0))
    for index, z in enumerate((BENCH - 0.34, BENCH, BENCH + 0.34)):
        room.put("Furnishings", bathroom.hook(f"Hook{index + 1}"), (LEFT, 1.70, z), TOWARDS_RIGHT)
    for index, (material, z, size) in enumerate((("SprigRound", -1.95, 0.42), ("Arches", -2.60, 0.42))):
        art = small.picture(f"Print{index + 1}", material, size, size * 4 / 3, "Oak", 0.05)
        room.put("Pictures", art, (RIGHT - 0.001, 1.55, z), TOWARDS_LEFT)
    landscape = small.picture("Landscape", "Meadow", 0.60, 0.40, "Walnut")
    room.put("Pictures", landscape, (RIGHT - 0.001, 1.55, 0.76), TOWARDS_LEFT)
    room.put_template("Plants", "RubberPlant", "plant_02", (LEFT + 0.28, 0.0, -2.52))


def _belongings(room: Room) -> None:
    side = LEFT + 0.03
    room.put("Furnishings", hall.coat("Coat1", "CoatWool", 5, 0.42, 0.96), (side, 1.70, BENCH - 0.34), TOWARDS_RIGHT)
    room.put(
        "Furnishings", hall.coat("Coat2", "UmbrellaNavy", 9, 0.40, 0.84), (side, 1.70, BENCH + 0.30), TOWARDS_RIGHT
    )
    room.put("Furnishings", hall.scarf("Scarf", "Mustard"), (LEFT + 0.045, 1.705, BENCH), ORIGIN)
    room.put_template("Furnishings", "Shoes", "shoes_01", (LEFT + 0.26, 0.0, BENCH - 0.18), (0.0, 84.0, 0.0))
    room.put_template("Furnishings", "Shoes2", "shoes_01", (LEFT + 0.25, 0.0, BENCH + 0.20), (0.0, 97.0, 0.0), "navy")
    room.put_template("Furnishings", "Boots", "boots_01", (RIGHT - 0.20, 0.0, 2.40), (0.0, -82.0, 0.0))
    room.put_template("Furnishings", "Suitcase", "suitcase_01", (RIGHT - 0.16, 0.0, 0.74), (0.0, -90.0, 0.0))
    room.put_template("Furnishings", "Hat", "hat_01", (LEFT + 0.20, 0.458, BENCH - 0.20), (0.0, 65.0, 0.0))
    top, x = 0.80, LEFT + 0.18
    room.put("Furniture", bedroom.table_lamp("TableLamp"), (x - 0.01, top, CONSOLE - 0.34))
    room.put_template("Plants", "Vase", "vase_01", (x, top, CONSOLE + 0.34), (0.0, 200.0, 0.0))
    room.put_template("TableThings", "KeyBowl", "bowl_01", (x + 0.03, top, CONSOLE + 0.05), (0.0, 20.0, 0.0), "green")
    for index, (spine, yaw) in enumerate(((6, 12.0), (11, -6.0))):
        item = small.book(f"HallBook{index + 1}", spine, 0.14, 0.21, 0.024)
        room.put("TableThings", item, (x + 0.02, 0.18 + 0.024 * index, CONSOLE - 0.22), (0.0, 90.0 + yaw, 0.0))
    room.put_template("Furniture", "Box", "box_01", (x, 0.18, CONSOLE + 0.20), (0.0, 88.0, 0.0))


def _light(room: Room) -> None:
    strength = {"day": 3.4, "evening": 1.4, "night": 0.10}
    color = {"day": (1.0, 0.99, 0.96), "evening": (1.0, 0.62, 0.36), "night": (0.30, 0.45, 1.0)}
    spread = {"day": 5.0, "evening": 2.0, "night": 1.0}  # compresses the range between the bright panes and the room
    glazing = [(f"PaneLight{index + 1}", *pane) for index, pane in enumerate(entrance.PANES)]
    glazing.append(
        ("TransomLight", 0.0, entrance.TALL + 0.07 + entrance.TRANSOM / 2.0, entrance.LEAF, entrance.TRANSOM)
    )
    for name, x, y, width, height in glazing:
        at = (-x, y, NEAR + 0.12 - 0.006)
        room.panel(name, width - 0.004, height - 0.004, at, ORIGIN, strength, color, "frosted_color.png", spread)
    for index, z in enumerate((1.45, -1.55)):
        room.bulb(
            f"CeilingLight{index + 1}", (0.0, HEIGHT - 0.21, z), 0.1205, {"day": 1.2, "evening": 3.0, "night": 4.0}
        )
    lamp = (LEFT + 0.17, 1.13, CONSOLE - 0.34)
    room.bulb("TableLampLight", lamp, 0.03, {"day": 8.0, "evening": 26.0, "night": 26.0})
    room.scale_emission("BedsideShade", {"day": 0.4, "evening": 0.8, "night": 0.8})
    room.dome("Outside", {"day": 0.5, "evening": 0.1, "night": 0.01})
    for name, x, y, width, height in glazing:
        room.portal("Outside", name.replace("Light", "Portal"), width, height, (-x, y, NEAR + 0.12), ORIGIN)


def _cameras(room: Room) -> None:
    exposure = {"day": 2.55, "evening": 2.9, "night": 3.1}
    room.camera("Main", (0.52, 1.48, 2.50), (-0.22, 1.02, -1.60), fov=58.0, exposure=exposure)
    room.camera("Agent", (0.25, 2.0, 2.30), turn=(-22.0, 4.0, 0.0), fov=60.0, exposure=exposure, focus=2.4)
    room.camera("Door", (0.45, 1.45, -2.55), (-0.12, 1.08, 2.0), fov=56.0, exposure=exposure)
    room.camera("Console", (0.72, 1.45, -1.55), (-0.80, 0.98, 0.02), fov=54.0, exposure=exposure)
    room.camera("Shoes", (0.72, 0.95, -0.55), (-0.75, 0.45, -1.85), fov=46.0, exposure=exposure)
