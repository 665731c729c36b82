# SPDX-License-Identifier: Apache-2.0
"""room_02, a living room of 8 × 7 × 2.9 m: x from -4.4 to 3.6, z from -6 to 1, the floor at y = 0.

Sun and sky come through two windows in the -x wall; sofa and pictures at the far wall, the dining table to the right,
the television behind the usual camera. The space over the coffee table is kept free for flying objects.
"""

from __future__ import annotations

import numpy as np

from usd_scenes.author.models import bedroom, building, cutlery, plants, seating, small, tables, tableware
from usd_scenes.author.room import ORIGIN, SKY, SUNLIGHT, Room

LEFT, RIGHT, FAR, NEAR, HEIGHT = -4.4, 3.6, -6.0, 1.0, 2.9
WALL = 0.32
SUN = (-0.80, 0.50, 0.33)
WINDOWS = (-4.25, -1.55)  # centers along z, in the -x wall
GARDEN_WINDOW = 1.75  # center along x, in the wall behind the camera
WINDOW_WIDTH, SILL, HEAD = 1.70, 0.42, 2.52
SIDE_LAMP = (-2.12, 0.83, NEAR - 0.20)


def build() -> Room:
    """Build the scene."""
    room = Room("Room02", "room_02")
    _shell(room)
    _sitting(room)
    _dining(room)
    _books(room)
    _television(room)
    _light(room)
    _cameras(room)
    return room


def _shell(room: Room) -> None:
    center = ((LEFT + RIGHT) / 2.0, 0.0, (FAR + NEAR) / 2.0)
    width, depth = RIGHT - LEFT, NEAR - FAR
    corners = [(LEFT, FAR), (RIGHT, FAR), (RIGHT, NEAR), (LEFT, NEAR)]
    half = WINDOW_WIDTH / 2.0
    openings = [building.WallOpening(NEAR - z - half, NEAR - z + half, SILL, HEAD) for z in WINDOWS]
    garden = building.WallOpening(RIGHT - GARDEN_WINDOW - half, RIGHT - GARDEN_WINDOW + half, SILL, HEAD)
    room.put("Building", building.planks(width, depth, 17), center)
    room.put("Building", building.ceiling(width, depth, HEIGHT), center)
    names = ("WallFar", "WallRight", "WallNear", "WallWindows")
    for index, name in enumerate(names):
        start, end = corners[index], corners[(index + 1) % 4]
        material = "AccentPlaster" if name == "WallFar" else "WallPlaster"
        holes = {"WallWindows": openings, "WallNear": [garden]}.get(name, [])
        room.put("Building", building.wall(name, start, end, HEIGHT, WALL, material, holes))
    room.put("Building", building.cornice("Cornice", corners, HEIGHT))
    door_z = -0.15
    runs = [[(RIGHT, door_z + 0.527), (RIGHT, NEAR), (LEFT, NEAR), *corners[:2], (RIGHT, door_z - 0.527)]]
    room.put("Building", building.skirting("Skirting", runs))
    room.put("Building", building.door("Door"), (RIGHT, 0.0, door_z), (0.0, -90.0, 0.0))
    room.put("Building", building.switch("Switch"), (RIGHT, 1.08, door_z - 0.72), (0.0, -90.0, 0.0))
    window = building.window("Window", WINDOW_WIDTH, HEAD - SILL, WALL)
    for index, z in enumerate(WINDOWS):
        room.put("Building", window, (LEFT, SILL, z), (0.0, 90.0, 0.0), f"Window{index + 1}")
        room.pane(f"Building/Window{index + 1}", WINDOW_WIDTH, HEAD - SILL, WALL)
        curtains = building.curtain_pair(f"Curtains{index + 1}", WINDOW_WIDTH, 2.66, 60 + 10 * index)
        room.put("Furnishings", curtains, (LEFT + 0.13, 0.012, z), (0.0, 90.0, 0.0))
    room.put("Building", window, (GARDEN_WINDOW, SILL, NEAR), (0.0, 180.0, 0.0), "Window3")
    room.pane("Building/Window3", WINDOW_WIDTH, HEAD - SILL, WALL)
    curtains = building.curtain_pair("Curtains3", WINDOW_WIDTH, 2.66, 80)
    room.put("Furnishings", curtains, (GARDEN_WINDOW, 0.012, NEAR - 0.13), (0.0, 180.0, 0.0))


