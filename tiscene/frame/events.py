# SPDX-License-Identifier: Apache-2.0
"""Events: what happened to the objects of a world between two frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Event:
    """Something that happened to an object at a frame.

    kind: "spawn": it is there for the first time. "despawn": it is not there any more. "contact": it met something.
    "enter", "leave": it came into the view of the frame's camera, or left it; `World.events` says what that means.
    object: its id. other: of a contact the id of the object that it met, 0 for a wall. wall: of a frustum, such as
    "left", or the prim path of a collider that nobody sees.
    """

    kind: Literal["spawn", "despawn", "contact", "enter", "leave"]
    object: int
    other: int = 0
    surface: str = ""
