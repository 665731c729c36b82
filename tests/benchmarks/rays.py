# SPDX-License-Identifier: Apache-2.0
"""Closest-hit and any-hit rates compared with Embree's single rays, and build times, on the benchmark room.

Both trace the same triangles and rays in this process, in turn. A rate is rays per CPU-second, so that the number of
threads and other processes matter little.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tests.benchmarks.room import room, static_placement
from tests.benchmarks.timing import timed
from tiscene.device.memory import device_array, upload, upload_vectors
from tiscene.render.intersect import trace
from tiscene.render.intersect.ray_queue import hit, hit_id
from tiscene.scene.camera import Camera
from tiscene.scene.description import RectLight, SceneDescription
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, Placement

WIDTH, HEIGHT = 640, 480
ROUNDS = 9
OFFSET = 1e-4  # distance of a ray's origin from its surface, m


def world_triangles(description: SceneDescription, placement: Placement) -> NDArray[np.float32]:
    """Return the triangles of all instances at CURRENT in world space, float32 [n, 3, 3], m."""
    parts = []
    for row, matrix in zip(placement.mesh, placement.world_from_object[CURRENT], strict=True):
        mesh = description.meshes[row]
        parts.append((mesh.positions @ matrix[:, :3].T + matrix[:, 3])[mesh.triangles])
    return np.concatenate(parts).astype(np.float32)


def camera_rays(camera: Camera, width: int, height: int) -> NDArray[np.float32]:
    """Return one ray through a random point of each pixel, float32 [n, 8]."""
    random = np.random.default_rng(0)
    y, x = np.mgrid[0:height, 0:width] + random.random((2, height, width))
    scale = 2.0 * np.tan(0.5 * camera.vertical_fov) / height
    directions = np.stack([(x - 0.5 * width) * scale, (0.5 * height - y) * scale, -np.ones_like(x)], axis=-1)
    return rays_from(np.broadcast_to(camera.position, (width * height, 3)), directions.reshape(-1, 3) @ camera.axes().T)


def rays_from(
    origins: NDArray[Any], directions: NDArray[Any], t_max: NDArray[Any] | float = np.inf
) -> NDArray[np.float32]:
    """Return rays in the layout of the kernels, float32 [n, 8]: origin, 0, unit direction, t_max."""
    rays = np.zeros((len(origins), 8), np.float32)
    rays[:, :3] = origins
    rays[:, 4:7] = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    rays[:, 7] = t_max
    return rays


class Embree:
    """Embree on the same triangles as one mesh; one ray per call of rtcIntersect1 or rtcOccluded1."""

    def __init__(self, triangles: NDArray[np.float32]) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.scene = EmbreeScene()
        TriangleMesh(self.scene, triangles)
        self.scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds the BVH

    def closest(self, rays: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
        """Return Embree's arrays of the closest hits, such as "primID" and "tfar"."""
        result: dict[str, NDArray[Any]] = self.scene.run(rays[:, :3].copy(), rays[:, 4:7].copy(), output=True)
        return result

    def job(self, rays: NDArray[np.float32], query: str) -> Callable[[], None]:
        """Return a function that traces the rays once. query: "INTERSECT" or "OCCLUDED"."""
        origins, directions, t_max = rays[:, :3].copy(), rays[:, 4:7].copy(), rays[:, 7].copy()
        t_max = np.minimum(t_max, np.float32(1e30))
        return lambda: self.scene.run(origins, directions, query=query, dists=t_max.copy())


