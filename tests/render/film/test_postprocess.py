# SPDX-License-Identifier: Apache-2.0
"""Denoising of incremental images, whose base shows where nothing changed, and of images over panoramas."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tiscene.device.memory import upload
from tiscene.render.film.denoise import denoise
from tiscene.render.film.postprocess import Postprocessor
from tiscene.render.film.upsample import demodulate
from tiscene.render.integrators.incremental.base_image import IncrementalBase
from tiscene.render.integrators.incremental.incremental_pass import IncrementalImage
from tiscene.render.integrators.panorama.light_changes import REDUCTION
from tiscene.render.integrators.panorama.panorama_pass import PanoramaImage
from tiscene.render.integrators.panorama.subpixels import Hidden

HEIGHT, WIDTH = 48, 64


def noisy_base() -> IncrementalBase:
    rng = np.random.default_rng(1)
    image = np.zeros((HEIGHT, WIDTH, 9), np.float32)
    image[..., :3] = rng.gamma(4.0, 0.125, (HEIGHT, WIDTH, 3))
    image[..., 3:6] = 0.5
    image[..., 8] = 1.0
    cache = SimpleNamespace(mean=upload(image.reshape(-1, 9)))
    return IncrementalBase(SimpleNamespace(groups=1), image, cache, SimpleNamespace())


def difference(base: IncrementalBase, change: float = 0.0) -> IncrementalImage:
    """Return an incremental image with a change of the right half."""
    radiance, albedo, normal = base.channels()
    static_mask = np.ones((HEIGHT, WIDTH, 1), np.float32)
    if change:
        radiance[:, WIDTH // 2 :] += change
        static_mask[:, WIDTH // 2 :] = 0.0
    regions = [(slice(0, HEIGHT), slice(16, WIDTH))] if change else []
    return IncrementalImage(radiance, albedo, normal, radiance, base, np.ones((1, 3), np.float32), static_mask, regions)


@pytest.mark.parametrize("downscale", [1, 2])
def test_unchanged_regions_show_high_quality_base(downscale: int) -> None:
    base = noisy_base()
    image_out = Postprocessor("fast", downscale, True).process_incremental(difference(base))
    np.testing.assert_allclose(image_out, denoise(*base.channels(), "high"), atol=1e-5)
    assert len(base.derived) == 1


@pytest.mark.parametrize("downscale", [1, 2])
def test_movers_change_only_their_region(downscale: int) -> None:
    base = noisy_base()
    postprocessor = Postprocessor("fast", downscale, True)
    before, after = (postprocessor.process_incremental(difference(base, change)) for change in (0.0, 4.0))
    assert after[:, 40:].mean() == pytest.approx(4.5, rel=0.05)
    assert np.abs(after - before)[:, :24].mean() < 0.02


@pytest.mark.parametrize("downscale", [1, 2])
def test_errors_of_light_that_movers_take_away_are_not_corrected(downscale: int) -> None:
    """Else edges of the sun's light leave dark and bright specks in a shadow that falls on them."""
    base = noisy_base()
    image = difference(base)
    dimmed = replace(image, filtered=np.float32(0.01) * image.filtered)
    postprocessor = Postprocessor("fast", downscale, True)
    shown = postprocessor.process_incremental(dimmed)
    best = np.float32(0.01) * denoise(*base.channels(), "high")
    assert shown.min() > 0.0
    np.testing.assert_allclose(shown, best, rtol=0.5)


def test_without_denoiser_only_negative_values_are_clipped() -> None:
    base = noisy_base()
    image = difference(base)
    image.hdr[0, 0] = -1.0
    image_out = Postprocessor(None, 1, True).process_incremental(image)
    assert (image_out[0, 0] == 0.0).all()
    assert (image_out[1:] == image.hdr[1:]).all()
    assert not base.derived


def test_corrections_are_cached_per_postprocessor() -> None:
    """One base image serves postprocessors of any quality."""
    base = noisy_base()
    for quality in ("fast", "balanced"):
        Postprocessor(quality, 1, True).process_incremental(difference(base))
    assert len(base.derived) == 2


def test_hidden_parts_of_pixels_beside_a_shadow_of_movers_are_as_bright_as_their_surface() -> None:
    """Path-traced pixels beside movers are known to the panorama too: their light there is that of whole pixels."""
    light = np.full((HEIGHT, WIDTH, 3), 0.2, np.float32)
    albedo, normal = np.full_like(light, 0.5), np.zeros_like(light)
    normal[..., 2] = 1.0
    share, beside = np.ones((HEIGHT, WIDTH, 1), np.float32), np.zeros((HEIGHT, WIDTH), np.float32)
    beside[:, 20:24] = 0.5
    share[:, 24] = 0.25
    pixels = np.arange(HEIGHT, dtype=np.int32) * WIDTH + 24
    part = Hidden(pixels, *(each.reshape(-1, 3)[pixels] for each in (0.75 * light, albedo, normal)),
                  *(np.full(HEIGHT, value, np.float32) for value in (0.0, 10.0)))  # fmt: skip
    before, white, reduced_normal = demodulate(light, albedo, normal, REDUCTION)
    image = PanoramaImage(
        static=light, albedo=albedo, normal=normal, denoised=share * light, hidden=part, before=before, change=None,
        after=None, emitted=None, white=white, reduced_normal=reduced_normal, traced=beside > 0.0, beside=beside,
        static_mask=share, panorama_spp=64,
    )  # fmt: skip
    shown = Postprocessor("fast", 1, True).process_panorama(image)
    np.testing.assert_allclose(shown[8:-8, 24], shown[8:-8, 26], rtol=0.1)
