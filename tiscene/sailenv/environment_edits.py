# SPDX-License-Identifier: Apache-2.0
"""Edits of the world by agents: objects, lights, ambient light and walls. All show from the next frame on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import tiscene.scenario.objects as native_objects
from dynamics import Dynamic, RigidBody, Still
from tiscene.sailenv import asset_names, json_messages
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.json_messages import bounded
from tiscene.sailenv.light_controls import Color8, LightControls, clipped
from tiscene.sailenv.scene_profile import SceneProfile
from tiscene.sailenv.scene_session import SceneSession
from tiscene.sailenv.unity_coordinates import mirrored, mirrored_euler
from tiscene.sailenv.uploaded_models import UploadedModels
from tiscene.scene.camera import Camera, Vector3
from tiscene.stream.stream import Stream

_UPLOAD_PREFIX = "file:"


@dataclass(eq=False)
class AgentWalls:
    """Walls of one agent's view.

    Attributes:
        agent: The agent.
        frustum: Their extent.
        camera: The camera at which they are; None before the first frame.
    """

    agent: AgentCamera
    frustum: native_objects.Frustum
    camera: Camera | None = None

    def follow(self, stream: Stream, profile: SceneProfile, frame: int) -> None:
        """Move the walls to the agent's camera at a frame, if it has moved."""
        camera = self.agent.camera(profile, frame)
        if camera != self.camera:
            stream.world.set_frustum_walls(self.frustum, camera, self.agent.width / self.agent.height)
            self.camera = camera


class EnvironmentEdits:
    """Base of Environment: the methods by which agents edit the world.

    Attributes:
        uploads: Models that agents have sent.
    """

    uploads: UploadedModels
    physics: bool
    _session: SceneSession
    _walls: AgentWalls | None = None
    _ambient: Color8 = (0, 0, 0)

    @property
    def clock(self) -> int:
        """The index of the current frame, the one before the stream's position; -1 before the first."""
        return self._session.stream.position - 1 if self._session.is_running else -1

    @property
    def stream(self) -> Stream:
        """The stream that simulates and renders the scene; made at first use."""
        self._ensure_scene()
        return self._session.stream

    @property
    def lights(self) -> LightControls:
        """The lights of the scene; edits show from the next frame on. Agents edit them by `set_light`."""
        self._ensure_scene()
        return self._session.lights

    def set_light(self, agent: AgentCamera, quantity: str, name: str, value: Any) -> None:
        """Edit a light, from the next frame on.

        Args:
            agent: The agent that edits it.
            quantity: "color", "intensity", "indirect_multiplier", "position" or "direction".
            name: The name of the light.
            value: As of the method `set_<quantity>` of LightControls.

        Raises:
            LightNotFound, ArgumentError: The name or the value is invalid; nothing has changed then.
        """
        getattr(self.lights, f"set_{quantity}")(name, value)
        agent.edit_frame = self.clock + 1

    @property
    def ambient(self) -> Color8:
        """The color of the ambient light, which reaches every surface equally, 8-bit sRGB; black by default."""
        return self._ambient

    def set_ambient(self, agent: AgentCamera, color: Sequence[int]) -> None:
        """Set the color of the ambient light from the next frame on, 8-bit sRGB; values outside 0..255 are clipped."""
        self._ensure_scene()
        self._ambient = clipped(color)
        agent.edit_frame = self.clock + 1

    def spawn(
        self,
        agent: AgentCamera,
        name: str,
        position: Vector3,
        rotation: Vector3,
        *,
        scale: Vector3 = (1.0, 1.0, 1.0),
        frustum_limited: bool = True,
        dynamic: tuple[str, Mapping[str, Any]] | None = None,
        remove_default_dynamics: bool = True,
    ) -> str:
        """Spawn an object in the next frame.

        Args:
            agent: The agent that spawns it.
            name: SAILenv's name of a template, or "file:" and the path of an uploaded model.
            position: m.
            rotation: Euler angles, degrees.
            scale: Factors along the axes of the object.
            frustum_limited: Whether the walls of the view frustum stop the object.
            dynamic: SAILenv's type and description of the object's motion; None for a static object.
            remove_default_dynamics: False: with physics, an object without a dynamic falls and is pushed.

        Returns:
            The id of the object.

        Raises:
            TisceneError: The template does not exist, or an argument is invalid.
        """
        template, (x, y, z) = self._template(name)
        motion: Dynamic | None = Still() if self.stream.world.physics else None
        if dynamic is not None:
            motion = json_messages.dynamic_of(*dynamic)
        elif self.physics and not remove_default_dynamics:
            motion = RigidBody()
        number = self.stream.world.spawn(
            template,
            mirrored(bounded(position)),
            mirrored_euler(bounded(rotation)),
            motion,
            scale=(x * scale[0], y * scale[1], z * scale[2]),
            frustum_limited=frustum_limited,
        )
        agent.edit_frame = self.clock + 1
        return str(number)

    def despawn(self, agent: AgentCamera, object_id: int) -> None:
        """Remove an object from the next frame on. Raises ObjectNotFound."""
        self.stream.world.despawn(object_id)
        agent.edit_frame = self.clock + 1

    def move(self, agent: AgentCamera, object_id: int, position: Vector3, rotation: Vector3) -> None:
        """Move an object, from the next frame on.

        Args:
            agent: The agent that moves it.
            object_id: The id of the object.
            position: m.
            rotation: Euler angles, degrees.

        Raises:
            ObjectNotFound: The object is not alive.
            ArgumentError: A number is not finite or too large.
        """
        self.stream.world.move(object_id, mirrored(bounded(position)), mirrored_euler(bounded(rotation)))
        agent.edit_frame = self.clock + 1

    def set_frustum_walls(self, agent: AgentCamera) -> None:
        """Put walls at the sides of an agent's view, up to its far plane; they follow the agent."""
        self._ensure_scene()
        self._walls = AgentWalls(agent, native_objects.Frustum())
        agent.edit_frame = self.clock + 1

    def _ensure_scene(self) -> None:
        """Start the first scene, unless a scene has been started."""
        raise NotImplementedError

    def _template(self, name: str) -> tuple[str, Vector3]:
        """Return the catalog name of a template, or the file of an uploaded model, and the scale of SAILenv's size."""
        name = str(name)  # agents in process may pass anything
        if name.startswith(_UPLOAD_PREFIX):
            return self.uploads.template(name.removeprefix(_UPLOAD_PREFIX)), (1.0, 1.0, 1.0)
        template = asset_names.catalog_template(name)
        return template, asset_names.template_scale(template)
