# SPDX-License-Identifier: Apache-2.0
"""room_04, a kitchen of 3.6 × 4 × 2.7 m: x from -1.8 to 1.8, z from -2 to 2, the floor at y = 0.

Cabinets stand along the -x wall, with the sink below the window, and along the -z wall, with stove and refrigerator; a
round table stands to the right; the door is in the +z wall. The space before the cabinets is kept free for flying
objects.
"""

from __future__ import annotations

from usd_scenes.author.models import (
    bathroom,
    building,
    cabinets,
    sanitary,
    small,
    tables,
    tiling,
    towels,
)
from usd_scenes.author.room import ORIGIN, SKY, SUNLIGHT, Room

LEFT, RIGHT, FAR, NEAR, HEIGHT = -1.8, 1.8, -2.0, 2.0, 2.7
WALL = 0.28
WINDOW, WINDOW_WIDTH, SILL, HEAD = -0.35, 1.30, 1.06, 2.28
DOOR = -0.96  # center along x, in the +z wall
TOWARDS_ROOM = (0.0, 90.0, 0.0)  # rotation of objects on the -x wall
RUN_END = 1.10  # z at which the cabinets at the -x wall end
TOP = cabinets.TOP
FACE = tiling.THICK
TABLE = (0.98, 0.70)  # x, z
STOVE = 0.0  # center along x


def build() -> Room:
    """Build the scene."""
    room = Room("Room04", "room_04")
    _shell(room)
    _cabinets(room)
    _shelves(room)
    _worktop(room)
    _table(room)
    _light(room)
    _cameras(room)
    return room


def _shell(room: Room) -> None:
    width, depth = RIGHT - LEFT, NEAR - FAR
    corners = [(LEFT, FAR), (RIGHT, FAR), (RIGHT, NEAR), (LEFT, NEAR)]
    half = WINDOW_WIDTH / 2.0
    hole = building.WallOpening(NEAR - WINDOW - half, NEAR - WINDOW + half, SILL, HEAD)
    room.put("Building", tiling.checkered_floor("Floor", width, depth, ("CementLight", "CementDark"), 0.30, 401))
    room.put("Building", building.ceiling(width, depth, HEIGHT))
    for index, name in enumerate(("WallStove", "WallTable", "WallDoor", "WallWindow")):
        start, end = corners[index], corners[(index + 1) % 4]
        holes = [hole] if name == "WallWindow" else []
        room.put("Building", building.wall(name, start, end, HEIGHT, WALL, "WarmPlaster", holes, building.FOOTING))
    room.put("Building", building.cornice("Cornice", corners, HEIGHT))
    runs = [[(RIGHT, FAR), (RIGHT, NEAR), (DOOR + 0.527, NEAR)], [(DOOR - 0.527, NEAR), (LEFT, NEAR), (LEFT, RUN_END)]]
    room.put("Building", building.skirting("Skirting", runs))
    room.put("Building", building.door("Door"), (DOOR, 0.0, NEAR), (0.0, 180.0, 0.0))
    room.put("Building", building.switch("Switch"), (DOOR + 0.70, 1.08, NEAR), (0.0, 180.0, 0.0))
    room.put("Building", building.socket("Socket"), (-1.02, 1.13, FAR + FACE), name="Socket1")
    room.put("Building", building.socket("Socket"), (RIGHT, 0.30, 0.9), (0.0, -90.0, 0.0), "Socket2")
    tile = (0.15, 0.075)
    far = tiling.tiled_wall("TilesStove", 2.82, 0.60, "MetroTile", tile, 402, bond=0.5)
    room.put("Building", far, (LEFT, TOP, FAR))
    opening = building.WallOpening(RUN_END - WINDOW - half, RUN_END - WINDOW + half, SILL - TOP, 9.0)
    side = tiling.tiled_wall("TilesWindow", RUN_END - FAR, 0.60, "MetroTile", tile, 403, [opening], bond=0.5)
    room.put("Building", side, (LEFT, TOP, RUN_END), TOWARDS_ROOM)
    window = building.window("Window", WINDOW_WIDTH, HEAD - SILL, WALL)
    room.put("Building", window, (LEFT, SILL, WINDOW), TOWARDS_ROOM)
    room.pane("Building/Window", WINDOW_WIDTH, HEAD - SILL, WALL)


