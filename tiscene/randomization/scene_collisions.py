# SPDX-License-Identifier: Apache-2.0
"""SceneCollisions: exact tests of whether an object of a scene, or a new one, penetrates the rest of it.

Two triangle meshes intersect where an edge of one crosses a triangle of the other. Edges are traced as rays. Objects
are tested a little above their support, so that resting on it is no intersection.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device import runtime
from tiscene.randomization.static_rays import segment_rays, static_placement
from tiscene.render.intersect.ray_queue import RayWave
from tiscene.render.intersect.trace import closest
from tiscene.scene.description import Instance, Mesh, SceneDescription
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, NEXT

Array = NDArray[np.float64]
LIFT = 0.004  # m above its support at which an object is tested
CONTACT = 0.012  # m: a support is that close below an object
LOWEST = 0.006  # m above its lowest point, where an object touches its support
MAX_CONTACTS = 256
_EVERYTHING = -1


class SceneCollisions:
    """Tests objects against the rest of a static scene. Starts Taichi.

    Args:
        stage: the scene.

    Attributes:
        up: unit vector of the up axis.
    """

    def __init__(self, stage: SceneDescription) -> None:
        runtime.start()
        self._stage = stage
        self._instances: list[Instance] = list(stage.instances) + [replace(each) for each in stage.colliders]
        self._scene = DeviceScene()
        if self._instances:
            self._scene.add(replace(stage, lights=()))
        self._rays = RayWave()
        self._edges = [unique_edges(mesh) for mesh in stage.meshes]
        self._selected: int | None = None
        self.up: Array = np.asarray(stage.up, np.float64)
        self._owner = np.array([each.object for each in self._instances], np.int64)
        self._parts = [self._world_edges(row) for row in range(len(self._instances))]
        self._boxes = [box_of(part) for part in self._parts]

    def select(self, number: int = _EVERYTHING) -> None:
        """Choose the object to be tested; nothing: what is tested is not of the scene.

        Args:
            number: row of the object in the stage.
        """
        if self._selected == number or not self._instances:
            return
        own = self._owner == number
        placement = static_placement(self._instances, np.stack([np.ones_like(own), ~own, own]))
        self._selected = None  # until an interruption can no longer come between
        self._scene.place(placement, (CURRENT, NEXT) if own.any() else (CURRENT,))
        self._selected = number

    def edges_of(self, number: int) -> Array:
        """Return the edges of an object of the scene, float64 [n, 2, 3], m."""
        return np.concatenate(
            [np.zeros((0, 2, 3)), *(self._parts[row] for row in np.flatnonzero(self._owner == number))]
        )

    def move(self, number: int, by: Array) -> None:
        """Move an object of the scene by a rigid 4x4 matrix, for all later tests."""
        for row, each in enumerate(self._instances):
            if each.object == number:
                matrix = np.einsum("ij,jk->ik", by, each.world_from_object)
                self._instances[row] = replace(each, world_from_object=matrix)
                self._parts[row] = self._world_edges(row)
                self._boxes[row] = box_of(self._parts[row])
        self._selected = None

    def penetrates(self, edges: Array, by: Array | None = None) -> bool:
        """Return whether an object intersects the rest of the scene, or surrounds something of it.

        Args:
            edges: its edges where it would stand, float64 [n, 2, 3].
            by: 4x4 matrix by which it is moved there, for the selected object; None: a new object, whose bounding box
                must not hold any vertex of the scene.
        """
        lifted = edges + LIFT * self.up
        if self._hits(lifted, CURRENT).any():
            return True
        low, high = box_of(lifted)
        near = self._rest_near(low, high)
        if by is None:
            return bool(((near > low) & (near < high)).all(axis=2).any())
        back = np.linalg.inv(by)
        return bool(self._hits(transformed(near - (LIFT * self.up), np.asarray(back, np.float64)), NEXT).any())

    def carries(self, others: Array) -> bool:
        """Return whether another object of the scene, or one of `others`, rests on the selected one.

        Args:
            others: edges of objects that are not of the scene, float64 [n, 2, 3].
        """
        low, high = box_of(self.edges_of(_EVERYTHING if self._selected is None else self._selected))
        near = np.concatenate([self._rest_near(low, high + CONTACT), others])
        return bool(self._hits(near - CONTACT * self.up, NEXT).any())

    def support(self, edges: Array) -> float:
        """Return the fraction of an object's lowest points that the scene supports, 0..1."""
        points = edges.reshape(-1, 3)
        height = points @ self.up
        lowest = np.unique(points[height < height.min() + LOWEST], axis=0)
        lowest = lowest[:: max(1, len(lowest) // MAX_CONTACTS)]
        starts = lowest + LIFT * self.up
        return float(self._hits(np.stack([starts, starts - (LIFT + CONTACT) * self.up], axis=1), CURRENT).mean())

    def drop(self, points: Array, reach: float) -> Array:
        """Return how far below each of the points [n, 3] a surface is, m; inf where none is within reach."""
        segments = np.stack([points, points - reach * self.up], axis=1)
        return np.where(self._hits(segments, CURRENT), self._distances(len(points)), np.inf)

    def _rest_near(self, low: Array, high: Array) -> Array:
        """Return the edges [n, 2, 3] of all but the selected object whose own box overlaps a box."""
        found = [np.zeros((0, 2, 3))]
        for row, (least, most) in enumerate(self._boxes):
            if self._owner[row] != self._selected and (most > low).all() and (least < high).all():
                part = self._parts[row]
                overlaps = (np.maximum(part[:, 0], part[:, 1]) > low).all(axis=1)
                overlaps &= (np.minimum(part[:, 0], part[:, 1]) < high).all(axis=1)
                found.append(part[overlaps])
        return np.concatenate(found)

    def _hits(self, segments: Array, time: int) -> NDArray[np.bool_]:
        """Return which of the segments [n, 2, 3] cross a surface."""
        count = len(segments)
        if not count or not self._instances:
            return np.zeros(count, np.bool_)
        wave = segment_rays(self._rays, segments[:, 0], segments[:, 1])
        closest(self._scene, time, wave.rays, wave.queue, count, wave.hits, wave.hit_ids)
        result: NDArray[np.bool_] = wave.hit_ids.to_numpy()[:count, 0] >= 0
        return result

    def _distances(self, count: int) -> Array:
        """Return the distances of the last hits."""
        if not self._instances:
            return np.full(count, np.inf)
        distances: Array = self._rays.reserved(count).hits.to_numpy()[:count, 0].astype(np.float64)
        return distances

    def _world_edges(self, row: int) -> Array:
        each = self._instances[row]
        edges: Array = self._stage.meshes[each.mesh].positions[self._edges[each.mesh]].astype(np.float64)
        return transformed(edges, each.world_from_object)


def unique_edges(mesh: Mesh) -> NDArray[np.int64]:
    """Return the edges of a mesh as rows of its vertices [n, 2], each once."""
    triangles = mesh.triangles.astype(np.int64)
    pairs = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    keys = np.unique(pairs[:, 0] << 32 | pairs[:, 1])
    return np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=1)


def template_edges(template: SceneDescription) -> Array:
    """Return the edges of a template in its own axes, float64 [n, 2, 3], m."""
    meshes = (template.meshes[each.mesh] for each in template.instances)
    edges = (mesh.positions[unique_edges(mesh)].astype(np.float64) for mesh in meshes)
    return np.concatenate(
        [transformed(part, each.world_from_object) for part, each in zip(edges, template.instances, strict=True)]
    )


def box_of(edges: Array) -> tuple[Array, Array]:
    """Return the lowest and the highest corner of edges [n, 2, 3]; an empty box for none."""
    points = edges.reshape(-1, 3)
    return points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)


def transformed(points: NDArray[np.floating[Any]], matrix: Array) -> Array:
    """Return points [..., 3] transformed by a 4x4 matrix."""
    result: Array = points @ np.asarray(matrix)[:3, :3].T + np.asarray(matrix)[:3, 3]
    return result


def about(center: Array, up: Array, angle: float, shift: Array) -> Array:
    """Return the 4x4 matrix of a turn about a vertical axis through a point, in radians, then a shift."""
    cosine, sine = np.cos(angle), np.sin(angle)
    cross = np.array([[0.0, -up[2], up[1]], [up[2], 0.0, -up[0]], [-up[1], up[0], 0.0]])
    result = np.eye(4)
    result[:3, :3] = cosine * np.eye(3) + sine * cross + (1.0 - cosine) * np.outer(up, up)
    result[:3, 3] = center - result[:3, :3] @ center + shift
    return result


def horizontal(up: Array, angle: float) -> Array:
    """Return the unit vector of a horizontal direction at an angle, in radians."""
    first = np.eye(3)[0] - up[0] * up
    second = np.cross(up, first)
    result: Array = np.cos(angle) * first + np.sin(angle) * second
    return result
