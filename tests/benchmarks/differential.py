"""A fixed camera and three movers: differences to a base image against path tracing each frame, and against Mitsuba.

Three scenes: the benchmark room, in which a chair, a ball and a vase move; `room_02` with three things of the demo's;
and that in matte materials, which Mitsuba renders as well (its means are tiscene's within 2 %).
relMSE: squared error over squared reference plus 0.01, mean over pixels, of the last frame measured. PSNR: of the same
frame as it is displayed. "gain": how many times less time than path tracing takes for the same relMSE, both with the
denoiser or both without; between the samples that were measured, and beyond them, error and time follow a power law.
Mitsuba is denoised with the reference's albedo and normal, for nothing.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks import living_room as living
from tests.benchmarks import power_law
from tests.benchmarks.path import DEPTH
from tests.benchmarks.room import room, still
from tests.reference import mitsuba_scene
from tiscene.render.base_image import BaseImages
from tiscene.render.clean import Cleaner
from tiscene.render.denoise import denoise
from tiscene.render.film import meter, tone_map
from tiscene.render.integrators.path import PathImage, PathPass
from tiscene.render.integrators.replay import ReplayImage, ReplayPass
from tiscene.render.view import View
from tiscene.scene.description import SceneDescription
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import Placement

SIZES = ((256, 192), (640, 480))
SAMPLES = (4, 16, 64)
PATHS = (2, 4, 8)
BASE_SPP = 256
REFERENCE_SPP = 256
FRAMES = 5
MOVERS = ("chair", "ball", "vase")


@dataclass(frozen=True, eq=False)
class Case:
    """A scene, a view of it, what moves, where everything is at a frame, and the last frame for Mitsuba, if it can."""

    name: str
    scene: DeviceScene
    view: View
    moving: NDArray[np.bool_]
    placement: Callable[[int], Placement]
    description: SceneDescription | None = None


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
    stream = living.stream()
    stream[0]  # loads what moves
    camera = stream.world.camera
    view = View(camera, camera, camera, width, height)
    return Case("room_02", stream._scene, view, stream.world.moving(0), stream.world.placement)


def matte_room(width: int, height: int) -> Case:
    """The same without gloss; the movers stand where they are at the last frame."""
    description, moving = living.room(FRAMES - 1, matte=True)
    scene = DeviceScene()
    scene.add(description)
    placed = still(description)
    camera = description.cameras[0]
    view = View(camera, camera, camera, width, height)
    return Case("room_02, matte", scene, view, moving, lambda frame: placed, description)


CASES = (benchmark_room, living_room, matte_room)


def main() -> None:
    """Print the tables."""
    for width, height in SIZES:
        for make in CASES:
            measure(make(width, height))


@dataclass(frozen=True)
class Row:
    """s and relMSE, raw and denoised."""

    seconds: float
    error: float
    clean_seconds: float
    clean_error: float


def measure(case: Case) -> None:
    """One line for each renderer and number of paths."""
    view, last = case.view, FRAMES - 1
    print(f"{case.name} {view.width}x{view.height}, depth {DEPTH}, base image of {BASE_SPP} spp")
    print(
        f"{'renderer':>24} {'once s':>7} {'ms':>8} {'relMSE':>8} {'gain':>6}"
        f" {'+ OIDN ms':>10} {'relMSE':>8} {'PSNR':>6} {'gain':>6}"
    )
    paths = PathPass(case.scene, view.width, view.height)

    def trace(frame: int, spp: int, seed: int = 1) -> PathImage:
        case.scene.place(case.placement(frame))
        return paths.render(view, frame_index=frame, seed=seed, spp=spp, max_depth=DEPTH)

    reference = trace(last, REFERENCE_SPP, 99)
    exposure = meter(reference.hdr)
    shown = tone_map(denoise(reference.hdr, reference.albedo, reference.normal, "high"), exposure).astype(float)

    def error_of(radiance: NDArray[np.float32]) -> float:
        return float(np.mean((radiance - reference.hdr) ** 2 / (reference.hdr**2 + 1e-2)))

    def row(
        name: str,
        once: float,
        seconds: float,
        image: PathImage,
        clean: Callable[[], NDArray[np.float32]],
        *against: list[Row],
    ) -> Row:
        denoising, radiance = timed(lambda frame: clean())
        noise = np.mean((tone_map(np.maximum(radiance, 0.0), exposure) - shown) ** 2)
        result = Row(seconds, error_of(image.hdr), seconds + denoising, error_of(radiance))
        raw = " ".join(f"{time_for(each, result.error) / seconds:6.1f}" for each in against) or f"{'':>6}"
        both = " ".join(
            f"{time_for(each, result.clean_error, clean=True) / result.clean_seconds:6.1f}" for each in against
        )
        psnr = 10.0 * np.log10(255.0**2 / noise)
        print(
            f"{name:>24} {once:7.1f} {1e3 * seconds:8.1f} {result.error:8.4f} {raw}"
            f" {1e3 * result.clean_seconds:10.1f} {result.clean_error:8.4f} {psnr:6.1f} {both}",
            flush=True,
        )
        return result

    plain = []
    cleaner = Cleaner("balanced", 1, True)
    for spp in SAMPLES:
        seconds, image = timed(partial(trace, spp=spp), spp < 64)
        plain.append(
            row(
                f"path tracing, {spp} spp",
                0.0,
                seconds,
                image,
                partial(cleaner.traced, image, image.albedo, image.normal),
            )
        )
    against = [plain]
    if case.description is not None:
        against.append([])
        for spp, seconds, radiance in mitsuba(case.description, view):
            image = replace(reference, hdr=radiance)
            against[1].append(
                row(
                    f"Mitsuba LLVM, {spp} spp",
                    0.0,
                    seconds,
                    image,
                    partial(denoise, image.hdr, image.albedo, image.normal, "balanced"),
                )
            )
    with tempfile.TemporaryDirectory() as folder:  # the base image is made once, and counted at the first row
        images = BaseImages(Path(folder))
        for spp in PATHS:
            difference(case, spp, images, row, against)


def difference(case: Case, spp: int, images: BaseImages, row: Callable[..., Row], against: list[list[Row]]) -> None:
    """The rows of so many kept paths a pixel."""
    view = case.view
    replayed = ReplayPass(case.scene, view.width, view.height, images=images)

    def replay(frame: int) -> ReplayImage:
        placement = case.placement(frame)
        replayed.prepare(view, placement, case.moving, seed=1, spp=spp, max_depth=DEPTH, base_spp=BASE_SPP)
        case.scene.place(placement)
        return replayed.render(case.moving)

    began = time.perf_counter()
    replay(0)
    once = time.perf_counter() - began
    seconds, image = timed(replay)
    for name, cleaner in (("", Cleaner("balanced", 1, True)), (", fast", Cleaner("fast", 2, True))):
        label = f"difference, {spp} paths{name}"
        row(label, once, seconds, image, partial(cleaner.difference, image), *against)


def time_for(rows: list[Row], error: float, *, clean: bool = False) -> float:
    """How long a renderer takes for an error, s, by its rows."""
    points = [(each.clean_error, each.clean_seconds) if clean else (each.error, each.seconds) for each in rows]
    return power_law.time_for(error, points)


def mitsuba(description: SceneDescription, view: View) -> Iterator[tuple[int, float, NDArray[np.float32]]]:
    """Samples per pixel, s a frame, radiance."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    scene = mitsuba_scene.scene(
        mi, description, description.cameras[0], view.width, view.height, max_depth=DEPTH, spp=SAMPLES[0]
    )
    for spp in SAMPLES:
        seconds, radiance = timed(partial(_mitsuba, mi, scene, spp), spp < 64)
        yield spp, seconds, radiance


def _mitsuba(mi: Any, scene: Any, spp: int, frame: int) -> NDArray[np.float32]:
    return np.array(mi.render(scene, spp=spp, seed=frame), np.float32)


def timed(render: Callable[[int], Any], again: bool = True) -> tuple[float, Any]:
    """The shortest time that a frame took, s, and the last one; the first is not counted if there is time for more."""
    times = []
    for frame in range(FRAMES + 1) if again else (FRAMES,):
        began = time.perf_counter()
        image = render(max(frame - 1, 0))
        times.append(time.perf_counter() - began)
    return min(times[1:] or times), image
