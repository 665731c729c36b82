# SPDX-License-Identifier: Apache-2.0
"""ViewHistory: from where the objects of a scenario were seen before, and how new a view of them is.

A view of an object is the direction from it to the camera, in its own axes. Views count as shown while the object's
center lies in the image, whatever is in front of it. They are evaluated twice a second, at fixed frames, over the last
64 s: a pure function of the frame, whatever was rendered. Edits that come after a frame do not change its views.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.lru_cache import LRUCache
from dynamics.rotation import matrix_from_quaternion
from tiscene.frame.difficulty import NEVER_SHOWN
from tiscene.scenario.edits import EditLog
from tiscene.scene.camera import Camera
from tiscene.world.trajectories import Trajectories
from tiscene.world.world_cameras import WorldCameras

Array = NDArray[np.float64]
RATE = 2.0  # views per second
LATEST = 1.0  # s before the frame: views after that are not "shown before"
WINDOW = 128  # views
KEPT = 4 * WINDOW


@dataclass(eq=False)
class FrameNovelty:
    """The novelty of the views of one frame, computed when it is asked for. A pickle holds the angles.

    Attributes:
        frame: the frame.
        row: the camera whose earlier views count.
        camera: the camera that took the frame.
        history: what computes the angles; None: they are known.
        known: the angles.
    """

    frame: int
    row: int
    camera: Camera
    history: ViewHistory | None
    known: Mapping[int, float] = field(default_factory=dict)

    def angles(self) -> Mapping[int, float]:
        """Return the angle to the nearest view shown before of each object of the scenario, by id, degrees."""
        history = self.history
        if history is not None:
            with history.lock:
                if self.history is not None:  # no other thread has computed them meanwhile
                    self.known = history.angles(self.frame, self.row, self.camera)
                    self.history = None
        return self.known

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "known": self.angles(), "history": None}


@dataclass(eq=False)
class ViewHistory:
    """Views of the objects of a scenario over time.

    Attributes:
        log: the edit log, which may grow.
        trajectories: poses of the objects.
        cameras: the cameras.
        first_id: instance id of the object in row 0 of the log.
        fps: frames per second.
        aspect: width / height of the image.
        lock: held while views are evaluated, which simulates.
    """

    log: EditLog
    trajectories: Trajectories
    cameras: WorldCameras
    first_id: int
    fps: float
    aspect: float
    lock: AbstractContextManager[object]

    def __post_init__(self) -> None:
        self._step = max(1, round(self.fps / RATE))
        self._lag = max(1, round(self.fps * LATEST))
        self._novelties: weakref.WeakSet[FrameNovelty] = weakref.WeakSet()
        self._views: LRUCache[tuple[int, int], dict[int, Array]] = LRUCache(KEPT)

    def settle(self, frame: int) -> None:
        """Compute the novelty of the frames that are held, from one on that an edit is about to change."""
        for novelty in list(self._novelties):
            if novelty.frame >= frame:
                novelty.angles()

    def forget(self, frame: int) -> None:
        """Drop the views from a frame on, which an edit may have changed."""
        self._views.drop(lambda key: key[0] >= frame)

    def of_frame(self, frame: int, row: int, camera: Camera) -> FrameNovelty:
        """Return the novelty of a frame that a camera took, against the views of the camera in a row."""
        novelty = FrameNovelty(frame, row, camera, self)
        self._novelties.add(novelty)
        return novelty

    def angles(self, frame: int, row: int, camera: Camera) -> Mapping[int, float]:
        """Return the angle to the nearest earlier view of each live object, by id, degrees."""
        last = (frame - self._lag) // self._step
        earlier = [self._seen(number * self._step, row) for number in range(max(last - WINDOW + 1, 0), last + 1)]
        result = {}
        for number, direction in self._directions(frame, camera).items():
            shown = [views[number] for views in earlier if number in views]
            angle = NEVER_SHOWN
            if shown:
                differences = np.linalg.norm(np.array(shown) - direction, axis=1)
                angle = float(np.degrees(2.0 * np.arcsin(np.clip(0.5 * differences.min(), 0.0, 1.0))))
            result[self.first_id + number] = angle
        return result

    def _seen(self, frame: int, row: int) -> dict[int, Array]:
        """Return the directions to the camera of the objects in view at a frame, by row."""
        return self._views.get(
            (frame, row), lambda: self._directions(frame, self.cameras.at(frame, row, frame), in_view=True)
        )

    def _directions(self, frame: int, camera: Camera, *, in_view: bool = False) -> dict[int, Array]:
        rows = self.log.alive(frame)
        if not rows:
            return {}
        poses = self.trajectories.poses(frame, rows)
        towards = np.asarray(camera.position) - poses[:, :3]
        if camera.orthographic_height is not None:
            towards = np.broadcast_to(camera.axes()[:, 2], towards.shape)
        unit = towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
        directions = np.einsum("nij,ni->nj", matrix_from_quaternion(poses[:, 3:]), unit)
        kept = np.ones(len(rows), np.bool_)
        if in_view:
            local = (poses[:, :3] - camera.position) @ camera.axes()
            framed = camera.framed(self.aspect)
            half = np.array([framed.half_height(max(depth, 0.0)) for depth in (-local[:, 2]).tolist()])
            x, y = camera.image_center(-local[:, 2])
            kept = (-local[:, 2] > 0.0) & (np.abs(local[:, 1] - y) <= half)
            kept &= np.abs(local[:, 0] - x) <= half * self.aspect
        return {row: direction for row, direction, shown in zip(rows, directions, kept, strict=True) if shown}
