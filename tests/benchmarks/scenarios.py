# SPDX-License-Identifier: Apache-2.0
"""Thousands of small scenarios in one process: memory and processor time of the first, the last, and their frames.

24 label frames of 64 x 48 of each, over three scenes, as `npz`; `python -m tests.benchmarks.scenarios N` for another
number of scenarios. "frames alone": of each scenario the median frame after the first, rendered and written, times the
number of frames. Memory is the largest of a hundred scenarios, since three scenes have different sizes.
"""

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.stress.process_resources import resident_memory
from tiscene.export.generation.generator import generate
from tiscene.export.generation.recipe import Recipe

SCENARIOS, FRAMES = 2000, 24
RECIPE = {
    "scenes": ["object_view", "solid_benchmark", "room_02"],
    "ranges": {"objects": [1, 3], "depth": [1.0, 4.0]},
    "frames": FRAMES,
    "settings": {"width": 64, "height": 48, "buffers": ["semantic", "instance", "depth", "forward_flow"]},
    "format": "npz",
    "seed": 1,
}


@dataclass(frozen=True)
class Measured:
    """What a process used.

    Attributes:
        seconds: Processor time of each scenario.
        frames: Processor time of each frame after the first, by scenario.
        memory: Resident bytes after each scenario.
    """

    seconds: list[float]
    frames: list[list[float]]
    memory: list[int]

    def overhead(self) -> float:
        """Return the time of the second half of the scenarios, over that of their frames alone.

        Templates are read, measured and covered by spheres in the first half.
        """
        half = len(self.seconds) // 2
        return sum(self.seconds[half:]) / sum(FRAMES * float(np.median(each)) for each in self.frames[half:])

    def drift(self) -> float:
        """Return the median time of the last hundred scenarios over that of the first hundred."""
        return float(np.median(self.seconds[-100:]) / np.median(self.seconds[:100]))

    def growth(self) -> float:
        """Return the largest memory of the last hundred scenarios over that of the second hundred."""
        return max(self.memory[-100:]) / max(self.memory[100:200] or self.memory)


def measure(folder: str | Path, count: int) -> Measured:
    """Generate a data set, and measure."""
    measured = Measured([], [], [])
    began = last = time.process_time()
    frames: list[float] = []

    def step(number: int, frame: int | None) -> None:
        nonlocal began, last, frames
        now = time.process_time()
        if frame is None:
            measured.seconds.append(now - began)
            measured.memory.append(resident_memory())
            measured.frames.append(frames)
            began, frames = now, []
            if number % 100 == 99:
                print(f"{number + 1} scenarios, {measured.memory[-1] / 1e6:.0f} MB", file=sys.stderr, flush=True)
        elif frame > 0:
            frames.append(now - last)
        last = now

    generate(Recipe.from_json(RECIPE), folder, count, progress=step)
    return measured


def main(count: int = SCENARIOS) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        measured = measure(folder, count)
    times = np.array(measured.seconds) * 1e3
    print(f"processor time per scenario, median: {np.median(times[:100]):.0f} ms of the first hundred, ", end="")
    print(f"{np.median(times[-100:]):.0f} ms of the last ({measured.drift():.2f} times)")
    for first in range(0, count, max(100, count // 10 // 100 * 100)):
        part = slice(first, first + 100)
        memory = np.array(measured.memory[part]) / 1e6
        print(f"scenarios from {first}: {np.median(times[part]):.0f} ms, {memory.max():.0f} MB at most")
    print(f"memory: {measured.growth():.3f} times as much at the end as in the second hundred")
    frames = np.concatenate([np.array(each) for each in measured.frames])
    print(f"per frame: {np.median(frames) * 1e3:.1f} ms; scenarios of the second half: ", end="")
    print(f"{measured.overhead():.2f} times their frames alone")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else SCENARIOS)
