# SPDX-License-Identifier: Apache-2.0
"""The environment: one world and one frame clock that agents share, in place of SAILenv's Unity program.

Agents share the scene, its objects and its lights. Each has its own pose, image size, background and views. The clock
advances in lock step: by one frame (1 / fps s) when an agent that has had the current frame requests another. An agent
that has not had the current frame receives that one. So a single agent sees every frame, several agents that take turns
see the same frames, and a slow agent misses some, as in SAILenv, which ran in real time. An agent's edit of the world
shows in the frame after the current one, which is then the agent's next frame.

Poses are in Unity's space (`tiscene.sailenv.unity_coordinates`). No method blocks, and none may be called from two
threads at once.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

import tiscene.scenario.objects as native_objects
import tiscene.scenario.scenario as native
from tiscene.device import runtime
from tiscene.render.render_settings import preset
from tiscene.sailenv import asset_names, json_messages
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.agent_renderer import AgentRenderer
from tiscene.sailenv.agent_walls import AgentWalls
from tiscene.sailenv.json_messages import bounded
from tiscene.sailenv.light_controls import Color8, LightControls, clipped, integer_color
from tiscene.sailenv.scene_profile import SceneProfile
from tiscene.sailenv.scene_session import SceneSession
from tiscene.sailenv.unity_coordinates import mirrored, mirrored_euler
from tiscene.sailenv.uploaded_models import UploadedModels
from tiscene.scene.camera import Vector3
from tiscene.stream.stream import Stream
from tiscene.validation import integer, positive

_UPLOAD_PREFIX = "file:"


class Environment:
    """A world that agents share.

    Attributes:
        fps: Frames per second.
        clock: The index of the current frame; -1 before the first.
        agents: The registered agents by id.
        consecutive_flow: Whether flow is always measured from the frame before.
        uploads: Models that agents have sent.
    """

    def __init__(
        self,
        scene: str | None = None,
        *,
        fps: float = 25.0,
        quality: str = "preview",
        spp: int | None = None,
        max_depth: int | None = None,
        denoise: bool | None = None,
        incremental: bool | None = None,
        seed: int = 0,
        consecutive_flow: bool = False,
        arch: str | None = None,
    ) -> None:
        """Check the arguments; the scene is read when it is first needed.

        Args:
            scene: SAILenv's or tiscene's name of the first scene; None for SAILenv's default.
            fps: Frames per second.
            quality: Preset of the render settings, as of `Stream`; the next four arguments override its parts.
            spp: Samples per pixel.
            max_depth: Maximum path depth in segments.
            denoise: Whether color is denoised.
            incremental: Whether views of a camera that stands still are rendered incrementally, without flicker and
                after waiting for a base image; None: as the preset says ("fast", "preview": yes).
            seed: Seed of the rendering.
            consecutive_flow: Whether flow is always measured from the frame before. False: from the agent's last frame.
            arch: "cpu" or "cuda"; None for "cpu".

        Raises:
            TisceneError: An argument is invalid.
        """
        self.fps = positive("fps", fps)
        overrides = {"spp": spp, "max_depth": max_depth, "denoise": denoise, "incremental": incremental}
        preset(quality, **overrides)  # raises errors before clients connect
        integer("seed", seed, 0, 2**32 - 1)
        runtime.start(arch)
        self.consecutive_flow = bool(consecutive_flow)
        self.clock = -1
        self.agents: dict[int, AgentCamera] = {}
        self.uploads = UploadedModels()
        self._first_scene = scene or asset_names.default_scene()
        asset_names.catalog_scene(self._first_scene)
        settings = {"fps": self.fps, "quality": quality, **overrides, "seed": seed, "arch": arch}
        self._session = SceneSession(settings)
        weakref.finalize(self, self._session.close).atexit = False
        self._renderer = AgentRenderer()
        self._walls: AgentWalls | None = None
        self._ambient: Color8 = (0, 0, 0)
        self._next_id = 0

    @property
    def stream(self) -> Stream:
        """The stream that simulates and renders the scene; made at first use."""
        self._ensure_scene()
        return self._session.stream

    # Agents

    def register(self, width: int, height: int) -> AgentCamera:
        """Add an agent at the start pose of the scene.

        Args:
            width: Image width, px.
            height: Image height, px.

        Raises:
            ArgumentError: The image is too large or empty.
        """
        agent = AgentCamera(self._next_id, width, height)
        self._next_id += 1
        self.agents[agent.id] = agent
        if self._session.is_running:
            agent.reset(self._profile)
        return agent

    def delete(self, agent: AgentCamera) -> None:
        """Remove an agent. Objects that it has spawned stay."""
        self.agents.pop(agent.id, None)

    def agents_to_wait_for(self, agent: AgentCamera) -> list[AgentCamera]:
        """Return the other agents that would miss the current frame if this agent were given its next frame now."""
        if not agent.needs_new_frame(self.clock):
            return []
        others = (each for each in self.agents.values() if each is not agent and each.is_stepping)
        return [each for each in others if not each.needs_new_frame(self.clock)]

    def frame(self, agent: AgentCamera, views: Sequence[str]) -> tuple[dict[str, NDArray[Any]], float]:
        """Render an agent's next frame.

        Args:
            agent: The agent.
            views: Keys of `frame_views.VIEWS`.

        Returns:
            The views by name, and the time since the agent's last frame, s.
        """
        stream = self.stream
        if agent.needs_new_frame(self.clock):
            self.clock += 1
            for each in self.agents.values():
                each.begin_frame(self._profile, self.clock)
            self._session.apply_light_edits()
            if self._walls is not None:
                self._walls.follow(stream, self._profile, self.clock)
            stream.seek(self.clock + 1)
            self._renderer.start_frame(self._ambient)
        steps = self.clock - agent.last_frame if agent.last_frame >= 0 else 1
        step = agent.flow_step(self._profile, self.clock, self.consecutive_flow)
        result = self._renderer.render(stream, self._session.category_numbers, agent, step, self.clock, views)
        agent.last_frame, agent.has_edited, agent.is_stepping, agent.last_camera = self.clock, False, True, step.current
        return result, steps / self.fps

    def position(self, agent: AgentCamera) -> Vector3:
        """Return an agent's position, m."""
        self._ensure_scene()
        return agent.pose(self._profile, self.clock)[0]

    def rotation(self, agent: AgentCamera) -> Vector3:
        """Return an agent's Euler angles, degrees: as they were set, or 0..360 on the camera track."""
        self._ensure_scene()
        return agent.pose(self._profile, self.clock)[1]

    def set_pose(self, agent: AgentCamera, position: Vector3 | None = None, rotation: Vector3 | None = None) -> None:
        """Move an agent, from its next frame on; it leaves the camera track.

        Args:
            agent: The agent.
            position: m; None leaves it.
            rotation: Euler angles, degrees; None leaves them.

        Raises:
            ArgumentError: A number is not finite or too large.
        """
        self._ensure_scene()
        agent.set_pose(self._profile, self.clock, position, rotation)

    def toggle_follow(self, agent: AgentCamera) -> None:
        """Make an agent follow the camera track from its start, or stop where it is."""
        self._ensure_scene()
        agent.toggle_follow(self._profile, self.clock)

    def set_background(self, agent: AgentCamera, color: Sequence[int]) -> None:
        """Set the color of an agent's pixels that show no object.

        Args:
            agent: The agent.
            color: 8-bit sRGB; with a negative component, the sky.
        """
        color = integer_color(color)
        agent.background = None if min(color) < 0 else clipped(color)

    # The world

    def scenes(self) -> list[str]:
        """Return SAILenv's names of all scenes."""
        return asset_names.scenes()

    def spawnable(self) -> list[str]:
        """Return the names of all templates that can be spawned."""
        return asset_names.spawnable()

    def categories(self) -> dict[int, str]:
        """Return the names of the numbers in `category` views: of the scene, and of all templates."""
        return self._session.category_numbers.names(self.stream.categories.values())

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
        self._mark_edited(agent)

    @property
    def ambient(self) -> Color8:
        """The color of the ambient light, which reaches every surface equally, 8-bit sRGB; black by default."""
        return self._ambient

    def set_ambient(self, agent: AgentCamera, color: Sequence[int]) -> None:
        """Set the color of the ambient light from the next frame on, 8-bit sRGB; values outside 0..255 are clipped."""
        self._ensure_scene()
        self._ambient = clipped(color)
        self._mark_edited(agent)

    def change_scene(self, name: str) -> None:
        """Start a scene, with all agents at its start pose. Raises SceneNotFound, StageError."""
        self._start_scene(asset_names.catalog_scene(name))
        for agent in self.agents.values():
            agent.reset(self._profile)

    def load_scenario(self, agent: AgentCamera, content: Mapping[str, Any]) -> tuple[list[str], list[str]]:
        """Start a scenario. Agents that have moved keep their poses.

        Args:
            agent: The agent whose view gets the scenario's walls, if it has any.
            content: SAILenv's JSON.

        Returns:
            The id of each object of the scenario, "" for an object that is invalid; and the messages about those.

        Raises:
            TisceneError: The scenario as a whole is invalid; nothing has changed then.
        """
        scene = asset_names.catalog_scene(str(content.get("scene_name")))
        scenario, names, problems = json_messages.scenario_of(content, scene, self._template)
        self._start_scene(scene, scenario, agent)
        for each in self.agents.values():
            if not each.has_own_pose:
                each.reset(self._profile)
        ids = {row.name: str(row.id) for row in self.stream.world.state(0).objects if row.template}
        return [ids.get(name, "") for name in names], problems

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

        Returns:
            The id of the object.

        Raises:
            TisceneError: The template does not exist, or an argument is invalid.
        """
        template, (x, y, z) = self._template(name)
        number = self.stream.world.spawn(
            template,
            mirrored(bounded(position)),
            mirrored_euler(bounded(rotation)),
            None if dynamic is None else json_messages.dynamic_of(*dynamic),
            scale=(x * scale[0], y * scale[1], z * scale[2]),
            frustum_limited=frustum_limited,
        )
        self._mark_edited(agent)
        return str(number)

    def despawn(self, agent: AgentCamera, object_id: int) -> None:
        """Remove an object from the next frame on. Raises ObjectNotFound."""
        self.stream.world.despawn(object_id)
        self._mark_edited(agent)

    def move(self, agent: AgentCamera, object_id: int, position: Vector3, rotation: Vector3) -> None:
        """Move an object, from the next frame on.

        Args:
            agent: The agent that moves it.
            object_id: The id of the object.
            position: m.
            rotation: Euler angles, degrees.

        Raises ObjectNotFound, and ScenarioError for invalid numbers.
        """
        self.stream.world.move(object_id, mirrored(bounded(position)), mirrored_euler(bounded(rotation)))
        self._mark_edited(agent)

    def set_frustum_walls(self, agent: AgentCamera) -> None:
        """Put walls at the sides of an agent's view, up to its far plane; they follow the agent."""
        self._ensure_scene()
        self._walls = AgentWalls(agent, native_objects.Frustum())
        self._mark_edited(agent)

    def close(self) -> None:
        """Free the memory of the scene, and delete the uploaded models."""
        self._session.close()
        self.uploads.close()

    # Implementation

    def _ensure_scene(self) -> None:
        """Start the first scene, unless a scene has been started."""
        if not self._session.is_running:
            self.change_scene(self._first_scene)

    @property
    def _profile(self) -> SceneProfile:
        return self._session.profile

    def _mark_edited(self, agent: AgentCamera) -> None:
        """Record that an agent has edited the world, so that its next frame is a new one."""
        agent.has_edited = True

    def _start_scene(
        self, scene: str, scenario: native.Scenario | None = None, agent: AgentCamera | None = None
    ) -> None:
        """Start a scene at frame 0.

        Args:
            scene: Its name in the catalog.
            scenario: A scenario of that scene; None for the motion that the author of the stage has defined.
            agent: The agent that has loaded the scenario.

        Raises:
            TisceneError: The scene or the scenario is invalid; nothing has changed then.
        """
        walls = None
        if scenario is None or agent is None:
            self._session.start(scene)
        else:
            profile = self._session.profile_of(scene)
            camera = agent.camera(profile, 0) if agent.has_own_pose else profile.start
            self._session.start(scene, replace(scenario, camera=camera), (agent.width, agent.height))
            if scenario.frustum is not None:
                walls = AgentWalls(agent, scenario.frustum, camera)
        self._walls, self._ambient = walls, (0, 0, 0)
        self._renderer.start_frame(self._ambient)
        self.clock = -1
        for each in self.agents.values():
            each.restart_clock()

    def _template(self, name: str) -> tuple[str, Vector3]:
        """Return the catalog name of a template, or the file of an uploaded model, and the scale of SAILenv's size."""
        name = str(name)  # agents in process may pass anything
        if name.startswith(_UPLOAD_PREFIX):
            return self.uploads.template(name.removeprefix(_UPLOAD_PREFIX)), (1.0, 1.0, 1.0)
        template = asset_names.catalog_template(name)
        return template, asset_names.template_scale(template)
