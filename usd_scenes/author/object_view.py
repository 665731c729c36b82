"""An empty studio: an even, light ground and three soft lights. Nothing in it has a label."""

from __future__ import annotations

from usd_scenes.author.room import Room


def build() -> Room:
    room = Room("ObjectView", "object_view")
    room.dome("Background", 0.42, color=(1.0, 0.99, 0.97))
    target = (0.0, 1.0, -2.0)
    room.panel("KeyLight", (-2.2, 3.4, 0.8), target, 1.6, 5.5, (1.0, 0.95, 0.88))
    room.panel("FillLight", (2.8, 1.6, 0.4), target, 2.0, 0.9, (0.88, 0.94, 1.0))
    room.panel("RimLight", (1.2, 3.2, -5.0), target, 1.2, 5.0, (1.0, 0.98, 0.95))
    room.camera("Main", (0.0, 1.0, 0.0), turn=(0.0, 0.0, 0.0), exposure=0.0)
    room.camera("High", (1.4, 2.2, 0.2), target, exposure=0.0)
    return room
