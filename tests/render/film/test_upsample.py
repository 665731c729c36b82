# SPDX-License-Identifier: Apache-2.0
"""Guided upsampling: sizes, exact cases, edges, and the error against full-resolution frames."""

from __future__ import annotations

import numpy as np
import pytest

import tiscene as ts
from tests.stream.test_stream import moving_scenario
from tiscene.render.film.upsample import ALBEDO_OFFSET, demodulate, reduced_size, upsample
from tiscene.render.render_settings import PRESETS, RenderSettings


@pytest.mark.parametrize(
    ("size", "downscale", "expected"),
    [((320, 240), 1, (320, 240)), ((320, 240), 2, (160, 120)), ((33, 25), 2, (18, 13)), ((1, 1), 4, (1, 1))],
)
def test_reduced_size_keeps_field_of_view(size: tuple[int, int], downscale: int, expected: tuple[int, int]) -> None:
    width, height = reduced_size(*size, downscale)
    assert (width, height) == expected
    assert width * size[1] >= size[0] * height


@pytest.mark.parametrize("size", [(32, 24), (33, 25), (1, 1)])
def test_uniform_irradiance_reproduces_texture_exactly(size: tuple[int, int]) -> None:
    width, height = size
    rng = np.random.default_rng(0)
    albedo = rng.uniform(size=(height, width, 3)).astype(np.float32)
    normal = np.zeros_like(albedo)
    normal[...] = 0.0, 0.6, 0.8
    low_width, low_height = reduced_size(width, height, 2)
    even = np.full((low_height, low_width, 3), 2.0, np.float32)
    facing = np.broadcast_to(normal[0, 0], even.shape).copy()
    np.testing.assert_allclose(upsample(even, facing, albedo, normal), 2.0 * (albedo + ALBEDO_OFFSET), rtol=1e-5)


def test_demodulate_divides_by_albedo_only_at_surfaces() -> None:
    radiance = np.full((1, 2, 3), 3.0, np.float32)
    albedo = np.full((1, 2, 3), 0.52, np.float32)
    normal = np.array([[[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]], np.float32)
    reached, white, same = demodulate(radiance, albedo, normal)
    np.testing.assert_allclose(reached[0, :, 0], [3.0 / (0.52 + ALBEDO_OFFSET), 3.0])
    assert white[0, :, 0].tolist() == [1.0, 0.0]
    assert np.array_equal(same, normal)


def test_light_does_not_leak_across_an_edge() -> None:
    """A bright wall beside a dark one with another normal, below a bright sky; edges at odd pixels."""
    width, height = 16, 12
    normal = np.zeros((height, width, 3), np.float32)
    normal[5:, :7] = 1.0, 0.0, 0.0
    normal[5:, 7:] = 0.0, 0.0, 1.0
    albedo = np.full((height, width, 3), 1.0 - ALBEDO_OFFSET, np.float32)
    albedo[:5] = 0.0
    low_normal = normal[::2, ::2].copy()
    low = np.where(low_normal[..., :1] > 0.0, 10.0, np.where(low_normal[..., 2:] > 0.0, 1.0, 100.0))
    result = upsample(np.repeat(low, 3, axis=-1).astype(np.float32), low_normal, albedo, normal)[..., 0]
    for region, expected in ((result[5:, :7], 10.0), (result[5:, 7:], 1.0), (result[:5], 100.0)):
        assert np.abs(region / expected - 1.0).max() < 0.35
        assert np.median(np.abs(region / expected - 1.0)) < 0.01


@pytest.mark.parametrize("size", [(32, 24), (33, 25)])
def test_gradient_is_not_shifted_by_down_and_upsampling(size: tuple[int, int]) -> None:
    width, height = size
    slope = np.repeat((np.arange(width) + 2.0 * np.arange(height)[:, None])[..., None], 3, axis=-1).astype(np.float32)
    normal = np.zeros_like(slope)
    normal[..., 2] = 1.0
    albedo = np.full_like(slope, 1.0 - ALBEDO_OFFSET)
    small, white, facing = demodulate(slope, albedo, normal, 2)
    assert small.shape == (-(-height // 2), -(-width // 2), 3)
    assert (white == 1.0).all()
    result = upsample(small, facing, albedo, normal, 2)
    np.testing.assert_allclose(result[3:-3, 3:-3], slope[3:-3, 3:-3], atol=0.3)
    np.testing.assert_allclose((result - slope)[4:-4, 4:-4].mean(), 0.0, atol=0.01)


def test_fast_frame_is_close_to_full_frame_and_reproducible(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 64 samples per pixel each; and a frame has the same bytes whatever was rendered before."""
    monkeypatch.setitem(PRESETS, "fast", RenderSettings(64, 3, denoiser="fast", base_spp=64, downscale=2))
    monkeypatch.setitem(PRESETS, "full", RenderSettings(16, 3, denoiser="fast", base_spp=64))
    settings = {"width": 45, "height": 33, "buffers": ("rgb", "hdr", "instance")}
    for incremental in (False, True):
        fast = ts.Stream(moving_scenario(), quality="fast", incremental=incremental, **settings)
        full = ts.Stream(moving_scenario(), quality="full", incremental=incremental, **settings)
        frame, expected = fast[3], full[3]
        assert set(frame.buffers) == {"rgb", "hdr", "instance"}
        assert frame.rgb.shape == (33, 45, 3)
        assert frame.hdr.mean() == pytest.approx(expected.hdr.mean(), rel=0.1)
        assert np.sqrt(np.mean((frame.rgb.astype(float) - expected.rgb) ** 2)) < 16.0
        fast[1]
        assert (fast[3].rgb == frame.rgb).all()
    assert (frame.instance == expected.instance).all()
