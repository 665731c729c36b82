"""Witness: what happens to the objects of a world between two frames, and what comes into view."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from dynamics.rotation import matrix_from_quaternion
from tiscene.camera import Camera
from tiscene.edits import Life
from tiscene.events import Event
from tiscene.in_view import in_view
from tiscene.inventory import WorldObject
from tiscene.motion import WALLS, Meeting
from tiscene.scene.description import SceneDescription
from tiscene.stage_things import StageThings

KEPT_VIEWS = 8  # of the frames last asked for what was in view is kept: the next one needs it again


class Witness:
    """Looks at things and objects, and remembers what it has seen last."""

    def __init__(
        self,
        stage: SceneDescription,
        things: StageThings,
        lives: Sequence[Life],
        objects: Callable[[int], list[WorldObject]],
    ) -> None:
        """lives: of the scenario's objects; it grows. objects: all that are there at a frame."""
        self._stage = stage
        self._things = things
        self._lives = lives
        self._objects = objects
        self._seen_by_view: dict[tuple[int, Camera, float], set[int]] = {}

    def forget(self) -> None:
        """The world has been edited."""
        self._seen_by_view.clear()

    def events(
        self, frame: int, meetings: Iterable[Meeting], before: Camera, now: Camera, aspect: float
    ) -> list[Event]:
        """What has happened since the frame before; see `World.events`."""
        first = len(self._stage.objects) + 1
        events = []
        for number, stage_life in self._things.lives.items():
            if stage_life.despawned == frame:
                events.append(Event("despawn", number + 1))
        for number, life in enumerate(self._lives):
            if life.planned.first_frame == frame:
                events.append(Event("spawn", first + number))
            elif life.last_frame is not None and life.last_frame + 1 == frame:
                events.append(Event("despawn", first + number))
        events.sort(key=lambda event: event.object)
        for meeting in meetings:
            if meeting.kind == "wall":
                events.append(Event("contact", first + meeting.number, wall=WALLS[meeting.other]))
            elif meeting.kind == "collider":
                path = self._stage.colliders[meeting.other].prim_path
                events.append(Event("contact", first + meeting.number, wall=path))
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
            rows = self._objects(frame)
            poses = np.array([[*row.position, *row.rotation] for row in rows]).reshape(-1, 7)
            placed = np.concatenate([matrix_from_quaternion(poses[:, 3:]), poses[:, :3, None]], axis=2)
            boxes = np.array([row.box for row in rows]).reshape(-1, 2, 3)
            visible = in_view(camera, aspect, boxes, placed)
            self._seen_by_view[key] = {row.id for row, there in zip(rows, visible.tolist(), strict=True) if there}
        return self._seen_by_view[key]
