# SPDX-License-Identifier: Apache-2.0
"""Blue noise: errors of neighboring pixels cancel, so that less error remains after a blur or a denoiser."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, uniform_filter

from tests.render.path_scenes import described, device_scene, matte, quad, towards
from tiscene.render.film.tone_map import LUMINANCE
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import RectLight

SIZE, SEEDS = 48, 24
CAMERA = Camera.look_at((0.0, 1.5, 1.5), (0.0, 0.0, 0.0), vertical_fov=0.7)
VIEW = View(CAMERA, CAMERA, CAMERA, SIZE, SIZE)


@cache
def floor() -> PathPass:
    """Return a path tracer of a matte floor under a square lamp."""
    lamp = RectLight("lamp", "/lamp", towards((0.0, 2.0, 0.0), (0.0, -1.0, 0.0)), (10.0, 10.0, 10.0), 1.0, 1.0)
    floor = quad((-9, 0, 9), (9, 0, 9), (9, 0, -9), (-9, 0, -9))
    return PathPass(device_scene(described([floor], [matte("white", (0.7, 0.7, 0.7))], [lamp])), SIZE, SIZE)


def luminance(seed: int, spp: int) -> NDArray[np.float64]:
    hdr = floor().render(VIEW, frame_index=0, seed=seed, spp=spp, max_depth=2).hdr
    return np.asarray(hdr.astype(np.float64) @ np.array(LUMINANCE))


@cache
def exact() -> NDArray[np.float64]:
    return luminance(SEEDS, 2048)


def errors(spp: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return relative errors [n, h, w] of images of different seeds, and of images with an own seed for each pixel."""
    correlated = np.array([luminance(seed, spp) / exact() - 1.0 for seed in range(SEEDS)])
    return correlated, np.random.default_rng(1).permuted(correlated, axis=0)


@pytest.mark.slow
@pytest.mark.parametrize(("spp", "most"), [(1, 0.45), (4, 0.5), (16, 0.6)])
def test_blurred_error_is_below_that_of_white_noise(spp: int, most: float) -> None:
    correlated, independent = errors(spp)
    assert (correlated**2).mean() == pytest.approx((independent**2).mean())
    for blur in (lambda e: uniform_filter(e, (0, 4, 4)), lambda e: gaussian_filter(e, (0.0, 1.5, 1.5))):
        a, b = blur(independent)[:, 4:-4, 4:-4], blur(correlated)[:, 4:-4, 4:-4]
        assert (b**2).mean() < most * (a**2).mean()


def test_error_spectrum_is_blue_and_isotropic() -> None:
    """The error's spectrum is weak at low frequencies, equally along rows and columns."""
    correlated, independent = (error[:, 8:40, 8:40] for error in errors(1))
    window = np.outer(np.hanning(32), np.hanning(32))
    power, white = ((np.abs(np.fft.fft2(e * window)) ** 2).mean(axis=0) for e in (correlated, independent))
    frequency = np.abs(np.fft.fftfreq(32))
    radius = np.hypot(frequency[:, None], frequency)
    low = (radius > 0.05) & (radius < 0.15)
    assert power[low].sum() < 0.35 * white[low].sum()
    assert power[radius > 0.35].sum() > 1.1 * white[radius > 0.35].sum()
    along, across = frequency[:, None] > 2.0 * frequency, frequency > 2.0 * frequency[:, None]
    assert power[along].sum() == pytest.approx(power[across].sum(), rel=0.15)


def test_pixel_is_independent_of_which_others_are_rendered() -> None:
    paths = floor()
    every = paths.sums(VIEW, np.arange(SIZE * SIZE, dtype=np.int32), spp=3, key=5, max_depth=2)
    some = np.random.default_rng(3).choice(SIZE * SIZE, 100, replace=False).astype(np.int32)
    np.testing.assert_array_equal(paths.sums(VIEW, some, spp=3, key=5, max_depth=2), every[some])
