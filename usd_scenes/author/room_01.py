# SPDX-License-Identifier: Apache-2.0
"""room_01, a bedroom of 4.5 × 4 × 2.8 m: x from -2.05 to 2.45, z from -2 to 2, the floor at y = 0.

The bed's head is at the +x wall, the window in the +z wall; a wardrobe stands behind the usual camera, a chest of
drawers at the -x wall. The space before the bed is kept free for flying objects.
"""

from __future__ import annotations

from usd_scenes.author.model import Model
from usd_scenes.author.models import bathroom, bedding, bedroom, building, plants, small, tables, tableware
from usd_scenes.author.room import ORIGIN, SKY, SUNLIGHT, Room

LEFT, RIGHT, FAR, NEAR, HEIGHT = -2.05, 2.45, -2.0, 2.0, 2.8
WALL = 0.30
WINDOW, WINDOW_WIDTH, SILL, HEAD = -0.35, 1.60, 0.82, 2.34
BED = 0.45  # center along z
BEDSIDES = (BED - 1.10, BED + 1.09)
DOOR = -1.25  # center along z, in the -x wall
TOWARDS_BED = (0.0, -90.0, 0.0)


def build() -> Room:
    """Build the scene."""
    room = Room("Room01", "room_01")
    _shell(room)
    _bed(room)
    _furniture(room)
    _clutter(room)
    _light(room)
    _cameras(room)
    return room


def _shell(room: Room) -> None:
    center = ((LEFT + RIGHT) / 2.0, 0.0, 0.0)
    width, depth = RIGHT - LEFT, NEAR - FAR
    corners = [(LEFT, FAR), (RIGHT, FAR), (RIGHT, NEAR), (LEFT, NEAR)]
    half = WINDOW_WIDTH / 2.0
    opening = building.WallOpening(RIGHT - WINDOW - half, RIGHT - WINDOW + half, SILL, HEAD)
    room.put("Building", building.planks(width, depth, 19), center)
    room.put("Building", building.ceiling(width, depth, HEIGHT), center)
    for index, name in enumerate(("WallWardrobe", "WallBed", "WallWindow", "WallDoor")):
        material = "ClayPlaster" if name == "WallBed" else "WallPlaster"
        holes = [opening] if name == "WallWindow" else []
        room.put(
            "Building", building.wall(name, corners[index], corners[(index + 1) % 4], HEIGHT, WALL, material, holes)
        )
    room.put("Building", building.cornice("Cornice", corners, HEIGHT))
    runs = [[(LEFT, DOOR - 0.527), *corners, (LEFT, DOOR + 0.527)]]
    room.put("Building", building.skirting("Skirting", runs))
    room.put("Building", building.door("Door"), (LEFT, 0.0, DOOR), (0.0, 90.0, 0.0))
    room.put("Building", building.switch("Switch"), (LEFT, 1.08, DOOR + 0.70), (0.0, 90.0, 0.0))
    room.put("Building", building.switch("Switch"), (RIGHT, 0.78, BEDSIDES[0] + 0.16), TOWARDS_BED, "BedSwitch")
    for index, z in enumerate((BEDSIDES[0] - 0.32, BEDSIDES[1] + 0.30)):
        room.put("Building", building.socket("Socket"), (RIGHT, 0.30, z), TOWARDS_BED, f"Socket{index + 1}")
    window = building.window("Window", WINDOW_WIDTH, HEAD - SILL, WALL)
    room.put("Building", window, (WINDOW, SILL, NEAR), (0.0, 180.0, 0.0))
    room.pane("Building/Window", WINDOW_WIDTH, HEAD - SILL, WALL)
    curtains = building.curtain_pair("Curtains", WINDOW_WIDTH, 2.56, 140, 0.46)
    room.put("Furnishings", curtains, (WINDOW, 0.012, NEAR - 0.13), (0.0, 180.0, 0.0))
    room.put("Building", bathroom.globe_lamp("CeilingLamp", 0.13), (0.1, HEIGHT, 0.0))