def _cabinets(room: Room) -> None:
    length, sink = RUN_END - FAR, RUN_END - WINDOW  # along the run at the -x wall
    side = [(0.40, "door"), (sink - 0.30 - 0.40, "drawers"), (0.60, "sink"), (length - sink - 0.30 - 0.60, "door")]
    room.put("Furniture", cabinets.base_units("CabinetsWindow", side), (LEFT, 0.0, RUN_END), TOWARDS_ROOM)
    slabs = [
        (-0.012, sink - 0.30, 0.0, 0.615),
        (sink + 0.30, length - 0.615, 0.0, 0.615),
        (sink - 0.30, sink + 0.30, 0.0, 0.147),
    ]
    room.put("Furniture", cabinets.worktop("WorktopWindow", slabs), (LEFT, 0.0, RUN_END), TOWARDS_ROOM)
    start = LEFT + cabinets.DEPTH
    left, right = STOVE - 0.305 - start, 0.60
    far = [(left, "doors"), (0.61, "gap"), (right, "drawers")]
    room.put("Furniture", cabinets.base_units("CabinetsStove", far), (start, 0.0, FAR))
    slabs = [(LEFT - start, left, 0.0, 0.615), (left + 0.61, left + 0.61 + right + 0.01, 0.0, 0.615)]
    room.put("Furniture", cabinets.worktop("WorktopStove", slabs), (start, 0.0, FAR))
    room.put_template("Furniture", "Sink", "sink_01", (LEFT + 0.385, TOP - 0.262, WINDOW), TOWARDS_ROOM)
    room.put("Furniture", sanitary.basin_tap("Tap"), (LEFT + 0.075, TOP, WINDOW + 0.02), TOWARDS_ROOM)
    room.put_template("Furniture", "Stove", "stove_01", (STOVE, 0.0, FAR + 0.30), ORIGIN, "black")
    room.put_template("Furniture", "Fridge", "fridge_01", (1.40, 0.0, FAR + 0.38))
    room.put("Furniture", cabinets.hood("Hood", HEIGHT - 1.62), (STOVE, 1.62, FAR))
    towel = towels.hanging_towel("TeaTowel", "TerryWhite", 0.30, 0.34, 0.30, 0.0105, 41)
    room.put("Furnishings", towel, (STOVE - 0.06, 0.727 + 0.0105, FAR + 0.30 - 0.027 + 0.29 + 0.048))


def _shelves(room: Room) -> None:
    """Place two shelves left of the hood and one right of it, with tableware and jars."""
    left, right = -1.08, 0.66
    for index, y in enumerate((1.56, 1.93)):
        room.put("Furniture", cabinets.shelf("Shelf", 1.30), (left, y, FAR), name=f"Shelf{index + 1}")
    room.put("Furniture", cabinets.shelf("ShortShelf", 0.56), (right, 1.56, FAR), name="Shelf3")
    z, low, high = FAR + 0.125, 1.56, 1.93
    for index in range(5):
        color = "blue" if index % 2 == 0 else "stoneware"
        room.put_template(
            "TableThings", f"Dish{index + 1}", "dish_01", (-1.55, low + 0.011 * index, z + 0.02), ORIGIN, color
        )
    for index in range(3):
        room.put_template(
            "TableThings", f"Bowl{index + 1}", "bowl_01", (-1.20, low + 0.022 * index, z + 0.02), ORIGIN, "cream"
        )
    for index, (x, turn, color) in enumerate(
        ((-0.93, 35.0, "blue"), (-0.82, 20.0, "cream"), (-0.71, 48.0, "blue"), (-0.59, 28.0, "stoneware"))
    ):
        room.put_template("TableThings", f"Cup{index + 1}", "cup_01", (x, low, z), (0.0, turn, 0.0), color)
    for index, (x, color) in enumerate(((-1.60, "white"), (-1.46, "white"), (-1.32, "blue"))):
        room.put_template(
            "TableThings", f"Jar{index + 1}", "storage_jar_01", (x, high, z), (0.0, 30.0 * index, 0.0), color
        )
    room.put_template("TableThings", "Ewer", "ewer_01", (-1.03, high, z + 0.01), (0.0, 205.0, 0.0))
    room.put_template("TableThings", "ShelfPot", "pot_01", (-0.66, high, z - 0.005), (0.0, 8.0, 0.0), "cream")
    for index, (spine, thick, tall) in enumerate(
        ((2, 0.032, 0.25), (7, 0.026, 0.24), (12, 0.040, 0.26), (4, 0.024, 0.235), (9, 0.030, 0.25))
    ):
        book = small.book(f"CookBook{index + 1}", spine, 0.18, tall, thick)
        x = 0.46 + sum((0.034, 0.028, 0.042, 0.026, 0.032)[:index]) + thick
        room.put("Books", book, (x, low + tall / 2.0, z), (-90.0, 90.0, 0.0))
    room.put_template("Plants", "Vase", "vase_01", (0.82, low, z), (0.0, 30.0, 0.0))


