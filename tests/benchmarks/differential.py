"""A fixed camera and three movers: differences to a base image against path tracing each frame, and against Mitsuba.

Two scenes: the benchmark room, in which a chair, a ball and a vase move, and `room_02` with three things of the demo's.
relMSE: squared error over squared reference plus 0.01, mean over pixels, of the last frame measured. PSNR: of the same
frame as it is displayed. "gain": how many times less time than path tracing for the same relMSE, whose error falls as 1
over its samples; with the denoiser (+), times less than path tracing with it, as they stand.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.path import DEPTH, SPP, mitsuba
from tests.benchmarks.room import room, still
from tiscene.commands import demo
from tiscene.render.denoise import denoise
from tiscene.render.film import meter, tone_map
from tiscene.render.integrators.path import PathImage, PathPass
from tiscene.render.integrators.replay import ReplayPass
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import Placement
from tiscene.stream import Stream

SIZES = ((256, 192), (640, 480))
PATHS = (4, 8)
BASE_SPP = 256
REFERENCE_SPP = 512
FRAMES = 5
MOVERS = ("chair", "ball", "vase")


@dataclass(frozen=True, eq=False)
class Case:
    """A scene, a view of it, what moves, and where everything is at a frame."""

    name: str
    scene: DeviceScene
    view: View
    moving: NDArray[np.bool_]
    placement: Callable[[int], Placement]


def benchmark_room(width: int, height: int) -> Case:
    """The first of each of MOVERS moves in a circle."""
    description = room()
    scene = DeviceScene()
    scene.add(description)
    placed = still(description)
    names = [thing.category for thing in description.objects]
    chosen = [names.index(name) for name in MOVERS]
    moving = np.array([instance.object in chosen for instance in description.instances])

    def placement(frame: int) -> Placement:
        matrices = placed.world_from_object.copy()
        matrices[:, moving, 0, 3] += 0.3 * np.sin(0.5 * frame)
        matrices[:, moving, 1, 3] += 0.15 - 0.15 * np.cos(0.5 * frame)
        return replace(placed, world_from_object=matrices)

    camera = description.cameras[0]
    return Case("benchmark room", scene, View(camera, camera, camera, width, height), moving, placement)


def living_room(width: int, height: int) -> Case:
    """`room_02` with the first three of the demo's things."""
    scenario = demo.scenario()
    stream = Stream(replace(scenario, objects=scenario.objects[:3]), fps=demo.FPS, buffers=("depth",))
    stream[0]  # loads what moves
    camera = stream.world.camera
    view = View(camera, camera, camera, width, height)
    return Case(demo.SCENE, stream._scene, view, stream.world.moving(0), stream.world.placement)


def main() -> None:
    """Print the table."""
    head = f"{'renderer':>22} {'first ms':>9} {'frame ms':>9} {'+ OIDN':>8} {'relMSE':>8} {'PSNR':>6} {'gain':>6}"
    for width, height in SIZES:
        for make in (benchmark_room, living_room):
            case = make(width, height)
            print(f"{case.name} {width}x{height}, plain at {SPP} spp, depth {DEPTH}\n{head}")
            measure(case, with_mitsuba=make is benchmark_room)


def measure(case: Case, with_mitsuba: bool) -> None:
    """One row for each renderer, the second line of each with the denoiser."""
    view, last = case.view, FRAMES - 1
    paths = PathPass(case.scene, view.width, view.height)

    def trace(frame: int, spp: int = SPP, seed: int = 1) -> PathImage:
        case.scene.place(case.placement(frame))
        return paths.render(view, frame_index=frame, seed=seed, spp=spp, max_depth=DEPTH)

    reference = trace(last, REFERENCE_SPP, 99)
    exposure = meter(reference.hdr)
    shown = tone_map(reference.hdr, exposure).astype(float)

    def errors(radiance: NDArray[np.float32]) -> tuple[float, float]:
        relative = np.mean((radiance - reference.hdr) ** 2 / (reference.hdr**2 + 1e-2))
        noise = np.mean((tone_map(np.maximum(radiance, 0.0), exposure) - shown) ** 2)
        return float(relative), float(10.0 * np.log10(255.0**2 / noise))

    plain: list[tuple[float, float]] = []

    def row(name: str, first: float, seconds: float, image: PathImage) -> None:
        clean, denoising = denoised(image)
        for label, radiance, taken in ((name, image.hdr, seconds), ("+", clean, seconds + denoising)):
            error, psnr = errors(radiance)
            known = 0 if label == name else 1
            if len(plain) == known:
                plain.append((taken, error))
            gain = plain[known][0] / taken * (plain[0][1] / error if known == 0 else 1.0)
            print(
                f"{label:>22} {1e3 * first:9.0f} {1e3 * seconds:9.1f} {1e3 * taken:8.1f} {error:8.4f} {psnr:6.1f}"
                f" {gain:6.1f}",
                flush=True,
            )

    seconds, image = timed(trace)
    row("path tracing", 0.0, seconds, image)
    for spp in PATHS:
        replayed = ReplayPass(case.scene, view.width, view.height)

        def replay(frame: int, spp: int = spp, replayed: ReplayPass = replayed) -> PathImage:
            placement = case.placement(frame)
            replayed.prepare(view, placement, case.moving, seed=1, spp=spp, max_depth=DEPTH, base_spp=BASE_SPP)
            case.scene.place(placement)
            return replayed.render(case.moving)

        began = time.perf_counter()
        replay(0)
        first = time.perf_counter() - began
        seconds, image = timed(replay)
        row(f"differential, {spp} paths", first, seconds, image)
    if with_mitsuba:
        traced = mitsuba("llvm_ad_rgb", view.width, view.height)
        seconds, radiance = timed(traced)
        _, denoising = denoised(replace(image, hdr=radiance))
        print(f"{'mitsuba llvm_ad_rgb':>22} {'':>9} {1e3 * seconds:9.1f} {1e3 * (seconds + denoising):8.1f}")


def timed(render: Callable[[int], Any]) -> tuple[float, Any]:
    """The shortest time that a frame took, s, and the last one; the first is not counted."""
    image = render(0)
    times = []
    for frame in range(FRAMES):
        began = time.perf_counter()
        image = render(frame)
        times.append(time.perf_counter() - began)
    return min(times), image


def denoised(image: PathImage) -> tuple[NDArray[np.float32], float]:
    """What OIDN makes of it, and the time it takes, s."""
    radiance = np.maximum(image.hdr, 0.0)
    denoise(radiance, image.albedo, image.normal, "balanced")
    began = time.perf_counter()
    clean = denoise(radiance, image.albedo, image.normal, "balanced")
    return clean, time.perf_counter() - began
