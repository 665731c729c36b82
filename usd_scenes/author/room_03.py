# SPDX-License-Identifier: Apache-2.0
"""room_03, a bathroom of 3 × 2.5 × 2.7 m: x from -1.5 to 1.5, z from -1.25 to 1.25, the floor at y = 0.

The tub stands under a frosted window in the -z wall, the washbasin at the +x wall, the toilet at the -x wall; the door
is behind the usual camera. The space over the mat is kept free for flying objects.
"""

from __future__ import annotations

from usd_scenes.author.models import bathroom, building, plants, sanitary, small, tableware, tiling, towels
from usd_scenes.author.room import ORIGIN, Room

LEFT, RIGHT, FAR, NEAR, HEIGHT = -1.5, 1.5, -1.25, 1.25, 2.7
WALL = 0.28
WINDOW, WINDOW_WIDTH, SILL, HEAD = -0.42, 1.00, 1.24, 2.28
DOOR = 0.86  # center along x, in the +z wall
DADO = 1.24
BASIN = -0.10  # center along z
TOWARDS_ROOM = (0.0, -90.0, 0.0)  # rotation of objects on the +x wall
FACE = tiling.THICK


def build() -> Room:
    """Build the scene."""
    room = Room("Room03", "room_03")
    _shell(room)
    _bath(room)
    _washing(room)
    _toilet(room)
    _light(room)
    _cameras(room)
    return room


def _shell(room: Room) -> None:
    width, depth = RIGHT - LEFT, NEAR - FAR
    corners = [(LEFT, FAR), (RIGHT, FAR), (RIGHT, NEAR), (LEFT, NEAR)]
    half = WINDOW_WIDTH / 2.0
    hole = building.WallOpening(WINDOW - half - LEFT, WINDOW + half - LEFT, SILL, HEAD)
    room.put("Building", tiling.tiled_floor("Floor", width, depth, "Terrazzo", 0.5, 301))
    room.put("Building", building.ceiling(width, depth, HEIGHT))
    for index, name in enumerate(("WallWindow", "WallBasin", "WallDoor", "WallToilet")):
        holes = [hole] if name == "WallWindow" else []
        room.put(
            "Building",
            building.wall(name, corners[index], corners[(index + 1) % 4], HEIGHT, WALL, "BathPlaster", holes),
        )
    tile = (0.075, 0.225)
    door = building.WallOpening(RIGHT - DOOR - 0.53, RIGHT - DOOR + 0.53, -1.0, 3.0)
    full = tiling.tiled_wall("TilesWindow", width, HEIGHT, "Zellige", tile, 302, [hole])
    room.put("Building", full, (LEFT, 0.0, FAR))
    room.put(
        "Building", tiling.tiled_wall("TilesBasin", depth, DADO, "Zellige", tile, 303), (RIGHT, 0.0, FAR), TOWARDS_ROOM
    )
    room.put(
        "Building",
        tiling.tiled_wall("TilesToilet", depth, DADO, "Zellige", tile, 304),
        (LEFT, 0.0, NEAR),
        (0.0, 90.0, 0.0),
    )
    room.put(
        "Building",
        tiling.tiled_wall("TilesDoor", width, DADO, "Zellige", tile, 305, [door]),
        (RIGHT, 0.0, NEAR),
        (0.0, 180.0, 0.0),
    )
    rails = [
        [(RIGHT, FAR + FACE), (RIGHT, NEAR), (DOOR + 0.53, NEAR)],
        [(DOOR - 0.53, NEAR), (LEFT, NEAR), (LEFT, FAR + FACE)],
    ]
    room.put("Building", bathroom.rail("DadoRail", rails, DADO))
    room.put("Building", building.door("Door"), (DOOR, 0.0, NEAR), (0.0, 180.0, 0.0))
    room.put("Building", building.switch("Switch"), (DOOR - 0.66, 1.38, NEAR), (0.0, 180.0, 0.0))
    room.put("Building", bathroom.frosted_window("Window", WINDOW_WIDTH, HEAD - SILL, WALL), (WINDOW, SILL, FAR))
    room.put("Furniture", bathroom.globe_lamp("CeilingLamp"), (0.1, HEIGHT, 0.05))


