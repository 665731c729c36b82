# SPDX-License-Identifier: Apache-2.0
"""Errors against converged pictures, and times to equal error, for the tables of several benchmarks."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks import power_law
from tests.benchmarks.timing import timed
from tiscene.render.film.denoise import denoise

Image = NDArray[np.float32]
Render = Callable[[int, int], tuple[Image, Image, Image]]  # spp, seed -> radiance, albedo, normal
FILTER = "balanced"


@dataclass(frozen=True)
class Plan:
    """Size and samples of a benchmark.

    Attributes:
        width: px.
        height: px.
        seeds: number of seeds that a row is the mean of.
        half: samples per pixel of each of the two halves of a reference.
        samples: samples per pixel of the rows.
        base_spp: samples per pixel of a base image.
    """

    width: int
    height: int
    seeds: int
    half: int
    samples: tuple[int, ...]
    base_spp: int


SMALL = Plan(256, 192, seeds=3, half=128, samples=(4, 16, 64), base_spp=256)
LARGE = Plan(640, 480, seeds=2, half=24, samples=(4, 16), base_spp=64)


def note(text: str) -> None:
    """Print progress to stderr; stdout has the tables only."""
    print(f"  {text} ...", file=sys.stderr, flush=True)


@dataclass(frozen=True, eq=False)
class Reference:
    """A converged picture with its first hits.

    Attributes:
        image: radiance, float32 [h, w, 3].
        albedo: albedo of the first hits.
        normal: normal of the first hits.
        noise: relMSE of the reference itself.
    """

    image: Image
    albedo: Image
    normal: Image
    noise: float

    def error(self, image: Image) -> float:
        """Return the relMSE of an image minus the reference's noise: squared error over squared reference plus 0.01."""
        return max(_relative(image, self.image, self.image) - self.noise, 1e-6)


def reference(render: Render, half: int) -> Reference:
    """Render a reference as two halves of `half` samples per pixel each, whose difference gives its noise."""
    a, albedo, normal = render(half, 1001)
    b = render(half, 1002)[0]
    image = 0.5 * (a + b)
    return Reference(image, albedo, normal, 0.25 * _relative(a, b, image))


@dataclass(frozen=True)
class Row:
    """Times and errors of one renderer at one number of samples, mean over the seeds.

    Attributes:
        wall: wall time of the raw picture, s.
        cpu: its CPU time, s.
        error: its relMSE.
        denoised_wall: wall time including the denoiser, s.
        denoised_cpu: CPU time including the denoiser, s.
        denoised_error: relMSE of the denoised picture.
    """

    wall: float
    cpu: float
    error: float
    denoised_wall: float
    denoised_cpu: float
    denoised_error: float


def measured(render: Render, spp: int, seeds: int, against: Reference) -> Row:
    """Render all seeds and return their mean, after a warm-up picture of few samples."""
    rows = []
    render(min(spp, 4), 0)
    for seed in range(1, seeds + 1):
        wall, cpu, picture = timed(render, spp, seed)
        denoising_wall, denoising_cpu, denoised = timed(denoise, *picture, FILTER)
        both = wall + denoising_wall, cpu + denoising_cpu
        rows.append((wall, cpu, against.error(picture[0]), *both, against.error(denoised)))
    return Row(*np.mean(rows, axis=0).tolist())


def times_for(row: Row, peer: list[Row]) -> tuple[float, float]:
    """Return the wall times that another renderer needs for the errors of a row, raw and denoised, s."""
    raw = power_law.time_for(row.error, [(each.error, each.wall) for each in peer])
    return raw, power_law.time_for(row.denoised_error, [(each.denoised_error, each.denoised_wall) for each in peer])


def cpu_for(row: Row, peer: list[Row]) -> tuple[float, float]:
    """Return the same as CPU times, which depend less on the load of the machine."""
    raw = power_law.time_for(row.error, [(each.error, each.cpu) for each in peer])
    return raw, power_law.time_for(row.denoised_error, [(each.denoised_error, each.denoised_cpu) for each in peer])


def _relative(image: Image, other: Image, reference: Image) -> float:
    return float(np.mean((image - other) ** 2 / (reference**2 + 1e-2)))
