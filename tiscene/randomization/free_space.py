# SPDX-License-Identifier: Apache-2.0
"""FreeSpace: where objects fit in a static scene, and what a static camera sees there.

Three exact queries against the scene's triangles answer this:

- the distance from a point to the nearest surface, which is the radius of the largest free ball about it;
- the line of sight from the camera to a point, by the rule of the label buffers: alpha-rejected surfaces hide nothing;
- whether a point is reachable from the camera without crossing a surface, so that the inside of furniture, walls and
  rooms next door is not free space. Points that the camera cannot see are connected to it over landmarks: random points
  that see each other.

Invisible colliders bound free space and hide nothing.
"""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynamics.contact import MAX_TOUCHES, TOUCH_COLUMNS
from dynamics.obstacles import Obstacles
from dynamics.sweep_obstacles import obstacle_distances
from tiscene.device import runtime
from tiscene.randomization.static_rays import segment_rays, static_placement
from tiscene.render.integrators.labels.first_hits import first_hits
from tiscene.render.intersect.ray_queue import RayWave
from tiscene.render.intersect.trace import closest
from tiscene.scene.bvh.obstacle_tree import ObstacleTree
from tiscene.scene.camera import Camera
from tiscene.scene.description import SceneDescription
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, NEXT

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LANDMARKS = 384
NEIGHBORS = 24  # landmarks from which a point is looked for
_RAY_END = 1.0 - 1e-5  # part of a segment that is tested, so that a point on a surface is not hidden by it


