# SPDX-License-Identifier: Apache-2.0
"""Path tracing compared with Mitsuba 3's `path`: `room_02` and the benchmark room at equal samples and path depth.

Each round runs every renderer once, so that other load on the machine affects all alike. relMSE: squared error over
squared reference plus 0.01, mean over pixels. The reference is tiscene's own at many samples; the means of both
renderers agree (tests/render/integrators/path/test_mitsuba.py).
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
    """A renderer of one scene, with the times of its runs.

    Attributes:
        name: name in the table.
        render: function from a seed to float32 [h, w, 3].
        walls: wall time of each run, s.
        cpus: CPU time of each run, s.
        image: picture of the last run.
    """

    name: str
    render: Callable[[int], NDArray[np.float32]]
    walls: list[float] = field(default_factory=list)
    cpus: list[float] = field(default_factory=list)
    image: NDArray[np.float32] | None = None

    def run(self, seed: int) -> None:
        """Render once and record the times."""
        wall, cpu = time.perf_counter(), time.process_time()
        self.image = self.render(seed)
        self.walls.append(time.perf_counter() - wall)
        self.cpus.append(time.process_time() - cpu)


def ours(width: int, height: int, spp: int = SPP) -> Callable[[int], NDArray[np.float32]]:
    """Return a function that renders the benchmark room with tiscene."""
    return _picture_of(living_room.tiscene(room(), width, height, DEPTH), spp)


def mitsuba(variant: str, width: int, height: int) -> Callable[[int], NDArray[np.float32]] | None:
    """Return a function that renders the benchmark room with a variant of Mitsuba; None if it is not installed."""
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
    """Return both renderers of `room_02`. Mitsuba also renders first hits for a denoiser, as tiscene always does."""
    description = living_room.room(0, matte=False).description
    renderers = {
        "tiscene": living_room.tiscene(description, *SIZES[0], DEPTH),
        f"mitsuba {VARIANTS[0]}": living_room.mitsuba(description, *SIZES[0], DEPTH, glossy=True),
    }
    return [Renderer(name, _picture_of(render)) for name, render in renderers.items() if render]


def _picture_of(render: Render, spp: int = SPP) -> Callable[[int], NDArray[np.float32]]:
    return lambda seed: render(spp, seed)[0]


def main() -> None:
    """Print the table."""
    print(
        f"{'':>16} {'renderer':>20} {'wall ms':>9} {'CPU ms':>9} {'relMSE':>8} {'speed':>6}  ({SPP} spp, depth {DEPTH})"
    )
    renderers = in_room_02()
    race(renderers)
    lines(f"room_02 {SIZES[0][0]}x{SIZES[0][1]}", renderers, None)
    for width, height in SIZES:
        variants = VARIANTS if (width, height) == SIZES[0] else VARIANTS[:1]
        renderers = [Renderer("tiscene", ours(width, height))]
        theirs = {variant: mitsuba(variant, width, height) for variant in variants}
        renderers += [Renderer(f"mitsuba {variant}", render) for variant, render in theirs.items() if render]
        race(renderers)
        reference = ours(width, height, REFERENCE_SPP)(99) if (width, height) == SIZES[0] else None
        lines(f"{width}x{height}", renderers, reference)
    print("speed: of tiscene relative to the renderer, by the shortest wall times")


def race(renderers: list[Renderer]) -> None:
    """Run all renderers in turn, ROUNDS times after a warm-up run."""
    for renderer in renderers:
        renderer.render(0)
    for seed in range(1, ROUNDS + 1):
        for renderer in renderers:
            renderer.run(seed)


def lines(scene: str, renderers: list[Renderer], reference: NDArray[np.float32] | None) -> None:
    """Print one line per renderer. The first renderer is the one that speeds refer to."""
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
