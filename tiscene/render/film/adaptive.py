# SPDX-License-Identifier: Apache-2.0
"""Adaptive sampling: paths in rounds, pixel by pixel until the error of each is estimated to be small enough.

A round is two nets of points, scrambled apart, whose difference tells their error without a bias. One pixel's
differences tell little, and to stop where they happen to be small would favor pictures that lack what is rare: a
decision looks at the pixel's neighborhood and takes the worst pixel around. It is a pure function of the picture so
far, and the picture is one of (scene, view, frame, seed, error, most).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import ArgumentError
from tiscene.render.film.tone_map import LUMINANCE
from tiscene.render.integrators.path.path_pass import PathImage, PathPass
from tiscene.render.integrators.path.path_state import DROPPED, FILM_COLUMNS
from tiscene.render.intersect.ray_queue import tiled_order
from tiscene.render.sampling.sobol import frame_key
from tiscene.render.view import View

FIRST_NET = 8  # paths per pixel; every other round they are twice as many
RADIUS = 2  # px, of the neighborhood that shares its scatter
REACH = 2  # px, how far a pixel that needs more keeps others going
DARKEST = 0.1  # of the picture's mean luminance: what is darker may err as much as that would


@dataclass(frozen=True, eq=False)
class AdaptiveImage(PathImage):
    """samples: int32 [height, width], paths through each pixel. variance: float64 [height, width], an unbiased estimate
    of that of the pixel's luminance, by its own paths; decisions take what is around into account."""

    samples: NDArray[np.int32]
    variance: NDArray[np.float64]


def render_to_error(
    paths: PathPass, view: View, *, frame_index: int, seed: int, error: float, most: int, max_depth: int
) -> AdaptiveImage:
    """A picture whose pixels are each expected to be off by `error` of their luminance at most (one standard error).

    most: paths per pixel, where the error is still larger; whole rounds of them, and the first (16) in any case.
    Raises ArgumentError for numbers out of range.
    """
    if not 0.0 < error < 1.0:
        raise ArgumentError(f"error={error}: must lie between 0 and 1")
    height, width = view.height, view.width
    order = tiled_order(width, height)
    sums = np.zeros((height * width, FILM_COLUMNS))
    scatter = np.zeros(height * width)
    samples = np.zeros(height * width, np.int32)
    pixels, number, reached = order, 0, 0
    while len(pixels):
        net = FIRST_NET << number // 2
        if number and reached + 2 * net > most:
            break
        pair = []
        for half in (0, 1):
            key = net_key(seed, frame_index, 2 * number + half)
            rows = paths.sums(view, pixels, spp=net, key=key, max_depth=max_depth)
            pair.append(rows[:, :3].astype(np.float64) @ LUMINANCE)
            sums[pixels] += rows
        scatter[pixels] += (pair[0] - pair[1]) ** 2
        samples[pixels] += 2 * net
        number, reached = number + 1, reached + 2 * net
        light = (sums[:, :3] @ LUMINANCE).reshape(height, width)
        wanted = estimated_error(light, scatter.reshape(height, width), samples.reshape(height, width)) > error
        pixels = order[wanted.ravel()[order] & (samples[order] == reached)]
    counts = samples[:, None]
    kept = np.maximum(counts - sums[:, DROPPED:], 1.0)
    paths.nonfinite = int(sums[:, DROPPED].sum())
    hdr, albedo, normal = (
        (part / count).astype(np.float32).reshape(height, width, 3)
        for part, count in ((sums[:, :3], kept), (sums[:, 3:6], counts), (sums[:, 6:9], counts))
    )
    variance = (scatter / samples.astype(np.float64) ** 2).reshape(height, width)
    return AdaptiveImage(hdr, albedo, normal, samples.reshape(height, width), variance)


def net_key(seed: int, frame_index: int, number: int) -> int:
    """The key of the random numbers of a net."""
    return frame_key(frame_key(seed, frame_index), number)


def estimated_error(
    light: NDArray[np.float64], scatter: NDArray[np.float64], samples: NDArray[np.int32]
) -> NDArray[np.float64]:
    """The standard error of each pixel's luminance, as a part of it, and of the worst pixel around it, [h, w].

    light: sum of the luminance of all paths. scatter: sum over the rounds of the square of the difference that the two
    nets made to it, which is the variance of what they make together.
    """
    luminance = np.abs(light) / samples
    level = np.maximum(_mean_around(luminance), DARKEST * luminance.mean())
    variance = _mean_around(scatter / samples.astype(np.float64) ** 2)
    return np.sqrt(_most_around(np.where(level > 0.0, variance / np.maximum(level, 1e-30) ** 2, 0.0)))


def _windows(image: NDArray[np.float64], radius: int) -> NDArray[np.float64]:
    padded = np.pad(image, radius, mode="edge")
    size = 2 * radius + 1
    return np.lib.stride_tricks.sliding_window_view(padded, (size, size))


def _mean_around(image: NDArray[np.float64]) -> NDArray[np.float64]:
    mean: NDArray[np.float64] = _windows(image, RADIUS).mean(axis=(2, 3))
    return mean


def _most_around(image: NDArray[np.float64]) -> NDArray[np.float64]:
    most: NDArray[np.float64] = _windows(image, REACH).max(axis=(2, 3))
    return most
