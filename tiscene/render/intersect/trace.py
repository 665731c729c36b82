# SPDX-License-Identifier: Apache-2.0
"""Closest hits and occlusion of arrays of rays. All passes trace through these functions.

Rays are rows of eight: origin x, y, z, one that is not read here, direction x, y, z, t_max; hits are in (0, t_max). The
rays to trace are `queue[0 .. count)` (i32). Of hits at the same distance, the lowest (instance row, triangle) wins,
independent of how the hierarchy was built. The traversal is `scene.traversal`: "bvh8" or "bvh2".
"""

from __future__ import annotations

from typing import Any

from tiscene.device.vector_mode import vector_mode
from tiscene.render.intersect import bvh2, bvh8, bvh8_any_hit, bvh8_packets
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, MOVERS

__all__ = ["closest", "occluded", "occluded_by_instance", "trees_at"]


def closest(
    scene: DeviceScene,
    time: int,
    rays: Any,
    queue: Any,
    count: int,
    hits: Any,
    hit_ids: Any,
    coherent: bool = False,
    rays_per_frame: int = 0,
) -> None:
    """Find the closest hit of each ray.

    Args:
        scene: The scene.
        time: PREVIOUS, CURRENT or NEXT of `tiscene.scene.placement`, at which it was placed, or MOVERS.
        rays: [n] of 8.
        queue: i32, rows of the rays to trace.
        count: How many of them.
        hits: [n] of 4; receives distance in units of the direction's length (+inf for a miss), barycentrics b1 and b2
            of vertices 1 and 2, and 0.
        hit_ids: [n] of 2; receives instance row and global triangle, -1 for a miss.
        coherent: Faster, with the same result, if most runs of sixteen rays in the queue start at one point and go
            through one pixel or through neighbors.
        rays_per_frame: Rows of rays of each frame that `DeviceScene.place_frames` has placed; 0: one frame is placed.

    Raises:
        ArgumentError: The scene is not placed at `time`.
    """
    roots = scene.frame_roots(time) if rays_per_frame else queue
    arrays = _arrays(scene, time, 0 if rays_per_frame else None)
    if scene.traversal == "bvh8" and coherent and not rays_per_frame:
        with vector_mode():
            bvh8_packets.closest(*arrays, rays, queue, count, hits, hit_ids)
    elif scene.traversal == "bvh8":
        with vector_mode():
            bvh8.closest(*arrays, rays, queue, count, roots, rays_per_frame, hits, hit_ids)
    else:
        bvh2.closest(*arrays, rays, queue, count, roots, rays_per_frame, hits, hit_ids)


def occluded(scene: DeviceScene, time: int, rays: Any, queue: Any, count: int, result: Any, trees: Any = None) -> None:
    """Set result[ray] (i32 [n]) to 1 if any surface is in (0, t_max), else to 0; other arguments as `closest`.

    Args:
        trees: i32 [n], for each ray -1 minus the root of the tree to test it against, where `DeviceScene.place_frames`
            has placed several frames; None: the tree at `time`.
    """
    if trees is None:
        _occluded(scene, time, rays, queue, count, queue, 0, result)
    else:
        _occluded(scene, time, rays, queue, count, trees, 1, result, root=0)


def occluded_by_instance(
    scene: DeviceScene, rays: Any, queue: Any, instance_rows: Any, count: int, result: Any
) -> None:
    """Test each ray against one instance only, in row instance_rows[ray] (i32 [n]); else as `occluded` at CURRENT.

    Instances that are not present are hit as well: the caller chooses the rows.
    """
    _occluded(scene, CURRENT, rays, queue, count, instance_rows, 1, result)


def _occluded(
    scene: DeviceScene, time: int, rays: Any, queue: Any, count: int, targets: Any, targeted: int, result: Any,
    root: int | None = None,
) -> None:  # fmt: skip
    arrays = _arrays(scene, time, root)
    if scene.traversal == "bvh8":
        with vector_mode():
            bvh8_any_hit.occluded(*arrays, rays, queue, count, targets, targeted, result)
    else:
        bvh2.occluded(*arrays, rays, queue, count, targets, targeted, result)


def trees_at(scene: DeviceScene, time: int) -> tuple[Any, Any, Any, int]:
    """Return (nodes, leaf_blocks, instances, root) for `bvh8.trace_ray` at CURRENT, or among the MOVERS."""
    return scene.nodes, scene.leaf_blocks, scene.instances_at(time), scene.tlas_root(time)


def _arrays(scene: DeviceScene, time: int, root: int | None = None) -> tuple[Any, ...]:
    root = scene.tlas_root(time) if root is None else root
    transforms_time = CURRENT if time == MOVERS else time
    return scene.nodes, scene.leaf_blocks, scene.instance_from_world, scene.instances_at(time), transforms_time, root
