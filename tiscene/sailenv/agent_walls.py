# SPDX-License-Identifier: Apache-2.0
"""Walls at the sides of an agent's view, which move with the agent."""

from __future__ import annotations

from dataclasses import dataclass

from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.scene_profile import SceneProfile
from tiscene.scenario.objects import Frustum
from tiscene.scene.camera import Camera
from tiscene.stream.stream import Stream


@dataclass(eq=False)
class AgentWalls:
    """Walls of one agent's view.

    Attributes:
        agent: The agent.
        frustum: Their extent.
        camera: The camera at which they are; None before the first frame.
    """

    agent: AgentCamera
    frustum: Frustum
    camera: Camera | None = None

    def follow(self, stream: Stream, profile: SceneProfile, frame: int) -> None:
        """Move the walls to the agent's camera at a frame, if it has moved."""
        camera = self.agent.camera(profile, frame)
        if camera != self.camera:
            stream.world.set_frustum_walls(self.frustum, camera, self.agent.width / self.agent.height)
            self.camera = camera
