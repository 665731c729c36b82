"""An empty studio: an even, light ground and three lights far away, so that a thing is lit alike wherever it flies."""

from __future__ import annotations

from usd_scenes.author.room import Room


def build() -> Room:
    room = Room("ObjectView", "object_view")
    room.dome("Background", 0.42, color=(1.0, 0.99, 0.97))
    room.sun("KeyLight", (-0.62, 0.70, 0.60), 2.4, (1.0, 0.94, 0.86), 9.0)
    room.sun("FillLight", (0.85, 0.15, 0.55), 0.45, (0.86, 0.93, 1.0), 20.0)
    room.sun("RimLight", (0.35, 0.80, -0.65), 1.8, (1.0, 0.98, 0.95), 9.0)
    room.camera("Main", (0.0, 1.0, 0.0), exposure=0.15, focus=2.0)
    room.camera("High", (1.4, 2.2, 0.2), (0.0, 1.0, -2.0), exposure=0.15)
    return room
