# SPDX-License-Identifier: Apache-2.0
"""Incremental rendering with a fixed camera and three movers, compared with path tracing each frame and with Mitsuba.

`room_02` with three movers of the demo, in its own materials ("glossy") and in matte ones. Mitsuba's `principled`
differs from UsdPreviewSurface, so in the glossy room each renderer is compared with its own converged picture. In the
matte room both have the same. relMSE: squared error over squared reference plus 0.01, mean over pixels and seeds, of
the last timed frame, minus the reference's own noise as estimated from its two halves. PSNR: of that frame as
displayed, against the denoised reference. Times are means over frames or seeds. Base image and recorded paths are made
anew for every seed; "once" is the time that takes.

"gain": how many times less time than path tracing needs for the same relMSE, both without or both with the denoiser.
Between the measured samples and beyond them, error and time follow a power law. In brackets: compared with Mitsuba.
"pays": number of frames after which "once" is paid back, compared with path tracing to the same denoised error.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.benchmarks import shipped_rooms
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
from tests.benchmarks.shipped_rooms import Room
from tests.benchmarks.timing import timed
from tiscene.render.film.denoise import denoise
from tiscene.render.film.postprocess import Postprocessor
from tiscene.render.film.tone_map import auto_exposure, tone_map
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache
from tiscene.render.integrators.incremental.incremental_pass import IncrementalImage, IncrementalPass
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene

FRAMES = 6  # the first counts as a part of "once"
PATHS = (4, 8)
DENOISERS = {"": Postprocessor("balanced", 1, True), ", fast": Postprocessor("fast", 2, True)}


def main(large: bool = False) -> None:
    """Print the tables, at 256x192 or, if large, at 640x480 with a base image of fewer samples."""
    for matte in (False, True):
        table(shipped_rooms.living_room(FRAMES - 1, matte=matte), matte, LARGE if large else SMALL)


def table(room: Room, matte: bool, plan: Plan) -> None:
    """Print one line for each renderer and number of samples."""
    name = f"{'matte' if matte else 'glossy'} {plan.width}x{plan.height}"
    print(
        f"{name}, depth {DEPTH}, {plan.seeds} seeds, base images of {plan.base_spp} spp, references of {2 * plan.half}"
    )
    heads = ("once s", "ms", "relMSE", "gain", "+ OIDN ms", "relMSE", "gain", "PSNR", "pays")
    print(f"{'':>28} " + "{:>7} {:>7} {:>8} {:>13} {:>10} {:>8} {:>13} {:>6} {:>6}".format(*heads), flush=True)
    size = plan.width, plan.height
    ours = shipped_rooms.tiscene(room.description, *size, DEPTH)
    theirs = shipped_rooms.mitsuba(room.description, *size, DEPTH, glossy=not matte)
    note(f"{name}: reference")
    truth = reference(ours, plan.half)
    peers = [traced("path tracing", ours, plan, truth)]
    if theirs is not None:
        note(f"{name}: Mitsuba")
        peers.append(traced("Mitsuba LLVM", theirs, plan, truth if matte else reference(theirs, plan.half)))
    results: dict[str, list[IncrementalResult]] = {}
    for seed in range(1, plan.seeds + 1):
        note(f"{name}: incremental, seed {seed}")
        for result in incremental_results(room, plan, truth, seed):
            results.setdefault(result.name, []).append(result)
    for label, each in results.items():
        columns = np.array(
            [(one.wall, one.error, one.denoised_wall, one.denoised_error, one.once, one.psnr) for one in each]
        )
        wall, error, denoised_wall, denoised_error, once, psnr = columns.mean(axis=0).tolist()
        line(label, Row(wall, 0.0, error, denoised_wall, 0.0, denoised_error), peers, once, psnr)


def traced(name: str, render: Render, plan: Plan, truth: Reference) -> list[Row]:
    """Measure and print the rows of a renderer that traces each frame from scratch."""
    rows = []
    for spp in plan.samples:
        rows.append(measured(render, spp, plan.seeds, truth))
        line(f"{name}, {spp} spp", rows[-1])
    return rows


def line(name: str, row: Row, peers: list[list[Row]] | None = None, once: float = 0.0, psnr: float = 0.0) -> None:
    """Print a row.

    Args:
        name: first cell.
        row: times and errors.
        peers: rows of path tracing, then of Mitsuba, to compare with; None for a peer itself.
        once: time for base image and recorded paths, s.
        psnr: dB.
    """
    first, raw, denoised, last = f"{'':7}", "", "", ""
    if peers is not None:
        times = [times_for(row, each) for each in peers]
        raw = _gains([without / row.wall for without, _ in times])
        denoised = _gains([both / row.denoised_wall for _, both in times])
        saved = times[0][1] - row.denoised_wall
        first, last = f"{once:7.1f}", f"{psnr:6.1f} {np.ceil(once / saved) if saved > 0.0 else np.inf:6.0f}"
    print(
        f"{name:>28} {first} {1e3 * row.wall:7.1f} {row.error:8.4f} {raw:>13}"
        f" {1e3 * row.denoised_wall:10.1f} {row.denoised_error:8.4f} {denoised:>13} {last}",
        flush=True,
    )


def _gains(times: list[float]) -> str:
    return f"{times[0]:.1f}" + "".join(f" ({each:.1f})" for each in times[1:])


@dataclass(frozen=True)
class IncrementalResult:
    """Result of one seed: times in s, relMSE, PSNR in dB."""

    name: str
    wall: float
    error: float
    denoised_wall: float
    denoised_error: float
    once: float
    psnr: float


def incremental_results(room: Room, plan: Plan, truth: Reference, seed: int) -> Iterator[IncrementalResult]:
    """Render one seed with each number of recorded paths and each denoiser."""
    scene = DeviceScene()
    scene.add(room.description)
    camera = room.description.cameras[0]
    view = View(camera, camera, camera, plan.width, plan.height)
    exposure = auto_exposure(truth.image)
    shown = tone_map(denoise(truth.image, truth.albedo, truth.normal, "high"), exposure).astype(float)

    def prepare(renderer: IncrementalPass, frame: int, paths: int) -> None:
        renderer.prepare(
            view, room.placement(frame), room.moving,
            seed=seed, spp=paths, max_depth=DEPTH, base_spp=plan.base_spp,
        )  # fmt: skip

    def render_frames(renderer: IncrementalPass, paths: int, frames: range) -> IncrementalImage:
        for frame in frames:
            prepare(renderer, frame, paths)
            scene.place(room.placement(frame))
            image = renderer.render(room.moving)
        return image

    with tempfile.TemporaryDirectory() as folder:
        images = BaseImageCache(Path(folder))
        base, _, _ = timed(prepare, IncrementalPass(PathPass(scene, plan.width, plan.height), images=images), 0, 1)
        for paths in PATHS:  # each finds the base image on disk
            renderer = IncrementalPass(PathPass(scene, plan.width, plan.height), images=images)
            first, _, _ = timed(render_frames, renderer, paths, range(1))
            several, _, image = timed(render_frames, renderer, paths, range(1, FRAMES))
            wall = several / (FRAMES - 1)
            for name, denoiser in DENOISERS.items():
                best, _, _ = timed(denoiser.difference, image)
                denoising, _, radiance = timed(denoiser.difference, image)
                noise = np.mean((tone_map(radiance, exposure) - shown) ** 2)
                yield IncrementalResult(
                    f"incremental, {paths} paths{name}",
                    wall,
                    truth.error(image.hdr),
                    wall + denoising,
                    truth.error(radiance),
                    base + first + best,
                    10.0 * float(np.log10(255.0**2 / noise)),
                )


if __name__ == "__main__":
    main()
