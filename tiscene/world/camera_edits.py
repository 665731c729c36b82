# SPDX-License-Identifier: Apache-2.0
"""CameraEdits: the edits of a world that place its cameras, for active vision."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager

from dynamics import argument_checks
from tiscene.errors import scenario_errors
from tiscene.scenario.edits import Edit
from tiscene.scene.camera import Camera
from tiscene.scene.description import SceneDescription
from tiscene.scene.walking import Axes
from tiscene.world.edit_lock import one_at_a_time
from tiscene.world.world_parts import WorldParts


class CameraEdits(ABC):
    """Base class of a world with cameras that can be placed.

    Attributes:
        stage: the stage.
        next_frame: the frame at which edits take effect.
        edit_lock: held during an edit.
    """

    stage: SceneDescription
    next_frame: int
    edit_lock: AbstractContextManager[object]

    @property
    @abstractmethod
    def _parts(self) -> WorldParts:
        """What depends on the edits."""

    @abstractmethod
    def _edit(self, edit: Edit) -> None:
        """Add an edit to the log."""

    def camera_at(self, frame: int, camera: str | None = None) -> Camera:
        """Return a camera at a frame, with the edits up to it.

        Args:
            frame: 0 or more.
            camera: its name or prim path; None: the main camera.

        Raises:
            CameraNotFound: there is no such camera.
            ArgumentError: for a negative frame.
        """
        frame = argument_checks.integer(frame, "frame", 0)
        return self._parts.cameras.at(frame, self._parts.cameras.row(camera), frame)

    def camera_is_dynamic(self, frame: int, row: int) -> bool:
        """Return whether a camera, given by its row, moves at any time, as known at a frame; see `View.is_dynamic`."""
        return self._parts.cameras.is_dynamic(frame, row)

    def camera_zooms(self, row: int) -> bool:
        """Return whether the field of view of a camera, given by its row, changes at any time; see `View.zooms`."""
        lens = self._parts.cameras.cameras[row].lens
        return lens is not None and lens.zooms

    def camera_walks(self, frame: int, row: int) -> Axes:
        """Return along which axes a camera, given by its row, walks, as known at a frame; see `View.walks`."""
        return self._parts.cameras.walks(frame, row)

    @one_at_a_time
    def move_camera(
        self,
        position: Sequence[float],
        rotation: Sequence[float] | None = None,
        *,
        relative: bool = False,
        camera: str | None = None,
    ) -> None:
        """Move a camera at the next frame. It leaves its trajectory, if it has one, and stays.

        The walls of the scenario's frustum stay as planned; `set_frustum_walls` places them anew. Objects do not hold
        the camera back.

        Args:
            position: m, in the world.
            rotation: Euler angles (x, y, z), degrees, or a quaternion (w, x, y, z); None: unchanged.
            relative: `position` is an offset along the camera's own axes: x right, y up, -z forward.
            camera: its name or prim path; None: the main camera.

        Raises:
            CameraNotFound: there is no such camera.
            ScenarioError: the pose is invalid.
        """
        frame, cameras = self.next_frame, self._parts.cameras
        with scenario_errors():
            place = argument_checks.vector(position, "position")
            rotation = None if rotation is None else argument_checks.rotation(rotation, "rotation")
            argument_checks.flag(relative, "relative")
        place = cameras.offset(frame, camera, place) if relative else place
        self._edit(cameras.moved(frame, camera, place, rotation))

    @one_at_a_time
    def turn_camera(self, yaw: float = 0.0, pitch: float = 0.0, *, camera: str | None = None) -> None:
        """Turn a camera at the next frame, from where it looks then. It leaves its trajectory, if it has one.

        Args:
            yaw: turn about the vertical, degrees; positive: to the left.
            pitch: turn about the camera's own x axis, degrees; positive: up.
            camera: its name or prim path; None: the main camera.

        Raises:
            CameraNotFound: there is no such camera.
            ScenarioError: an angle is not a number.
        """
        with scenario_errors():
            yaw, pitch = argument_checks.number(yaw, "yaw"), argument_checks.number(pitch, "pitch")
        rotation = self._parts.cameras.turned(self.next_frame, camera, yaw, pitch, self.stage.up)
        self._edit(self._parts.cameras.moved(self.next_frame, camera, None, rotation))
