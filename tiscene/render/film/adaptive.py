# SPDX-License-Identifier: Apache-2.0
"""Adaptive sampling: rounds of samples until the estimated error of each pixel is below a threshold.

A round consists of two independently scrambled digital nets; their difference is an unbiased estimate of the error. The
estimate of a single pixel is noisy, and stopping where it happens to be small would bias the image against rare light
paths: decisions use the mean over a neighborhood, and the worst pixel around. They are a function of the image so far,
so that the image is a function of (scene, view, frame, seed, threshold, maximum).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError
from tiscene.render.integrators.path.path_image import PathImage
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_state import DROPPED, FILM_COLUMNS
from tiscene.render.intersect.ray_queue import tiled_order
from tiscene.render.sampling.sobol import frame_key
from tiscene.render.view import View
from tiscene.scene.color import LUMINANCE

FIRST_NET_SPP = 8  # samples per pixel of each net; doubled every other round
RADIUS = 2  # px, of the neighborhood over which variance is averaged
DILATION = 2  # px around a pixel above the threshold in which sampling continues
MIN_LUMINANCE = 0.1  # of the image's mean; darker pixels are allowed the absolute error of this luminance


@dataclass(frozen=True, eq=False)
class AdaptiveImage(PathImage):
    """A PathImage with the outcome of adaptive sampling.

    Attributes:
        samples: int32 [height, width], samples of each pixel.
        variance: float64 [height, width], unbiased estimate of the variance of each pixel's luminance.
    """

    samples: NDArray[np.int32]
    variance: NDArray[np.float64]


def render_to_error(
    paths: PathPass, view: View, *, frame_index: int, seed: int, relative_error: float, max_spp: int, max_depth: int
) -> AdaptiveImage:
    """Render an image with at most a relative standard error per pixel.

    Args:
        paths: The integrator.
        view: Camera and size.
        frame_index: Part of the random seed.
        seed: Part of the random seed.
        relative_error: Threshold of the standard error over the luminance, 0..1, exclusive.
        max_spp: Maximum of samples per pixel. Only whole rounds are rendered, and the first (16) in any case.
        max_depth: Of paths.

    Raises:
        ArgumentError: relative_error is out of range.
    """
    if not 0.0 < relative_error < 1.0:
        raise ArgumentError(f"relative_error={relative_error}: must be between 0 and 1, exclusive")
    height, width = view.height, view.width
    order = tiled_order(width, height)
    sums = np.zeros((height * width, FILM_COLUMNS))
    squared_differences = np.zeros(height * width)
    samples = np.zeros(height * width, np.int32)
    pixels, round_number, total_spp = order, 0, 0
    while len(pixels):
        net = FIRST_NET_SPP << round_number // 2
        if round_number and total_spp + 2 * net > max_spp:
            break
        pair = []
        for half in (0, 1):
            key = net_key(seed, frame_index, 2 * round_number + half)
            rows = paths.sums(view, pixels, spp=net, key=key, max_depth=max_depth)
            pair.append(rows[:, :3].astype(np.float64) @ LUMINANCE)
            sums[pixels] += rows
        squared_differences[pixels] += (pair[0] - pair[1]) ** 2
        samples[pixels] += 2 * net
        round_number, total_spp = round_number + 1, total_spp + 2 * net
        light = (sums[:, :3] @ LUMINANCE).reshape(height, width)
        unfinished = (
            estimated_error(light, squared_differences.reshape(height, width), samples.reshape(height, width))
            > relative_error
        )
        pixels = order[unfinished.ravel()[order] & (samples[order] == total_spp)]
    counts = samples[:, None]
    kept = np.maximum(counts - sums[:, DROPPED:], 1.0)
    paths.nonfinite = int(sums[:, DROPPED].sum())
    hdr, albedo, normal = (
        (part / count).astype(np.float32).reshape(height, width, 3)
        for part, count in ((sums[:, :3], kept), (sums[:, 3:6], counts), (sums[:, 6:9], counts))
    )
    variance = (squared_differences / samples.astype(np.float64) ** 2).reshape(height, width)
    return AdaptiveImage(hdr, albedo, normal, samples.reshape(height, width), variance)


def net_key(seed: int, frame_index: int, round_number: int) -> int:
    """Return the key of the random numbers of a net."""
    return frame_key(frame_key(seed, frame_index), round_number)


def estimated_error(
    light: NDArray[np.float64], squared_differences: NDArray[np.float64], samples: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Return the relative standard error of the worst pixel around each pixel, float64 [h, w].

    Args:
        light: [h, w], sum of the luminance of all samples.
        squared_differences: [h, w], sum over the rounds of the squared difference between the sums of the two nets,
            which is the variance of their total.
        samples: [h, w].
    """
    luminance = np.abs(light) / samples
    level = np.maximum(_mean_around(luminance), MIN_LUMINANCE * luminance.mean())
    variance = _mean_around(squared_differences / samples.astype(np.float64) ** 2)
    return np.sqrt(_maximum_around(np.where(level > 0.0, variance / np.maximum(level, 1e-30) ** 2, 0.0)))


def _windows(image: NDArray[np.float64], radius: int) -> NDArray[np.float64]:
    """Return the square neighborhood of each pixel, [h, w, 2 radius + 1, 2 radius + 1]."""
    padded = np.pad(image, radius, mode="edge")
    size = 2 * radius + 1
    return np.lib.stride_tricks.sliding_window_view(padded, (size, size))


def _mean_around(image: NDArray[np.float64]) -> NDArray[np.float64]:
    mean: NDArray[np.float64] = _windows(image, RADIUS).mean(axis=(2, 3))
    return mean


def _maximum_around(image: NDArray[np.float64]) -> NDArray[np.float64]:
    maximum: NDArray[np.float64] = _windows(image, DILATION).max(axis=(2, 3))
    return maximum
