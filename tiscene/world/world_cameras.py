# SPDX-License-Identifier: Apache-2.0
"""WorldCameras: the cameras at each frame, by their lenses' keyframes, their trajectories and edits that place them.

A camera that an edit has placed has left its trajectory: it stays until the next edit. Edits are not anticipated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from dynamics.rotation import multiply, quaternion
from tiscene.errors import CameraNotFound
from tiscene.scenario.edits import EditLog, PlaceCamera
from tiscene.scene.camera import Camera, Vector3
from tiscene.scene.walking import Axes, walked_axes
from tiscene.world.trajectories import Trajectories
from tiscene.world.world_state import CameraStep

AS_PLANNED = -1  # a frame before all edits


@dataclass(frozen=True, eq=False)
class WorldCameras:
    """The cameras of a world.

    Attributes:
        cameras: the cameras at their start.
        log: the edit log, which may grow.
        trajectories: poses along trajectories.
        fps: frames per second.
        names: names of the stage's cameras by prim path.

    Raises:
        CameraNotFound: an edit places a camera that the scenario does not have.
    """

    cameras: Sequence[Camera]
    log: EditLog
    trajectories: Trajectories
    fps: float
    names: Mapping[str, str]

    def __post_init__(self) -> None:
        for name in self.log.cameras:
            self._row(name)

    def row(self, camera: str | None) -> int:
        """Return the row of a camera by name or prim path; None: the main camera's. Raises CameraNotFound."""
        return self._row(None if camera is None else self.names.get(camera, camera))

    def _row(self, name: str | None) -> int:
        names = [camera.name for camera in self.cameras]
        if name is not None and name not in names:
            raise CameraNotFound("camera", name, names, " among those of the scenario")
        return 0 if name is None else names.index(name)

    def at(self, time: Fraction | int, row: int, as_of: int) -> Camera:
        """Return a camera at a time in frames, as planned when frame `as_of` was made."""
        camera = self._with_lens(row, time)
        edit = self.log.camera(camera.name, min(math.floor(time), as_of))
        if edit is not None:
            return camera.with_pose(edit.position, edit.rotation)
        if camera.dynamic is None:
            return camera
        x, y, z, *rotation = self.trajectories.camera_poses(time)[row].tolist()
        return camera.with_pose((x, y, z), tuple(rotation))

    def _with_lens(self, row: int, time: Fraction | int) -> Camera:
        """Return a camera with its lens at a time in frames, where it is at its start."""
        return self.cameras[row].at(max(float(time), 0.0) / self.fps)

    def is_dynamic(self, frame: int, row: int) -> bool:
        """Return whether a camera has a trajectory, or was placed by an edit up to a frame and so may be again."""
        camera = self.cameras[row]
        return camera.dynamic is not None or self.log.camera(camera.name, frame) is not None

    def walks(self, frame: int, row: int) -> Axes:
        """Return along which axes a camera walks, on its trajectory or by edits up to a frame."""
        camera = self.cameras[row]
        axes = Axes() if camera.dynamic is None else self.trajectories.camera_axes[row]
        history = self.log.cameras.get(camera.name)
        if history is None or history.placements[0].frame > frame:
            return axes
        first = history.placements[0]
        start = self.at(first.frame - 1, row, AS_PLANNED)
        return axes | walked_axes(start.position, first.position) | history.walks(frame)

    def step(self, frame: int, row: int) -> CameraStep:
        """Return a camera at frames k - 1, k and k + 1; the last one as planned at k."""
        return CameraStep(*(self.at(frame + step, row, frame) for step in (-1, 0, 1)))

    def planned_start(self) -> CameraStep:
        """Return the main camera at frames -1, 0 and 1, without edits."""
        return CameraStep(*(self.at(frame, 0, AS_PLANNED) for frame in (-1, 0, 1)))

    def between(self, frame: int, shift: Fraction) -> tuple[Camera, ...]:
        """Return all cameras at a time within the shutter interval of a frame.

        An edit places a camera at once: while the shutter of its first frame is open, the camera stands still.
        """
        result = []
        for row, camera in enumerate(self.cameras):
            edit = self.log.camera(camera.name, frame)
            now = self.at(frame + shift, row, frame)
            result.append(now if edit is None else now.with_pose(edit.position, edit.rotation))
        return tuple(result)

    def moved(
        self, frame: int, name: str | None, position: Sequence[float] | None, rotation: Sequence[float] | None
    ) -> PlaceCamera:
        """Return the edit that places a camera; what is None stays as it is at the frame."""
        now = self.at(frame, self.row(name), frame)
        turned = now.rotation if rotation is None else tuple(quaternion(rotation).tolist())
        return PlaceCamera(frame, now.name, now.position if position is None else position, turned)  # type: ignore[arg-type]

    def offset(self, frame: int, name: str | None, by: Vector3) -> Vector3:
        """Return a camera's position, moved along its own axes (x right, y up, -z forward)."""
        now = self.at(frame, self.row(name), frame)
        x, y, z = (np.asarray(now.position) + now.axes() @ np.asarray(by, np.float64)).tolist()
        return (x, y, z)

    def turned(self, frame: int, name: str | None, yaw: float, pitch: float, up: Vector3) -> tuple[float, ...]:
        """Return a camera's rotation after a turn about the vertical, and one about its own x axis, degrees."""
        now = self.at(frame, self.row(name), frame)
        half, tilt = 0.5 * math.radians(yaw), 0.5 * math.radians(pitch)
        around = np.array([math.cos(half), *(math.sin(half) * np.asarray(up))])
        upward = np.array([math.cos(tilt), math.sin(tilt), 0.0, 0.0])
        rotation = multiply(multiply(around, now.rotation), upward)
        return tuple((rotation / np.linalg.norm(rotation)).tolist())
