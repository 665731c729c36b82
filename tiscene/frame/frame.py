# SPDX-License-Identifier: Apache-2.0
"""What a stream hands out: one frame's buffers, its camera and its objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import BufferNotFound
from tiscene.frame.buffers import BUFFERS
from tiscene.frame.events import Event
from tiscene.frame.object_table import ObjectTable
from tiscene.scene.camera import Camera, Quaternion, Vector3


@dataclass(frozen=True)
class FrameCamera:
    """The camera that took a frame.

    camera: pose and lens, in USD's axes (x right, y up, -z forward). width, height: px.
    """

    camera: Camera
    width: int
    height: int

    @property
    def position(self) -> Vector3:
        """m, world."""
        return self.camera.position

    @property
    def rotation(self) -> Quaternion:
        """Unit quaternion (w, x, y, z) from USD's camera axes to the world."""
        return self.camera.rotation

    @property
    def K(self) -> NDArray[np.float64]:
        """The 3x3 intrinsic matrix, px; the center of the top left pixel is (0, 0), as in OpenCV."""
        return self.K_at(0.0)

    def K_at(self, center: float) -> NDArray[np.float64]:
        """The 3x3 intrinsic matrix where the center of the top left pixel has the coordinates (center, center).

        0.5 puts whole numbers on the pixels' corners, which is how boxes are given.
        """
        K = self.camera.intrinsics(self.width, self.height)
        K[:2, 2] += center
        return K

    @property
    def world_from_camera(self) -> NDArray[np.float64]:
        """4x4 from camera coordinates (x right, y down, z forward; OpenCV's) to the world, m."""
        return self.camera.world_from_camera()

    @property
    def camera_from_world(self) -> NDArray[np.float64]:
        """4x4 from the world to camera coordinates: what OpenCV calls the extrinsic matrix."""
        pose = self.world_from_camera
        inverse = np.eye(4)
        inverse[:3, :3] = pose[:3, :3].T
        inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
        return inverse


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of a stream.

    index: its number, from 0. time: s. camera: what took it. buffers: numpy arrays by name, [height, width, ...]; also
    attributes, so that `frame.rgb` is `frame.buffers["rgb"]`. Nobody else holds the arrays: they may be written to.
    objects: one row for each live object, computed when first looked at. categories: what the ids of `semantic` mean.
    materials: what those of `material_coverage` mean: prim paths.
    events: what was spawned, was despawned, met something, came into view or left it since the frame before.
    spp: paths per pixel that color was made of, in the mean; 0 where the frame has no color.
    others: the same moment as the stream's other cameras see it; `views` has all by name.
    """

    index: int
    time: float
    camera: FrameCamera
    buffers: Mapping[str, NDArray[Any]]
    objects: ObjectTable = field(default_factory=ObjectTable)
    categories: Mapping[int, str] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    spp: float = 0.0
    others: tuple[Frame, ...] = ()
    materials: Mapping[int, str] = field(default_factory=dict)

    @property
    def views(self) -> dict[str, Frame]:
        """What each of the stream's cameras sees at this moment, by the camera's name; this frame comes first."""
        return {each.camera.camera.name: each for each in (self, *self.others)}

    def __getattr__(self, name: str) -> NDArray[Any]:
        """The buffer of that name. Raises BufferNotFound (an AttributeError) with what to do about it."""
        if name.startswith("__") or name in type(self).__dataclass_fields__:
            raise AttributeError(name)  # asked for by copy and pickle before the fields are set
        try:
            return self.buffers[name]
        except KeyError:
            pass
        if name in BUFFERS:
            wanted = (*self.buffers, name)
            raise BufferNotFound(
                "buffer", name, (), f" in frame {self.index}", f"Ask for it: Stream(..., buffers={wanted!r})."
            )
        raise BufferNotFound("buffer", name, BUFFERS)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.buffers})

    def __repr__(self) -> str:
        size = f"{self.camera.width}x{self.camera.height}"
        return f"<Frame {self.index} at {self.time:.3f} s, {size}: {', '.join(self.buffers)}>"
