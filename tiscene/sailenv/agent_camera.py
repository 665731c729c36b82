# SPDX-License-Identifier: Apache-2.0
"""An agent as the world knows it."""

from __future__ import annotations

from dataclasses import dataclass

from tiscene.sailenv.light_controls import Color8
from tiscene.scene.camera import Camera, Vector3


@dataclass(eq=False)
class AgentCamera:
    """An agent in the world.

    position: m, rotation: Euler degrees, both Unity's. placed: it was put there, not just begun there.
    background: the 8-bit color of what shows nothing, None: the sky. follows_since: the frame at which it joined the
    camera track, None: it stands. taken: the last frame it has had, -1: none. acted: it did something to the world
    since. stepping: it takes frames, so that others may wait for it. last_camera: that of its last frame;
    still_since: the frame since which that is the same.
    """

    id: int
    width: int
    height: int
    position: Vector3 = (0.0, 0.0, 0.0)
    rotation: Vector3 = (0.0, 0.0, 0.0)
    placed: bool = False
    background: Color8 | None = None
    follows_since: int | None = None
    taken: int = -1
    acted: bool = False
    stepping: bool = False
    last_camera: Camera | None = None
    still_since: int = 0
