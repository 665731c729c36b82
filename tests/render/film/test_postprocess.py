# SPDX-License-Identifier: Apache-2.0
"""Pictures without their noise: where nothing moved a difference shows its base's best picture, else the movers."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tiscene.device.memory import upload
from tiscene.render.film.denoise import denoise
from tiscene.render.film.postprocess import Postprocessor
from tiscene.render.integrators.incremental.base_image import IncrementalBase
from tiscene.render.integrators.incremental.incremental_pass import IncrementalImage

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
    """What came into the right half, if anything."""
    radiance, albedo, normal = base.channels()
    static_mask = np.ones((HEIGHT, WIDTH, 1), np.float32)
    if change:
        radiance[:, WIDTH // 2 :] += change
        static_mask[:, WIDTH // 2 :] = 0.0
    regions = [(slice(0, HEIGHT), slice(16, WIDTH))] if change else []
    return IncrementalImage(radiance, albedo, normal, radiance, base, np.ones((1, 3), np.float32), static_mask, regions)


@pytest.mark.parametrize("downscale", [1, 2])
def test_where_nothing_changed_the_base_shows_at_its_best(downscale: int) -> None:
    base = noisy_base()
    shown = Postprocessor("fast", downscale, True).process_incremental(difference(base))
    np.testing.assert_allclose(shown, denoise(*base.channels(), "high"), atol=1e-5)
    assert len(base.derived) == 1


@pytest.mark.parametrize("downscale", [1, 2])
def test_movers_show_through_and_leave_the_rest_alone(downscale: int) -> None:
    base = noisy_base()
    cleaner = Postprocessor("fast", downscale, True)
    before, after = (cleaner.process_incremental(difference(base, change)) for change in (0.0, 4.0))
    assert after[:, 40:].mean() == pytest.approx(4.5, rel=0.05)
    assert np.abs(after - before)[:, :24].mean() < 0.02


def test_without_a_denoiser_nothing_is_touched_but_what_overshoots() -> None:
    base = noisy_base()
    image = difference(base)
    image.hdr[0, 0] = -1.0
    shown = Postprocessor(None, 1, True).process_incremental(image)
    assert (shown[0, 0] == 0.0).all()
    assert (shown[1:] == image.hdr[1:]).all()
    assert not base.derived


def test_a_wide_lens_is_told_apart() -> None:
    """Base images serve cameras of one lens, but cleaners of any quality."""
    base = noisy_base()
    for quality in ("fast", "balanced"):
        Postprocessor(quality, 1, True).process_incremental(difference(base))
    assert len(base.derived) == 2