def _worktop(room: Room) -> None:
    """Place what stands on the worktops, the stove and the sill."""
    top = TOP + 0.0005
    wall = FAR + 0.16
    room.put_template("TableThings", "Kettle", "kettle_01", (STOVE + 0.145, TOP + 0.044, FAR + 0.43), (0.0, 150.0, 0.0))
    room.put_template(
        "TableThings", "Pot", "pot_01", (STOVE - 0.145, TOP + 0.044, FAR + 0.18), (0.0, 25.0, 0.0), "mint"
    )
    room.put_template("TableThings", "Utensils", "utensils_01", (STOVE - 0.42, top, wall + 0.02), (0.0, 20.0, 0.0))
    for index, (dx, dz, color) in enumerate(((-0.55, 0.0, "green"), (-0.64, 0.03, "yellow"))):
        room.put_template(
            "TableThings",
            f"Bottle{index + 1}",
            "bottle_01",
            (STOVE + dx, top, wall - 0.03 + dz),
            (0.0, 25.0 - 40.0 * index, 0.0),
            color,
        )
    room.put_template("TableThings", "Toaster", "toaster_01", (STOVE + 0.60, top, wall + 0.07), (0.0, -8.0, 0.0))
    room.put_template("TableThings", "Board", "cutting_board_01", (-1.28, top, wall + 0.13), (-90.0, 62.0, 0.0))
    room.put_template("TableThings", "Bread", "bread_01", (-1.29, top + 0.022, wall + 0.12), (0.0, -20.0, 0.0))
    room.put_template(
        "TableThings", "Board2", "cutting_board_01", (-0.98, top, FAR + 0.070), (-11.0, 0.0, 0.0), "walnut"
    )
    side = LEFT + 0.10
    room.put("TableThings", bathroom.soap_dispenser("SoapDispenser"), (side, top, WINDOW + 0.38), (0.0, 70.0, 0.0))
    for index, (dx, dz, turn) in enumerate(((0.21, 0.74, 15.0), (0.33, 0.86, 80.0))):
        room.put_template(
            "TableThings",
            f"WashedCup{index + 1}",
            "cup_01",
            (LEFT + dx, top, WINDOW + dz),
            (180.0, turn, 0.0),
            ("green", "cream")[index],
        )
    room.put_template(
        "TableThings", "WashedDish", "dish_01", (LEFT + 0.24, top, WINDOW + 1.14), (0.0, 0.0, 0.0), "green"
    )
    for index, z in enumerate((WINDOW - 0.42, WINDOW + 0.46)):
        plant = ("plant_01", "white") if index else ("plant_01", "clay")
        room.put_template(
            "Plants",
            f"SillPlant{index + 1}",
            plant[0],
            (LEFT - 0.075, SILL + 0.001, z),
            (0.0, 70.0 * index, 0.0),
            plant[1],
        )
    jar = (LEFT - 0.06, SILL + 0.001, WINDOW + 0.10)
    room.put(
        "TableThings", bathroom.bottle("WashingUp", "AmberGlass", 0.19), (jar[0], jar[1], jar[2]), (0.0, 100.0, 0.0)
    )


