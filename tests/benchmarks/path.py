# SPDX-License-Identifier: Apache-2.0
"""Path tracing against Mitsuba 3's `path`: the benchmark room and `room_02` at equal samples and depth.

Each round runs every renderer once, so that what else the machine does hits all alike. relMSE: squared error over
squared reference plus 0.01, mean over pixels; the reference is tiscene's own at many samples (their means agree:
tests/render/integrators/path/test_mitsuba.py).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks import living_room, peers
from tests.benchmarks.reference_pictures import Render
from tests.benchmarks.room import room
from tests.reference import mitsuba_scene

SIZES = ((256, 192), (640, 480))
SPP, DEPTH = 16, 5
ROUNDS = 5
REFERENCE_SPP = 512
VARIANTS = ("llvm_ad_rgb", "scalar_rgb")


@dataclass
class Renderer:
    """Something that renders with a seed, and how long it took."""

    name: str
    render: Callable[[int], NDArray[np.float32]]
    walls: list[float] = field(default_factory=list)
    cpus: list[float] = field(default_factory=list)
    image: NDArray[np.float32] | None = None

    def run(self, seed: int) -> None:
        wall, cpu = time.perf_counter(), time.process_time()
        self.image = self.render(seed)
        self.walls.append(time.perf_counter() - wall)
        self.cpus.append(time.process_time() - cpu)


def ours(width: int, height: int, spp: int = SPP) -> Callable[[int], NDArray[np.float32]]:
    """tiscene on the room."""
    return _picture_of(living_room.tiscene(room(), width, height, DEPTH), spp)


def mitsuba(variant: str, width: int, height: int) -> Callable[[int], NDArray[np.float32]] | None:
    """A variant of Mitsuba on the room; None where it is not installed."""
    mi = peers.mitsuba(variant)
    if mi is None:
        return None
    description = room()
    scene = mitsuba_scene.scene(mi, description, description.cameras[0], width, height, max_depth=DEPTH, spp=SPP)

    def render(seed: int) -> NDArray[np.float32]:
        mi.set_variant(variant)
        return np.array(mi.render(scene, spp=SPP, seed=seed))

    return render


def in_room_02() -> list[Renderer]:
    """Both in `room_02`, with first hits for a denoiser, which tiscene makes anyway."""
    description = living_room.room(0, matte=False).description
    renderers = {
        "tiscene": living_room.tiscene(description, *SIZES[0], DEPTH),
        f"mitsuba {VARIANTS[0]}": living_room.mitsuba(description, *SIZES[0], DEPTH, glossy=True),
    }
    return [Renderer(name, _picture_of(render)) for name, render in renderers.items() if render]


def _picture_of(render: Render, spp: int = SPP) -> Callable[[int], NDArray[np.float32]]:
    return lambda seed: render(spp, seed)[0]


def main() -> None:
    print(
        f"{'':>16} {'renderer':>20} {'wall ms':>9} {'CPU ms':>9} {'relMSE':>8} {'speed':>6}  ({SPP} spp, depth {DEPTH})"
    )
    for width, height in SIZES:
        variants = VARIANTS if (width, height) == SIZES[0] else VARIANTS[:1]
        renderers = [Renderer("tiscene", ours(width, height))]
        theirs = {variant: mitsuba(variant, width, height) for variant in variants}
        renderers += [Renderer(f"mitsuba {variant}", render) for variant, render in theirs.items() if render]
        race(renderers)
        reference = ours(width, height, REFERENCE_SPP)(99) if (width, height) == SIZES[0] else None
        lines(f"{width}x{height}", renderers, reference)
    renderers = in_room_02()
    race(renderers)
    lines(f"room_02 {SIZES[0][0]}x{SIZES[0][1]}", renderers, None)
    print("speed: tiscene's, as a multiple of the renderer's, by the shortest wall times")


def race(renderers: list[Renderer]) -> None:
    """Rounds after one that is not counted."""
    for renderer in renderers:
        renderer.render(0)
    for seed in range(1, ROUNDS + 1):
        for renderer in renderers:
            renderer.run(seed)


def lines(scene: str, renderers: list[Renderer], reference: NDArray[np.float32] | None) -> None:
    """One for each renderer."""
    for renderer in renderers:
        error = "-"
        if reference is not None and renderer.image is not None:
            error = f"{np.mean((renderer.image - reference) ** 2 / (reference**2 + 1e-2)):.4f}"
        ratio = min(renderer.walls) / min(renderers[0].walls)
        print(
            f"{scene:<16} {renderer.name:>20} {1e3 * min(renderer.walls):9.1f}"
            f" {1e3 * min(renderer.cpus):9.1f} {error:>8} {ratio:6.2f}",
            flush=True,
        )
