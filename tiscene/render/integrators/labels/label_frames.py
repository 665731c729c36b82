# SPDX-License-Identifier: Apache-2.0
"""LabelFrames: what label kernels read of a frame besides the scene, or of several frames that are rendered at once.

The images of several frames are stacked below each other, and the rows of their instances follow each other
(`DeviceScene.place_frames`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device.kept_uploads import KeptUploads
from tiscene.device.memory import upload
from tiscene.render.integrators.labels import label_kernels as kernels
from tiscene.render.view import View
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS, Placement


@dataclass(frozen=True, eq=False)
class LabelFrames:
    """Frames that are rendered at once.

    Attributes:
        views: Their views, of one image size.
        cameras: Device array, the rows of all views (`View.rows`).
        instance_motion: float32 [max(n, 1), 51], of all their instances, see the function; NumPy or device array.
        camera_motion: float32 [3 f, 13], see the function; NumPy or device array.
    """

    views: Sequence[View]
    cameras: Any
    instance_motion: Any
    camera_motion: Any

    @classmethod
    def of(
        cls, views: Sequence[View], placements: Sequence[Placement], uploads: KeptUploads | None = None
    ) -> LabelFrames:
        """Return the frames with these views and placements.

        Args:
            views: The views.
            placements: The placements.
            uploads: Takes the arrays to the device; None: kernels read NumPy arrays.
        """
        if len(views) == 1:
            parts = instance_motion(placements[0], views[0]), camera_motion(views[0])
        else:
            motion = [instance_motion(*pair)[: len(pair[0].mesh)] for pair in zip(placements, views, strict=True)]
            empty = np.zeros((0 if any(map(len, motion)) else 1, kernels.MOTION_COLUMNS), np.float32)
            parts = np.concatenate([*motion, empty]), np.concatenate([camera_motion(view) for view in views])
        if uploads is not None:
            moved, turned, cameras = uploads.upload([*parts, np.concatenate([view.rows() for view in views])])
            return cls(views, cameras, moved, turned)
        cameras = views[0].array() if len(views) == 1 else upload(np.concatenate([view.rows() for view in views]))
        return cls(views, cameras, *parts)

    @property
    def width(self) -> int:
        """Width of a frame, px."""
        return self.views[0].width

    @property
    def height(self) -> int:
        """Height of a frame, px."""
        return self.views[0].height

    @property
    def stacked(self) -> bool:
        """Whether there are several frames."""
        return len(self.views) > 1

    @property
    def pixels(self) -> int:
        """Pixels of a frame, if there are several; 0 for one frame."""
        return self.width * self.height if self.stacked else 0


def instance_motion(placement: Placement, view: View) -> NDArray[np.float32]:
    """Return the kernels' description of each instance's motion, float32 [max(n, 1), 51].

    Columns: 0-35 mesh to camera coordinates (x right, y down, z forward, where the z axis passes through the image's
    center: see `Camera.image_from_camera`) at k-1, k, k+1, each 3x4; 36-47 world
    displacement from k to k+1, 3x4; 48-50 whether the instance is present at k-1, k, k+1.
    """
    world = placement.world_from_object
    count = world.shape[1]
    motion = np.zeros((max(count, 1), kernels.MOTION_COLUMNS), np.float32)
    for time, camera in enumerate(view.cameras):
        pose = camera.world_from_camera()
        relative = world[time].copy()
        relative[:, :, 3] -= pose[:3, 3]
        placed = _product(pose[:3, :3].T, relative)
        if any(camera.aperture_offset):
            image_from_camera = camera.image_from_camera()
            placed = _product(image_from_camera[:3, :3], placed)
            placed[:, :, 3] += image_from_camera[:3, 3]
        motion[:count, 12 * time : 12 * time + 12] = placed.reshape(count, 12)
    motion[:count, kernels.DISPLACEMENT : kernels.PRESENT] = (world[NEXT] - world[CURRENT]).reshape(count, 12)
    motion[:count, kernels.PRESENT :] = placement.present.T
    return motion


def camera_motion(view: View) -> NDArray[np.float32]:
    """Return the kernels' description of the camera's motion, float32 [3, 13], one row per time.

    Columns: 0-8 rotation from the current camera's coordinates to that camera's, 3x3; 9 focal length, px; 10 whether it
    is orthographic; 11-12 shear, x and y per z, from these coordinates to those of the optical axis. The coordinates
    are those of `instance_motion`.
    """
    rotations = view.camera_from_world()[:, :, :3]
    motion = np.zeros((3, 13), np.float32)
    now = rotations[CURRENT].T
    if any(view.current.aperture_offset):
        now = np.linalg.inv(rotations[CURRENT])
    for time in (PREVIOUS, CURRENT, NEXT):
        motion[time, :9] = _product(rotations[time], now).ravel()
        motion[time, kernels.SHEAR : kernels.SHEAR + 2] = -view.cameras[time].image_from_camera()[:2, 2]
    motion[:, kernels.FOCAL_LENGTH] = view.focal_lengths()
    motion[:, kernels.ORTHOGRAPHIC] = [camera.orthographic_height is not None for camera in view.cameras]
    return motion


def _product(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix product [..., 3, 3] x [..., 3, m] with a fixed order of summation.

    Equal poses give equal bytes on every machine and in every row of an array, unlike with BLAS or SIMD sums.
    """
    columns = [a[..., :, axis, None] * b[..., axis, None, :] for axis in range(3)]
    return columns[0] + columns[1] + columns[2]
