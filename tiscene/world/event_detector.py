# SPDX-License-Identifier: Apache-2.0
"""EventDetector: what happens to the objects of a world between two frames, and what comes into view."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from dynamics.rotation import matrix_from_quaternion
from tiscene.frame.events import Event
from tiscene.scenario.edits import ObjectHistory
from tiscene.scene.camera import Camera
from tiscene.scene.description import SceneDescription
from tiscene.world.frustum_test import in_view
from tiscene.world.object_registry import WorldObject
from tiscene.world.stage_objects import StageObjects
from tiscene.world.trajectories import WALLS, Collision

KEPT_VIEWS = 8  # of the frames last asked for what was in view is kept: the next one needs it again


class EventDetector:
    """Looks at things and objects, and remembers what it has seen last."""

    def __init__(
        self,
        stage: SceneDescription,
        things: StageObjects,
        lives: Sequence[ObjectHistory],
        objects: Callable[[int], list[WorldObject]],
    ) -> None:
        """lives: of the scenario's objects; it grows. objects: all that are there at a frame."""
        self._stage = stage
        self._things = things
        self._lives = lives
        self._objects = objects
        self._seen_by_view: dict[tuple[int, Camera, float], set[int]] = {}
        # Of the rows looked at last: where they are, and which of them were in which view.
        self._rows: list[WorldObject] = []
        self._boxes = np.zeros((0, 2, 3))
        self._poses = np.zeros((0, 3, 4))
        self._visible = np.zeros(0, np.bool_)
        self._view: tuple[Camera, float] | None = None

    def forget(self) -> None:
        """The world has been edited."""
        self._seen_by_view.clear()

    def events(
        self, frame: int, meetings: Iterable[Collision], before: Camera, now: Camera, aspect: float
    ) -> list[Event]:
        """What has happened since the frame before; see `World.events`."""
        first = len(self._stage.objects) + 1
        events = []
        for number, stage_life in self._things.lives.items():
            if stage_life.despawned == frame:
                events.append(Event("despawn", number + 1))
        for number, life in enumerate(self._lives):
            there = life.alive(frame, as_of=frame)
            if there != (frame > 0 and life.alive(frame - 1, as_of=frame - 1)):
                events.append(Event("spawn" if there else "despawn", first + number))
        events.sort(key=lambda event: event.object)
        for meeting in meetings:
            if meeting.kind == "wall":
                events.append(Event("contact", first + meeting.number, surface=WALLS[meeting.other]))
            elif meeting.kind == "collider":
                path = self._stage.colliders[meeting.other].prim_path
                events.append(Event("contact", first + meeting.number, surface=path))
            else:
                start = 1 if meeting.kind == "stage" else first
                events.append(Event("contact", first + meeting.number, start + meeting.other))
        seen = self._seen(frame, now, aspect)
        earlier = self._seen(frame - 1, before, aspect) if frame else {id for id in seen if id < first}
        events += [Event("enter", id) for id in sorted(seen - earlier)]
        events += [Event("leave", id) for id in sorted(earlier - seen)]
        return events

    def _seen(self, frame: int, camera: Camera, aspect: float) -> set[int]:
        """Ids of what is in a camera's view at a frame."""
        key = frame, camera, aspect
        if key not in self._seen_by_view:
            while len(self._seen_by_view) >= KEPT_VIEWS:
                self._seen_by_view.pop(next(iter(self._seen_by_view)))
            visible = self._in_view(self._objects(frame), camera, aspect)
            self._seen_by_view[key] = {row.id for row, there in zip(self._rows, visible, strict=True) if there}
        return self._seen_by_view[key]

    def _in_view(self, rows: list[WorldObject], camera: Camera, aspect: float) -> list[bool]:
        """Which of the rows are in a view; what has not changed since the last time is not looked at again."""
        if len(rows) != len(self._rows):
            new = list(range(len(rows)))
            self._boxes, self._poses = np.zeros((len(rows), 2, 3)), np.zeros((len(rows), 3, 4))
            self._visible, self._view = np.zeros(len(rows), np.bool_), None
        else:
            new = [place for place, (row, last) in enumerate(zip(rows, self._rows, strict=True)) if row is not last]
        if new:
            poses = np.array([[*rows[place].position, *rows[place].rotation] for place in new])
            self._poses[new] = np.concatenate([matrix_from_quaternion(poses[:, 3:]), poses[:, :3, None]], axis=2)
            self._boxes[new] = [rows[place].box for place in new]
        looked_at = new if self._view == (camera, aspect) else slice(None)
        self._visible[looked_at] = in_view(camera, aspect, self._boxes[looked_at], self._poses[looked_at])
        self._rows, self._view = rows, (camera, aspect)
        return self._visible.tolist()