def _sitting(room: Room) -> None:
    rug_center = (-1.55, 0.0, -3.75)
    room.put("Furnishings", building.rug("Rug"), rug_center)
    room.put("Furniture", seating.sofa("Sofa"), (-1.55, 0.0, -5.42))
    room.put("Furniture", tables.coffee_table("CoffeeTable"), (-1.50, 0.011, -3.95), (0.0, 3.0, 0.0))
    room.put_template("Furniture", "Armchair", "armchair_01", (-3.35, 0.0, -3.45), (0.0, 62.0, 0.0))
    room.put_template("Furniture", "Pouf", "pouf_01", (0.46, 0.0, -3.42), (0.0, 20.0, 0.0))
    room.put_template("Furniture", "Armchair2", "armchair_01", (-3.38, 0.0, -1.62), (0.0, 105.0, 0.0))
    room.put_template("Furniture", "Pouf2", "pouf_01", (-2.62, 0.0, -1.28), (0.0, 64.0, 0.0), "cream")
    room.put("Furniture", tables.floor_lamp("FloorLamp"), (0.02, 0.0, -5.55))
    room.put("Plants", plants.rubber_plant("RubberPlant"), (-3.75, 0.0, -5.45))
    for index, (material, x, z, turn, size) in enumerate(
        (
            ("Mustard", -2.22, -5.28, (-21.0, 24.0, 0.0), 0.46),
            ("Cream", -2.02, -5.16, (-24.0, 8.0, 0.0), 0.42),
            ("Rust", -0.86, -5.24, (-21.0, -20.0, 0.0), 0.46),
        )
    ):
        room.put(
            "Furnishings", seating.scatter_pillow(f"Pillow{index + 1}", material, size, 40 + index), (x, 0.505, z), turn
        )
    room.put("Furnishings", seating.folded_throw("Throw"), (-0.49, 0.615, -5.30), (0.0, 0.0, 0.0))
    top = 0.412
    level = top
    stack = ((5, 0.19, 0.26, 0.030, 8.0), (10, 0.17, 0.24, 0.024, -6.0), (0, 0.14, 0.21, 0.028, 15.0))
    for index, (spine, width, height, thick, yaw) in enumerate(stack):
        item = small.book(f"TableBook{index + 1}", spine, width, height, thick)
        room.put("TableThings", item, (-1.86, level, -3.93), (0.0, 90.0 + yaw, 0.0))
        level += thick
    room.put_template("TableThings", "TableBowl", "bowl_01", (-1.40, top, -4.06))
    for index, (material, x, y, z) in enumerate(
        (("Lemon", -1.44, 0.030, -4.08), ("Lemon", -1.36, 0.030, -4.05), ("Apple", -1.40, 0.028, -4.005))
    ):
        room.put("TableThings", small.fruit(f"Fruit{index + 1}", material, index + 1), (x, top + y - 0.010, z))
    room.put_template("TableThings", "TableRemote", "remote_controller_01", (-1.52, top, -3.77), (0.0, 62.0, 0.0))
    room.put_template("TableThings", "Cellphone", "cellphone_01", (-1.22, top, -3.74), (0.0, -18.0, 0.0))
    room.put_template("TableThings", "TableCup", "cup_01", (-1.10, top, -3.84), (0.0, -35.0, 0.0))
    room.put("TableThings", small.candle("TableCandle", 0.10, 0.034), (-1.13, top, -4.05))
    shelf = 0.011 + 0.163
    for index, (spine, yaw) in enumerate(((7, 4.0), (2, -9.0), (13, 12.0))):
        item = small.book(f"Magazine{index + 1}", spine, 0.21, 0.285, 0.009)
        room.put("TableThings", item, (-1.62, shelf + 0.009 * index, -3.95), (0.0, 90.0 + yaw, 0.0))
    corner = (-3.72, 0.0, -2.72)
    room.put("Furniture", tables.side_table("SideTable"), corner)
    room.put("TableThings", small.book("ReadingBook", 6, 0.135, 0.205, 0.026), (-3.70, 0.505, -2.68), (0.0, 35.0, 0.0))
    room.put_template("TableThings", "ReadingCup", "cup_01", (-3.80, 0.505, -2.85), (0.0, 70.0, 0.0))
    room.put("Furniture", tables.basket("Basket"), (-0.05, 0.0, -4.85))
    wall = FAR + 0.001
    room.put("Pictures", small.picture("Landscape", "Landscape", 1.20, 0.80, "Oak"), (-1.62, 1.62, wall))
    room.put(
        "Pictures", small.picture("AbstractWarm", "AbstractWarm", 0.45, 0.60, "Walnut", 0.055), (-2.82, 1.72, wall)
    )
    room.put(
        "Pictures", small.picture("AbstractCool", "AbstractCool", 0.45, 0.60, "Walnut", 0.055), (-3.44, 1.62, wall)
    )


