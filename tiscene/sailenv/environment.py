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

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

import tiscene.scenario.objects as native_objects
import tiscene.scenario.scenario as native
from tiscene.device import runtime
from tiscene.errors import ArgumentError
from tiscene.render.render_settings import preset
from tiscene.sailenv import asset_names, frame_views, json_messages
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.agent_renderer import AgentRenderer
from tiscene.sailenv.json_messages import bounded
from tiscene.sailenv.light_controls import Color8, LightControls, clipped, integer_color
from tiscene.sailenv.scene_profile import SceneProfile
from tiscene.sailenv.unity_coordinates import mirrored, mirrored_euler
from tiscene.sailenv.uploaded_models import UploadedModels
from tiscene.scene.camera import Camera, Vector3
from tiscene.scene.description import Light
from tiscene.stream.stream import Stream
from tiscene.validation import integer, positive

MAX_SIDE, MAX_PIXELS = 8192, 3840 * 2160
_UPLOAD_PREFIX = "file:"


class Environment:
    """A world that agents share.

    Attributes:
        fps: Frames per second.
        clock: The index of the current frame; -1 before the first.
        agents: The registered agents by id.
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
            arch: "cpu" or "cuda"; None for "cpu".

        Raises:
            TisceneError: An argument is invalid.
        """
        self.fps = positive("fps", fps)
        overrides = {"spp": spp, "max_depth": max_depth, "denoise": denoise, "incremental": incremental}
        preset(quality, **overrides)  # raises errors before clients connect
        integer("seed", seed, 0, 2**32 - 1)
        runtime.start(arch)
        self.clock = -1
        self.agents: dict[int, AgentCamera] = {}
        self.uploads = UploadedModels()
        self._first_scene = scene or asset_names.default_scene()
        asset_names.catalog_scene(self._first_scene)
        self._settings: dict[str, Any] = {"fps": self.fps, "quality": quality, **overrides, "seed": seed, "arch": arch}
        self._stream: Stream | None = None
        self._renderer = AgentRenderer()
        self._walls: tuple[AgentCamera, native_objects.Frustum] | None = None  # the agent whose view has walls
        self._walls_camera: Camera | None = None  # the camera at which the walls are
        self._next_id = 0

    @property
    def stream(self) -> Stream:
        """The stream that simulates and renders the scene; made at first use."""
        self._ensure_scene()
        assert self._stream is not None
        return self._stream

    # Agents

    def register(self, width: int, height: int) -> AgentCamera:
        """Add an agent at the start pose of the scene.

        Args:
            width: Image width, px.
            height: Image height, px.

        Raises:
            ArgumentError: The image is too large or empty.
        """
        if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE and width * height <= MAX_PIXELS):
            raise ArgumentError(
                f"{width}x{height} px: a side must be from 1 to {MAX_SIDE}, all pixels at most {MAX_PIXELS}"
            )
        agent = AgentCamera(self._next_id, width, height)
        self._next_id += 1
        self.agents[agent.id] = agent
        if self._stream is not None:
            agent.reset(self._profile)
        return agent

    def delete(self, agent: AgentCamera) -> None:
        """Remove an agent. Objects that it has spawned stay."""
        self.agents.pop(agent.id, None)

    def agents_to_wait_for(self, agent: AgentCamera) -> list[AgentCamera]:
        """Return the other agents that would miss the current frame if this agent were given its next frame now."""
        if not self._advances_clock(agent):
            return []
        others = (each for each in self.agents.values() if each is not agent and each.is_stepping)
        return [each for each in others if not self._advances_clock(each)]

    def frame(self, agent: AgentCamera, views: Sequence[str]) -> tuple[dict[str, NDArray[Any]], float]:
        """Render an agent's next frame.

        Args:
            agent: The agent.
            views: Keys of `frame_views.VIEWS`.

        Returns:
            The views by name, and the time since the agent's last frame, s.
        """
        stream = self.stream
        if self._advances_clock(agent):
            self.clock += 1
            self._move_walls(stream)
            stream.seek(self.clock + 1)
            self._renderer.discard_buffers()
        steps = self.clock - agent.last_frame if agent.last_frame >= 0 else 1
        camera = agent.camera(self._profile, self.clock)
        result = self._renderer.render(stream, self._profile, agent, camera, self.clock, views)
        agent.last_frame, agent.has_edited, agent.is_stepping, agent.last_camera = self.clock, False, True, camera
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
        for category in self.stream.categories.values():
            self._profile.category_number(category)
        numbers = self._profile.category_numbers
        return {number: name for name, number in numbers.items() if number != frame_views.NO_CATEGORY}

    @property
    def lights(self) -> LightControls:
        """The lights of the scene; changes show from the next frame on."""
        self._ensure_scene()
        return self._lights

    @property
    def ambient(self) -> Color8:
        """The color of the ambient light, which reaches every surface equally, 8-bit sRGB; black by default."""
        return self._renderer.ambient

    def set_ambient(self, color: Sequence[int]) -> None:
        """Set the color of the ambient light, 8-bit sRGB; values outside 0..255 are clipped."""
        self._renderer.ambient = clipped(color)
        self._renderer.discard_buffers()

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
        self._mark_edited(agent)
        return str(
            self.stream.world.spawn(
                self._template(name),
                mirrored(bounded(position)),
                mirrored_euler(bounded(rotation)),
                None if dynamic is None else json_messages.dynamic_of(*dynamic),
                scale=scale,
                frustum_limited=frustum_limited,
            )
        )

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
        self._walls, self._walls_camera = (agent, native_objects.Frustum()), None
        self._mark_edited(agent)

    def close(self) -> None:
        """Delete the uploaded models."""
        self.uploads.close()

    # Implementation

    def _ensure_scene(self) -> None:
        """Start the first scene, unless a scene has been started."""
        if self._stream is None:
            self.change_scene(self._first_scene)

    def _mark_edited(self, agent: AgentCamera) -> None:
        """Record that an agent has edited the world, so that its next frame is a new one."""
        agent.has_edited = True

    def _move_walls(self, stream: Stream) -> None:
        """Move the walls to the current camera of their agent."""
        if self._walls is None:
            return
        agent, frustum = self._walls
        camera = agent.camera(self._profile, self.clock)
        if camera != self._walls_camera:
            stream.world.set_frustum_walls(frustum, camera, agent.width / agent.height)
            self._walls_camera = camera

    def _advances_clock(self, agent: AgentCamera) -> bool:
        """Return whether the agent's next frame is later than the current one."""
        return self.clock < 0 or agent.has_edited or agent.last_frame == self.clock

    def _start_scene(
        self, scene: str, scenario: native.Scenario | None = None, agent: AgentCamera | None = None
    ) -> None:
        """Start a scene at frame 0.

        Args:
            scene: Its name in the catalog.
            scenario: A scenario of that scene; None for the motion that the author of the stage has defined.
            agent: The agent that has loaded the scenario.
        """
        stream = self._stream
        if stream is None or stream.scenario.scene != scene:
            stream = Stream(native.Scenario.load(scene), width=64, height=48, **self._settings)
            self._profile = SceneProfile.of(stream)
        self._walls = self._walls_camera = None
        if scenario is None or agent is None:
            stream.restart(self._profile.scenario)
        else:
            camera = agent.camera(self._profile, 0) if agent.has_own_pose else self._profile.start
            stream.restart(replace(scenario, camera=camera), width=agent.width, height=agent.height)
            if scenario.frustum is not None:
                self._walls, self._walls_camera = (agent, scenario.frustum), camera
        stream.seek(0)
        light_names = asset_names.sailenv_names()["lights"].get(scene, ["Directional Light"])
        self._lights = LightControls(stream.world.stage.lights, light_names, self._set_light)
        self._stream = stream
        self._renderer.start_scene()
        self.clock = -1
        for each in self.agents.values():
            each.last_frame, each.has_edited, each.last_camera = -1, False, None
            each.track_start = None if each.track_start is None else 0

    def _template(self, name: str) -> str:
        """Return the catalog name of SAILenv's template `name`, or the file of an uploaded model."""
        name = str(name)  # agents in process may pass anything
        if name.startswith(_UPLOAD_PREFIX):
            return self.uploads.template(name.removeprefix(_UPLOAD_PREFIX))
        return asset_names.catalog_template(name)

    def _set_light(self, row: int, light: Light) -> None:
        self.stream.set_light(row, light)
        self._renderer.discard_buffers()
