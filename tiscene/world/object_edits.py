# SPDX-License-Identifier: Apache-2.0
"""ObjectEdits: the edits of a world that spawn, remove and move its objects, and that place the frustum's walls."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dynamics import Dynamic, RigidBody, argument_checks
from tiscene.errors import ArgumentError, ArgumentTypeError, ObjectNotFound, ScenarioError
from tiscene.scenario.edits import Despawn, Move, SetFrustumWalls, Spawn
from tiscene.scenario.objects import Frustum, Object
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera
from tiscene.world.camera_edits import CameraEdits
from tiscene.world.edit_lock import one_at_a_time

WHOLE_IMAGE = (0.0, 0.0, 1.0, 1.0)  # left, top, right, bottom
TYPICAL_DEPTH = (1.0, 5.0)  # m
_SPAWN_ARGUMENTS = (
    *("template", "position", "rotation", "dynamic", "id", "free", "region", "depth"),
    *("last_frame", "frustum_limited", "collide", "scale"),  # of `Object`
)


class ObjectEdits(CameraEdits):
    """Base class of a world with objects that can be edited.

    Attributes:
        fps: frames per second.
    """

    fps: float
    _scenario: Scenario
    _aspect: float

    @property
    def physics(self) -> bool:
        """Whether a physics engine moves objects, see `Scenario.physics`."""
        return self._scenario.physics

    @one_at_a_time
    def spawn(
        self,
        template: str,
        position: Sequence[float] | None = None,
        rotation: Sequence[float] = (0.0, 0.0, 0.0),
        dynamic: Dynamic | None = None,
        *,
        id: str | None = None,
        free: bool = False,
        region: tuple[float, float, float, float] = WHOLE_IMAGE,
        depth: tuple[float, float] = TYPICAL_DEPTH,
        **others: Any,
    ) -> int:
        """Spawn an object at the next frame.

        Args:
            template: name or file of its template.
            position: m; None: the origin, or with `free` the place that is found.
            rotation: Euler angles (x, y, z), degrees, or a quaternion (w, x, y, z).
            dynamic: trajectory, whose clock starts at the next frame; None: none, or with `Scenario(physics=True)` a
                RigidBody.
            id: name in the scenario; None: a new one is made.
            free: find a place as `Scenario.sample` does: the main camera sees it, and the ball around the object
                touches neither the stage nor other objects. It depends on `seed`, the frame and the number of
                objects so far.
            region: with `free`, part of the image for the object's origin: left, top, right, bottom, 0..1.
            depth: with `free`, nearest and farthest depth of the object's origin, m.
            **others: further attributes of `Object`: last_frame, frustum_limited, collide, scale.

        Returns:
            The instance id.

        Raises:
            ScenarioError, ArgumentError, TemplateNotFound, MissingExtra: nothing has changed then.
        """
        parts = self._parts
        if id is None:
            first = len(parts.log.histories) - len(self._scenario.objects) + 1
            id = next(name for n in itertools.count(first) if parts.log.row(name := f"spawned_{n}") is None)
        if isinstance(template, Object):
            raise ArgumentTypeError(
                f"template={argument_checks.brief(template)}: must be a name; of an Object, "
                "spawn(it.template, it.position, it.rotation, it.dynamic, id=it.id)"
            )
        argument_checks.known_names(others, _SPAWN_ARGUMENTS, "world.spawn")
        if not free and (region is not WHOLE_IMAGE or depth is not TYPICAL_DEPTH):
            raise ArgumentError("region and depth say where a free place is looked for; add free=True")
        start = (0.0, 0.0, 0.0) if position is None else position
        if dynamic is None and self.physics:
            dynamic = RigidBody()
        new = Object(id, template, start, rotation, dynamic, first_frame=self.next_frame, **others)  # type: ignore[arg-type]
        parts.trajectories.check(new)
        parts.registry.template(new)
        if argument_checks.flag(free, "free"):
            if position is not None:
                raise ArgumentError("free=True finds a position; leave position out")
            new = parts.place_finder.placed(new, self.camera_at(self.next_frame), region, depth)
        self._edit(Spawn(self.next_frame, new))
        return parts.registry.id_of(len(parts.log.histories) - 1)

    @one_at_a_time
    def despawn(self, object: int | str) -> None:
        """Remove an object from the next frame on.

        Args:
            object: instance id, name in the scenario, or prim path on the stage.

        Raises:
            ObjectNotFound: no such object is alive at the next frame.
        """
        self._edit(Despawn(self.next_frame, self._live_name(object)))

    @one_at_a_time
    def move(self, object: int | str, position: Sequence[float], rotation: Sequence[float] | None = None) -> None:
        """Move an object at the next frame.

        An object on a path returns to it from there, a bouncing one continues in its direction, objects of the stage
        stay, or go on with their animation.

        Args:
            object: instance id, name in the scenario, or prim path on the stage.
            position: m, as in `frame.objects`.
            rotation: Euler angles (x, y, z), degrees, or a quaternion (w, x, y, z); None: unchanged.

        Raises:
            ObjectNotFound: no such object is alive at the next frame.
            ScenarioError: the pose is invalid.
        """
        name, parts = self._live_name(object), self._parts
        if rotation is None:
            row = parts.log.row(name)
            if row is None:
                rotation = parts.stage_objects.rotation(name, self.next_frame)
            elif (last := parts.log.histories[row].move(self.next_frame)) and last.frame == self.next_frame:
                rotation = last.rotation
            else:
                rows = parts.log.around(self.next_frame)
                rotation = parts.trajectories.arrivals(self.next_frame, rows)[rows.index(row), 3:].tolist()
        self._edit(Move(self.next_frame, name, position, rotation))  # type: ignore[arg-type]

    @one_at_a_time
    def set_frustum_walls(
        self, frustum: Frustum | None, camera: Camera | str | None = None, aspect: float | None = None
    ) -> None:
        """Replace the walls that bound objects, from the next frame on.

        Args:
            frustum: the walls; None: none.
            camera: the camera whose view they enclose: a Camera, or the name or prim path of one of the scenario's, as
                it is then; None: the main camera.
            aspect: width / height of that view; None: the world's.

        Raises:
            CameraNotFound: the scenario has no such camera.
            ScenarioError: an argument is of the wrong kind.
        """
        if not isinstance(camera, Camera | str | None):
            raise ScenarioError(f"camera={camera!r}: must be a Camera, the name of one or None")
        if isinstance(camera, Camera):
            now = camera.at(self.next_frame / self.fps)
        else:
            now = self.camera_at(self.next_frame, camera)
        seen = replace(now, dynamic=None)
        self._edit(SetFrustumWalls(self.next_frame, frustum, seen, self._aspect if aspect is None else aspect))

    def _live_name(self, object: int | str) -> str:
        """Return the scenario's name or the prim path of an object that is alive at the next frame."""
        if not isinstance(object, int | str | np.integer):
            raise ArgumentError(f"object={object!r}: must be an instance id, a name or a prim path")
        frame, parts = self.next_frame, self._parts
        histories = parts.log.histories
        row = parts.log.row(object) if isinstance(object, str) else parts.registry.row_of(int(object))
        if row is not None and not isinstance(object, bool) and histories[row].alive(frame, as_of=frame):
            return histories[row].spec.id
        objects = {parts.registry.id_of(row): histories[row].spec.id for row in parts.log.alive(frame)}
        on_stage = {
            row.id: row.prim_path
            for number, row in enumerate(parts.registry.stage_rows)
            if parts.stage_objects.is_alive(number, frame)
        }
        names = objects | on_stage
        if object in names.values():
            return str(object)
        if isinstance(object, bool) or object not in names:
            known = list(names.values())
            if not isinstance(object, str):  # of many objects only the scenario's are listed
                listed = names if len(on_stage) <= 20 else objects
                known = [f"{name} ({number})" for number, name in listed.items()]
            raise ObjectNotFound("object", object, known, f" at frame {frame}")
        return names[int(object)]
