# SPDX-License-Identifier: Apache-2.0
"""Rays against the scene. All passes trace through these functions, over arrays of rays.

rays: [n] of 8, origin x, y, z, unused, direction x, y, z, t_max; what lies in (0, t_max) is hit. `queue[0 .. count)`
(i32) are the rays to trace. time: PREVIOUS, CURRENT or NEXT of tiscene.scene.placement, for which the scene was placed,
or MOVERS.
Two surfaces at the same distance: the lower (instance row, triangle) wins, however the hierarchy is built.
"""

from __future__ import annotations

from typing import Any

from tiscene.device.vector_mode import vector_mode
from tiscene.render.intersect import bvh2, bvh8, bvh8_any_hit, bvh8_packets
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, MOVERS

__all__ = ["closest", "occluded", "occluded_by_instance"]


def closest(
    scene: DeviceScene, time: int, rays: Any, queue: Any, count: int, hits: Any, hit_ids: Any, together: bool = False
) -> None:
    """Find the first hit of each ray.

    hits: [n] of 4, distance in units of the direction's length (+inf for none), barycentrics b1 and b2 of vertices 1
    and 2, 0. hit_ids: [n] of 2, instance row and global triangle, -1 for none.
    together: the same, faster where sixteen in a row of the queue mostly go from one point through one pixel.
    Raises ArgumentError if the scene is not placed at `time`.
    """
    arrays = _arrays(scene, time)
    if scene.traversal == "bvh8":
        with vector_mode():
            traversal = bvh8_packets if together else bvh8
            traversal.closest(*arrays, rays, queue, count, hits, hit_ids)
    else:
        bvh2.closest(*arrays, rays, queue, count, hits, hit_ids)


def occluded(scene: DeviceScene, time: int, rays: Any, queue: Any, count: int, result: Any) -> None:
    """Set result[ray] (i32 [n]) to 1 where something lies in (0, t_max), else to 0."""
    _occluded(scene, time, rays, queue, count, queue, 0, result)


def occluded_by_instance(
    scene: DeviceScene, time: int, rays: Any, queue: Any, instance_rows: Any, count: int, result: Any
) -> None:
    """The same against one instance only, whatever else is in the way: row instance_rows[ray] (i32 [n]).

    It also finds an instance that is not present at `time`: the caller chooses the rows.
    """
    _occluded(scene, time, rays, queue, count, instance_rows, 1, result)


def _occluded(
    scene: DeviceScene, time: int, rays: Any, queue: Any, count: int, targets: Any, targeted: int, result: Any
) -> None:
    arrays = _arrays(scene, time)
    if scene.traversal == "bvh8":
        with vector_mode():
            bvh8_any_hit.occluded(*arrays, rays, queue, count, targets, targeted, result)
    else:
        bvh2.occluded(*arrays, rays, queue, count, targets, targeted, result)


def _arrays(scene: DeviceScene, time: int) -> tuple[Any, ...]:
    root = scene.tlas_root(time)
    transforms_time = CURRENT if time == MOVERS else time
    return scene.nodes, scene.leaf_blocks, scene.instance_from_world, scene.instances_at(time), transforms_time, root