def _bed(room: Room) -> None:
    """Place bed and bedding, all in the bed's coordinates: head at the wall, foot towards -x."""
    place = (RIGHT - 0.002, 0.0, BED)
    top = bedroom.MATTRESS_TOP - 0.014

    def lay(where: str, item: Model) -> None:
        room.put(where, item, place, TOWARDS_BED)

    lay("Furniture", bedroom.bed("Bed"))
    lay("Bedding", bedding.duvet("Duvet"))
    lay("Bedding", bedding.bed_throw("Throw", "Rust"))
    for name, material, size, seed, at, pitch, yaw in (
        ("PillowBackLeft", "BedSheet", (0.70, 0.50, 0.19), 1, (-0.40, top, 0.262), 68.0, 2.0),
        ("PillowBackRight", "BedSheet", (0.70, 0.50, 0.19), 2, (0.39, top, 0.260), 69.0, -2.0),
        ("PillowLeft", "BlueLinen", (0.60, 0.44, 0.16), 3, (-0.37, top, 0.475), 57.0, -3.0),
        ("PillowRight", "BlueLinen", (0.60, 0.44, 0.16), 4, (0.41, top, 0.475), 57.0, 4.0),
        ("PillowSmall", "Rust", (0.48, 0.30, 0.14), 5, (0.02, top + 0.055, 0.640), 52.0, 4.0),
    ):
        item = bedding.leaning(bedding.bed_pillow(name, material, *size, seed), at, pitch, yaw)
        lay("Bedding", item)


def _furniture(room: Room) -> None:
    for index, z in enumerate(BEDSIDES):
        table, lamp = bedroom.bedside_table("BedsideTable"), bedroom.table_lamp("TableLamp")
        room.put("Furniture", table, (RIGHT - 0.206, 0.0, z), TOWARDS_BED, f"BedsideTable{index + 1}")
        room.put("Furniture", lamp, (RIGHT - 0.23, 0.5, z + (-0.03, 0.02)[index]), ORIGIN, f"TableLamp{index + 1}")
    room.put("Furniture", bedroom.wardrobe("Wardrobe"), (1.42, 0.0, FAR + 0.001))
    room.put("Furniture", bedroom.chest_of_drawers("Chest"), (LEFT + 0.232, 0.0, 0.55), (0.0, 90.0, 0.0))
    room.put("Furnishings", bedroom.standing_mirror("Mirror"), (LEFT + 0.002, 1.48, 0.55), (0.0, 90.0, 0.0))
    room.put_template("Furniture", "Chair", "chair_01", (-0.02, 0.0, FAR + 0.36), (0.0, -14.0, 0.0))
    room.put("Furniture", bedroom.bench("Bench"), (-0.30, 0.0, 1.74), (0.0, 180.0, 0.0))
    room.put("Furnishings", building.rug("Rug", 2.3, 1.6, "Berber"), (-0.10, 0.0, BED - 0.05), (0.0, 3.0, 0.0))
    wall = (RIGHT - 0.001, 1.62)
    for index, (material, z) in enumerate((("SprigLong", BED - 0.36), ("SprigRound", BED + 0.36))):
        art = small.picture(f"Print{index + 1}", material, 0.46, 0.60, "Oak", 0.055)
        room.put("Pictures", art, (wall[0], wall[1], z), TOWARDS_BED)
    coast = small.picture("Coast", "Coast", 0.60, 0.40, "Walnut", 0.05)
    room.put("Pictures", coast, (1.62, 1.50, NEAR - 0.001), (0.0, 180.0, 0.0))
    landscape = small.picture("Landscape", "Meadow", 0.90, 0.60, "Oak")
    room.put("Pictures", landscape, (-0.42, 1.60, FAR + 0.001))
    room.put("Plants", plants.rubber_plant("RubberPlant", 1.35, 21), (-1.62, 0.0, 1.62))
    room.put("Furniture", tables.basket("Basket"), (1.02, 0.0, 1.72))


