# SPDX-License-Identifier: Apache-2.0
"""Adaptive sampling: the requested error in every region, at lower cost, reproducible."""

import hashlib
import math
import subprocess
import sys

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from tests.render.path_scenes import described, device_scene, matte, quad, towards
from tiscene.errors import ArgumentError
from tiscene.render.film.adaptive import FIRST_NET_SPP, MIN_LUMINANCE, AdaptiveImage, estimated_error, render_to_error
from tiscene.render.film.tone_map import LUMINANCE
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import DomeLight, RectLight

WIDTH, HEIGHT = 48, 32
CAMERA = Camera.look_at((0.0, 1.0, 3.0), (0.2, 0.6, -1.0))
VIEW = View(CAMERA, CAMERA, CAMERA, WIDTH, HEIGHT)


def paths() -> PathPass:
    """Return a path tracer of a scene with low variance (constant sky) and high variance (soft shadow under a roof)."""
    meshes = [
        quad((-6, 0, 2), (6, 0, 2), (6, 0, -6), (-6, 0, -6)),
        quad((-6, 0, -3), (6, 0, -3), (6, 5, -3), (-6, 5, -3)),
        quad((0.2, 0.6, -2.8), (2.5, 0.6, -2.8), (2.5, 0.6, -0.5), (0.2, 0.6, -0.5)),
    ]
    lamp = RectLight("lamp", "/lamp", towards((0.5, 2.0, -0.2), (0.3, -1.0, -0.6)), (30.0, 30.0, 30.0), 0.3, 0.3)
    sky = DomeLight("sky", "/sky", np.eye(4), (0.6, 0.6, 0.6))
    return PathPass(device_scene(described(meshes, [matte("white", (0.7, 0.7, 0.7))], [lamp, sky])), WIDTH, HEIGHT)


def render_to(passes: PathPass, error: float, max_spp: int = 2048, seed: int = 1) -> AdaptiveImage:
    return render_to_error(passes, VIEW, frame_index=3, seed=seed, relative_error=error, max_spp=max_spp, max_depth=4)


def luminance(hdr: NDArray[np.float32]) -> NDArray[np.float64]:
    result: NDArray[np.float64] = hdr.astype(np.float64) @ np.array(LUMINANCE)
    return result


@pytest.mark.slow
def test_error_threshold_holds_everywhere_at_lower_cost() -> None:
    passes = paths()
    exact = luminance(passes.render(VIEW, frame_index=0, seed=9, spp=8192, max_depth=4).hdr)
    scale = np.maximum(exact, MIN_LUMINANCE * exact.mean())

    def errors(hdr: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the root mean square of the relative error, of blocks of 8 x 8 px."""
        relative = (luminance(hdr) - exact) / scale
        blocks: NDArray[np.float64] = np.sqrt((relative.reshape(HEIGHT // 8, 8, WIDTH // 8, 8) ** 2).mean(axis=(1, 3)))
        return blocks

    image = render_to(passes, 0.05)
    assert image.samples.max() < 2048  # the cap decided nothing
    assert image.samples.min() < 0.2 * image.samples.max()
    assert 0.02 < np.sqrt((errors(image.hdr) ** 2).mean()) < 0.05
    assert errors(image.hdr).max() < 0.05 * 1.15
    bias = ((luminance(image.hdr) - exact) / scale).mean()
    assert abs(bias) < 0.003
    fixed = passes.render(VIEW, frame_index=3, seed=1, spp=int(1.5 * image.samples.mean()), max_depth=4)
    assert errors(fixed.hdr).max() > errors(image.hdr).max()  # half as many again, spread evenly, leave more


def test_samples_are_within_cap_and_minimum() -> None:
    passes = paths()
    capped = render_to(passes, 0.001, max_spp=70)
    assert (capped.samples == 64).all()  # whole rounds: 16, 16, 32
    easy = render_to(passes, 0.9)
    assert (easy.samples == 2 * FIRST_NET_SPP).all()
    assert easy.hdr.tobytes() == render_to(passes, 0.9, max_spp=1).hdr.tobytes()


@pytest.mark.slow
def test_stopping_does_not_bias_means() -> None:
    """Over many seeds, for which stopping varies, the mean is that of all paths."""
    passes = paths()
    exact = luminance(passes.render(VIEW, frame_index=0, seed=9, spp=4096, max_depth=4).hdr).mean()
    means = [luminance(render_to(passes, 0.15, seed=seed).hdr).mean() for seed in range(24)]
    assert np.mean(means) == pytest.approx(exact, abs=4.0 * np.std(means) / math.sqrt(24) + 2e-4 * exact)


@pytest.mark.slow
def test_reported_variance_equals_variance_over_seeds() -> None:
    """The variance over images of different seeds equals the mean of their estimates."""
    passes, runs = paths(), 96
    images = [render_to(passes, 0.001, max_spp=32, seed=seed) for seed in range(runs)]
    luminances = np.array([luminance(image.hdr) for image in images])
    scatter = (luminances - luminances.mean(axis=0)) ** 2 * runs / (runs - 1)
    said = np.array([image.variance for image in images])
    assert said.sum() == pytest.approx(scatter.sum(), rel=0.03)

    # Student's test of each block of 8 x 8 pixels, with Šidák's correction to a false-alarm rate of 1 %.
    difference = (said - scatter).reshape(runs, HEIGHT // 8, 8, WIDTH // 8, 8).mean(axis=(2, 4))
    p = stats.ttest_1samp(difference, 0.0).pvalue
    assert p.min() > 1.0 - 0.99 ** (1.0 / p.size)
    precision = difference.std(axis=0) / math.sqrt(runs) / said.mean()
    assert precision.max() < 0.2


def test_estimated_error_is_a_standard_error() -> None:
    random = np.random.default_rng(5)
    nets = 8.0 * random.normal(2.0, 0.3, (6, 2, 24, 32))  # six rounds of two nets of 8 paths
    light, scatter = nets.sum(axis=(0, 1)), ((nets[:, 0] - nets[:, 1]) ** 2).sum(axis=0)
    error = estimated_error(light, scatter, np.full((24, 32), 96, np.int32))
    np.testing.assert_allclose(error, 0.3 / math.sqrt(12.0) / 2.0, rtol=0.3)
    assert error.mean() > 0.3 / math.sqrt(12.0) / 2.0  # the worst around
    black, few = np.zeros((8, 8)), np.full((8, 8), 16, np.int32)
    assert not estimated_error(black, black, few).any()
    light, scatter = black.copy(), black.copy()
    light[4, 4], scatter[4, 4] = 1.0, 1.0  # one path in one pixel found light: its neighbors may have missed it
    assert (estimated_error(light, scatter, few) > 0.5).sum() > 40


def digest() -> str:
    image = render_to(paths(), 0.1, max_spp=64)
    return hashlib.sha256(image.hdr.tobytes() + image.samples.tobytes() + image.albedo.tobytes()).hexdigest()


@pytest.mark.slow
def test_same_bytes_for_any_number_of_threads() -> None:
    code = (
        "from tiscene.device import runtime; runtime.start(threads=1)\n"
        "from tests.render.film.test_adaptive import digest; print(digest())"
    )
    result = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True)
    assert (result.returncode, result.stderr[-3000:]) == (0, "")
    assert result.stdout.split() == [digest()]


@pytest.mark.parametrize("error", [0.0, -0.1, 1.0, math.nan])
def test_relative_error_out_of_range_raises(error: float) -> None:
    with pytest.raises(ArgumentError, match="must be between 0 and 1"):
        render_to(paths(), error)