def _dining(room: Room) -> None:
    x, z, top = 1.95, -2.55, 0.75
    room.put("Furniture", tables.dining_table("DiningTable"), (x, 0.0, z), (0.0, 90.0, 0.0))
    seats = ((-0.62, -0.42, 90.0), (-0.66, 0.40, 84.0), (0.62, -0.40, -90.0), (0.70, 0.46, -101.0))
    for index, (dx, dz, yaw) in enumerate(seats):
        room.put_template("Furniture", f"Chair{index + 1}", "chair_01", (x + dx, 0.0, z + dz), (0.0, yaw, 0.0))
    for index, (dx, dz) in enumerate(((-0.25, -0.42), (-0.25, 0.42), (0.25, -0.42), (0.25, 0.42))):
        room.put_template("TableThings", f"Dish{index + 1}", "dish_01", (x + dx, top, z + dz))
    room.put_template("TableThings", "Ewer", "ewer_01", (x + 0.04, top, z - 0.05), (0.0, 140.0, 0.0))
    room.put_template("TableThings", "DiningCup1", "cup_01", (x - 0.16, top, z + 0.68), (0.0, 20.0, 0.0))
    room.put_template("TableThings", "DiningCup2", "cup_01", (x + 0.15, top, z - 0.68), (0.0, 200.0, 0.0))
    for index, (side, dz) in enumerate(((-1.0, -0.42), (-1.0, 0.42), (1.0, -0.42), (1.0, 0.42))):
        # Seen from the seat, the fork lies on a napkin left of the dish, the knife right of it.
        left = 0.20 * side
        place = (x + 0.25 * side, z + dz)
        room.put(
            "TableThings",
            cutlery.napkin("Napkin"),
            (place[0], top, place[1] + left),
            (0.0, 90.0, 0.0),
            f"Napkin{index + 1}",
        )
        room.put_template(
            "TableThings",
            f"Fork{index + 1}",
            "fork_01",
            (place[0], top + 0.0125, place[1] + left),
            (0.0, 90.0 * side, 0.0),
        )
        room.put(
            "TableThings",
            cutlery.knife("Knife"),
            (place[0], top, place[1] - left),
            (0.0, 90.0 * side, 0.0),
            f"Knife{index + 1}",
        )
    room.put("TableThings", tableware.vase("Vase"), (x - 0.03, top, z + 0.30 - 0.12))
    room.put("Plants", plants.branches("Branches"), (x - 0.03, top + 0.012, z + 0.18))
    room.put("Furniture", tables.pendant("Pendant", 1.15), (x, HEIGHT, z))


def _books(room: Room) -> None:
    """Place two bookcases at the far wall; each shelf is filled with books from the left, then an ornament."""
    rng = np.random.default_rng(29)
    case = tables.bookcase("Bookcase")
    kinds = [
        (spine, float(rng.uniform(0.125, 0.19)), float(rng.uniform(0.19, 0.27)), float(rng.uniform(0.020, 0.046)))
        for spine in range(16)
    ]
    library = [small.book(f"Book{spine:02}", spine, *size) for spine, *size in kinds]
    ornaments = (
        tableware.vase("ShelfVase", "CreamGlaze"),
        small.ornament("Ornament"),
        tableware.bowl("ShelfBowl", "BlueGlaze", 0.09),
    )
    count = 0
    for case_index, x in enumerate((1.30, 2.52)):
        z = FAR + 0.168
        room.put("Furniture", case, (x, 0.0, z), name=f"Bookcase{case_index + 1}")
        for level, y in enumerate(tables.shelf_heights()[:-1]):
            at, end = x - 0.555, x + 0.555 - float(rng.uniform(0.15, 0.62))
            while True:
                pick = int(rng.integers(16))
                _, width, height, thick = kinds[pick]
                if at + thick + 0.004 > end:
                    break
                count += 1
                depth = z + 0.138 - width / 2.0 - float(rng.uniform(0.01, 0.03))
                place = (at + thick, y + 0.012 + height / 2.0, depth)
                room.put("Books", library[pick], place, (-90.0, 90.0, 0.0), name=f"Book{count:03}")
                at += thick + float(rng.uniform(0.0005, 0.003))
            middle = (at + x + 0.555) / 2.0
            if x + 0.555 - at > 0.24:
                ornament = ornaments[(level + case_index) % 3]
                room.put("Ornaments", ornament, (middle, y + 0.012, z), name=f"{ornament.name}{count}")


