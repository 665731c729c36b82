# SPDX-License-Identifier: Apache-2.0
"""Changes of light: spots of single paths vanish, shadows stay."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tiscene.render.film.shrinkage import shrunk_change

SIZE = 48, 64
Image = NDArray[np.float32]
NORMAL = np.broadcast_to(np.array([0.0, 0.0, 1.0], np.float32), (*SIZE, 3)).copy()


def gray(values: object) -> Image:
    return np.broadcast_to(np.asarray(values, np.float32)[..., None], (*SIZE, 3)).copy()


def test_spots_of_single_paths_vanish_and_their_mean_stays() -> None:
    rng = np.random.default_rng(3)
    samples = gray(np.where(rng.random(SIZE) < 0.02, -1.0, 0.0))
    spots = np.lib.stride_tricks.sliding_window_view(np.pad(samples[..., 0], 2), (5, 5)).mean(axis=(2, 3))
    result = shrunk_change(gray(spots), samples, NORMAL)
    assert result.mean() == pytest.approx(samples.mean(), rel=0.15)
    assert result.std() < 0.65 * spots.std()


def test_shadows_stay() -> None:
    shadow = np.zeros(SIZE)
    shadow[20:32, 24:40] = -1.0
    noise = np.random.default_rng(4).normal(0.0, 0.3, SIZE)
    result = shrunk_change(gray(shadow), gray(shadow + noise), NORMAL)[..., 0]
    np.testing.assert_allclose(result, shadow, atol=0.3)
    assert np.abs(result - shadow).mean() < 0.05


def test_light_of_other_surfaces_does_not_count() -> None:
    normal, samples = NORMAL.copy(), gray(np.zeros(SIZE))
    normal[:, 32:] = (1.0, 0.0, 0.0)
    samples[:, 32:] = -1.0
    result = shrunk_change(np.zeros_like(samples), samples, normal)
    np.testing.assert_allclose(result[:, :32], 0.0, atol=1e-3)
