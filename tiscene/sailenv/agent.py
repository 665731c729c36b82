# SPDX-License-Identifier: Apache-2.0
"""SAILenv's Agent in process: the same names, arguments, results and printed errors, without a server or a display.

Positions are in Unity's space, m; rotations are its Euler angles, degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.agent_objects import AgentObjects
from tiscene.sailenv.environment import Environment
from tiscene.sailenv.frame_views import VIEWS
from tiscene.sailenv.json_messages import rounded, single_precision
from tiscene.sailenv.pixel_queries import PixelAnswer
from tiscene.sailenv.scenario_classes import Vector3


class FrameFlags(IntFlag):
    """Bits of the views that an agent requests."""

    NONE = 0
    MAIN = 1
    CATEGORY = 4
    OBJECT = 8
    OPTICAL = 16
    DEPTH = 32


class Agent(AgentObjects):
    """A camera in a world, which it can edit. `register` adds it to the world. Attributes are those of AgentBase."""

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

    def _render(
        self, environment: Environment, camera: AgentCamera, views: Sequence[str]
    ) -> tuple[dict[str, NDArray[Any]], float]:
        """Render views of the next frame; agents of scripts that are recorded do more."""
        return environment.frame(camera, views)


def to_client_dtype(name: str, view: NDArray[Any]) -> NDArray[Any]:
    """Return a view as `Agent.get_frame` does: color, object and depth views as float32 in 0..1."""
    if name in ("main", "object", "depth"):
        return view.astype(np.float32) / np.float32(255.0)
    return view
