# SPDX-License-Identifier: Apache-2.0
"""OverlapDetector: what an object is inside of when it appears or is moved by an edit."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dynamics.lru_cache import LRUCache
from dynamics.rotation import matrix_from_quaternion
from dynamics.surface_overlap import boxes_touch, shrunk, surfaces_cross, winding_number
from dynamics.weak_cache import weakly_cached
from tiscene.scenario.edits import EditLog
from tiscene.scenario.objects import Object
from tiscene.scene.affine_maps import inverted, transformed_boxes
from tiscene.scene.description import Instance, SceneDescription
from tiscene.world.trajectories import Collision, Trajectories

Array = NDArray[np.float64]

MARGIN = 0.005  # m: how deep an object may be in another one, such as the floor it stands on, without a report
MAX_SHRINK = 0.2  # the same as a fraction of the object's size
MAX_SOLID = 100_000  # triangles of a mesh that is tested for objects that lie wholly inside
MAX_BOXES = 1024  # kept, one per template and scale


class OverlapDetector:
    """Finds overlaps of colliding objects of a scenario with the stage and with each other.

    Two objects overlap if their surfaces cross, or if one of them lies inside the other's closed surface. A mesh of the
    stage that the camera lies inside of too is a room, not a solid.

    Args:
        log: the edit log, which may grow.
        stage: the stage.
        surface: returns an object's collision surface [m, 3, 3] in its own axes, m.
        instances: returns the stage's instances at a frame, then its colliders, and which are present.
        trajectories: poses of the objects.
        viewpoint: returns the position of the main camera at the start, m.
    """

    def __init__(
        self,
        log: EditLog,
        stage: SceneDescription,
        surface: Callable[[Object], Array],
        instances: Callable[[int], tuple[Sequence[Instance], Sequence[bool]]],
        trajectories: Trajectories,
        viewpoint: Callable[[], Sequence[float]],
    ) -> None:
        self._log = log
        self._stage = stage
        self._surface = surface
        self._instances = instances
        self._trajectories = trajectories
        self._viewpoint = viewpoint
        self._boxes: LRUCache[tuple[object, ...], Array] = LRUCache(MAX_BOXES)

    def find(self, frame: int) -> list[Collision]:
        """Return the overlaps of the objects that appear at a frame, or that an edit moves there.

        Returns:
            By ascending rows of the objects; for each first what it overlaps on the stage, then other objects.
        """
        rows = [row for row in self._log.around(frame) if self._collides(row, frame)]
        placed = [place for place, row in enumerate(rows) if self._is_placed(row, frame)]
        if not placed:
            return []
        poses = self._trajectories.poses(frame, rows)
        own = np.stack([self._own_box(row) for row in rows])
        boxes = _boxes_at(own, np.concatenate([matrix_from_quaternion(poses[:, 3:]), poses[:, :3, None]], axis=2))
        on_stage = self._instances_at(frame)
        found = []

        def surface_of(place: int) -> Array:
            return _at(self._surface(self._log.histories[rows[place]].spec), poses[place])

        for place in placed:
            surface = shrunk(surface_of(place), MARGIN, MAX_SHRINK)
            if len(surface):
                found += self._on_stage(rows[place], surface, *on_stage)
                for other in np.flatnonzero(boxes_touch(boxes[place], boxes)).tolist():
                    if other != place and _overlap(surface, surface_of(other)):
                        found.append(Collision(rows[place], "object", rows[other]))
        return found

    def _collides(self, row: int, frame: int) -> bool:
        history = self._log.histories[row]
        return history.spec.collide and history.alive(frame, as_of=frame)

    def _is_placed(self, row: int, frame: int) -> bool:
        """Return whether an object appears at a frame, or an edit moves it there."""
        history = self._log.histories[row]
        move = history.move(frame)
        is_moved = move is not None and move.frame == frame
        return is_moved or frame == 0 or not history.alive(frame - 1, as_of=frame - 1)

    def _own_box(self, row: int) -> Array:
        spec = self._log.histories[row].spec
        return self._boxes.get((spec.template, spec.scale), lambda: _box(self._surface(spec)))

    def _instances_at(self, frame: int) -> tuple[Sequence[Instance], Sequence[bool], Array]:
        """Return the stage's instances and colliders at a frame, which are present, and their boxes [n, 2, 3]."""
        instances, present = self._instances(frame)
        if not instances:
            return instances, present, np.empty((0, 2, 3))
        matrices = np.array([each.world_from_object[:3] for each in instances], np.float64)
        return instances, present, _boxes_at(_mesh_boxes(self._stage)[[each.mesh for each in instances]], matrices)

    def _on_stage(
        self, row: int, surface: Array, instances: Sequence[Instance], present: Sequence[bool], boxes: Array
    ) -> list[Collision]:
        """Return the overlaps of an object with the stage: objects by row, then colliders without an object."""
        near = boxes_touch(boxes, _box(surface))
        owners, hidden = set(), set()
        for number in np.flatnonzero(near).tolist():
            instance = instances[number]
            if not (instance.collides and present[number]) or instance.object in owners:
                continue
            if self._overlaps(surface, instance):
                if instance.object < 0:
                    hidden.add(number - len(self._stage.instances))
                else:
                    owners.add(instance.object)
        return [
            *(Collision(row, "stage", owner) for owner in sorted(owners)),
            *(Collision(row, "collider", number) for number in sorted(hidden)),
        ]

    def _overlaps(self, surface: Array, instance: Instance) -> bool:
        mesh, matrix = self._stage.meshes[instance.mesh], np.asarray(instance.world_from_object, np.float64)
        triangles = mesh.triangles
        if abs(inverted(matrix[:3])[1]) < 1e-18:
            return False
        corners = _mapped(mesh.positions[triangles[_near(mesh.positions, triangles, matrix, surface)]], matrix)
        if surfaces_cross(surface, corners):
            return True
        if len(corners) == len(triangles) and _is_inside(corners[0, 0], surface):
            return True
        if len(triangles) > MAX_SOLID:
            return False
        solid = _mapped(mesh.positions[triangles], matrix)
        return _is_inside(surface[0, 0], solid) and not _is_inside(np.array(self._viewpoint()), solid)