def ray_sets(
    description: SceneDescription, triangles: NDArray[np.float32], embree: Embree
) -> dict[str, NDArray[np.float32]]:
    """Return camera rays, and from each of their hits a cosine-distributed bounce and a ray to the light."""
    random = np.random.default_rng(3)
    primary = camera_rays(description.cameras[0], WIDTH, HEIGHT)
    found = embree.closest(primary)
    hit = found["primID"] >= 0
    corners = triangles[found["primID"][hit]].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= -np.sign((normals * primary[hit, 4:7]).sum(axis=1, keepdims=True))
    points = primary[hit, :3] + primary[hit, 4:7] * found["tfar"][hit, None] + OFFSET * normals
    sphere = random.normal(size=points.shape)
    bounce = rays_from(points, normals + 0.999 * sphere / np.linalg.norm(sphere, axis=1, keepdims=True))
    light = description.lights[0]
    assert isinstance(light, RectLight)
    on_light = np.zeros((len(points), 4))
    on_light[:, :2] = random.uniform(-0.5, 0.5, (len(points), 2)) * (light.width, light.height)
    on_light[:, 3] = 1.0
    to_light = (on_light @ light.world_from_light.T)[:, :3] - points
    shadow = rays_from(points, to_light, 0.9995 * np.linalg.norm(to_light, axis=1))
    return {"primary": primary, "bounce": bounce, "shadow": shadow}


def cpu_seconds(*jobs: Callable[[], None], rounds: int = ROUNDS) -> list[float]:
    """Return the shortest CPU time of each job, s. Jobs run in turn, so that load on the machine affects all alike."""
    best = [np.inf] * len(jobs)
    for _ in range(rounds):
        for k, job in enumerate(jobs):
            best[k] = min(best[k], timed(job)[1])
    return best


def rates(scene: DeviceScene, embree: Embree, sets: dict[str, NDArray[np.float32]]) -> dict[str, tuple[float, float]]:
    """Return the rates of tiscene and Embree for each set of rays, M rays per CPU-second."""
    result = {}
    for name, rays in sets.items():
        count = len(rays)
        on_device, queue = upload_vectors(rays), upload(np.arange(count, dtype=np.int32))
        hits, hit_ids = device_array(hit, count), device_array(hit_id, count)
        occluded = device_array(ti.i32, count)

        def job(
            any_hit: bool = name == "shadow", arrays: Any = (on_device, queue, count, hits, hit_ids, occluded)
        ) -> None:
            rays, queue, count, hits, hit_ids, occluded = arrays
            if any_hit:
                trace.occluded(scene, CURRENT, rays, queue, count, occluded)
            else:
                trace.closest(scene, CURRENT, rays, queue, count, hits, hit_ids)
            ti.sync()

        job()
        theirs = embree.job(rays, "OCCLUDED" if name == "shadow" else "INTERSECT")
        ours_time, embree_time = cpu_seconds(job, theirs)
        result[name] = 1e-6 * count / ours_time, 1e-6 * count / embree_time
    return result


def run(traversal: str = "bvh8") -> list[tuple[str, float, float, str]]:
    """Return rows of (name, tiscene's value, Embree's value, unit)."""
    description = room()
    placement = static_placement(description)
    triangles = world_triangles(description, placement)
    DeviceScene(traversal).add(room())  # compiles the build kernels
    start = time.perf_counter()
    scene = DeviceScene(traversal)
    scene.add(description)
    ti.sync()
    ours_build = time.perf_counter() - start
    start = time.perf_counter()
    embree = Embree(triangles)
    embree_build = time.perf_counter() - start
    scene.place(placement)

    names = {"primary": "closest hit, camera", "bounce": "closest hit, bounce", "shadow": "any hit, to the light"}
    measured = rates(scene, embree, ray_sets(description, triangles, embree))
    rows = [(names[name], ours, theirs, "M rays per CPU-second") for name, (ours, theirs) in measured.items()]
    rows.append(("build (tiscene: each mesh once)", 1e3 * ours_build, 1e3 * embree_build, "ms"))
    place_times = []
    for _ in range(20):
        copy = replace(placement)  # the same object again would not be placed
        start = time.perf_counter()
        scene.place(copy)
        ti.sync()
        place_times.append(time.perf_counter() - start)
    rows.append((f"place {len(placement.mesh)} instances", 1e3 * float(np.median(place_times)), np.nan, "ms"))
    return rows


def main() -> None:
    """Print the table."""
    rows = run()
    print(f"{'rays':32} {'tiscene':>9} {'Embree':>9} {'ratio':>7}")
    for name, ours, embree, unit in rows:
        print(f"{name:32} {ours:9.2f} {embree:9.2f} {ours / embree:7.2f}  {unit}")


if __name__ == "__main__":
    main()
