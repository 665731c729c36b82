# SPDX-License-Identifier: Apache-2.0
"""SAILenv's Agent in process: the same names, arguments, results and printed errors, without a server or a display.

Agents with the same host and port share their worlds, as those of one server do (`AgentWorlds`). Positions are in
Unity's space, m; rotations are its Euler angles, degrees.
"""

from __future__ import annotations

import inspect
import random
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import argument_checks
from tiscene.errors import ArgumentError, TisceneError
from tiscene.sailenv import asset_names
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.agent_objects import AgentObjects
from tiscene.sailenv.agent_worlds import AgentWorlds
from tiscene.sailenv.environment import Environment
from tiscene.sailenv.frame_views import VIEWS
from tiscene.sailenv.json_messages import integer, rounded, single_precision
from tiscene.sailenv.pixel_queries import PixelAnswer
from tiscene.sailenv.scenario_classes import Vector3

# By host and port. Worlds end with their last agent.
_worlds: weakref.WeakValueDictionary[tuple[str, int], AgentWorlds] = weakref.WeakValueDictionary()
_lock = threading.RLock()
SETTINGS = {  # defaults by name
    name: parameter.default
    for make in (AgentWorlds, Environment)
    for name, parameter in inspect.signature(make).parameters.items()
    if name != "settings"
}


class FrameFlags(IntFlag):
    """Bits of the views that an agent requests."""

    NONE = 0
    MAIN = 1
    CATEGORY = 4
    OBJECT = 8
    OPTICAL = 16
    DEPTH = 32


class Agent(AgentObjects):
    """A camera in a world, which it can edit. `register` adds it to the world.

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
        self.spawned_objects_idstr_names_table = {}
        self._settings = settings
        self._worlds: AgentWorlds | None = None
        self._camera: AgentCamera | None = None

    @property
    def active_frames(self) -> dict[str, bool]:
        """Whether each view is active, by name."""
        return {name: bool(getattr(self, f"{name}_frame_active")) for name in VIEWS}

    @property
    def flags(self) -> int:
        """The active views as bits of `FrameFlags`."""
        return sum(view.flag for name, view in VIEWS.items() if self.active_frames[name])

    @property
    def frame_index(self) -> int:
        """Extension of tiscene: the index of the frame received last, -1 before the first.

        Frames are counted from 0 at the start of a scene or scenario. The count is that of the world, not of the agent.
        """
        return self._registered()[1].last_frame

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

    def get_frame(self) -> dict[str, Any]:
        """Render the next frame.

        Returns:
            A dict with

            - main: float32 [h, w, 3], RGB, 0..1,
            - category: uint8 [h, w], keys of `categories`; 255 for no category,
            - object: float32 [h, w, 3], 0..1, a distinct color for each object; black for no object,
            - flow: float32 [h, w, 2], (-dx, +dy) px from the previous frame to this one (dx right, dy down),
            - depth: float32 [h, w], 0 at the camera, 1 at 15 m along the optical axis and beyond, in steps of 1/255,
            - sizes: bytes of each view,
            - deltaTime: s since the agent's previous frame.

            Views that are not active are None.
        """
        active = [name for name, is_active in self.active_frames.items() if is_active]
        with self._locked() as (environment, camera):
            views, seconds = self._render(environment, camera, active)
        frame: dict[str, Any] = {"sizes": dict.fromkeys(VIEWS, 0), **dict.fromkeys(VIEWS)}
        for name, array in views.items():
            frame["sizes"][name] = array.nbytes
            frame[name] = to_client_dtype(name, array)
        frame["deltaTime"] = rounded(seconds)
        return frame

    def ask_pixel(self, y: int, x: int) -> PixelAnswer | None:
        """Extension of tiscene: return the labels of a pixel of the frame received last.

        `Agent(..., query_budget=N)` allows N answers for each agent of the world. A question that cannot be answered
        prints an error, or raises it if `strict`, and does not count.

        Args:
            y: Row, 0 at the top.
            x: Column, 0 at the left.

        Returns:
            The answer; None for an error.
        """
        answer: PixelAnswer | None = self._try(
            "Error asking about a pixel: ", lambda world, camera: world.ask_pixel(camera, y, x)
        )
        return answer

    def change_scene(self, scene_name: str) -> None:
        """Go to one of `scenes`, or to a room of `world`; see `AgentWorlds.change_scene`."""
        failed = self._try(
            "Cannot change scene! error = ",
            lambda _, camera: self._registered()[0].change_scene(camera, scene_name),
            self,
        )
        if failed is self:
            return
        self._update_names()

    def get_categories(self) -> dict[int, str] | None:
        """Return the categories of the scene and of all templates, by their numbers in `category` views."""
        with self._locked() as (environment, _):
            self.categories = environment.categories()
        self.cat_colors = {number: [random.randint(0, 255) for _ in range(3)] for number in self.categories}
        return self.categories

    def get_position(self) -> Vector3:
        """Return the agent's position, m."""
        with self._locked() as (environment, camera):
            return Vector3(*single_precision(environment.position(camera)))

    def set_position(self, position: Any) -> None:
        """Set the agent's position, m, from the next frame on."""
        self._try("Error setting position: ", lambda world, camera: world.set_pose(camera, single_precision(position)))

    def get_rotation(self) -> Vector3:
        """Return the agent's Euler angles, degrees."""
        with self._locked() as (environment, camera):
            return Vector3(*single_precision(environment.rotation(camera)))

    def set_rotation(self, rotation: Any) -> None:
        """Set the agent's Euler angles, degrees, from the next frame on."""
        self._try(
            "Error setting rotation: ",
            lambda world, camera: world.set_pose(camera, rotation=single_precision(rotation)),
        )

    def toggle_follow(self) -> None:
        """Follow the camera track of the scene, or stop."""
        self._try("Error toggling follow: ", Environment.toggle_follow)

    def change_main_camera_clear_flags(self, r: int, g: int, b: int) -> None:
        """Set the 8-bit color of pixels that show no object; with a negative component, the sky."""
        self._try("Error sending clear flags: ", lambda world, camera: world.set_background(camera, (r, g, b)))

    def get_ambient_light_color(self) -> tuple[int, int, int]:
        """Return the color of the ambient light, 8-bit sRGB."""
        with self._locked() as (environment, _):
            return environment.ambient

    def set_ambient_light_color(self, r: int, g: int, b: int) -> None:
        """Set the color of the ambient light, which reaches every surface equally, 8-bit sRGB."""
        self._try("Error setting ambient light color: ", lambda world, camera: world.set_ambient(camera, (r, g, b)))

    def _load_scenario(self, content: dict[str, Any]) -> tuple[list[str], list[str]]:
        worlds, camera = self._registered()
        return worlds.load_scenario(camera, content)

    def _render(
        self, environment: Environment, camera: AgentCamera, views: Sequence[str]
    ) -> tuple[dict[str, NDArray[Any]], float]:
        """Render views of the next frame; agents of scripts that are recorded do more."""
        return environment.frame(camera, views)

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


def to_client_dtype(name: str, view: NDArray[Any]) -> NDArray[Any]:
    """Return a view as `Agent.get_frame` does: color, object and depth views as float32 in 0..1."""
    if name in ("main", "object", "depth"):
        return view.astype(np.float32) / np.float32(255.0)
    return view
