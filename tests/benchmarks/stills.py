"""Stills of `room_02` against Mitsuba 3's `path` (LLVM): the time for the same error, both denoised by the same OIDN.

Each renderer denoises by its own albedo and normal of the first hit, whose cost is in its time (Mitsuba's `aov`
integrator). "matte": both are measured against one converged picture, tiscene's; "glossy": materials are Mitsuba's
`principled`, which is not quite UsdPreviewSurface, so that each is measured against its own. relMSE: squared error over
squared reference plus 0.01, mean over pixels and seeds; the reference's own noise, which its two halves tell, is taken
off. "time": tiscene's, as a part of Mitsuba's for the same error, by the power law between or beyond 4, 16 and 64 spp.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks import living_room
from tests.benchmarks.power_law import time_for
from tests.benchmarks.room import still
from tests.reference import mitsuba_scene
from tiscene.render.denoise import denoise
from tiscene.render.integrators.path import PathPass
from tiscene.render.view import View
from tiscene.scene.description import SceneDescription
from tiscene.scene.device_scene import DeviceScene

# width, height, seeds, spp of each half of the reference
SIZES = ((256, 192, 3, 256), (640, 480, 1, 48))
SAMPLES = (4, 16, 64)
DEPTH = 6
FILTER = "balanced"

Image = NDArray[np.float32]
Render = Callable[[int, int], tuple[Image, Image, Image]]  # spp, seed -> radiance, albedo, normal


@dataclass(frozen=True)
class Reference:
    """A converged picture, and the relMSE that is its own."""

    image: Image
    noise: float

    def error(self, image: Image) -> float:
        return max(_relative(image, self.image, self.image) - self.noise, 1e-6)


@dataclass(frozen=True)
class Row:
    """Means over the seeds: s and relMSE, raw and denoised."""

    seconds: float
    error: float
    clean_seconds: float
    clean_error: float


def main() -> None:
    """Print the tables."""
    for matte in (True, False):
        room, _ = living_room.room(0, matte=matte)
        for width, height, seeds, half in SIZES:
            table(room, matte, width, height, seeds, half)


def table(room: SceneDescription, matte: bool, width: int, height: int, seeds: int, half: int) -> None:
    """One line for each renderer and number of samples."""
    print(f"{'matte' if matte else 'glossy'} {width}x{height}, depth {DEPTH}")
    print(f"{'':>8} {'spp':>4} {'ms':>7} {'relMSE':>8} {'time':>6} {'+ OIDN':>8} {'relMSE':>8} {'time':>6}")
    renderers = {"tiscene": ours(room, width, height), "Mitsuba": mitsuba(room, width, height, glossy=not matte)}
    own = reference(renderers["tiscene"], half)
    theirs = own if matte else reference(renderers["Mitsuba"], half)
    rows = {
        name: [measured(render, spp, seeds, against) for spp in SAMPLES]
        for (name, render), against in zip(renderers.items(), (own, theirs), strict=True)
    }
    peer = rows["Mitsuba"]
    for name, mine in rows.items():
        for spp, row in zip(SAMPLES, mine, strict=True):
            parts = ["", ""]
            if mine is not peer:
                raw = time_for(row.error, [(each.error, each.seconds) for each in peer])
                clean = time_for(row.clean_error, [(each.clean_error, each.clean_seconds) for each in peer])
                parts = [f"{row.seconds / raw:.2f}", f"{row.clean_seconds / clean:.2f}"]
            print(
                f"{name:>8} {spp:4} {1e3 * row.seconds:7.0f} {row.error:8.4f} {parts[0]:>6}"
                f" {1e3 * row.clean_seconds:8.0f} {row.clean_error:8.4f} {parts[1]:>6}",
                flush=True,
            )
    print(f"means: tiscene {own.image.mean():.4f}, Mitsuba {renderers['Mitsuba'](SAMPLES[-1], 0)[0].mean():.4f}")


def ours(room: SceneDescription, width: int, height: int) -> Render:
    """tiscene on the room."""
    scene = DeviceScene()
    scene.add(room)
    scene.place(still(room))
    camera = room.cameras[0]
    view = View(camera, camera, camera, width, height)
    paths = PathPass(scene, width, height)

    def render(spp: int, seed: int) -> tuple[Image, Image, Image]:
        image = paths.render(view, frame_index=0, seed=seed, spp=spp, max_depth=DEPTH)
        return image.hdr, image.albedo, image.normal

    return render


def mitsuba(room: SceneDescription, width: int, height: int, *, glossy: bool) -> Render:
    """Mitsuba on the room."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    scene = mitsuba_scene.scene(
        mi, room, room.cameras[0], width, height, max_depth=DEPTH, spp=SAMPLES[0], glossy=glossy, guides=True
    )

    def render(spp: int, seed: int) -> tuple[Image, Image, Image]:
        channels = np.array(mi.render(scene, spp=spp, seed=seed), np.float32)
        return channels[..., :3], channels[..., 3:6], channels[..., 6:9]

    return render


def reference(render: Render, half: int) -> Reference:
    """From two halves of so many samples."""
    a, b = render(half, 1001)[0], render(half, 1002)[0]
    image = 0.5 * (a + b)
    return Reference(image, 0.25 * _relative(a, b, image))


def measured(render: Render, spp: int, seeds: int, against: Reference) -> Row:
    """The mean of the seeds, after one that is not counted."""
    rows = []
    render(spp, 0)
    for seed in range(1, seeds + 1):
        began = time.perf_counter()
        radiance, albedo, normal = render(spp, seed)
        seconds = time.perf_counter() - began
        clean = denoise(radiance, albedo, normal, FILTER)
        clean_seconds = time.perf_counter() - began
        rows.append((seconds, against.error(radiance), clean_seconds, against.error(clean)))
    return Row(*np.mean(rows, axis=0).tolist())


def _relative(image: Image, other: Image, reference: Image) -> float:
    return float(np.mean((image - other) ** 2 / (reference**2 + 1e-2)))


if __name__ == "__main__":
    main()