def _bath(room: Room) -> None:
    tub = (-0.50, 0.0, -0.80)
    room.put("Furniture", sanitary.bathtub("Bathtub"), tub)
    room.put("Furniture", sanitary.bath_tap("BathTap"), (-0.50 + 0.62, 0.0, -1.14), (0.0, -28.0, 0.0))
    radiator = (1.00, 0.95, FAR + FACE)
    room.put("Furniture", sanitary.towel_radiator("TowelRadiator"), radiator)
    bars = sanitary.radiator_bars()
    for name, material, size, bar, dx, seed in (
        ("TowelLong", "TerryWhite", (0.40, 0.52, 0.40), bars[13], -0.015, 1),
        ("TowelShort", "TerryClay", (0.30, 0.33, 0.27), bars[5], 0.04, 2),
    ):
        towel = towels.hanging_towel(name, material, *size, 0.0105, seed)
        room.put("Furnishings", towel, (radiator[0] + dx, radiator[1] + bar + 0.0105, radiator[2] + 0.066))
    over = towels.hanging_towel("TowelBath", "TerryWhite", 0.46, 0.40, 0.30, 0.020, 3)
    room.put("Furnishings", over, (tub[0] - 0.28, 0.588, tub[2] + 0.362))
    room.put("Furnishings", towels.bath_mat("BathMat", "TerryClay"), (-0.42, 0.0, -0.08), (0.0, 4.0, 0.0))
    stool = (-1.22, 0.0, -0.12)
    room.put("Furniture", bathroom.stool("Stool"), stool)
    room.put(
        "Furnishings",
        towels.folded_towel("TowelFolded1", "TerryWhite", 0.29, 0.22, 3, 1),
        (stool[0], 0.45, stool[2]),
        (0.0, 8.0, 0.0),
    )
    room.put(
        "Furnishings",
        towels.folded_towel("TowelFolded2", "TerryClay", 0.27, 0.21, 2, 2),
        (stool[0], 0.532, stool[2]),
        (0.0, -5.0, 0.0),
    )
    sill = (SILL + 0.0, FAR - 0.10)
    for index, (material, x, height) in enumerate(
        (("AmberGlass", -0.74, 0.17), ("WhitePlastic", -0.64, 0.15), ("AmberGlass", -0.56, 0.12))
    ):
        bottle = bathroom.bottle(f"Bottle{index + 1}", material, height)
        room.put("TableThings", bottle, (x, sill[0], sill[1] + 0.02 * (index % 2)), (0.0, 40.0 * index, 0.0))
    room.put("Plants", plants.rubber_plant("Cutting", 0.46, 33, 0.40), (-0.06, sill[0], FAR - 0.045))
    room.put("TableThings", small.candle("Candle1", 0.09, 0.034), (-0.22, sill[0], sill[1] + 0.03))


def _washing(room: Room) -> None:
    wall, top = RIGHT - FACE, 0.82
    room.put("Furniture", sanitary.vanity("Vanity"), (wall, 0.0, BASIN), TOWARDS_ROOM)
    room.put("Furniture", sanitary.basin("Basin"), (wall - 0.255, top, BASIN), TOWARDS_ROOM)
    room.put("Furniture", sanitary.basin_tap("Tap"), (wall - 0.045, top, BASIN), TOWARDS_ROOM)
    room.put("Furnishings", bathroom.round_mirror("Mirror", 0.36), (RIGHT, 1.66, BASIN), TOWARDS_ROOM)
    for index, side in enumerate((-1.0, 1.0)):
        lamp = sanitary.wall_lamp("WallLamp")
        room.put("Furniture", lamp, (RIGHT, 1.72, BASIN + 0.52 * side), TOWARDS_ROOM, f"WallLamp{index + 1}")
    room.put("TableThings", bathroom.soap_dispenser("SoapDispenser"), (wall - 0.10, top, BASIN - 0.37), TOWARDS_ROOM)
    room.put("TableThings", bathroom.soap_dish("SoapDish"), (wall - 0.24, top, BASIN - 0.40), (0.0, -80.0, 0.0))
    room.put("TableThings", bathroom.brush_cup("ToothbrushCup"), (wall - 0.11, top, BASIN + 0.36), ORIGIN)
    room.put("TableThings", bathroom.brush("Hairbrush"), (wall - 0.20, top, BASIN + 0.37), (0.0, 80.0, 0.0))
    room.put("Ornaments", tableware.vase("Vase", "SandGlaze"), (wall - 0.12, top, BASIN + 0.475))
    room.put("Plants", plants.branches("Branches", 23), (wall - 0.12, top + 0.012, BASIN + 0.475))
    room.put("Furniture", bathroom.waste_bin("Bin"), (RIGHT - 0.20, 0.0, 0.72))


