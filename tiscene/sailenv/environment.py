# SPDX-License-Identifier: Apache-2.0
"""The environment: one running scene and its frame clock, which agents share, in place of SAILenv's Unity program.

Agents share the scene, its objects and its lights. Each has its own pose, image size, background and views. The clock
advances in lock step: by one frame (1 / fps s) when an agent that has had the current frame requests another. An agent
that has not had the current frame receives that one. So a single agent sees every frame, several agents that take turns
see the same frames, and a slow agent misses some, as in SAILenv, which ran in real time. An agent's edit of the world
shows in the frame after the current one, which is then the agent's next frame.

Poses are in Unity's space (`tiscene.sailenv.unity_coordinates`). No method blocks, and none may be called from two
threads at once.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

import tiscene.scenario.scenario as native
from dynamics import argument_checks
from tiscene.device import runtime
from tiscene.render.render_settings import preset
from tiscene.sailenv import asset_names, json_messages
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.agent_renderer import AgentRenderer
from tiscene.sailenv.environment_edits import AgentWalls, EnvironmentEdits
from tiscene.sailenv.light_controls import clipped, integer_color
from tiscene.sailenv.pixel_queries import PixelAnswer, PixelQueries
from tiscene.sailenv.scene_profile import SceneProfile
from tiscene.sailenv.scene_session import SceneSession, SceneStreams
from tiscene.sailenv.uploaded_models import UploadedModels
from tiscene.scene.camera import Vector3
from tiscene.world.physics.rigid_body_simulation import require_engine


class Environment(EnvironmentEdits):
    """A world that agents share. `tiscene.sailenv.agent_worlds` has one for each scene that agents are in.

    Attributes:
        fps: Frames per second.
        agents: The agents that are in it, by id.
        scene: The name in the catalog of its scene; None before it has started.
        consecutive_flow: Whether flow is always measured from the frame before.
        physics: Whether objects fall and are pushed.
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
        query_budget: int | None = None,
        keep_clock: bool = False,
        physics: bool = False,
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
                after waiting for a base image or a panorama; None: as the preset says ("fast", "preview": yes).
            seed: Seed of the rendering.
            consecutive_flow: Whether flow is always measured from the frame before. False: from the agent's last frame.
            query_budget: How many pixels each agent may ask about (see `ask_pixel`); None for any number.
            keep_clock: Whether the frame clock continues when an agent changes the scene: the new scene is then shown
                as it is at that time. False: it starts at frame 0, as in SAILenv. A scenario always starts at frame 0.
            physics: Whether objects fall and are pushed: those of scenarios without a dynamic, and those that are
                spawned with their default dynamics. Needs the extra `physics`.
            arch: "cpu" or "cuda"; None: as of `Stream`.

        Raises:
            TisceneError: An argument is invalid.
        """
        self.fps = argument_checks.positive(fps, "fps")
        overrides = {"spp": spp, "max_depth": max_depth, "denoise": denoise, "incremental": incremental}
        preset(quality, **overrides)  # raises errors before clients connect
        argument_checks.integer(seed, "seed", 0, 2**32 - 1)
        self._queries = PixelQueries(query_budget)
        runtime.start(arch)
        self.physics = bool(physics)
        if self.physics:
            require_engine()
        self.consecutive_flow, self._keep_clock = bool(consecutive_flow), bool(keep_clock)
        self.agents: dict[int, AgentCamera] = {}
        self.uploads = UploadedModels()
        self._first_scene = scene or asset_names.default_scene()
        asset_names.catalog_scene(self._first_scene)
        settings = {"fps": self.fps, "quality": quality, **overrides, "seed": seed, "arch": arch}
        self._session = SceneSession(SceneStreams(settings))
        self._renderer = AgentRenderer()
        self.scene: str | None = None

    def another(self) -> Environment:
        """Return an environment with the same settings, before its first scene.

        The two share the stages that were read last, their trees, and the uploaded models.
        """
        other = copy.copy(self)
        other.agents, other.scene, other._walls, other._ambient = {}, None, None, (0, 0, 0)
        other._queries, other._renderer = PixelQueries(self._queries.budget), AgentRenderer()
        other._session = SceneSession(self._session.pool)
        return other

    # Agents

    def enter(self, agent: AgentCamera) -> None:
        """Add an agent at the start pose of the scene. Its first frame is the current one."""
        self.agents[agent.id] = agent
        agent.restart_clock()
        if self._session.is_running:
            agent.reset(self._profile)

    def enter_room(self, agent: AgentCamera, room: str) -> None:
        """Move an agent that is here into a room of the scene, from its next frame on; the clock continues.

        It stands where the agents of the room's own scene start: at the room's camera named "Agent", else at its first
        camera, else at the center of the room.

        Args:
            agent: The agent.
            room: The name of the room.
        """
        agent.walk_to(self._profile.room_start(room))

    def leave(self, agent: AgentCamera) -> None:
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
            self._advance_clock()
        if self._renderer.frame != self.clock:
            self._renderer = AgentRenderer(self.clock, self._ambient)
        steps = self.clock - agent.last_frame if agent.last_frame >= 0 else 1
        step = agent.flow_step(self._profile, self.clock, self.consecutive_flow)
        background = agent.background or self._profile.background
        result = self._renderer.render(stream, self._session.category_numbers, agent, step, views, background)
        agent.last_frame, agent.is_stepping, agent.last_camera = self.clock, True, step.current
        return result, steps / self.fps

    def ask_pixel(self, agent: AgentCamera, y: int, x: int) -> PixelAnswer:
        """Extension of tiscene: return the labels of a pixel of an agent's last frame; see `PixelQueries.ask`."""
        return self._queries.ask(self.stream, self._session.category_numbers, agent, y, x)

    def position(self, agent: AgentCamera) -> Vector3:
        """Return an agent's position, m."""
        return agent.pose(self._profile, self.clock)[0]

    def rotation(self, agent: AgentCamera) -> Vector3:
        """Return an agent's Euler angles, degrees: as they were set, or 0..360 on the camera track."""
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
        agent.set_pose(self._profile, self.clock, position, rotation)

    def toggle_follow(self, agent: AgentCamera) -> None:
        """Make an agent follow the camera track from its start, or stop where it is."""
        agent.toggle_follow(self._profile, self.clock)

    def set_background(self, agent: AgentCamera, color: Sequence[int]) -> None:
        """Set the color of an agent's pixels that show no object.

        Args:
            agent: The agent.
            color: 8-bit sRGB; with a negative component, the scene's own background: the sky, or its one color.
        """
        color = integer_color(color)
        agent.background = None if min(color) < 0 else clipped(color)

    # The world

    def spawnable(self) -> list[str]:
        """Return the names of all templates that can be spawned."""
        return asset_names.spawnable()

    def categories(self) -> dict[int, str]:
        """Return the names of the numbers in `category` views: of the scene, and of all templates."""
        categories = self.stream.categories
        return self._session.category_numbers.names(categories.values())

    def change_scene(self, name: str, last: int | None = None) -> None:
        """Start a scene, with all agents that are here at its start pose.

        Args:
            name: Its name, SAILenv's or the catalog's.
            last: With `keep_clock`, the frame after which the clock continues; None: the current one.

        Raises:
            SceneNotFound, StageError: Nothing has changed then.
        """
        last = self.clock if last is None else last
        self._start_scene(asset_names.catalog_scene(name))
        for agent in self.agents.values():
            agent.reset(self._profile)
        if self._keep_clock and last >= 0:
            self.stream.seek(last + 1)
            self._advance_clock()

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
        scenario, names, problems = json_messages.scenario_of(content, scene, self._template, self.physics)
        if scenario.physics:
            require_engine()
        self._start_scene(scene, scenario, agent)
        for each in self.agents.values():
            if not each.has_own_pose:
                each.reset(self._profile)
        ids = {row.name: str(row.id) for row in self.stream.world.state(0).objects if row.template}
        return [ids.get(name, "") for name in names], problems

    def close(self) -> None:
        """Free the memory of the scene. What environments share stays until `close_all`."""
        self._session.close()

    def close_all(self) -> None:
        """Free the memory of all environments that share stages with this one."""
        self._session.pool.close()

    # Implementation

    def _ensure_scene(self) -> None:
        """Start the first scene, unless a scene has been started."""
        if not self._session.is_running:
            self.change_scene(self._first_scene)

    @property
    def _profile(self) -> SceneProfile:
        self._ensure_scene()
        return self._session.profile

    def _advance_clock(self) -> None:
        """Make the next frame the current one. After an exception the clock has not moved, and the rest is repeated."""
        frame = self.clock + 1
        for each in self.agents.values():
            each.begin_frame(self._profile, frame)
        self._session.apply_light_edits()
        if self._walls is not None:
            self._walls.follow(self.stream, self._profile, frame)
        self.stream.seek(frame + 1)

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
        self.scene, self._walls, self._ambient, self._renderer = scene, walls, (0, 0, 0), AgentRenderer()
        self._queries.forget()
        for each in self.agents.values():
            each.restart_clock()
