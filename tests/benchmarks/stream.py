# SPDX-License-Identifier: Apache-2.0
"""Whole frames of a stream with moving objects, from the request for a frame to NumPy arrays.

First the table of `tiscene bench`. The first frame of a line includes the kernels that this line compiles. Lines after
the first two should compile nothing. Then SAILenv's five views with three bouncing objects and a fixed camera. Last the
same views of `room_02` with three objects of the demo at `fast`: frames per second, and PSNR against path tracing. Two
references with independent noise are used, because the mean product of the errors against both does not depend on their
noise. Cameras that move are in `moving`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import tiscene as ts
from tests.benchmarks.timing import timed
from tiscene.cli import bench, demo
from tiscene.render.render_settings import preset

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
    """Print one line for each scene and quality."""
    print(f"{'':<12} {'':<16} {'frame':>10} {'CPU':>10} {'frames/s':>9}")
    for scene in scenes:
        for name in settings:
            stream = bouncing_objects(scene, SETTINGS[name])
            for index in range(WARM_UP):
                stream[index]
            times = [timed(stream.__getitem__, index)[:2] for index in range(WARM_UP, WARM_UP + FRAMES)]
            wall, cpu = 1e3 * np.median(times, axis=0)
            print(f"{scene:<12} {name:<16} {wall:>7.1f} ms {cpu:>7.1f} ms {1e3 / wall:>9.1f}", flush=True)


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
        once, _, _ = timed(stream.__getitem__, 0)
        walls = [1e3 * timed(stream.__getitem__, index)[0] for index in range(WARM_UP + FRAMES)]
        errors = [
            np.mean((stream[index].rgb / 255.0 - one) * (stream[index].rgb / 255.0 - other))
            for index, one, other in zip(COMPARED, *halves, strict=True)
        ]
        wall, best, psnr = np.median(walls[WARM_UP:]), min(walls), -10.0 * np.log10(np.mean(errors))
        times = f"{once:>8.1f} s {wall:>7.1f} ms {best:>7.1f} ms {1e3 / wall:>9.1f} {psnr:>5.1f} dB"
        print(f"base of {spp:>4} spp {times}", flush=True)


def bouncing_objects(scene: str, settings: dict[str, Any]) -> ts.Stream:
    """Return a stream of three bouncing objects in front of the main camera.

    Args:
        scene: name of a scene.
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
    return ts.Stream(ts.Scenario(scene, movers), width=width, height=height, buffers=FIVE_VIEWS, **settings)


def in_front_of(camera: ts.Camera, offset: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the world position of an offset in a camera's axes, m."""
    x, y, z = (np.array(camera.position) + camera.axes() @ offset).tolist()
    return x, y, z


if __name__ == "__main__":
    main()
