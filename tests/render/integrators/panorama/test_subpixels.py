# SPDX-License-Identifier: Apache-2.0
"""Path-traced subpixels, and the light of hidden parts of pixels."""

from __future__ import annotations

import numpy as np
import pytest

from tests.render.integrators.panorama.test_panorama_pass import SurroundedBalls, view_at
from tiscene.render.integrators.panorama import subpixels
from tiscene.render.integrators.panorama.reprojection_kernels import ALL_KNOWN, NONE_KNOWN, SUBPIXELS
from tiscene.render.integrators.panorama.subpixels import Hidden, SubpixelPaths
from tiscene.render.integrators.path.path_pass import PathPass

VIEW = view_at(0.0)
SHAPE = VIEW.height, VIEW.width, 3


@pytest.fixture(scope="module")
def scene() -> SurroundedBalls:
    scene = SurroundedBalls(lights="sky and bulb")
    scene.device.place(scene.at())
    return scene


def filled(
    scene: SurroundedBalls, known: np.ndarray, value: float, spp: int = 16, key: int = 3
) -> tuple[list[np.ndarray], Hidden]:
    """Fill images of one value."""
    images = [np.full(SHAPE, value, np.float32) for _ in range(4)]
    radiance, denoised, albedo, normal = images
    paths = SubpixelPaths(PathPass(scene.device, VIEW.width, VIEW.height))
    return images, paths.fill(VIEW, known, (radiance, denoised, albedo, normal), spp=spp, key=key, max_depth=4)


def test_known_pixels_stay(scene: SurroundedBalls) -> None:
    known = np.full(SHAPE[:2], ALL_KNOWN, np.int32)
    known[5, 7] = NONE_KNOWN
    images, hidden = filled(scene, known, 0.25)
    for image in images[:3]:
        assert (image[known == ALL_KNOWN] == np.float32(0.25)).all()
    assert (images[3][known == NONE_KNOWN] != np.float32(0.25)).any()
    assert len(hidden.pixels) == 0


def test_pixels_of_which_nothing_is_known_are_path_traced(scene: SurroundedBalls) -> None:
    images, _ = filled(scene, np.full(SHAPE[:2], NONE_KNOWN, np.int32), 9.0)
    truth = scene.paths.render(VIEW, frame_index=0, seed=5, spp=64, max_depth=4)
    expected = truth.hdr, truth.hdr * 0.0, truth.albedo, truth.normal
    for image, other in zip(images, expected, strict=True):
        assert image.mean() == pytest.approx(other.mean(), rel=0.02, abs=1e-6)


def test_known_and_traced_subpixels_add_up(scene: SurroundedBalls) -> None:
    # One quarter of each pixel is known, and black.
    images, hidden = filled(scene, np.full(SHAPE[:2], 1, np.int32), 0.0)
    whole, _ = filled(scene, np.full(SHAPE[:2], NONE_KNOWN, np.int32), 0.0)
    share = (SUBPIXELS - 1) / SUBPIXELS
    for image, other in ((images[0], whole[0]), (images[2], whole[2]), (images[3], whole[3])):
        assert image.mean() == pytest.approx(share * other.mean(), rel=0.03)
    assert not images[1].any()
    assert hidden.albedo.mean() == pytest.approx(whole[2].mean(), rel=0.03)
    assert hidden.light.mean() == pytest.approx(images[0].mean(), rel=0.1)
    np.testing.assert_array_equal(hidden.pixels, np.arange(VIEW.width * VIEW.height))
    noise, raw = ((each.reshape(SHAPE)[8:16, 8:16] - images[0].mean()) ** 2 for each in (hidden.light, images[0]))
    assert noise.mean() < raw.mean()  # a wall, where the average is over many alike
    surface = hidden.normal.any(axis=-1)
    relative = hidden.relative_variance[surface]
    assert 0.0 < relative.min() < relative.mean() < 0.2
    assert not hidden.variance[~surface].any()  # the background has no noise


def test_paths_see_the_points_that_are_hidden(scene: SurroundedBalls) -> None:
    """Not what is beside them: surfaces do not depend on the random numbers, but where a pixel is something else."""
    known = np.full(SHAPE[:2], 1, np.int32)
    known[:, ::2] = NONE_KNOWN
    (one, hidden), (other, again) = (filled(scene, known, 0.0, spp=1, key=key) for key in (3, 4))
    np.testing.assert_array_equal(hidden.normal, again.normal)
    np.testing.assert_array_equal(one[3][:, 1::2], other[3][:, 1::2])
    assert (one[3][:, ::2] != other[3][:, ::2]).any()


def test_variance_falls_with_the_number_of_paths(scene: SurroundedBalls) -> None:
    found = (filled(scene, np.full(SHAPE[:2], 1, np.int32), 0.0, spp=spp)[1] for spp in (1, 4))
    one, four = (hidden.relative_variance for hidden in found)
    surface = (one > 0.0) & (four > 0.0)
    assert surface.mean() > 0.5
    assert one[surface].mean() / four[surface].mean() == pytest.approx(4.0, rel=0.1)


def test_where_few_paths_find_the_light_the_others_are_as_uncertain() -> None:
    """Three of a hundred pixels have found light, and not those of the last columns, which have less noise."""
    width, rng = 60, np.random.default_rng(0)
    pixels = np.arange(20 * width, dtype=np.int32)
    light = np.where(rng.random(pixels.size) < 0.03, 30.0, 0.1).astype(np.float32)
    light[pixels % width >= 40] = 1.0
    exponential, variance = 0.1 * light**2, 0.1 * light**2
    variance[light == 30.0] *= 8.0
    spread = subpixels._spread(pixels, width, variance, exponential, 1)
    np.testing.assert_allclose(spread[pixels % width >= 49], 1.0)
    dark = (light < 0.5) & (pixels % width < 30)
    assert (spread[dark] > 10.0).all()
    surer = subpixels._spread(pixels, width, variance, exponential, 4)
    np.testing.assert_allclose(surer[dark] - 1.0, 0.625 * (spread[dark] - 1.0), rtol=1e-5)
    np.testing.assert_allclose(spread, subpixels._spread(pixels, width, 1e-12 * variance, 1e-12 * exponential, 1))
    assert not len(subpixels._spread(pixels[:0], width, variance[:0], exponential[:0], 1))


def test_light_of_few_samples_is_that_which_is_expected() -> None:
    expected = np.full((4, 3), 0.5, np.float32)
    light = np.array([0.0, 0.7, 0.7, 3.0], np.float32)[:, None].repeat(3, axis=1)
    variance, share = np.array([[0.0, 0.2, 1e-5, 0.1], [1.0, 0.001, 0.001, 0.01]], np.float32)
    hidden = Hidden(np.arange(4, dtype=np.int32), light, expected, expected, variance, share)
    estimate = hidden.estimate(expected)[:, 0]
    np.testing.assert_allclose(estimate[:2], 0.5)  # black, but few samples; and noisy
    np.testing.assert_allclose(estimate[2:], (0.7, 3.0), rtol=0.02)
