# SPDX-License-Identifier: Apache-2.0
"""home_01: rooms 1 to 5 as one home. A hall leads to living room, bedroom, bathroom and kitchen; its doors are open.

`rooms.usdc` references the rooms with openings cut into their walls (`tiscene.usd.join`); `scene.usda` adds the open
doors and cameras to it. The living room (room_02) is at the origin.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pxr import Sdf

from tiscene.usd.joining.floor_plan import Opening, RoomPlacement
from tiscene.usd.joining.room_join import join
from usd_scenes.author.models import entrance
from usd_scenes.author.room import Room, Vector3

PACKAGE = Path(__file__).resolve().parents[1]
ROOMS = {  # folder, position, yaw
    "living room": ("room_02", (0.0, 0.0, 0.0), 0.0),
    "hall": ("room_05", (4.94, 0.0, -1.90), 0.0),
    "bedroom": ("room_01", (8.31, 0.0, 1.10), 0.0),
    "bathroom": ("room_03", (7.49, 0.0, -3.00), -90.0),
    "kitchen": ("room_04", (5.90, 0.0, -7.30), 0.0),
}
OPENINGS = (
    Opening((3.82, 0.0, -0.15), depth=0.44, yaw=90.0),  # living room - hall
    Opening((6.05, 0.0, -0.15), depth=0.42, yaw=90.0),  # hall - bedroom
    Opening((6.04, 0.0, -2.14), depth=0.40, yaw=90.0),  # hall - bathroom
    Opening((4.94, 0.0, -5.10), depth=0.40),  # hall - kitchen
)
LEAVES: dict[str, tuple[Vector3, float]] = {  # hinge and yaw of each open door
    "LivingRoom": ((3.570, 0.0, -0.60), 106.0),
    "Bedroom": ((6.285, 0.0, -0.60), 8.0),
    "Bathroom": ((5.812, 0.0, -2.59), 101.0),
    "Kitchen": ((4.490, 0.0, -5.325), 104.0),
}
# A closed walk through all rooms at eye level: x and z, m, and yaw, degrees.
WALK = (
    *((0.3, -1.6, -70), (2.4, -0.45, -80), (3.82, -0.15, -90), (5.0, -0.15, -90), (6.05, -0.15, -90)),
    *((7.3, 0.1, -110), (7.5, 0.3, -200), (7.0, 0.0, -270), (6.05, -0.15, -270), (5.0, -0.7, -340)),
    *((4.98, -1.6, -400), (5.3, -2.1, -440), (6.04, -2.14, -450), (6.95, -2.3, -480), (7.0, -2.3, -570)),
    *((6.04, -2.14, -630), (5.1, -2.6, -690), (4.94, -4.0, -720), (4.94, -5.10, -720), (5.15, -6.3, -740)),
    *((5.5, -7.3, -700), (5.4, -7.2, -800), (5.1, -6.4, -890), (4.94, -5.10, -900), (4.94, -3.0, -900)),
    *((4.94, -1.2, -920), (4.8, -0.25, -970), (3.82, -0.15, -990), (2.4, -0.5, -1010), (0.8, -1.0, -1080)),
)


@dataclass(frozen=True, eq=False)
class Home:
    """The home to author.

    Attributes:
        room: its own doors and cameras.
    """

    room: Room

    def write(self, packages: Path) -> None:
        """Write scene.usda with its crates and rooms.usdc below `packages`/home_01."""
        target = packages / self.room.folder
        self.room.write(packages)
        placements = [
            RoomPlacement(PACKAGE / folder / "scene.usda", position, yaw, name)
            for name, (folder, position, yaw) in ROOMS.items()
        ]
        join(placements, target / "rooms.usdc", openings=OPENINGS, name=self.room.name)
        rooms = Sdf.Layer.FindOrOpen(str(target / "rooms.usdc"))
        for prim, (folder, _, _) in zip(rooms.rootPrims[0].nameChildren, ROOMS.values(), strict=False):
            prim.referenceList.prependedItems = [Sdf.Reference(f"../{folder}/scene.usda")]
        rooms.comment = f"{self.room.folder}: written by usd_scenes.author."
        rooms.Save()
        scene = Sdf.Layer.FindOrOpen(str(target / "scene.usda"))
        scene.subLayerPaths = ["./rooms.usdc"]
        scene.Save()


def build() -> Home:
    """Build the scene's own part."""
    room = Room("Home01", "home_01")
    for name, (hinge, yaw) in LEAVES.items():
        room.put("Doors", entrance.open_leaf("Leaf", 0.88), hinge, (0.0, yaw, 0.0), name)
    exposure = {"day": 2.7, "evening": 3.3, "night": 3.6}
    room.camera("Main", (-3.0, 1.45, -1.90), (3.7, 0.95, -1.08), fov=39.0, exposure=exposure)
    room.camera("Agent", (4.94, 1.8, 0.30), turn=(-14.0, 0.0, 0.0), fov=60.0, exposure=exposure, focus=2.4)
    room.camera("Hall", (5.35, 1.50, 0.55), (4.80, 1.02, -4.40), fov=58.0, exposure=exposure)
    facing = {**exposure, "day": 3.8}  # for the wall that the window does not light
    room.camera("Kitchen", (6.35, 1.50, -8.60), (4.86, 1.00, -4.70), fov=58.0, exposure=facing)
    room.camera("Bedroom", (9.60, 1.50, 1.90), (5.60, 0.95, -0.30), fov=56.0, exposure=exposure)
    return Home(room)
