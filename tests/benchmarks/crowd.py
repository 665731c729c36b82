# SPDX-License-Identifier: Apache-2.0
"""Ten million instanced triangles: rays per CPU-second and memory, compared with the benchmark room of 500 thousand.

Two scenes: twenty benchmark rooms side by side, seen from within one of them; and one room with 464 more balls of
20,480 triangles each. The rates are those of the rays of a path-traced picture, by kind. A second table compares with
Embree, one ray at a time, on all triangles in world space: dense geometry is slow for any tracer.
"""

from __future__ import annotations

import resource
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from inspect import signature
from typing import Any

import numpy as np

from tests.benchmarks.rays import Embree, rates, ray_sets, world_triangles
from tests.benchmarks.room import DEPTH as LENGTH
from tests.benchmarks.room import WIDTH as BREADTH
from tests.benchmarks.room import room, static_placement
from tiscene.render.integrators.path import path_pass
from tiscene.render.intersect import trace
from tiscene.render.view import View
from tiscene.scene.description import SceneDescription
from tiscene.scene.device_scene import DeviceScene

WIDTH, HEIGHT, SPP, DEPTH = 256, 192, 16, 5
ROUNDS = 5
KINDS = ("camera", "bounce", "shadow")


class RayTimer:
    """Counts rays of path tracing and their CPU time, by kind."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.rays: dict[str, int] = defaultdict(int)

    def timed(self, trace: Callable[..., None], kind: str) -> Callable[..., None]:
        """Wrap a trace function so that its rays and CPU time are counted.

        Args:
            trace: function of (scene, time, rays, queue, count, outputs...).
            kind: kind of its rays; packets of camera rays count as "camera".
        """

        def measured(*arguments: Any, **options: Any) -> None:
            counted_as = "camera" if signature(trace).bind(*arguments, **options).arguments.get("coherent") else kind
            start = time.process_time()
            trace(*arguments, **options)
            self.seconds[counted_as] += time.process_time() - start
            self.rays[counted_as] += arguments[4]

        return measured


def measure(description: SceneDescription) -> dict[str, float]:
    """Path trace a scene and return rays per CPU-second of each of KINDS, the best of ROUNDS, and its "triangles"."""
    scene = DeviceScene()
    scene.add(description)
    placement = static_placement(description)
    scene.place(placement)
    camera = description.cameras[0]
    view = View(camera, camera, camera, WIDTH, HEIGHT)
    paths = path_pass.PathPass(scene, WIDTH, HEIGHT)
    best: dict[str, float] = defaultdict(float)
    traces = trace.closest, trace.occluded
    for seed in range(ROUNDS + 1):  # the first round compiles
        counted = RayTimer()
        vars(path_pass).update(closest=counted.timed(traces[0], "bounce"), occluded=counted.timed(traces[1], "shadow"))
        paths.render(view, frame_index=0, seed=seed, spp=SPP, max_depth=DEPTH)
        vars(path_pass).update(closest=traces[0], occluded=traces[1])
        if seed > 0:
            for kind, seconds in counted.seconds.items():
                best[kind] = max(best[kind], counted.rays[kind] / seconds)
    best["triangles"] = sum(len(description.meshes[row].triangles) for row in placement.mesh)
    return best


def rooms(across: int, along: int) -> SceneDescription:
    """Return a grid of benchmark rooms, 0.3 m apart."""
    one = room()
    instances = []
    for x in range(across):
        for z in range(along):
            offset = np.eye(4)
            offset[:3, 3] = x * (BREADTH + 0.3), 0.0, z * (LENGTH + 0.3)
            instances += [replace(each, world_from_object=offset @ each.world_from_object) for each in one.instances]
    return replace(one, instances=tuple(instances))


def main() -> None:
    """Print both tables."""
    cases = {"the room": room(), "20 rooms": rooms(5, 4), "with 464 balls": room(balls=464)}
    first: dict[str, float] = {}
    print(f"{'M rays per CPU-second':22} {'triangles':>10} {'camera':>13} {'bounce':>13} {'shadow':>13} {'peak MB':>9}")
    for name, description in cases.items():
        found = measure(description)
        first = first or found
        columns = [f"{1e-6 * found[kind]:6.2f} ({found[kind] / first[kind]:.2f})" for kind in KINDS]
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"{name:22} {found['triangles']:10.0f} {' '.join(f'{column:>13}' for column in columns)} {peak:9.0f}")
    print("in brackets: fraction of the room's rate; peak: memory of the process so far")
    print(f"\n{'single rays':22} {'camera':>23} {'bounce':>23} {'shadow':>23}  (tiscene / Embree = ratio)")
    for name in ("the room", "with 464 balls"):
        pairs = [f"{ours:6.2f} / {theirs:5.2f} = {ours / theirs:4.2f}" for ours, theirs in against_embree(cases[name])]
        print(f"{name:22} {' '.join(f'{pair:>23}' for pair in pairs)}", flush=True)


def against_embree(description: SceneDescription) -> list[tuple[float, float]]:
    """Return the rates of tiscene and Embree for camera, bounce and shadow rays, M rays per CPU-second."""
    placement = static_placement(description)
    triangles = world_triangles(description, placement)
    embree = Embree(triangles)
    scene = DeviceScene()
    scene.add(description)
    scene.place(placement)
    return list(rates(scene, embree, ray_sets(description, triangles, embree)).values())
