# SPDX-License-Identifier: Apache-2.0
"""A fixed camera and three movers: differences to a base image against path tracing each frame, and against Mitsuba.

`room_02` with three things of the demo's, in its own materials ("glossy": Mitsuba's `principled` is not quite
UsdPreviewSurface, so that each renderer is measured against its own converged picture) and in matte ones (one converged
picture for both). relMSE: squared error over squared reference plus 0.01, mean over pixels and seeds, of the last of
the frames that are timed; the reference's own noise, which its two halves tell, is taken off. PSNR: of that frame as it
is displayed, against the reference denoised. Times are means over frames or seeds. A difference is made anew for every
seed, base image and kept paths too: "once" is what that takes, the mean over the seeds.

"gain": how many times less time than path tracing takes for the same relMSE, both without the denoiser or both with it
(Mitsuba and path tracing by their own albedo and normal); between the samples that were measured, and beyond them,
error and time follow a power law. In brackets: than Mitsuba. "pays": after how many frames "once" is saved, against
path tracing to the same error, both denoised.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from tests.benchmarks import living_room
from tests.benchmarks.living_room import Room
from tests.benchmarks.path import DEPTH
from tests.benchmarks.reference_pictures import (
    LARGE,
    SMALL,
    Plan,
    Reference,
    Render,
    Row,
    measured,
    note,
    reference,
    times_for,
)
from tiscene.render.film.denoise import denoise
from tiscene.render.film.postprocess import Postprocessor
from tiscene.render.film.tone_map import meter, tone_map
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache
from tiscene.render.integrators.incremental.incremental_pass import IncrementalImage, IncrementalPass
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene

T = TypeVar("T")
FRAMES = 6  # the first is counted among what is done once
PATHS = (4, 8)
CLEANERS = {"": Postprocessor("balanced", 1, True), ", fast": Postprocessor("fast", 2, True)}


def main(large: bool = False) -> None:
    """Print the tables. large: 640x480 in the place of 256x192, with a base image of fewer paths."""
    for matte in (False, True):
        table(living_room.room(FRAMES - 1, matte=matte), matte, LARGE if large else SMALL)


def table(room: Room, matte: bool, plan: Plan) -> None:
    """One line for each renderer and number of paths."""
    name = f"{'matte' if matte else 'glossy'} {plan.width}x{plan.height}"
    print(
        f"{name}, depth {DEPTH}, {plan.seeds} seeds, base images of {plan.base_spp} spp, references of {2 * plan.half}"
    )
    heads = ("once s", "ms", "relMSE", "gain", "+ OIDN ms", "relMSE", "gain", "PSNR", "pays")
    print(f"{'':>28} " + "{:>7} {:>7} {:>8} {:>13} {:>10} {:>8} {:>13} {:>6} {:>6}".format(*heads), flush=True)
    size = plan.width, plan.height
    ours = living_room.tiscene(room.description, *size, DEPTH)
    theirs = living_room.mitsuba(room.description, *size, DEPTH, glossy=not matte)
    note(f"{name}: reference")
    truth = reference(ours, plan.half)
    peers = [traced("path tracing", ours, plan, truth)]
    if theirs is not None:
        note(f"{name}: Mitsuba")
        peers.append(traced("Mitsuba LLVM", theirs, plan, truth if matte else reference(theirs, plan.half)))
    found: dict[str, list[Difference]] = {}
    for seed in range(1, plan.seeds + 1):
        note(f"{name}: differences, seed {seed}")
        for difference in differences(room, plan, truth, seed):
            found.setdefault(difference.name, []).append(difference)
    for label, each in found.items():
        columns = np.array([(one.wall, one.error, one.clean_wall, one.clean_error, one.once, one.psnr) for one in each])
        wall, error, clean_wall, clean_error, once, psnr = columns.mean(axis=0).tolist()
        line(label, Row(wall, 0.0, error, clean_wall, 0.0, clean_error), peers, once, psnr)


def traced(name: str, render: Render, plan: Plan, truth: Reference) -> list[Row]:
    """The rows of a renderer that traces each frame, printed as they are measured."""
    rows = []
    for spp in plan.samples:
        rows.append(measured(render, spp, plan.seeds, truth))
        line(f"{name}, {spp} spp", rows[-1])
    return rows


def line(name: str, row: Row, peers: list[list[Row]] | None = None, once: float = 0.0, psnr: float = 0.0) -> None:
    """Print a row. peers: those of path tracing, then of Mitsuba, that a difference is compared with."""
    first, raw, clean, last = f"{'':7}", "", "", ""
    if peers is not None:
        times = [times_for(row, each) for each in peers]
        raw = _gains([without / row.wall for without, _ in times])
        clean = _gains([both / row.clean_wall for _, both in times])
        saved = times[0][1] - row.clean_wall
        first, last = f"{once:7.1f}", f"{psnr:6.1f} {np.ceil(once / saved) if saved > 0.0 else np.inf:6.0f}"
    print(
        f"{name:>28} {first} {1e3 * row.wall:7.1f} {row.error:8.4f} {raw:>13}"
        f" {1e3 * row.clean_wall:10.1f} {row.clean_error:8.4f} {clean:>13} {last}",
        flush=True,
    )


def _gains(times: list[float]) -> str:
    return f"{times[0]:.1f}" + "".join(f" ({each:.1f})" for each in times[1:])


@dataclass(frozen=True)
class Difference:
    """What one seed gives: s, relMSE and dB."""

    name: str
    wall: float
    error: float
    clean_wall: float
    clean_error: float
    once: float
    psnr: float


def differences(room: Room, plan: Plan, truth: Reference, seed: int) -> Iterator[Difference]:
    """For each number of kept paths, and each way to denoise."""
    scene = DeviceScene()
    scene.add(room.description)
    camera = room.description.cameras[0]
    view = View(camera, camera, camera, plan.width, plan.height)
    exposure = meter(truth.image)
    shown = tone_map(denoise(truth.image, truth.albedo, truth.normal, "high"), exposure).astype(float)

    def prepare(replayed: IncrementalPass, frame: int, paths: int) -> None:
        replayed.prepare(
            view, room.placement(frame), room.moving,
            seed=seed, spp=paths, max_depth=DEPTH, base_spp=plan.base_spp,
        )  # fmt: skip

    def replay(replayed: IncrementalPass, paths: int, frames: range) -> IncrementalImage:
        for frame in frames:
            prepare(replayed, frame, paths)
            scene.place(room.placement(frame))
            image = replayed.render(room.moving)
        return image

    with tempfile.TemporaryDirectory() as folder:
        images = BaseImageCache(Path(folder))
        base, _ = timed(partial(prepare, IncrementalPass(scene, plan.width, plan.height, images=images), 0, 1))
        for paths in PATHS:  # they find the base image on disk
            replayed = IncrementalPass(scene, plan.width, plan.height, images=images)
            first, _ = timed(partial(replay, replayed, paths, range(1)))
            several, image = timed(partial(replay, replayed, paths, range(1, FRAMES)))
            wall = several / (FRAMES - 1)
            for name, cleaner in CLEANERS.items():
                best, _ = timed(partial(cleaner.difference, image))
                cleaning, radiance = timed(partial(cleaner.difference, image))
                noise = np.mean((tone_map(radiance, exposure) - shown) ** 2)
                yield Difference(
                    f"difference, {paths} paths{name}",
                    wall,
                    truth.error(image.hdr),
                    wall + cleaning,
                    truth.error(radiance),
                    base + first + best,
                    10.0 * float(np.log10(255.0**2 / noise)),
                )


def timed(work: Callable[[], T]) -> tuple[float, T]:
    """How long it takes, s, and what it gives."""
    began = time.perf_counter()
    result = work()
    return time.perf_counter() - began, result


if __name__ == "__main__":
    main()
