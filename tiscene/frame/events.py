# SPDX-License-Identifier: Apache-2.0
"""Event: something that happened to an object between two frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Event:
    """Something that happened to an object since the frame before.

    Attributes:
        kind: "spawn" (its first frame), "despawn" (the frame after its last), "contact" (it collided), "overlap" (it
            was placed inside of something, at its first frame or by an edit), "enter" and "leave" (it came into the
            view of the frame's camera, or left it; see `WorldState.events`), "enter_room" and "leave_room" (its middle
            went into another room; or the camera did).
        object: its id; 0 for the camera.
        other: of a contact or an overlap, the id of the other object; 0 for a wall.
        surface: of a contact with a wall, the wall ("left", "right", "bottom", "top", "near", "far") or the prim path
            of an invisible collider.
        room: name of the room that was entered or left.
    """

    kind: Literal["spawn", "despawn", "contact", "overlap", "enter", "leave", "enter_room", "leave_room"]
    object: int
    other: int = 0
    surface: str = ""
    room: str = ""
