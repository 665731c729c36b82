# SPDX-License-Identifier: Apache-2.0
"""Path tracing of the shipped rooms compared with Mitsuba 3's `path` (LLVM), at equal samples and path depth.

Materials are the rooms' own: Mitsuba's are `principled`. Each round runs both renderers once, so that other load on the
machine affects both. Mitsuba also renders first hits for a denoiser, as tiscene always does. Equal samples are not
equal errors: see `stills`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from tests.benchmarks import shipped_rooms
from tests.benchmarks.reference_pictures import Render
from tests.benchmarks.timing import timed

SIZES = ((256, 192), (640, 480))
SPP, DEPTH = 16, 5
ROUNDS = 5


@dataclass
class Renderer:
    """A renderer of one scene, with the times of its runs.

    Attributes:
        name: name in the table.
        render: renders a picture.
        walls: wall time of each run, s.
        cpus: CPU time of each run, s.
    """

    name: str
    render: Render
    walls: list[float] = field(default_factory=list)
    cpus: list[float] = field(default_factory=list)

    def run(self, seed: int) -> None:
        """Render once and record the times."""
        wall, cpu, _ = timed(self.render, SPP, seed)
        self.walls.append(wall)
        self.cpus.append(cpu)


def main(scenes: Sequence[str] = shipped_rooms.ROOMS) -> None:
    """Print the table of scenes."""
    print(f"{'':>16} {'renderer':>8} {'wall ms':>9} {'CPU ms':>9} {'speed':>6}  ({SPP} spp, depth {DEPTH})")
    for name in scenes:
        room = shipped_rooms.still_room(name, matte=False).description
        for width, height in SIZES:
            renderers = [Renderer("tiscene", shipped_rooms.tiscene(room, width, height, DEPTH))]
            mitsuba = shipped_rooms.mitsuba(room, width, height, DEPTH, glossy=True)
            renderers += [Renderer("Mitsuba", mitsuba)] if mitsuba else []
            race(renderers)
            lines(f"{name} {width}x{height}", renderers)
    print("speed: of tiscene relative to the renderer, by the shortest wall times")


def race(renderers: list[Renderer]) -> None:
    """Run all renderers in turn, ROUNDS times after a warm-up run."""
    for renderer in renderers:
        renderer.render(SPP, 0)
    for seed in range(1, ROUNDS + 1):
        for renderer in renderers:
            renderer.run(seed)


def lines(scene: str, renderers: list[Renderer]) -> None:
    """Print one line per renderer. The first renderer is the one that speeds refer to."""
    for renderer in renderers:
        ratio = min(renderer.walls) / min(renderers[0].walls)
        print(
            f"{scene:<16} {renderer.name:>8} {1e3 * min(renderer.walls):9.1f} {1e3 * min(renderer.cpus):9.1f}"
            f" {ratio:6.2f}",
            flush=True,
        )