def _overlap(a: Array, b: Array) -> bool:
    """Return whether two closed or open surfaces overlap."""
    return surfaces_cross(a, b) or _is_inside(a[0, 0], b) or _is_inside(b[0, 0], a)


def _is_inside(point: Array, triangles: Array) -> bool:
    """Return whether a point [3] lies inside a closed surface."""
    return bool(boxes_touch(_box(triangles), np.stack([point, point]))) and winding_number(point, triangles) > 0.5


def _near(
    positions: NDArray[np.float32], triangles: NDArray[np.int32], matrix: Array, surface: Array
) -> NDArray[np.intp]:
    """Return the rows of a mesh's triangles whose boxes touch the box of a surface, in the mesh's own space."""
    inverse = np.linalg.inv(matrix)
    low, high = _box(surface)
    center = inverse[:3, :3] @ (0.5 * (low + high)) + inverse[:3, 3]
    half = np.abs(inverse[:3, :3]) @ (0.5 * (high - low)) + 1e-6 * (1.0 + np.abs(center))
    below, above = positions < center - half, positions > center + half
    beside = below[triangles].all(axis=1) | above[triangles].all(axis=1)
    return np.flatnonzero(~beside.any(axis=1))


def _mapped(corners: NDArray[np.floating], matrix: Array) -> Array:
    """Return transformed triangles [n, 3, 3]; those that a reflection turned inside out are turned back."""
    result: Array = corners.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    return result[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0.0 else result


def _at(surface: Array, pose: Array) -> Array:
    """Return a surface [n, 3, 3] at a pose [7]."""
    result: Array = surface @ matrix_from_quaternion(pose[3:]).T + pose[:3]
    return result


def _box(triangles: Array) -> Array:
    """Return lowest and highest corner [2, 3] of a surface; of no triangles NaN."""
    points = triangles.reshape(-1, 3)
    return np.stack([points.min(axis=0), points.max(axis=0)]) if len(points) else np.full((2, 3), np.nan)


@weakly_cached
def _mesh_boxes(stage: SceneDescription) -> Array:
    """Return lowest and highest corner [meshes, 2, 3] of a stage's meshes in their own space; NaN for an empty mesh."""
    boxes = np.full((len(stage.meshes), 2, 3), np.nan)
    for box, mesh in zip(boxes, stage.meshes, strict=True):
        if len(mesh.positions) and len(mesh.triangles):
            box[:] = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    return boxes


def _boxes_at(boxes: Array, matrices: Array) -> Array:
    """Return the boxes [n, 2, 3] around boxes [n, 2, 3] transformed by affine maps [n, 3, 4]."""
    found: Array = transformed_boxes(boxes[None], matrices[None])[0].reshape(-1, 2, 3)
    return found
