# SPDX-License-Identifier: Apache-2.0
"""Base of SAILenv's Agent: its settings, its place in the worlds, and its errors.

Agents with the same host and port share their worlds, as those of one server do (`AgentWorlds`).
"""

from __future__ import annotations

import inspect
import random
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from dynamics import argument_checks
from tiscene.errors import ArgumentError, TisceneError
from tiscene.sailenv import asset_names
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.agent_worlds import AgentWorlds
from tiscene.sailenv.environment import Environment
from tiscene.sailenv.json_messages import integer

# By host and port. Worlds end with their last agent.
_worlds: weakref.WeakValueDictionary[tuple[str, int], AgentWorlds] = weakref.WeakValueDictionary()
_lock = threading.RLock()
SETTINGS = {  # defaults by name
    name: parameter.default
    for make in (AgentWorlds, Environment)
    for name, parameter in inspect.signature(make).parameters.items()
    if name != "settings"
}


class AgentBase:
    """An agent that can be registered.

    Attributes:
        id: The agent's number; -1 before `register`.
        scenes: Names of the scenes; None before `register`.
        categories: Category names by the numbers in `category` views; None before the first `change_scene`,
            `load_scenario` or `get_categories`.
        cat_colors: A random 8-bit color of each category.
        spawnable_objects_names: Names of templates; None before the first scene.
        lights_names: Names of lights; None before the first scene.
        spawned_objects_idstr_names_table: Names of spawned objects by id.
    """

    def __init__(
        self,
        main_frame_active: bool = True,
        object_frame_active: bool = True,
        category_frame_active: bool = True,
        flow_frame_active: bool = True,
        depth_frame_active: bool = True,
        host: str = "localhost",
        port: int = 8080,
        width: int = 512,
        height: int = 384,
        use_gzip: bool = False,
        *,
        strict: bool = False,
        **settings: Any,
    ) -> None:
        """Make an agent; nothing is read or connected before `register`.

        Args:
            main_frame_active: Whether `get_frame` returns the color view.
            object_frame_active: Whether it returns the object view.
            category_frame_active: Whether it returns the category view.
            flow_frame_active: Whether it returns the optical flow.
            depth_frame_active: Whether it returns the depth view.
            host: With `port`, identifies the worlds: agents with the same two share them. No connection is made.
            port: See `host`.
            width: Image width, px.
            height: Image height, px.
            use_gzip: Has no effect in process.
            strict: Raise a TisceneError where SAILenv prints a message.
            settings: Arguments of `AgentWorlds` and `Environment`: scene, together, world, fps, quality, spp,
                max_depth, denoise, incremental, seed, consecutive_flow, query_budget, keep_clock, physics, arch. The
                first agent of a port decides them; others leave them out or give the same.
        """
        argument_checks.known_names(settings, SETTINGS, "Agent")
        self.main_frame_active = main_frame_active
        self.object_frame_active = object_frame_active
        self.category_frame_active = category_frame_active
        self.flow_frame_active = flow_frame_active
        self.depth_frame_active = depth_frame_active
        self.host, self.port, self.width, self.height, self.gzip = host, port, width, height, use_gzip
        self.strict = strict
        self.id = -1
        self.scenes: list[str] | None = None
        self.categories: dict[int, str] | None = None
        self.cat_colors: dict[int, list[int]] | None = None
        self.spawnable_objects_names: list[str] | None = None
        self.lights_names: list[str] | None = None
        self.spawned_objects_idstr_names_table: dict[str, str] = {}
        self._settings = settings
        self._worlds: AgentWorlds | None = None
        self._camera: AgentCamera | None = None

    @property
    def environment(self) -> Environment:
        """The world that this agent is in. Raises ArgumentError before `register`."""
        worlds, camera = self._registered()
        return worlds.world_of(camera)

    def register(self) -> None:
        """Add the agent; it enters a world with its next command. If it was registered, it first leaves its world.

        Raises:
            ArgumentError: Agents with the same host and port have worlds with other settings than this one asks for.
            TisceneError: Settings, size or port are invalid.
        """
        with _lock:
            key = (str(self.host), integer(self.port, "port"))
            worlds = _worlds.get(key)
            if worlds is None:
                worlds = AgentWorlds(**self._settings)
            else:
                self._check_settings(worlds)
            camera = worlds.register(integer(self.width, "width"), integer(self.height, "height"))
            self.delete()
            self._camera, self._worlds = camera, worlds
            _worlds[key] = worlds
            self.id = self._camera.id
            self.scenes = asset_names.scenes()

    def _check_settings(self, worlds: AgentWorlds) -> None:
        """Raise ArgumentError if the agent asks for other settings than those of worlds that are there."""
        for name, value in self._settings.items():
            present = worlds.settings.get(name, SETTINGS[name])
            same = (
                asset_names.catalog_scene(value) == asset_names.catalog_scene(present)
                if name == "scene" and value
                else value == present
            )
            if value is not None and not same:  # None leaves the choice to the worlds
                raise ArgumentError(
                    f"{name}={value!r}: the worlds of {self.host}:{self.port} have {name}={present!r}, and agents with "
                    f"the same host and port share them. Leave {name} out, or choose another port."
                )

    def delete(self) -> None:
        """Remove the agent from its world."""
        with _lock:
            if self._worlds is not None and self._camera is not None:
                self._worlds.delete(self._camera)
            self._worlds = self._camera = None

    def get_categories(self) -> dict[int, str] | None:
        """Return the categories of the scene and of all templates, by their numbers in `category` views."""
        with self._locked() as (environment, _):
            self.categories = environment.categories()
        self.cat_colors = {number: [random.randint(0, 255) for _ in range(3)] for number in self.categories}
        return self.categories

    def _update_names(self) -> None:
        """Update the names of categories, templates and lights for a new scene."""
        self.get_categories()
        with self._locked() as (environment, _):
            self.spawnable_objects_names = environment.spawnable()
            self.lights_names = list(environment.lights.names)

    def _registered(self) -> tuple[AgentWorlds, AgentCamera]:
        if self._worlds is None or self._camera is None:
            raise ArgumentError("this agent is in no world: call register() first")
        return self._worlds, self._camera

    @contextmanager
    def _locked(self) -> Iterator[tuple[Environment, AgentCamera]]:
        """Yield this agent's world and its state, with the lock that keeps other threads out."""
        worlds, camera = self._registered()
        with _lock:
            yield worlds.world_of(camera), camera

    def _try(self, message: str, call: Callable[[Environment, AgentCamera], Any], default: Any = None) -> Any:
        """Return the result of a call; if it raises a TisceneError, print that and return the default."""
        try:
            with self._locked() as (environment, camera):
                return call(environment, camera)
        except TisceneError as error:
            self._report(message, error)
            return default

    def _report(self, message: str, error: TisceneError) -> None:
        """Print an error after a message, as SAILenv does; raise it if `strict`."""
        if self.strict:
            raise error
        print(f"{message}{error}")