class FreeSpace:
    """Free space of a static scene before a static camera. Starts Taichi.

    Args:
        stage: the scene.
        camera: the camera.
        aspect: width / height of its image.

    Attributes:
        bounds: float64 [2, 3], lowest and highest corner of the scene, m; zeros for an empty scene.
    """

    def __init__(self, stage: SceneDescription, camera: Camera, aspect: float) -> None:
        runtime.start()
        self.camera = camera.framed(aspect)
        self.aspect = aspect
        self.bounds = stage.bounds()
        self._scene, self._obstacles = _on_device(stage)
        self._rays = RayWave()
        self._landmarks = self._reachable_landmarks()

    def seen_by(self, camera: Camera, aspect: float) -> FreeSpace:
        """Return the free space of the same scene before another camera."""
        if camera.framed(aspect) == self.camera and aspect == self.aspect:
            return self
        other = copy.copy(self)
        other.camera, other.aspect = camera.framed(aspect), aspect
        other._landmarks = other._reachable_landmarks()
        return other

    def points(self, x: Array, y: Array, depth: Array) -> Array:
        """Return world points [n, 3] at image coordinates (0..1 from the left and from the top) and depths (m)."""
        half = self._half_height(depth)
        center_x, center_y = self.camera.image_center(depth)
        local = [(2.0 * x - 1.0) * self.aspect * half + center_x, (1.0 - 2.0 * y) * half + center_y, -depth]
        places: Array = np.stack(local, axis=1) @ self.camera.axes().T + self.camera.position
        return places

    def project(self, points: Array) -> tuple[Array, Array, Array]:
        """Return image coordinates x and y (0..1 from the left and from the top) and depths (m) of points [n, 3]."""
        local = (points - self.camera.position) @ self.camera.axes()
        depth = -local[:, 2]
        half = self._half_height(np.where(depth > 1e-9, depth, np.nan))
        center_x, center_y = self.camera.image_center(depth)
        x = 0.5 + 0.5 * (local[:, 0] - center_x) / (half * self.aspect)
        y = 0.5 - 0.5 * (local[:, 1] - center_y) / half
        return x, y, depth

    def _half_height(self, depth: Array) -> Array:
        """Return half the height of the view at some depths (m)."""
        half = self.camera.half_height(1.0)
        return half * (depth if self.camera.orthographic_height is None else np.where(np.isnan(depth), np.nan, 1.0))

    def in_view(self, points: Array) -> Mask:
        """Return which of the points [n, 3] lie in the view."""
        x, y, depth = self.project(points)
        return (depth > self.camera.near) & (x >= 0.0) & (x <= 1.0) & (y >= 0.0) & (y <= 1.0)

    def hidden(self, points: Array) -> Mask:
        """Return which of the points [n, 3] lie in the view, but are occluded by the scene."""
        result = self.in_view(points)
        rows = np.flatnonzero(result)
        result[rows] = self._is_blocked(self._sight_origins(points[rows]), points[rows], CURRENT)
        return result

    def distances(self, points: Array, limit: float) -> Array:
        """Return how far points [n, 3] are from the nearest surface, collider or the near plane, m; at most `limit`."""
        columns = np.full((len(points), 4), limit, np.float32)
        columns[:, :3] = points
        if len(points):
            touches = np.zeros((MAX_TOUCHES, TOUCH_COLUMNS), np.float32)
            obstacle_distances(columns, limit, touches, *self._obstacles.arguments())
        from_camera = np.linalg.norm(points - self.camera.position, axis=1)
        depth = self.project(points)[2]
        from_near_plane = np.where(self.in_view(points), depth, from_camera) - self.camera.near
        return np.minimum(columns[:, 3].astype(np.float64), from_near_plane)

    def is_reachable(self, points: Array) -> Mask:
        """Return which of the points [n, 3] are connected to the camera by free space.

        Points that are not in direct sight must lie within the scene's bounds. Some reachable points in narrow corners
        are missed; no unreachable point is returned.
        """
        if not self._scene.instance_count:
            return np.ones(len(points), np.bool_)
        in_view = self.in_view(points)
        origins = np.where(in_view[:, None], self._sight_origins(points), self.camera.position)
        within = self.is_within_bounds(points)
        result: Mask = (in_view | within) & ~self._is_blocked(origins, points, NEXT)
        rows = np.flatnonzero(within & ~result)
        result[rows] = self._sees_any(points[rows], self._landmarks)
        return result

    def is_within_bounds(self, points: Array) -> Mask:
        """Return which of the points [n, 3] lie within the scene's bounds."""
        return np.array(((points > self.bounds[0]) & (points < self.bounds[1])).all(axis=1), np.bool_)

    def sees(self, points: Array) -> Mask:
        """Return which of the points [n, 3], in any direction, no surface or collider separates from the camera."""
        return ~self._is_blocked(np.broadcast_to(np.asarray(self.camera.position), points.shape), points, NEXT)

    def _reachable_landmarks(self) -> Array:
        """Return random points [n, 3] of the scene's bounds that are connected to the camera by free space."""
        numbers = np.random.Philox(key=np.zeros(2, np.uint64)).random_raw(3 * LANDMARKS) >> np.uint64(11)
        low, high = self.bounds
        points: Array = low + numbers.reshape(-1, 3) * 2.0**-53 * (high - low)
        is_reached = self.sees(points)
        found = True
        while found:
            rest = np.flatnonzero(~is_reached)
            rest = rest[self._sees_any(points[rest], points[is_reached])]
            is_reached[rest] = True
            found = len(rest) > 0
        reached: Array = points[is_reached]
        return reached

    def _sees_any(self, points: Array, others: Array) -> Mask:
        """Return which of the points [n, 3] are connected to one of the nearest `others` [m, 3] by a free segment."""
        if not len(points) or not len(others):
            return np.zeros(len(points), np.bool_)
        squares = ((points[:, None] - others[None]) ** 2).sum(axis=2)
        nearest = np.argpartition(squares, min(NEIGHBORS, len(others)) - 1, axis=1)[:, :NEIGHBORS]
        starts = others[nearest].reshape(-1, 3)
        blocked = self._is_blocked(starts, np.repeat(points, nearest.shape[1], axis=0), NEXT)
        return np.array(~blocked.reshape(nearest.shape).all(axis=1), np.bool_)

    def _sight_origins(self, points: Array) -> Array:
        """Return where the lines of sight to points [n, 3] in view begin, on the near plane."""
        forward = -self.camera.axes()[:, 2]
        depth = (points - self.camera.position) @ forward
        if self.camera.orthographic_height is not None:
            return points - np.outer(depth - self.camera.near, forward)
        part = self.camera.near / np.where(depth > 1e-9, depth, np.nan)
        origins: Array = self.camera.position + (points - self.camera.position) * part[:, None]
        return np.nan_to_num(origins)

    def _is_blocked(self, origins: Array, targets: Array, time: int) -> Mask:
        """Return which of the segments between points [n, 3] a surface blocks.

        Args:
            origins: float64 [n, 3].
            targets: float64 [n, 3].
            time: CURRENT: visible surfaces that are not alpha-rejected. NEXT: all surfaces and colliders.
        """
        count = len(origins)
        if not count or not self._scene.instance_count:
            return np.zeros(count, np.bool_)
        wave = segment_rays(self._rays, origins, targets, _RAY_END)
        if time == CURRENT:
            first_hits(self._scene, time, wave, wave.queue, count)
        else:
            closest(self._scene, time, wave.rays, wave.queue, count, wave.hits, wave.hit_ids)
        result: Mask = wave.hit_ids.to_numpy()[:count, 0] >= 0
        return result


def _on_device(stage: SceneDescription) -> tuple[DeviceScene, Obstacles]:
    """Return a scene for rays, at CURRENT without the colliders and at NEXT with them, and the same as obstacles.

    Meshes that the stage exempts from collisions are obstacles too.
    """
    scene = DeviceScene()
    placed = [replace(each, collides=True) for each in (*stage.instances, *stage.colliders)]
    if not placed:
        return scene, Obstacles.empty()
    scene.add(replace(stage, lights=()))
    # Before the instances are placed, because more nodes unplace them.
    trees = scene.trees
    tree = ObstacleTree(trees, placed)
    obstacles = Obstacles.from_trees(trees.bvh, trees.is_bvh8, tree.roots, tree.matrices, tree.root)
    present = np.ones((3, len(placed)), np.bool_)
    present[CURRENT, len(stage.instances) :] = False
    scene.place(static_placement(placed, present), (CURRENT, NEXT))
    return scene, obstacles
