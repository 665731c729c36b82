# SPDX-License-Identifier: Apache-2.0
"""WorldState: everything about a world at one frame, computed once and handed down.

A state is immutable. It holds what the renderer places (instances, lights), what frames report (objects, events) and
where the cameras are, so that no consumer asks the world again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import matrix_from_quaternion
from tiscene.frame.events import Event
from tiscene.frame.object_table import ObjectState
from tiscene.scene.camera import Camera
from tiscene.scene.description import Light
from tiscene.scene.placement import Placement
from tiscene.scene.room_volume import RoomVolume, rooms_at
from tiscene.world.frustum_test import in_view


class CameraStep(NamedTuple):
    """A camera at frames k - 1, k and k + 1."""

    previous: Camera
    current: Camera
    next: Camera


class ObjectBounds:
    """Bounds of the live objects of one frame, and which of them a camera has in view.

    Most objects of a stage never change: their rows, and whether a resting camera sees them, are taken over from the
    frame before.

    Attributes:
        ids: int64 [n], ascending instance ids.
        boxes: float64 [n, 2, 3], lowest and highest corner in each object's own axes, m.
        poses: float64 [n, 3, 4], from each object's axes to the world.
    """

    def __init__(self, objects: Sequence[ObjectState], earlier: ObjectBounds | None = None):
        """Collect the bounds of live objects.

        Args:
            objects: the live objects, by ascending id.
            earlier: bounds at another frame; rows that are the same Python object there are not computed again.
        """
        self._objects = objects
        self._visible: dict[tuple[Camera, float], NDArray[np.bool_]] = {}
        self._known: dict[tuple[Camera, float], NDArray[np.bool_]] = {}
        self.ids: NDArray[np.int64]
        self.boxes: NDArray[np.float64]
        self.poses: NDArray[np.float64]
        if earlier is not None and len(earlier._objects) == len(objects):
            pairs = enumerate(zip(objects, earlier._objects, strict=True))
            self._changed = [row for row, (each, last) in pairs if each is not last]
            self._known = dict(earlier._visible)
            self.ids, self.boxes, self.poses = earlier.ids.copy(), earlier.boxes.copy(), earlier.poses.copy()
        else:
            self._changed, count = list(range(len(objects))), len(objects)
            self.ids, self.boxes, self.poses = (
                np.zeros(count, np.int64),
                np.zeros((count, 2, 3)),
                np.zeros((count, 3, 4)),
            )
        changed = [objects[row] for row in self._changed]
        if changed:
            poses = np.array([(*each.position, *each.rotation) for each in changed])
            self.ids[self._changed] = [each.id for each in changed]
            self.boxes[self._changed] = [each.box for each in changed]
            self.poses[self._changed, :, :3] = matrix_from_quaternion(poses[:, 3:])
            self.poses[self._changed, :, 3] = poses[:, :3]

    @property
    def rooms(self) -> dict[int, str]:
        """Names of the rooms that the objects are in, by id."""
        return {each.id: each.room for each in self._objects}

    def visible(self, camera: Camera, aspect: float) -> set[int]:
        """Return the ids of the objects whose box intersects a camera's view.

        Args:
            camera: the camera.
            aspect: width / height of its image.
        """
        key = camera, aspect
        if key not in self._visible:
            if key in self._known:
                rows, result = self._changed, self._known[key].copy()
            else:
                rows, result = list(range(len(self.ids))), np.zeros(len(self.ids), np.bool_)
            result[rows] = in_view(camera, aspect, self.boxes[rows], self.poses[rows])
            self._visible[key] = result
        return set(self.ids[self._visible[key]].tolist())


@dataclass(frozen=True, eq=False)
class WorldState:
    """Everything about a world at frame k.

    Attributes:
        frame: k.
        aspect: width / height of the main camera's image.
        cameras: one row per camera of the world.
        placement: transforms of all instances at frames k - 1, k and k + 1, and the lights.
        objects: the live objects, by ascending id.
        lights: the lights at frame k, with their poses and radiance.
        movers: bool [instances of `placement`], True for an instance that is known at frame k to move, deform, appear,
            vanish, or vary its material after frame 0.
        has_dynamic_lights: whether any light is known at frame k to move, appear, vanish or change at some frame, or
            whether an emissive material of the stage varies.
        starting_lights: whether the lights are those of frames 0 and 1, except for their intensity, and the stage's
            emissive materials too.
        changes: spawns, despawns and contacts since frame k - 1.
        volumes: volumes of rooms on the stage.
        previous_bounds: bounds of the objects that were live at frame k - 1; at frame 0 those of the stage's objects.
    """

    frame: int
    aspect: float
    cameras: tuple[CameraStep, ...]
    placement: Placement
    objects: tuple[ObjectState, ...]
    lights: tuple[Light, ...]
    movers: NDArray[np.bool_]
    has_dynamic_lights: bool
    starting_lights: bool
    changes: tuple[Event, ...]
    volumes: tuple[RoomVolume, ...]
    previous_bounds: ObjectBounds

    @cached_property
    def bounds(self) -> ObjectBounds:
        """Bounds of the live objects."""
        return ObjectBounds(self.objects, self.previous_bounds)

    def room_of(self, camera: Camera) -> str:
        """Return the name of the room that a camera is in, "" for none."""
        return rooms_at(self.volumes, [camera.position])[0]

    def events(self, camera: CameraStep | None = None, aspect: float | None = None) -> tuple[Event, ...]:
        """Return all events since frame k - 1, as one camera sees them.

        An object enters when it is live and its box intersects the view, and one of both was not so at frame k - 1; it
        leaves the other way round. Occlusion does not count. Objects of the stage that are in view at frame 0 do not
        enter.

        Args:
            camera: the camera at frames k - 1, k and k + 1; None for the main camera.
            aspect: width / height of its image; None for the world's.

        Returns:
            `changes`, then "enter" events, then "leave" events, each by ascending object id, then changes of rooms.
        """
        camera, aspect = camera or self.cameras[0], aspect or self.aspect
        seen = self.bounds.visible(camera.current, aspect)
        before = self.previous_bounds.visible(camera.previous if self.frame else camera.current, aspect)
        entered = [Event("enter", id) for id in sorted(seen - before)]
        left = [Event("leave", id) for id in sorted(before - seen)] if self.frame else []
        return (*self.changes, *entered, *left, *self._room_changes(camera))

    def _room_changes(self, camera: CameraStep) -> tuple[Event, ...]:
        """Return "leave_room" and "enter_room" events of the camera (object 0) and of objects, by ascending id."""
        if not self.volumes or self.frame == 0:
            return ()
        before = {0: self.room_of(camera.previous), **self.previous_bounds.rooms}
        events = []
        for id, room in {0: self.room_of(camera.current), **self.bounds.rooms}.items():
            last = before.get(id, room)  # what was just spawned has not come from anywhere
            if last != room:
                events += [Event("leave_room", id, room=last)] * bool(last)
                events += [Event("enter_room", id, room=room)] * bool(room)
        return tuple(events)
