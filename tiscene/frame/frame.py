# SPDX-License-Identifier: Apache-2.0
"""Frame: one frame of a stream, with its buffers, camera, objects and events."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import BufferNotFound
from tiscene.frame.buffers import BUFFERS
from tiscene.frame.difficulty import Difficulty, ViewNovelty, difficulty_of
from tiscene.frame.events import Event
from tiscene.frame.frame_display import FrameDisplay
from tiscene.frame.object_table import ObjectTable
from tiscene.scene.camera import Camera, Quaternion, Vector3


@dataclass(frozen=True)
class FrameCamera:
    """The camera that took a frame.

    Attributes:
        camera: pose and lens, in USD's axes (x right, y up, -z forward).
        width: image width, px.
        height: image height, px.
    """

    camera: Camera
    width: int
    height: int

    @property
    def position(self) -> Vector3:
        """Position in the world, m."""
        return self.camera.position

    @property
    def rotation(self) -> Quaternion:
        """Unit quaternion (w, x, y, z) from USD's camera axes to the world."""
        return self.camera.rotation

    @property
    def K(self) -> NDArray[np.float64]:
        """3x3 intrinsic matrix, px; the center of the top left pixel is (0, 0), as in OpenCV."""
        return self.K_at(0.0)

    def K_at(self, center: float) -> NDArray[np.float64]:
        """Return the 3x3 intrinsic matrix for another pixel convention.

        Args:
            center: both coordinates of the center of the top left pixel, px. With 0.5, whole numbers lie on the pixels'
                corners, as in the boxes of `frame.objects`.
        """
        K = self.camera.intrinsics(self.width, self.height)
        K[:2, 2] += center
        return K

    @property
    def world_from_camera(self) -> NDArray[np.float64]:
        """4x4 matrix from OpenCV's camera axes (x right, y down, z forward) to the world, m."""
        return self.camera.world_from_camera()

    @property
    def camera_from_world(self) -> NDArray[np.float64]:
        """4x4 matrix from the world to OpenCV's camera axes: the extrinsic matrix."""
        pose = self.world_from_camera
        inverse = np.eye(4)
        inverse[:3, :3] = pose[:3, :3].T
        inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
        return inverse


@dataclass(frozen=True, eq=False)
class Frame(FrameDisplay, Mapping[str, NDArray[Any]]):
    """One frame of a stream: a mapping from buffer names to arrays.

    `frame["depth"]` and `frame.depth` are the same array. The arrays belong to the frame: they may be written to.

    Attributes:
        index: frame number, from 0.
        time: s.
        camera: the camera that took it.
        buffers: numpy arrays [height, width, ...] by name.
        objects: one row for each live object; columns are computed when they are first read.
        categories: names of the ids in `semantic`.
        events: spawns, despawns, contacts, overlaps, and objects that entered or left the view, since the frame before.
        spp: samples per pixel of the color buffers (their mean, if adaptive); 0 without color.
        materials: prim paths of the ids in `material_coverage`.
        room: name of the room that the camera is in; "" for none.
    """

    index: int
    time: float
    camera: FrameCamera
    buffers: Mapping[str, NDArray[Any]]
    objects: ObjectTable = field(default_factory=ObjectTable)
    categories: Mapping[int, str] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    spp: float = 0.0
    materials: Mapping[int, str] = field(default_factory=dict)
    room: str = ""
    _other_views: tuple[Frame, ...] = ()
    _novelty: ViewNovelty | None = None

    # Frames are compared by identity: arrays have no single truth value.
    __eq__ = object.__eq__
    __hash__ = object.__hash__

    @property
    def views(self) -> dict[str, Frame]:
        """The frames of all of the stream's cameras at this moment, by camera name; this frame comes first."""
        return {each.camera.camera.name: each for each in (self, *self._other_views)}

    @property
    def difficulty(self) -> Difficulty:
        """Measures of how hard the frame is: visible instances, their size, motion, contrast and others.

        Computed at first access, from `objects`, a buffer of flow and `rgb`, as far as the frame has them.
        """
        # Not `functools.cached_property`: threads that render could wait for ever for its lock (`Measured`).
        known: Difficulty | None = vars(self).get("_difficulty")
        if known is None:
            pixels = self.camera.width * self.camera.height
            known = vars(self)["_difficulty"] = difficulty_of(self.buffers, self.objects, pixels, self._novelty)
        return known

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a buffer.

        Raises:
            BufferNotFound: a KeyError and an AttributeError that says how to ask for the buffer.
        """
        try:
            return self.buffers[name]
        except KeyError:
            pass
        if name in BUFFERS:
            wanted = (*self.buffers, name)
            hint = f"Ask for it: Stream(..., buffers={wanted!r})."
            raise BufferNotFound("buffer", name, (), f" in frame {self.index}", hint)
        raise BufferNotFound("buffer", name, BUFFERS)

    def __iter__(self) -> Iterator[str]:
        return iter(self.buffers)

    def __len__(self) -> int:
        return len(self.buffers)

    def __getattr__(self, name: str) -> NDArray[Any]:
        if name.startswith("__") or name in type(self).__dataclass_fields__:
            raise AttributeError(name)  # asked for by copy and pickle before the fields are set
        if hasattr(type(self), name):  # a property has raised an AttributeError: raise it again
            return object.__getattribute__(self, name)  # type: ignore[no-any-return]
        return self[name]

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.buffers})

    def __repr__(self) -> str:
        size = f"{self.camera.width}x{self.camera.height}"
        return f"<Frame {self.index} at {self.time:.3f} s, {size}: {', '.join(self.buffers)}>"
