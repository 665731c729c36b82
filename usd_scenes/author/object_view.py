# SPDX-License-Identifier: Apache-2.0
"""object_view: an empty studio with a uniform dome and three distant lights, which light an object alike everywhere."""

from __future__ import annotations

from usd_scenes.author.room import Room

KEY = {"day": (1.0, 0.94, 0.86), "evening": (1.0, 0.62, 0.34), "night": (0.55, 0.70, 1.0)}


def build() -> Room:
    """Build the scene."""
    room = Room("ObjectView", "object_view")
    room.dome(
        "Background",
        {"day": 0.42, "evening": 0.20, "night": 0.05},
        color={"day": (1.0, 0.99, 0.97), "evening": (1.0, 0.80, 0.66), "night": (0.45, 0.62, 1.0)},
    )
    room.sun("KeyLight", (-0.62, 0.70, 0.60), {"day": 2.4, "evening": 2.2, "night": 0.5}, KEY, 9.0)
    room.sun("FillLight", (0.85, 0.15, 0.55), {"day": 0.45, "evening": 0.30, "night": 0.12}, (0.86, 0.93, 1.0), 20.0)
    room.sun("RimLight", (0.35, 0.80, -0.65), {"day": 1.8, "evening": 1.2, "night": 0.9}, (1.0, 0.98, 0.95), 9.0)
    exposure = {"day": 0.15, "evening": 0.5, "night": 1.6}
    room.camera("Main", (0.0, 1.0, 0.0), exposure=exposure, focus=2.0)
    room.camera("Agent", (0.0, 0.2, 2.5), exposure=exposure, focus=2.5)  # sees an object at the origin
    room.camera("High", (1.4, 2.2, 0.2), (0.0, 1.0, -2.0), exposure=exposure)
    return room
