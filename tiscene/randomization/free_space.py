# SPDX-License-Identifier: Apache-2.0
"""FreeSpace: find room for objects in a camera's view of a static scene.

A depth image gives the free length of each line of sight: a ball nearer than everything visible around it is free.
Elsewhere, behind objects or out of view, a ball must not intersect the bounding box of any mesh.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tiscene.device import runtime
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.view import View
from tiscene.scene.assembly import bounding_box
from tiscene.scene.camera import Camera
from tiscene.scene.description import SceneDescription
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, Placement

Array = NDArray[np.float64]
ROWS = 96  # of the depth image


class FreeSpace:
    """Free space of a static scene before a static camera. Starts Taichi.

    Args:
        stage: the scene.
        camera: the camera.
        aspect: width / height of its image.
    """

    def __init__(self, stage: SceneDescription, camera: Camera, aspect: float) -> None:
        self.camera = camera
        self.aspect = aspect
        self._depth = _depth_image(stage, camera, max(1, round(ROWS * aspect)), ROWS)
        self.bounds = stage.bounds()
        # Invisible colliders are obstacles too.
        self._reach = self._depth
        if stage.colliders:
            solid = replace(stage, instances=(*stage.instances, *stage.colliders))
            self._reach = _depth_image(solid, camera, max(1, round(ROWS * aspect)), ROWS)
        boxes = _mesh_boxes(stage)
        # A mesh around the camera, such as a room modeled in one piece, is hollow.
        around = np.all((boxes[:, 0] < camera.position) & (camera.position < boxes[:, 1]), axis=1)
        self._boxes = boxes[~around]

    @property
    def empty(self) -> bool:
        """Whether the scene has no geometry."""
        return not np.any(self.bounds[1] > self.bounds[0])

    def points(self, x: Array, y: Array, depth: Array) -> Array:
        """Return world points [n, 3] at image coordinates (0..1 from the left and from the top) and depths (m)."""
        half = self._half_height(depth)
        local = [(2.0 * x - 1.0) * self.aspect * half, (1.0 - 2.0 * y) * half, -depth]
        places: Array = np.stack(local, axis=1) @ self.camera.axes().T + self.camera.position
        return places

    def project(self, points: Array) -> tuple[Array, Array, Array]:
        """Return image coordinates x and y (0..1 from the left and from the top) and depths (m) of points [n, 3]."""
        local = (points - self.camera.position) @ self.camera.axes()
        depth = -local[:, 2]
        half = self._half_height(np.where(depth > 1e-9, depth, np.nan))
        x = 0.5 + 0.5 * local[:, 0] / (half * self.aspect)
        y = 0.5 - 0.5 * local[:, 1] / half
        return x, y, depth

    def _half_height(self, depth: Array) -> Array:
        """Return half the height of the view at some depths (m)."""
        half = self.camera.half_height(1.0)
        return half * (depth if self.camera.orthographic_height is None else np.where(np.isnan(depth), np.nan, 1.0))

    def in_view(self, points: Array) -> NDArray[np.bool_]:
        """Return which of the points [n, 3] lie in the view."""
        x, y, depth = self.project(points)
        return (depth > self.camera.near) & (x >= 0.0) & (x <= 1.0) & (y >= 0.0) & (y <= 1.0)

    def hidden(self, points: Array) -> NDArray[np.bool_]:
        """Return which of the points [n, 3] lie in the view, but are occluded by the scene."""
        x, y, depth = self.project(points)
        seen = self.in_view(points)
        column, row = self._pixels(np.where(seen, x, 0.0), np.where(seen, y, 0.0))
        result: NDArray[np.bool_] = seen & (self._depth[row, column] < depth)
        return result

    def is_free(self, points: Array, radius: float) -> NDArray[np.bool_]:
        """Return at which of the points [n, 3] a ball is free."""
        return self._in_front(points, radius) | self.is_clear(points, radius)

    def _in_front(self, points: Array, radius: float) -> NDArray[np.bool_]:
        """Return whether everything visible around each ball lies behind it; False beyond the image."""
        x, y, depth = self.project(points)
        result = np.zeros(len(points), np.bool_)
        for row in np.flatnonzero(depth > radius + self.camera.near):
            reach = radius / (2.0 * self.camera.half_height(float(depth[row]) - radius))  # of the image's height
            left, right = x[row] - reach / self.aspect, x[row] + reach / self.aspect
            top, bottom = y[row] - reach, y[row] + reach
            if left >= 0.0 and right <= 1.0 and top >= 0.0 and bottom <= 1.0:
                (a, b), (c, d) = self._pixels(np.array([left, right]), np.array([top, bottom]))
                result[row] = self._reach[c : d + 1, a : b + 1].min() > depth[row] + radius
        return result

    def is_clear(self, points: Array, radius: float) -> NDArray[np.bool_]:
        """Return at which of the points [n, 3] a ball lies within the scene's bounds and intersects no mesh's box."""
        if self.empty:
            return np.ones(len(points), np.bool_)
        inside = np.all((points > self.bounds[0] + radius) & (points < self.bounds[1] - radius), axis=1)
        nearest = np.clip(points[:, None], self._boxes[None, :, 0], self._boxes[None, :, 1])
        distance = np.linalg.norm(points[:, None] - nearest, axis=2)
        result: NDArray[np.bool_] = inside & np.all(distance > radius, axis=1)
        return result

    def _pixels(self, x: Array, y: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        height, width = self._depth.shape
        column = np.clip((x * width).astype(np.intp), 0, width - 1)
        return column, np.clip((y * height).astype(np.intp), 0, height - 1)


def _depth_image(stage: SceneDescription, camera: Camera, width: int, height: int) -> NDArray[np.float32]:
    """Return the depth image of the scene, +inf where nothing is hit."""
    count = len(stage.instances)
    if not count:
        return np.full((height, width), np.inf, np.float32)
    runtime.start()
    scene = DeviceScene()
    scene.add(stage)
    world = np.array([each.world_from_object[:3] for each in stage.instances])
    placement = Placement(
        mesh=np.array([each.mesh for each in stage.instances], np.int32),
        instance_id=np.array([each.object + 1 for each in stage.instances], np.int32),
        category_id=np.zeros(count, np.int32),
        world_from_object=np.broadcast_to(world, (3, count, 3, 4)).copy(),
        box_from_object=np.broadcast_to(np.eye(4)[:3], (count, 3, 4)).copy(),
        present=np.ones((3, count), np.bool_),
    )
    scene.place(placement, (CURRENT,))
    depth: NDArray[np.float32] = LabelPass(scene).render(View(camera, camera, camera, width, height), ("depth",))[
        "depth"
    ]
    return depth


def _mesh_boxes(stage: SceneDescription) -> Array:
    """Return the lowest and highest corner of every placed mesh: float64 [n, 2, 3]."""
    placed = (*stage.instances, *stage.colliders)
    boxes = [bounding_box(stage, [each.mesh], [each.world_from_object]) for each in placed]
    return np.array(boxes).reshape(-1, 2, 3)