def _table(room: Room) -> None:
    x, z, top = *TABLE, 0.75
    room.put("Furniture", cabinets.round_table("Table"), (x, 0.0, z))
    for index, (dx, dz, yaw) in enumerate(((-0.30, 0.62, 154.0), (0.42, -0.60, -35.0))):
        room.put_template(
            "Furniture",
            f"Chair{index + 1}",
            "chair_02",
            (x + dx, 0.0, z + dz),
            (0.0, yaw, 0.0),
            ("white", "mustard")[index],
        )
    room.put_template("Furniture", "Stool", "stool_01", (-0.98, 0.0, 0.74), (0.0, 20.0, 0.0))
    room.put_template("TableThings", "FruitBowl", "fruit_bowl_01", (x + 0.10, top, z - 0.08), (0.0, 35.0, 0.0), "blue")
    room.put_template("TableThings", "TableCup", "cup_01", (x - 0.22, top, z + 0.12), (0.0, 30.0, 0.0), "cream")
    for index, (spine, yaw) in enumerate(((5, 24.0), (13, 8.0))):
        item = small.book(f"Magazine{index + 1}", spine, 0.21, 0.285, 0.009)
        room.put("TableThings", item, (x - 0.10, top + 0.009 * index, z - 0.23 - 0.01 * index), (0.0, 90.0 + yaw, 0.0))
    side = RIGHT - 0.001
    for index, (material, dz) in enumerate((("SprigRound", -0.30), ("SprigLong", 0.22))):
        art = small.picture(f"Print{index + 1}", material, 0.36, 0.48, "Oak", 0.05)
        room.put("Pictures", art, (side, 1.58, z + dz), (0.0, -90.0, 0.0))
    room.put("Furnishings", cabinets.wall_clock("Clock"), (0.35, 1.95, NEAR - 0.001), (0.0, 180.0, 0.0))
    room.put_template("Furniture", "RecycleBin", "recycle_bin_02", (0.10, 0.0, NEAR - 0.20), (0.0, 186.0, 0.0), "gray")
    room.put_template("Plants", "FigTree", "plant_02", (1.42, 0.0, 1.60), (0.0, 70.0, 0.0), "clay")
    room.put("Furniture", tables.pendant("Pendant", 0.95), (x, HEIGHT, z))
    room.put("Furniture", bathroom.globe_lamp("CeilingLamp", 0.12), (-0.55, HEIGHT, -0.45))


def _light(room: Room) -> None:
    room.dome("Sky", *SKY)
    size, middle = (WINDOW_WIDTH, round(HEAD - SILL, 3)), (SILL + HEAD) / 2.0
    room.portal("Sky", "Portal", *size, (LEFT - WALL, middle, WINDOW), (0.0, -90.0, 0.0))
    room.sun(
        "Sun", {"day": (-0.80, 0.50, 0.33), "evening": (-0.92, 0.17, 0.36), "night": (-0.55, 0.75, 0.30)}, *SUNLIGHT
    )
    lamp = (TABLE[0], HEIGHT - 0.95 + 0.075, TABLE[1])
    room.bulb("PendantLight", lamp, 0.045, {"day": 0.0, "evening": 45.0, "night": 70.0})
    room.bulb("CeilingLight", (-0.55, HEIGHT - 0.21, -0.45), 0.1205, {"day": 0.0, "evening": 3.0, "night": 5.0})
    hood = {"day": 0.0, "evening": 3.0, "night": 5.0}
    room.panel("HoodLight", 0.20, 0.05, (STOVE, 1.61, FAR + 0.40), (-90.0, 0.0, 0.0), hood, (1.0, 0.80, 0.58))


def _cameras(room: Room) -> None:
    exposure = {"day": 3.4, "evening": 3.5, "night": 3.3}
    room.camera("Main", (0.60, 1.46, 1.80), (-0.72, 0.86, -1.70), fov=58.0, exposure=exposure)
    room.camera("Agent", (-0.55, 2.0, 1.30), turn=(-22.0, -18.0, 0.0), fov=60.0, exposure=exposure, focus=2.4)
    room.camera("Stove", (-0.30, 1.48, 0.95), (-0.10, 1.12, -2.0), fov=56.0, exposure=exposure)
    facing = {**exposure, "day": 4.1}  # for the wall that the window does not light
    room.camera("Table", (-1.25, 1.48, -0.60), (1.15, 0.82, 0.95), fov=54.0, exposure=facing)
    room.camera("Bread", (-0.62, 1.26, -1.02), (-1.28, 0.95, -1.72), fov=36.0, exposure=facing, f_stop=2.8)
