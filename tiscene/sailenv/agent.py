# SPDX-License-Identifier: Apache-2.0
"""SAILenv's Agent, in process: the same names, arguments, results and printed errors, without a server or a display."""

from __future__ import annotations

import os
import random
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntFlag
from typing import Any, BinaryIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError, TisceneError
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.environment import Environment
from tiscene.sailenv.frame_views import VIEWS
from tiscene.sailenv.json_messages import vector
from tiscene.sailenv.light_controls import LightControls
from tiscene.sailenv.scenario_classes import Dynamic, Scenario, Vector3

# Agents that name the same host and port share a world, as they did; it ends with its last agent.
_worlds: weakref.WeakValueDictionary[tuple[str, int], Environment] = weakref.WeakValueDictionary()
_lock = threading.RLock()
Result = TypeVar("Result")


class FrameFlags(IntFlag):
    """The views that an agent asks for, as bits."""

    NONE = 0
    MAIN = 1
    CATEGORY = 4
    OBJECT = 8
    OPTICAL = 16
    DEPTH = 32


class Agent:
    """An eye in a world that `register` puts there.

    main_frame_active and the others: which views `get_frame` gives. host, port: agents that name the same share a
    world; no connection is made. width, height: px. use_gzip: of no effect in process.
    strict: raise a TisceneError for what SAILenv prints.
    settings: of the world, for the agent that is first in it: scene, fps, quality, spp, max_depth, denoise, seed, arch
    as of `tiscene.sailenv.environment.Environment`.

    id: -1 before `register`. scenes, spawnable_objects_names, lights_names: lists of names. categories: names by the
    numbers of `category` views. cat_colors: a random 8-bit color for each. spawned_objects_idstr_names_table: names of
    what was spawned, by id. Positions are in Unity's space, m; rotations are its Euler angles, degrees.
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
        self._environment: Environment | None = None
        self._viewer: AgentCamera | None = None

    @property
    def active_frames(self) -> dict[str, bool]:
        """Which views there are."""
        return {name: bool(getattr(self, f"{name}_frame_active")) for name in VIEWS}

    @property
    def flags(self) -> int:
        """The same as the bits of `FrameFlags`."""
        return sum(view.flag for name, view in VIEWS.items() if self.active_frames[name])

    def register(self) -> None:
        """Enter the world. Raises a TisceneError for settings that cannot be."""
        with _lock:
            key = (self.host, int(self.port))
            environment = _worlds.get(key) or Environment(**self._settings)
            self._viewer = environment.register(int(self.width), int(self.height))
            self._environment = _worlds[key] = environment
            self.id = self._viewer.id
            self.scenes = environment.scenes()

    def delete(self) -> None:
        """Leave the world."""
        with _lock:
            if self._environment is not None and self._viewer is not None:
                self._environment.delete(self._viewer)
            self._environment = self._viewer = None

    def get_frame(self) -> dict[str, Any]:
        """The next frame: a dict with

        main: float32 [h, w, 3], RGB, 0..1. category: uint8 [h, w], keys of `categories`, 255 where there is none.
        object: float32 [h, w, 3], one color for each object, 0..1, black where there is none.
        flow: float32 [h, w, 2], (-dx, +dy) px from the frame before to this one (dx right, dy down).
        depth: float32 [h, w], 0 at the camera to 1 at 15 m along the axis and beyond, in steps of 1/255.
        sizes: of each view, bytes. deltaTime: s since the agent's frame before.

        Views that are not active are None.
        """
        active = [name for name, wanted in self.active_frames.items() if wanted]
        with self._world() as (environment, viewer):
            shown, seconds = environment.frame(viewer, active)
        frame: dict[str, Any] = {"sizes": dict.fromkeys(VIEWS, 0), **dict.fromkeys(VIEWS)}
        for name, array in shown.items():
            frame["sizes"][name] = array.nbytes
            frame[name] = as_numbers(name, array)
        frame["deltaTime"] = seconds
        return frame

    def change_scene(self, scene_name: str) -> None:
        """Begin anew in one of `scenes`."""
        if self._try("Cannot change scene! error = {}", lambda world, _: world.change_scene(scene_name), self) is self:
            return
        self._ask_about_scene()

    def get_categories(self) -> dict[int, str] | None:
        """The categories of what there is and what can be spawned."""
        with self._world() as (environment, _):
            self.categories = environment.categories()
        self.cat_colors = {number: [random.randint(0, 255) for _ in range(3)] for number in self.categories}
        return self.categories

    def get_position(self) -> Vector3:
        """m."""
        with self._world() as (environment, viewer):
            return Vector3(*environment.position(viewer))

    def set_position(self, position: Any) -> None:
        """m; from the next frame on."""
        self._try("Error setting position: {}", lambda world, viewer: world.place(viewer, position=single(position)))

    def get_rotation(self) -> Vector3:
        """Euler degrees."""
        with self._world() as (environment, viewer):
            return Vector3(*environment.rotation(viewer))

    def set_rotation(self, rotation: Any) -> None:
        """Euler degrees; from the next frame on."""
        self._try("Error setting rotation: {}", lambda world, viewer: world.place(viewer, rotation=single(rotation)))

    def toggle_follow(self) -> None:
        """Follow the scene's camera track, or stop."""
        self._try("Error toggling follow: {}", Environment.toggle_follow)

    def spawn_object(
        self,
        name: str,
        position: Any = (0, 0, 0),
        rotation: Any = (0, 0, 0),
        dynamic: Dynamic | None = None,
        remove_default_dynamics: bool = True,
        frustum_limited: bool = True,
        scale: Any = (1, 1, 1),
        use_parent: bool = True,
        remove_dynamics: bool = True,
    ) -> str:
        """Let an object appear in the next frame; its id, "" if it cannot be.

        name: one of `spawnable_objects_names`, or "file:" and what `send_obj_zip` gave. remove_default_dynamics,
        `remove_dynamics` as it was called in 2020, and use_parent are of no effect: nothing falls here, and places are
        those of the world.
        """
        # Before there were dynamics, and before there were limits, scale was that much earlier in the row.
        if isinstance(dynamic, bool):
            dynamic, scale = None, scale if isinstance(remove_default_dynamics, bool) else remove_default_dynamics
            frustum_limited = True
        elif not isinstance(frustum_limited, bool | int):
            frustum_limited, scale = True, frustum_limited
        id: str = self._try(
            f"Error object {name} not spawned: {{}}",
            lambda world, viewer: world.spawn(
                viewer,
                name,
                single(position),
                single(rotation),
                scale=single(scale),
                frustum_limited=bool(frustum_limited),
                dynamic=None if dynamic is None else (dynamic.get_type(), dynamic.asdict()),
            ),
            "",
        )
        if id:
            self.spawned_objects_idstr_names_table[id] = name
        return id

    def despawn_object(self, idstr: str) -> None:
        """Let an object be gone from the next frame on."""
        failed = self._try(
            f"Error despawning object with id {idstr}: {{}}",
            lambda world, viewer: world.despawn(viewer, _number(idstr)),
            self,
        )
        if failed is not self:
            self.spawned_objects_idstr_names_table.pop(str(idstr), None)

    def move_object(self, idstr: str, position: Any, rotation: Any) -> None:
        """Put an object elsewhere in the next frame."""
        self._try(
            f"Error moving object with id {idstr}: {{}}",
            lambda world, viewer: world.move(viewer, _number(idstr), single(position), single(rotation)),
        )

    def load_scenario(self, scenario: Scenario) -> list[tuple[str, str]]:
        """Begin anew with a scenario; for each of its objects (id, the object's `id`), the first "" if it cannot be."""
        failure: tuple[list[str], list[str]] = ([""] * scenario.n_objects, [])
        spawned, problems = self._try(
            "Error loading scenario: {}", lambda world, viewer: world.load(viewer, scenario.asdict()), failure
        )
        for problem in problems:
            self._complain("Error loading scenario: {}", ArgumentError(problem))
        ids = [(id, each.id) for id, each in zip(spawned, scenario.objects, strict=True)]
        self.spawned_objects_idstr_names_table.update((id, name) for id, name in ids if id)
        self._ask_about_scene()
        return ids

    def spawn_collidable_view_frustum(self) -> None:
        """Put walls at the sides of the agent's view."""
        self._try("Error spawning view frustum: {}", Environment.set_frustum_walls)

    def send_obj_zip(self, file: str | os.PathLike[str] | BinaryIO, filename: str | None = None) -> str:
        """Bring in a model, an OBJ file in a zip; the path to spawn it by ("file:" + path), "" if it cannot be."""
        if isinstance(file, str | os.PathLike):
            name = filename or os.path.basename(file)
            with open(file, "rb") as opened:
                data = opened.read()
        elif filename is None:
            raise ValueError("filename cannot be None if an open file is provided")
        else:
            name = filename
            file.seek(0)
            data = file.read()
        path: str = self._try("Error sending file: {}", lambda world, _: world.uploads.store(name, data), "")
        return path

    def change_main_camera_clear_flags(self, r: int, g: int, b: int) -> None:
        """The 8-bit color of what shows nothing; negative: the sky."""
        self._try("Error sending clear flags: {}", lambda world, viewer: world.clear(viewer, (r, g, b)))

    def get_light_color(self, light_name: str) -> tuple[int, int, int] | None:
        """8-bit sRGB; None for no such light. So are the following."""
        return self._light("getting light color", lambda lights: lights.color(light_name))

    def set_light_color(self, light_name: str, r: int, g: int, b: int) -> None:
        self._light("setting light color", lambda lights: lights.set_color(light_name, (r, g, b)))

    def get_light_position(self, light_name: str) -> tuple[float, float, float] | None:
        """m."""
        return self._light("getting light position", lambda lights: lights.position(light_name))

    def set_light_position(self, light_name: str, position: Any) -> None:
        self._light("setting light position", lambda lights: lights.set_position(light_name, single(position)))

    def get_light_direction(self, light_name: str) -> tuple[float, float, float] | None:
        """Where its light goes."""
        return self._light("getting light direction", lambda lights: lights.direction(light_name))

    def set_light_direction(self, light_name: str, direction: Any) -> None:
        self._light("setting light direction", lambda lights: lights.set_direction(light_name, single(direction)))

    def get_light_intensity(self, light_name: str) -> float | None:
        """1: as the scene has it."""
        return self._light("getting light intensity", lambda lights: lights.intensity(light_name))

    def set_light_intensity(self, light_name: str, intensity: float) -> None:
        self._light(
            "setting light intensity", lambda lights: lights.set_intensity(light_name, float(np.float32(intensity)))
        )

    def get_light_indirect_multiplier(self, light_name: str) -> float | None:
        """1: as the scene has it. Of what the light gives to surfaces that are seen by way of others."""
        return self._light("getting light indirect multiplier", lambda lights: lights.indirect_multiplier(light_name))

    def set_light_indirect_multiplier(self, light_name: str, indirect_multiplier: float) -> None:
        self._light(
            "setting light indirect multiplier",
            lambda lights: lights.set_indirect_multiplier(light_name, float(indirect_multiplier)),
        )

    def get_light_type(self, light_name: str) -> str | None:
        """ "Directional", "Point", "Rectangle", "Disc" or "Area"."""
        return self._light("getting light type", lambda lights: lights.type(light_name))

    def get_ambient_light_color(self) -> tuple[int, int, int]:
        """8-bit sRGB."""
        with self._world() as (environment, _):
            return environment.ambient

    def set_ambient_light_color(self, r: int, g: int, b: int) -> None:
        """Light that reaches every surface alike."""
        self._try("Error setting ambient light color: {}", lambda world, _: world.set_ambient((r, g, b)))

    def _light(self, doing: str, act: Callable[[LightControls], Result]) -> Result | None:
        result: Result | None = self._try(f"Error {doing}: {{}}", lambda world, _: act(world.lights))
        return result

    def _ask_about_scene(self) -> None:
        self.get_categories()
        with self._world() as (environment, _):
            self.spawnable_objects_names = environment.spawnable()
            self.lights_names = list(environment.lights.names)

    @contextmanager
    def _world(self) -> Iterator[tuple[Environment, AgentCamera]]:
        if self._environment is None or self._viewer is None:
            raise ArgumentError("this agent is in no world: call register() first")
        with _lock:
            yield self._environment, self._viewer

    def _try(self, message: str, act: Callable[[Environment, AgentCamera], Any], otherwise: Any = None) -> Any:
        """What `act` gives; where it fails, `otherwise`, and the message is printed."""
        try:
            with self._world() as (environment, viewer):
                return act(environment, viewer)
        except TisceneError as error:
            self._complain(message, error)
            return otherwise

    def _complain(self, message: str, error: TisceneError) -> None:
        if self.strict:
            raise error
        print(message.format(error))


def single(value: Any) -> tuple[float, float, float]:
    """Three numbers in single precision, as they are over the wire and in Unity. Raises ScenarioError."""
    x, y, z = np.array(vector(value), np.float32).tolist()
    return (x, y, z)


def as_numbers(name: str, view: NDArray[Any]) -> NDArray[Any]:
    """A view as `Agent.get_frame` gives it: pictures as float32 in 0..1."""
    if name in ("main", "object", "depth"):
        return view.astype(np.float32) / np.float32(255.0)
    return view


def _number(id: Any) -> int:
    try:
        return int(id)
    except (TypeError, ValueError, OverflowError):
        raise ArgumentError(f"{id!r}: must be the id of an object") from None
