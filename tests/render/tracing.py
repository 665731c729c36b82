# SPDX-License-Identifier: Apache-2.0
"""Small scenes and rays for tests of intersection, and a function that traces NumPy rays."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import taichi as ti
import trimesh
from numpy.typing import ArrayLike, NDArray

from tiscene.device.memory import device_array, upload, upload_vectors
from tiscene.render.intersect import trace
from tiscene.render.intersect.ray_queue import hit, hit_id
from tiscene.scene.description import Material, Mesh, SceneDescription
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, Placement


def compiled_kernels() -> int:
    """Return the number of kernels compiled in this process."""
    return sum(len(kernel.compiled_kernels) for kernel in ti.lang.impl.get_runtime().kernels)


class Traced(NamedTuple):
    """Results of `trace.closest` and `trace.occluded`."""

    t: NDArray[np.float32]
    barycentrics: NDArray[np.float32]
    instance: NDArray[np.int32]
    triangle: NDArray[np.int32]
    occluded: NDArray[np.int32]


def mesh(positions: ArrayLike, triangles: ArrayLike, name: str = "mesh") -> Mesh:
    positions = np.asarray(positions, np.float32).reshape(-1, 3)
    triangles = np.asarray(triangles, np.int32).reshape(-1, 3)
    return Mesh(name, positions, triangles, np.zeros(len(triangles), np.int32))


def soup(corners: ArrayLike) -> Mesh:
    """Return a mesh of unconnected triangles [n, 3, 3]."""
    corners = np.asarray(corners, np.float32).reshape(-1, 3)
    return mesh(corners, np.arange(len(corners)))


def shape(made: trimesh.Trimesh) -> Mesh:
    return mesh(made.vertices, made.faces)


def described(*meshes: Mesh) -> SceneDescription:
    return SceneDescription("test", meshes=meshes, materials=(Material("gray"),))


def placed(
    rows: ArrayLike, matrices: ArrayLike | None = None, present: ArrayLike | None = None, **others: NDArray[np.float64]
) -> Placement:
    """Return a placement of instances.

    Args:
        rows: Mesh of each instance.
        matrices: [n, 3, 4] for all times or [3, n, 3, 4]; None: the identity.
        present: bool [3, n]; None: always.
        others: `box_from_object`, [n, 3, 4].
    """
    rows = np.asarray(rows, np.int32)
    count = len(rows)
    matrices = np.eye(3, 4)[None] if matrices is None else np.asarray(matrices, np.float64)
    return Placement(
        mesh=rows,
        instance_id=np.arange(1, count + 1, dtype=np.int32),
        category_id=np.zeros(count, np.int32),
        world_from_object=np.broadcast_to(matrices, (3, count, 3, 4)).copy(),
        box_from_object=others.get("box_from_object", np.repeat(np.eye(3, 4)[None], count, axis=0)),
        present=np.ones((3, count), bool) if present is None else np.asarray(present, bool),
    )


def scene_of(
    meshes: tuple[Mesh, ...], placement: Placement, traversal: str = "bvh8", times: tuple[int, ...] = (CURRENT,)
) -> DeviceScene:
    scene = DeviceScene(traversal)
    scene.add(described(*meshes))
    scene.place(placement, times)
    return scene


def rays_of(origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> NDArray[np.float32]:
    origins, directions = np.broadcast_arrays(np.atleast_2d(origins), np.atleast_2d(directions))
    rays = np.zeros((len(origins), 8), np.float32)
    rays[:, :3], rays[:, 4:7], rays[:, 7] = origins, directions, t_max
    return rays


def random_rays(random: np.random.Generator, count: int, extent: float) -> NDArray[np.float32]:
    """Return rays between random points of a cube about the origin."""
    origins, targets = random.uniform(-extent, extent, (2, count, 3))
    directions = targets - origins
    return rays_of(origins, directions / np.linalg.norm(directions, axis=1, keepdims=True))


def random_matrices(random: np.random.Generator, count: int, extent: float) -> NDArray[np.float64]:
    """Return random matrices [n, 3, 4]: rotation, scale per axis, translation; every other one mirrored."""
    matrices = np.zeros((count, 3, 4))
    for k in range(count):
        rotation = trimesh.transformations.random_rotation_matrix(random.random(3))[:3, :3]
        scale = random.uniform(0.2, 1.2, 3) * (1.0, 1.0, -1.0 if k % 2 else 1.0)
        matrices[k, :, :3] = rotation * scale
        matrices[k, :, 3] = random.uniform(-extent, extent, 3)
    return matrices


def sentinel_hits(count: int) -> tuple[Any, Any]:
    """Return arrays of hits and hit ids filled with 7, to detect rows that are not written."""
    hits, hit_ids = device_array(hit, count), device_array(hit_id, count)
    hits.from_numpy(np.full((count, 4), 7.0, np.float32))
    hit_ids.from_numpy(np.full((count, 2), 7, np.int32))
    return hits, hit_ids


def trace_rays(scene: DeviceScene, rays: NDArray[np.float32], time: int = CURRENT) -> Traced:
    """Trace all rays, closest hit and any hit."""
    count = len(rays)
    on_device, queue = upload_vectors(rays), upload(np.arange(count, dtype=np.int32))
    hits, hit_ids = sentinel_hits(count)
    result = device_array(ti.i32, count)
    result.fill(7)
    trace.closest(scene, time, on_device, queue, count, hits, hit_ids)
    trace.occluded(scene, time, on_device, queue, count, result)
    t, ids = hits.to_numpy(), hit_ids.to_numpy()
    assert (t[:, 3] == 0.0).all()
    return Traced(t[:, 0], t[:, 1:3], ids[:, 0], ids[:, 1], result.to_numpy())