def _television(room: Room) -> None:
    room.put("Furniture", tables.sideboard("Sideboard"), (-1.55, 0.0, NEAR - 0.235), (0.0, 180.0, 0.0))
    room.put("Furniture", tables.television("Television"), (-1.55, 0.5, NEAR - 0.22), (0.0, 180.0, 0.0))
    top = 0.5
    room.put("Ornaments", small.set_top_box("MediaBox"), (-1.55, top, NEAR - 0.16), (0.0, 180.0, 0.0))
    room.put_template("Ornaments", "Statue", "statue_01", (-0.78, top, NEAR - 0.24), (0.0, 160.0, 0.0))
    room.put("Furniture", bedroom.table_lamp("TableLamp"), (SIDE_LAMP[0], top, SIDE_LAMP[2]))
    room.put_template("Plants", "SillPlant", "plant_01", (1.30, SILL + 0.001, NEAR + 0.07), (0.0, 40.0, 0.0))
    room.put_template("Furniture", "RecycleBin", "recycle_bin_02", (0.98, 0.0, NEAR - 0.24))
    for index, (x, yaw) in enumerate(((1.22, 6.0), (2.62, -9.0))):
        room.put_template("Furniture", f"Box{index + 1}", "box_01", (x, 2.1, FAR + 0.17), (0.0, yaw, 0.0))
    for index, (x, z, height) in enumerate(((-2.34, 0.80, 0.16), (-2.25, 0.72, 0.11), (-2.38, 0.68, 0.07))):
        room.put("Ornaments", small.candle(f"Candle{index + 1}", height), (x, top, z))
    room.put(
        "Pictures",
        small.picture("Coast", "Coast", 0.90, 0.60, "Oak"),
        (0.15, 1.62, NEAR - 0.001),
        (0.0, 180.0, 0.0),
    )
    side = RIGHT - 0.001
    room.put("Furnishings", tables.mirror("Mirror"), (side, 1.60, -2.55), (0.0, -90.0, 0.0))
    for index, (material, z) in enumerate((("AbstractCool", -3.72), ("AbstractWarm", -4.42))):
        art = small.picture(f"Print{index + 1}", material, 0.50, 0.68, "Oak", 0.06)
        room.put("Pictures", art, (side, 1.58, z), (0.0, -90.0, 0.0))
    room.put("Building", building.socket("Socket"), (0.12, 0.30, FAR), name="Socket1")
    room.put("Building", building.socket("Socket"), (-2.75, 0.30, NEAR), (0.0, 180.0, 0.0), "Socket2")
    room.put("Plants", plants.rubber_plant("SmallPlant", 0.95, 8), (-3.7, 0.0, 0.35))


def _light(room: Room) -> None:
    room.dome("Sky", *SKY)
    # Portals are at the outer face of the walls, so that they also light reveals and frames.
    size, middle = (WINDOW_WIDTH, round(HEAD - SILL, 3)), (SILL + HEAD) / 2.0
    for index, z in enumerate(WINDOWS):
        room.portal("Sky", f"Portal{index + 1}", *size, (LEFT - WALL, middle, z), (0.0, -90.0, 0.0))
    room.portal("Sky", "Portal3", *size, (GARDEN_WINDOW, middle, NEAR + WALL), ORIGIN)
    room.sun("Sun", {"day": SUN, "evening": (-0.92, 0.17, 0.36), "night": (-0.55, 0.75, 0.30)}, *SUNLIGHT)
    room.bulb("FloorLampLight", (0.02, 1.46, -5.55), 0.035, {"day": 16.0, "evening": 60.0, "night": 100.0})
    room.bulb(
        "PendantLight", (1.95, HEIGHT - 1.15 + 0.075, -2.55), 0.045, {"day": 14.0, "evening": 50.0, "night": 110.0}
    )
    room.bulb("SideLampLight", SIDE_LAMP, 0.03, {"day": 0.0, "evening": 70.0, "night": 150.0})
    room.scale_emission("LampShade", {"day": 1.0, "evening": 2.6, "night": 2.6})
    room.scale_emission("BedsideShade", {"day": 0.0, "evening": 0.9, "night": 1.2})


def _exposure(day: float) -> dict[str, float]:
    return {"day": day, "evening": day + 0.9, "night": day + 2.0}


def _cameras(room: Room) -> None:
    room.camera("Main", (0.75, 1.32, 0.72), (-1.72, 0.88, -4.2), fov=46.0, exposure=_exposure(2.2))
    room.camera("Dining", (3.3, 1.45, 0.75), (-0.7, 0.80, -4.2), fov=50.0, exposure=_exposure(2.3))
    # SAILenv's published pose: Unity (-1.5, 2.0, 0.5), pitch 18 down, yaw 12 to the left.
    room.camera("SAILenv", (-1.5, 2.0, -0.5), turn=(-18.0, 12.0, 0.0), fov=60.0, exposure=_exposure(2.0), focus=3.6)
    room.camera("Agent", (-1.0, 2.5, -1.8), turn=(-20.0, 0.0, 0.0), fov=60.0, exposure=_exposure(2.0))
    room.camera("Sofa", (-3.55, 1.45, -5.45), (1.4, 0.85, -1.2), fov=56.0, exposure=_exposure(2.3))
    room.camera("Table", (-0.55, 0.78, -2.75), (-1.50, 0.47, -3.98), fov=36.0, exposure=_exposure(2.3), f_stop=2.8)