def _clutter(room: Room) -> None:
    top = 0.5
    near, far = BEDSIDES
    for index, (spine, yaw, size) in enumerate(((3, 6.0, (0.135, 0.205, 0.026)), (12, -11.0, (0.125, 0.19, 0.020)))):
        book = small.book(f"NightBook{index + 1}", spine, *size)
        room.put("TableThings", book, (RIGHT - 0.33, top + 0.026 * index, near + 0.09), (0.0, 90.0 + yaw, 0.0))
    room.put("TableThings", bedroom.glass_of_water("Glass"), (RIGHT - 0.32, top, near - 0.14))
    room.put_template("TableThings", "Cup", "cup_01", (RIGHT - 0.33, top, far - 0.12), (0.0, 130.0, 0.0))
    room.put_template(
        "TableThings", "AlarmClock", "alarm_clock_01", (RIGHT - 0.14, top, near + 0.135), (0.0, -75.0, 0.0)
    )
    room.put_template("TableThings", "Cellphone", "cellphone_01", (RIGHT - 0.31, top, far + 0.10), (0.0, 70.0, 0.0))
    room.put_template("Bedding", "TeddyBear", "teddy_bear_01", (RIGHT - 0.86, 0.625, BED + 0.52), (-14.0, -62.0, 0.0))
    room.put_template("Furniture", "Box", "box_01", (1.05, 2.2, FAR + 0.30), (0.0, 8.0, 0.0))
    book = small.book("NightBook3", 9, 0.14, 0.21, 0.030)
    room.put("TableThings", book, (RIGHT - 0.22, 0.166, near), (0.0, 84.0, 0.0))
    book = small.book("NightBook4", 1, 0.15, 0.22, 0.024)
    room.put("TableThings", book, (RIGHT - 0.23, 0.166, far), (0.0, 97.0, 0.0))
    chest = (LEFT + 0.232, 0.82)
    room.put("Ornaments", tableware.vase("Vase", "SandGlaze"), (chest[0] - 0.06, chest[1], 0.22))
    room.put("Plants", plants.branches("Branches", 19), (chest[0] - 0.06, chest[1] + 0.012, 0.22))
    for index, (spine, width, height, thick, yaw) in enumerate(
        ((4, 0.20, 0.27, 0.028, 4.0), (14, 0.18, 0.25, 0.022, -7.0), (11, 0.15, 0.22, 0.026, 9.0))
    ):
        level = chest[1] + (0.0, 0.028, 0.050)[index]
        room.put(
            "TableThings",
            small.book(f"ChestBook{index + 1}", spine, width, height, thick),
            (chest[0] + 0.02, level, 0.86),
            (0.0, yaw, 0.0),
        )
    room.put("Ornaments", small.ornament("Ornament"), (chest[0] + 0.02, chest[1] + 0.076, 0.86))
    for index, (x, z, height) in enumerate(((0.04, 0.42, 0.13), (-0.04, 0.50, 0.085))):
        room.put("Ornaments", small.candle(f"Candle{index + 1}", height), (chest[0] + x, chest[1], z))
    for index, (spine, yaw) in enumerate(((7, -14.0), (15, 8.0))):
        item = small.book(f"BenchBook{index + 1}", spine, 0.20, 0.27, 0.022)
        room.put("TableThings", item, (-0.55, 0.458 + 0.022 * index, 1.74), (0.0, 90.0 + yaw, 0.0))


def _light(room: Room) -> None:
    room.dome("Sky", *SKY, turn=41.0)
    size, middle = (WINDOW_WIDTH, round(HEAD - SILL, 3)), (SILL + HEAD) / 2.0
    room.portal("Sky", "Portal", *size, (WINDOW, middle, NEAR + WALL), ORIGIN)
    towards = {"day": (-0.33, 0.58, 0.72), "evening": (-0.42, 0.17, 0.80), "night": (-0.25, 0.75, 0.72)}
    room.sun("Sun", towards, *SUNLIGHT)
    strength = {"day": 0.0, "evening": 26.0, "night": 26.0}
    for index, z in enumerate(BEDSIDES):
        at = (RIGHT - 0.23, 0.83, z + (-0.03, 0.02)[index])
        room.bulb(f"TableLampLight{index + 1}", at, 0.03, strength)
    room.scale_emission("BedsideShade", {"day": 0.0, "evening": 0.8, "night": 0.8})
    room.bulb("CeilingLight", (0.1, HEIGHT - 0.21, 0.0), 0.1305, {"day": 0.0, "evening": 0.0, "night": 5.0})


def _cameras(room: Room) -> None:
    exposure = {"day": 2.8, "evening": 3.6, "night": 3.7}
    room.camera("Main", (-1.78, 1.35, -1.28), (1.6, 0.70, 0.72), fov=50.0, exposure=exposure)
    # SAILenv's published pose: Unity (-1.3, 2.0, 1.5), pitch 22 down, yaw 144 to the right.
    room.camera("SAILenv", (-1.3, 2.0, -1.5), turn=(-22.0, -144.0, 0.0), fov=60.0, exposure=exposure, focus=3.0)
    room.camera("Agent", (-1.2, 2.0, -1.35), turn=(-22.0, -144.0, 0.0), fov=60.0, exposure=exposure, focus=3.0)
    room.camera("Chest", (2.12, 1.50, 1.12), (-1.6, 0.80, -0.20), fov=54.0, exposure=exposure)
    close = {"day": 3.6, "evening": 3.3, "night": 3.4}
    room.camera("Bedside", (1.05, 0.98, -0.95), (2.2, 0.66, -0.42), fov=36.0, exposure=close, f_stop=2.8)
