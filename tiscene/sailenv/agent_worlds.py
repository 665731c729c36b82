# SPDX-License-Identifier: Apache-2.0
"""AgentWorlds: the worlds that the agents of a server, or of a port in process, are in.

SAILenv has one world for all agents of a server: when one of them changes the scene, all are in the new one. Here each
agent keeps its scene. An agent enters a world with its first command: its own, by `change_scene` or `load_scenario`, or
that which was started last. `together` is SAILenv's way.

One scene may be a place with rooms, such as a home: agents then walk to the scenes that are its rooms.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tiscene import catalog
from tiscene.errors import ArgumentError, SceneNotFound
from tiscene.sailenv import asset_names
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.environment import Environment
from tiscene.sailenv.uploaded_models import UploadedModels
from tiscene.usd.read.room_volumes import read_room_files

MAX_WORLDS = 8


class AgentWorlds:
    """All agents and the worlds that they are in.

    Attributes:
        agents: The registered agents by id.
        settings: Arguments of this and of `Environment`; those that are not there have their defaults.
        uploads: Models that agents have sent.
    """

    def __init__(
        self, scene: str | None = None, *, together: bool = False, world: str | None = None, **settings: Any
    ) -> None:
        """Check the arguments; the first scene is read when it is first needed.

        Args:
            scene: SAILenv's or tiscene's name of the first scene; None for `world`, else for SAILenv's default.
            together: Whether all agents go along when one of them changes the scene or loads a scenario, as in SAILenv.
                False: the others stay where they are.
            world: A scene with rooms, such as "home_01". Changing to a scene that is one of its rooms, or to a room by
                its name, moves the agent to that room; nothing else is loaded. None: every scene is on its own.
            settings: Further arguments of `Environment`.

        Raises:
            TisceneError: An argument is invalid.
        """
        self.agents: dict[int, AgentCamera] = {}
        self._together = bool(together)
        self._home = None if world is None else asset_names.catalog_scene(world)
        first = scene or self._home or asset_names.default_scene()
        self.settings = {"scene": first, "together": together, "world": world, **settings}
        self._latest = Environment(first, **settings)
        self._worlds = [self._latest]
        self._place: dict[int, Environment] = {}  # by id of the agent; it is nowhere before its first command
        self._next_id = 0
        self._room_files: dict[str, frozenset[Path]] | None = None  # of `world`, once they are needed
        weakref.finalize(self, self._latest.close_all).atexit = False

    @property
    def uploads(self) -> UploadedModels:
        """Models that agents have sent."""
        return self._latest.uploads

    def register(self, width: int, height: int) -> AgentCamera:
        """Add an agent.

        Args:
            width: Image width, px.
            height: Image height, px.

        Raises:
            ArgumentError: The image is too large or empty.
        """
        agent = AgentCamera(self._next_id, width, height)
        self._next_id += 1
        self.agents[agent.id] = agent
        return agent

    def delete(self, agent: AgentCamera) -> None:
        """Remove an agent. Objects that it has spawned stay, as long as others are there or no other scene starts."""
        self.agents.pop(agent.id, None)
        world = self._place.pop(agent.id, None)
        if world is not None:
            world.leave(agent)
            self._close_empty()

    def world_of(self, agent: AgentCamera) -> Environment:
        """Return the world that an agent is in; it enters that which was started last if it is in none."""
        if agent.id not in self._place:
            self._latest.enter(agent)
            self._place[agent.id] = self._latest
        return self._place[agent.id]

    def change_scene(self, agent: AgentCamera, name: str) -> None:
        """Move an agent to a scene.

        If other agents are in that scene, it joins them. Else the scene starts, in a world of its own if other agents
        are in its present one.

        Args:
            agent: The agent.
            name: SAILenv's or tiscene's name of the scene, or the name of a room of `world`.

        Raises:
            SceneNotFound, StageError: The scene does not exist or cannot be read; nothing has changed then.
            ArgumentError: Too many scenes are in use.
        """
        room = self._room(name)
        scene = asset_names.catalog_scene(name) if room is None else str(self._home)
        here = self.world_of(agent)
        if room is not None and here.scene == scene:
            here.enter_room(agent, room)
            return
        if self._together:
            here.change_scene(scene)
            self._latest = here
        else:
            there = self._with_others(scene, agent)
            if there is None and len(here.agents) > 1:
                there = self._new_world(here)
                there.change_scene(scene, here.clock)
                self._worlds.append(there)
            elif there is None:
                there = here
                here.change_scene(scene)
            self._move(agent, there)
        if room is not None:
            self.world_of(agent).enter_room(agent, room)

    def load_scenario(self, agent: AgentCamera, content: Mapping[str, Any]) -> tuple[list[str], list[str]]:
        """Start a scenario; arguments, result and errors as of `Environment.load_scenario`.

        It is for all agents in the agent's world, unless it is in another scene and other agents are here: then these
        stay, and it starts in a world of its own.
        """
        here = self.world_of(agent)
        scene = asset_names.catalog_scene(str(content.get("scene_name")))
        if self._together or len(here.agents) == 1 or here.scene in (None, scene):
            result = here.load_scenario(agent, content)
            self._latest = here
            return result
        there = self._new_world(here)
        there.agents[agent.id] = agent
        try:
            result = there.load_scenario(agent, content)
        except BaseException:
            there.close()
            raise
        self._worlds.append(there)
        here.leave(agent)
        self._place[agent.id] = self._latest = there
        self._close_empty()
        return result

    def close(self) -> None:
        """Free all memory, and delete the uploaded models."""
        for each in self._worlds:
            each.close()
        self._latest.close_all()
        self.uploads.close()

    def _new_world(self, like: Environment) -> Environment:
        if len(self._worlds) >= MAX_WORLDS:
            raise ArgumentError(f"agents are in {MAX_WORLDS} scenes already, which is the limit; join one of these")
        return like.another()

    def _with_others(self, scene: str, agent: AgentCamera) -> Environment | None:
        """Return the world with a scene in which there are other agents; that of the agent first, then the newest."""
        here = self._place[agent.id]
        for each in (here, *reversed(self._worlds)):
            if each.scene == scene and each.agents.keys() - {agent.id}:
                return each
        return None

    def _move(self, agent: AgentCamera, there: Environment) -> None:
        here = self._place[agent.id]
        self._latest = self._place[agent.id] = there
        if there is not here or len(there.agents) > 1:
            here.leave(agent)
            there.enter(agent)
        self._close_empty()

    def _close_empty(self) -> None:
        """End the worlds without agents, but for the newest, which the next agent enters."""
        for each in [each for each in self._worlds if not each.agents and each is not self._latest]:
            self._worlds.remove(each)
            each.close()

    def _room(self, name: str) -> str | None:
        """Return the room of `world` that a scene is, or that has this name; None if there is none."""
        if self._home is None:
            return None
        if self._room_files is None:
            self._room_files = read_room_files(catalog.find_scene(self._home))
        rooms = self._room_files
        plain = asset_names.plain(name)
        named = [each for each in rooms if asset_names.plain(each) == plain]
        if named:
            return named[0]
        try:
            scene = asset_names.catalog_scene(name)
        except SceneNotFound as error:
            raise SceneNotFound("scene or room", str(name), [*asset_names.scenes(), *sorted(rooms)]) from error
        file = catalog.find_scene(scene).resolve()
        of_scene = [room for room, files in rooms.items() if file in {each.resolve() for each in files}]
        return of_scene[0] if len(of_scene) == 1 and scene != self._home else None
