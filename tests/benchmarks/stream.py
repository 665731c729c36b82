# SPDX-License-Identifier: Apache-2.0
"""Whole frames of a stream with moving objects, from the request for a frame to NumPy arrays.

First the table of `tiscene bench`. The first frame of a line includes the kernels that this line compiles. Lines after
the first two should compile nothing. Then SAILenv's five views with three bouncing objects: with a fixed camera, whose
frames are rendered incrementally, or with a camera that turns by a degree a frame. "outside" is the fraction of time
spent neither in kernels nor in the denoiser. Last the same views of `room_02` with three objects of the demo at `fast`:
frames per second, and PSNR against path tracing. Two references with independent noise are used, because the mean
product of the errors against both does not depend on their noise.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pyoidn
from numpy.typing import NDArray
from taichi.lang import kernel_impl

import tiscene as ts
from dynamics.rotation import multiply
from tiscene.cli import bench, demo
from tiscene.render.render_settings import preset
from tiscene.render.view import View

SECONDS = 5.0
FIVE_VIEWS = ("rgb", "semantic", "instance", "backward_flow", "depth")
SETTINGS: dict[str, dict[str, Any]] = {
    "fast": {"quality": "fast"},
    "preview": {"quality": "preview"},
    "standard, 4 spp": {"quality": "standard", "spp": 4},
}
SCENES = ("room_02", "object_view")
SIZE = 256, 192
WARM_UP, FRAMES = 6, 24
BASES = (64, 1024)  # samples per pixel of the base image: of the preset, and of the published figure
REFERENCE_SPP, COMPARED = 256, (9, 15)  # COMPARED: frame indices


def main() -> None:
    """Print the tables."""
    bench.print_table(demo.scenario(), seconds=SECONDS)
    five_views(SCENES, SETTINGS)
    against_path_tracing()


def five_views(scenes: Iterable[str], settings: Iterable[str]) -> None:
    """Print one line for each scene, quality and camera."""
    print(f"{'':<12} {'':<16} {'camera':>8} {'frame':>10} {'CPU':>10} {'frames/s':>9} {'outside':>8}")
    for scene in scenes:
        for name in settings:
            for turns in (False, True):
                render = renderer_of(scene, turns, SETTINGS[name])
                for index in range(WARM_UP):
                    render(index)
                walls, cpus, outside = [], [], []
                with timed_kernels() as spent:
                    for index in range(WARM_UP, WARM_UP + FRAMES):
                        wall, cpu, before = time.perf_counter(), time.process_time(), spent[0]
                        render(index)
                        walls.append(time.perf_counter() - wall)
                        cpus.append(time.process_time() - cpu)
                        outside.append(1.0 - (spent[0] - before) / walls[-1])
                wall, cpu = 1e3 * np.median(walls), 1e3 * np.median(cpus)
                camera, share = "turns" if turns else "fixed", 100.0 * np.median(outside)
                times = f"{wall:>7.1f} ms {cpu:>7.1f} ms {1e3 / wall:>9.1f} {share:>6.1f} %"
                print(f"{scene:<12} {name:<16} {camera:>8} {times}", flush=True)


def against_path_tracing() -> None:
    """Print one line for each base image."""
    scenario = demo.scenario()
    scenario = replace(scenario, objects=scenario.objects[:3])
    size = {"width": SIZE[0], "height": SIZE[1], "fps": demo.FPS}
    depth = preset("fast").max_depth
    halves: list[list[NDArray[np.float64]]] = []
    for seed in (1, 2):
        traced = ts.Stream(
            scenario,
            buffers=("rgb",),
            quality="standard",
            spp=REFERENCE_SPP,
            max_depth=depth,
            seed=seed,
            denoise=False,
            incremental=False,
            **size,
        )
        halves.append([traced[index].rgb / 255.0 for index in COMPARED])
    print(f"{'room_02, fast':<16} {'once':>10} {'frame':>10} {'best':>10} {'frames/s':>9} {'PSNR':>8}")
    for spp in BASES:
        stream = ts.Stream(scenario, buffers=FIVE_VIEWS, quality="fast", base_spp=spp, incremental=True, **size)
        began = time.perf_counter()
        stream[0]
        once, walls = time.perf_counter() - began, []
        for index in range(WARM_UP + FRAMES):
            began = time.perf_counter()
            stream[index]
            walls.append(1e3 * (time.perf_counter() - began))
        errors = [
            np.mean((stream[index].rgb / 255.0 - one) * (stream[index].rgb / 255.0 - other))
            for index, one, other in zip(COMPARED, *halves, strict=True)
        ]
        wall, best, psnr = np.median(walls[WARM_UP:]), min(walls), -10.0 * np.log10(np.mean(errors))
        times = f"{once:>8.1f} s {wall:>7.1f} ms {best:>7.1f} ms {1e3 / wall:>9.1f} {psnr:>5.1f} dB"
        print(f"base of {spp:>4} spp {times}", flush=True)


def renderer_of(scene: str, turns: bool, settings: dict[str, Any]) -> Callable[[int], ts.Frame]:
    """Return a function that renders a frame of three bouncing objects by its index.

    Args:
        scene: name of a scene.
        turns: whether the camera turns by a degree a frame.
        settings: quality and samples, arguments of `Stream`.
    """
    camera = ts.Stream(scene, width=8, height=8, buffers=("depth",)).world.camera
    movers = [
        ts.Object(f"mover_{number}", name, in_front_of(camera, offset), dynamic=ts.UniformMovementRandomBounce(0.8))
        for number, (name, offset) in enumerate(
            (("Chair 01", (0.5, 0.0, -2.0)), ("Pillow 01", (0.0, -0.5, -2.0)), ("Dish 01", (-0.5, 0.5, -2.0)))
        )
    ]
    width, height = SIZE
    stream = ts.Stream(
        ts.Scenario(scene, movers), width=width, height=height, buffers=FIVE_VIEWS, incremental=not turns, **settings
    )

    def turned(index: int) -> ts.Camera:
        half = math.radians(0.5 * index)
        w, x, y, z = multiply(np.array([math.cos(half), 0.0, math.sin(half), 0.0]), np.array(camera.rotation)).tolist()
        return camera.with_pose(camera.position, (w, x, y, z))

    def render(index: int) -> ts.Frame:
        if not turns:
            return stream[index]
        return stream.render_view(
            index, View(*(turned(index + step) for step in (-1, 0, 1)), width, height), FIVE_VIEWS
        )

    return render


def in_front_of(camera: ts.Camera, offset: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the world position of an offset in a camera's axes, m."""
    x, y, z = (np.array(camera.position) + camera.axes() @ offset).tolist()
    return x, y, z


@contextmanager
def timed_kernels() -> Iterator[list[float]]:
    """Measure the time spent in kernels, including launches, and in the denoiser within the block, s."""
    spent = [0.0]
    timed: list[tuple[Any, str]] = [(kernel_impl.Kernel, "__call__"), (pyoidn.Filter, "execute")]
    originals = [getattr(kind, name) for kind, name in timed]
    for (kind, name), call in zip(timed, originals, strict=True):

        def measured(*args: Any, call: Any = call, **kwargs: Any) -> Any:
            began = time.perf_counter()
            try:
                return call(*args, **kwargs)
            finally:
                spent[0] += time.perf_counter() - began

        setattr(kind, name, measured)
    try:
        yield spent
    finally:
        for (kind, name), call in zip(timed, originals, strict=True):
            setattr(kind, name, call)


if __name__ == "__main__":
    main()
