# SPDX-License-Identifier: Apache-2.0
"""The methods of SAILenv's Agent for objects: spawn, move and despawn them, load scenarios, upload models."""

from __future__ import annotations

import os
from typing import Any, BinaryIO

from dynamics import argument_checks
from tiscene.errors import ArgumentError, ArgumentTypeError
from tiscene.sailenv.agent_lights import AgentLights
from tiscene.sailenv.environment import Environment
from tiscene.sailenv.json_messages import integer, single_precision
from tiscene.sailenv.scenario_classes import Dynamic, Object, Scenario


class AgentObjects(AgentLights):
    """Base of Agent: its methods for objects. Positions are in Unity's space, rotations are its Euler angles."""

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
        """Spawn an object in the next frame.

        Args:
            name: One of `spawnable_objects_names`, or "file:" and the path returned by `send_obj_zip`.
            position: m.
            rotation: Euler angles, degrees.
            dynamic: Its trajectory; None for a static object.
            remove_default_dynamics: Whether it stays where it is. False: in a world with `physics=True`, an object
                without a dynamic falls and is pushed.
            frustum_limited: Whether the walls of the view frustum stop it.
            scale: Factors along its axes.
            use_parent: Has no effect: poses are always those of the world.
            remove_dynamics: Name of `remove_default_dynamics` in 2020.

        Returns:
            The id of the object; "" if it cannot be spawned.
        """
        # Signatures of 2020 and 2021 lack `dynamic` or `frustum_limited`, so that `scale` comes earlier.
        removed = remove_default_dynamics if isinstance(remove_default_dynamics, bool | int) else True
        if isinstance(dynamic, bool):
            removed = dynamic
            dynamic, scale = None, scale if isinstance(remove_default_dynamics, bool) else remove_default_dynamics
            frustum_limited = True
        elif not isinstance(frustum_limited, bool | int):
            frustum_limited, scale = True, frustum_limited
        id: str = self._try(
            f"Error object {name} not spawned: ",
            lambda world, camera: world.spawn(
                camera,
                name,
                single_precision(position),
                single_precision(rotation),
                scale=single_precision(scale),
                frustum_limited=bool(frustum_limited),
                dynamic=_typed_json(dynamic),
                remove_default_dynamics=bool(removed) and remove_dynamics,
            ),
            "",
        )
        if id:
            self.spawned_objects_idstr_names_table[id] = name
        return id

    def despawn_object(self, idstr: str) -> None:
        """Remove an object from the next frame on."""
        failed = self._try(
            f"Error despawning object with id {idstr}: ",
            lambda world, camera: world.despawn(camera, integer(idstr, "object id")),
            self,
        )
        if failed is not self:
            self.spawned_objects_idstr_names_table.pop(str(idstr), None)

    def move_object(self, idstr: str, position: Any, rotation: Any) -> None:
        """Move an object in the next frame; position in m, Euler angles in degrees."""
        self._try(
            f"Error moving object with id {idstr}: ",
            lambda world, camera: world.move(
                camera, integer(idstr, "object id"), single_precision(position), single_precision(rotation)
            ),
        )

    def load_scenario(self, scenario: Scenario) -> list[tuple[str, str]]:
        """Start a scenario.

        Returns:
            For each object the id that it was spawned with, "" if it is invalid, and the `id` of the object itself.
        """
        if not _is_scenario(scenario):
            given = argument_checks.brief(scenario)
            error = ArgumentTypeError(f"scenario={given}: must be a Scenario whose `objects` are a list of Object")
            self._report("Error loading scenario: ", error)
            return []
        failure: tuple[list[str], list[str]] = ([""] * scenario.n_objects, [])
        spawned, problems = self._try(
            "Error loading scenario: ", lambda *_: self._load_scenario(scenario.asdict()), failure
        )
        for problem in problems:
            self._report("Error loading scenario: ", ArgumentError(problem))
        ids = [(id, each.id) for id, each in zip(spawned, scenario.objects, strict=True)]
        self.spawned_objects_idstr_names_table.update((id, name) for id, name in ids if id)
        self._update_names()
        return ids

    def spawn_collidable_view_frustum(self) -> None:
        """Put walls at the sides of the agent's view; they follow the agent."""
        self._try("Error spawning view frustum: ", Environment.set_frustum_walls)

    def send_obj_zip(self, file: str | os.PathLike[str] | BinaryIO, filename: str | None = None) -> str:
        """Upload a model.

        Args:
            file: A zip file with an OBJ file, by path or open for reading.
            filename: Its name; required for an open file.

        Returns:
            The path by which it is spawned ("file:" + path); "" if it cannot be read.

        Raises:
            FileNotFoundError, ValueError, ArgumentTypeError: There is no such file, or an argument is wrong.
        """
        if isinstance(file, str | os.PathLike):
            name = argument_checks.text(filename or os.path.basename(file), "filename")
            with open(file, "rb") as opened:
                data = opened.read()
        elif filename is None:
            raise ValueError("filename cannot be None if an open file is provided")
        elif not hasattr(file, "read") or not hasattr(file, "seek"):
            raise ArgumentTypeError(f"file={argument_checks.brief(file)}: must be a path, or a file open for reading")
        else:
            name = argument_checks.text(filename, "filename")
            file.seek(0)
            data = file.read()
        path: str = self._try("Error sending file: ", lambda world, _: world.uploads.store(name, data), "")
        return path

    def _load_scenario(self, content: dict[str, Any]) -> tuple[list[str], list[str]]:
        """Start a scenario in SAILenv's JSON; see `AgentWorlds.load_scenario`."""
        worlds, camera = self._registered()
        return worlds.load_scenario(camera, content)


def _is_scenario(value: Any) -> bool:
    is_list = isinstance(value, Scenario) and isinstance(value.objects, list | tuple)
    return is_list and all(isinstance(each, Object) for each in value.objects)


def _typed_json(dynamic: Any) -> tuple[str, dict[str, Any]] | None:
    """Return type and description of a trajectory; None for none."""
    if dynamic is None:
        return None
    if not isinstance(dynamic, Dynamic):
        given = argument_checks.brief(dynamic)
        raise ArgumentTypeError(f"dynamic={given}: must be a Dynamic of SAILenv, such as CatmullWaypoints(waypoints)")
    return dynamic.get_type(), dynamic.asdict()