def _toilet(room: Room) -> None:
    z = 0.66
    room.put("Furniture", sanitary.toilet("Toilet"), (LEFT + FACE, 0.0, z), (0.0, 90.0, 0.0))
    room.put("Furniture", bathroom.paper_holder("PaperHolder"), (LEFT + FACE, 0.78, z - 0.42), (0.0, 90.0, 0.0))
    room.put("Furniture", bathroom.toilet_brush("ToiletBrush"), (LEFT + 0.14, 0.0, z + 0.40))
    room.put_template("Ornaments", "ToiletPaper", "toilet_paper_01", (LEFT + FACE + 0.09, 0.757, z - 0.11))
    room.put_template("Furniture", "Plunger", "plunger_01", (LEFT + 0.13, 0.0, z - 0.30))
    art = small.picture("Print1", "Arches", 0.36, 0.48, "Oak", 0.045)
    room.put("Pictures", art, (LEFT + 0.001, 1.62, z), (0.0, 90.0, 0.0))
    for index, x in enumerate((-0.5, 0.02)):
        room.put("Furnishings", bathroom.hook(f"Hook{index + 1}"), (x, 1.72, NEAR), (0.0, 180.0, 0.0))
        material = ("TerryWhite", "TerryClay")[index]
        towel = towels.hooked_towel(f"TowelHook{index + 1}", material, 0.62, (1.05, 0.95)[index], 7 + index)
        room.put("Furnishings", towel, (x, 1.72, NEAR), (0.0, 180.0, 0.0))


def _light(room: Room) -> None:
    pane = WINDOW_WIDTH - 0.21, HEAD - SILL - 0.21
    middle, back = (SILL + HEAD) / 2.0, (0.0, 180.0, 0.0)
    room.panel(
        "WindowLight",
        *pane,
        (WINDOW, middle, FAR - WALL * 0.62 + 0.012),
        back,
        {"day": 2.6, "evening": 1.6, "night": 0.12},
        {"day": (1.0, 0.99, 0.96), "evening": (1.0, 0.62, 0.36), "night": (0.30, 0.45, 1.0)},
        "frosted_color.png",
        {
            "day": 4.4,
            "evening": 2.0,
            "night": 1.0,
        },  # compresses the range between the bright window and the room
    )
    for index, side in enumerate((-1.0, 1.0)):
        at = (RIGHT - 0.11, 1.72, BASIN + 0.52 * side)
        room.bulb(f"WallLampLight{index + 1}", at, 0.0665, {"day": 2.2, "evening": 6.0, "night": 6.0})
    room.bulb("CeilingLight", (0.1, HEIGHT - 0.21, 0.05), 0.1005, {"day": 0.0, "evening": 1.2, "night": 4.5})
    room.dome("Outside", {"day": 0.5, "evening": 0.1, "night": 0.01})
    room.portal("Outside", "Portal", *pane, (WINDOW, middle, FAR - WALL), back)


def _cameras(room: Room) -> None:
    exposure = {"day": 2.55, "evening": 2.9, "night": 2.8}
    room.camera("Main", (0.98, 1.42, 1.12), (-0.50, 0.80, -0.85), fov=62.0, exposure=exposure)
    room.camera("Agent", (1.22, 2.0, 1.05), turn=(-24.0, 42.0, 0.0), fov=60.0, exposure=exposure, focus=2.2)
    room.camera("Basin", (-1.15, 1.42, 0.35), (1.2, 1.10, -0.25), fov=50.0, exposure=exposure)
    facing = {**exposure, "day": 2.15}  # for surfaces lit by the window
    room.camera("Toilet", (0.72, 1.35, -0.62), (-1.25, 0.72, 0.75), fov=56.0, exposure=facing)
    room.camera("Soap", (0.62, 1.16, 0.10), (1.33, 0.90, -0.42), fov=34.0, exposure=exposure, f_stop=2.8)
