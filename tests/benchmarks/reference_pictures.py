# SPDX-License-Identifier: Apache-2.0
"""What tables of equal error are made of: errors against converged pictures, and the times beside them."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks import power_law
from tiscene.render.film.denoise import denoise

Image = NDArray[np.float32]
Render = Callable[[int, int], tuple[Image, Image, Image]]  # spp, seed -> radiance, albedo, normal
FILTER = "balanced"


@dataclass(frozen=True)
class Plan:
    """The size, how many seeds a row is the mean of, the spp of each half of the references, of the rows, of a base."""

    width: int
    height: int
    seeds: int
    half: int
    samples: tuple[int, ...]
    base_spp: int


SMALL = Plan(256, 192, seeds=3, half=128, samples=(4, 16, 64), base_spp=256)
LARGE = Plan(640, 480, seeds=2, half=24, samples=(4, 16), base_spp=64)


def note(text: str) -> None:
    """What is going on, for whoever waits: tables alone go to stdout."""
    print(f"  {text} ...", file=sys.stderr, flush=True)


@dataclass(frozen=True, eq=False)
class Reference:
    """A converged picture with its first hits, and the relMSE that is its own."""

    image: Image
    albedo: Image
    normal: Image
    noise: float

    def error(self, image: Image) -> float:
        """relMSE: squared error over squared reference plus 0.01, mean over pixels; the reference's noise taken off."""
        return max(_relative(image, self.image, self.image) - self.noise, 1e-6)


def reference(render: Render, half: int) -> Reference:
    """From two halves of so many samples, which tell its noise."""
    a, albedo, normal = render(half, 1001)
    b = render(half, 1002)[0]
    image = 0.5 * (a + b)
    return Reference(image, albedo, normal, 0.25 * _relative(a, b, image))


@dataclass(frozen=True)
class Row:
    """Of one picture, the mean over the seeds: s (wall, CPU) and relMSE, raw and denoised."""

    wall: float
    cpu: float
    error: float
    clean_wall: float
    clean_cpu: float
    clean_error: float


def measured(render: Render, spp: int, seeds: int, against: Reference) -> Row:
    """The mean of the seeds, after one picture of few samples that is not counted."""
    rows = []
    render(min(spp, 4), 0)
    for seed in range(1, seeds + 1):
        wall, cpu = time.perf_counter(), time.process_time()
        radiance, albedo, normal = render(spp, seed)
        raw = time.perf_counter() - wall, time.process_time() - cpu
        clean = denoise(radiance, albedo, normal, FILTER)
        both = time.perf_counter() - wall, time.process_time() - cpu
        rows.append((*raw, against.error(radiance), *both, against.error(clean)))
    return Row(*np.mean(rows, axis=0).tolist())


def times_for(row: Row, peer: list[Row]) -> tuple[float, float]:
    """How long another renderer takes for the errors of a row, raw and denoised: wall time, s, by its own rows."""
    raw = power_law.time_for(row.error, [(each.error, each.wall) for each in peer])
    return raw, power_law.time_for(row.clean_error, [(each.clean_error, each.clean_wall) for each in peer])


def cpu_for(row: Row, peer: list[Row]) -> tuple[float, float]:
    """The same in CPU time, which others on the machine disturb less."""
    raw = power_law.time_for(row.error, [(each.error, each.cpu) for each in peer])
    return raw, power_law.time_for(row.clean_error, [(each.clean_error, each.clean_cpu) for each in peer])


def _relative(image: Image, other: Image, reference: Image) -> float:
    return float(np.mean((image - other) ** 2 / (reference**2 + 1e-2)))
