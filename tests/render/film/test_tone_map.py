# SPDX-License-Identifier: Apache-2.0
"""Exposure, properties of the tone curve, automatic exposure."""

import numpy as np
import pytest

from tiscene.render.film.tone_map import GRAY, INSET, OUTSET, auto_exposure, curve, radiance_shown_as, tone_map
from tiscene.scene.color import encode_srgb

HUES = [(1, 1, 1), (1, 0.02, 0.02), (0.02, 1, 0.02), (0.02, 0.02, 1), (1, 0.5, 0.02), (0.02, 0.5, 1), (1, 0.02, 0.6)]


def ramp(color: tuple[float, float, float], stops: np.ndarray) -> np.ndarray:
    return (GRAY * 2.0 ** stops[None, :, None] * np.array(color)).astype(np.float32)


def linear(rgb: np.ndarray) -> np.ndarray:
    code = rgb / 255.0
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def test_middle_gray_is_preserved() -> None:
    rgb = tone_map(ramp((1, 1, 1), np.array([0.0, -20.0, 20.0])))[0]
    assert np.abs(linear(rgb[0]) - GRAY).max() < 2e-3
    assert rgb[1].tolist() == [0, 0, 0]
    assert rgb[2].tolist() == [255, 255, 255]


def test_grays_are_neutral_and_monotonic() -> None:
    rgb = tone_map(ramp((1, 1, 1), np.linspace(-10.0, 6.5, 200)))[0].astype(int)
    assert (rgb[:, 0] == rgb[:, 1]).all()
    assert (rgb[:, 1] == rgb[:, 2]).all()
    assert (np.diff(rgb[:, 0]) >= 0).all()
    assert rgb[np.linspace(-10.0, 6.5, 200) < 4.5].max() < 250


@pytest.mark.parametrize("color", HUES)
def test_bright_colors_keep_their_hue_and_roll_off_to_white(color: tuple[float, float, float]) -> None:
    stops = np.linspace(-3.0, 9.0, 60)
    display = linear(tone_map(ramp(color, stops))[0])
    brightness = display @ np.array([0.2126, 0.7152, 0.0722])
    assert (np.diff(brightness) > -2e-3).all()
    order = np.argsort(np.asarray(color), kind="stable")
    assert (np.diff(display[:, order], axis=1) > -0.01).all()  # the strongest channel stays the strongest
    saturation = 1.0 - display.min(axis=1) / display.max(axis=1)
    assert saturation[-1] < 0.35 or color == (1, 1, 1)
    assert saturation[-1] <= saturation[20] + 1e-6


def test_exposure_is_in_stops() -> None:
    image = ramp((0.7, 0.4, 0.9), np.linspace(-5.0, 3.0, 50))
    assert (tone_map(image, 2.0) == tone_map(image * np.float32(4.0), 0.0)).all()


def test_nan_is_black_and_infinity_white() -> None:
    image = np.array([[[np.nan] * 3, [np.inf] * 3, [-1.0] * 3]], np.float32)
    assert tone_map(image).tolist() == [[[0, 0, 0], [255, 255, 255], [0, 0, 0]]]


def test_tables_agree_with_formulas() -> None:
    rng = np.random.default_rng(0)
    image = (2.0 ** rng.uniform(-16.0, 8.0, (300, 100, 1)) * rng.uniform(0.0, 1.0, (300, 100, 3))).astype(np.float32)
    scene = image.astype(np.float64)
    scene = np.maximum(scene * (1.0 - INSET) + scene.sum(axis=-1, keepdims=True) * (INSET / 3.0), 1e-30)
    display = np.maximum(curve(scene), 0.0) ** 2.2
    display = (display - display.sum(axis=-1, keepdims=True) * (OUTSET / 3.0)) / (1.0 - OUTSET)
    codes = 255.0 * encode_srgb(np.clip(display, 0.0, 1.0))
    assert np.abs(tone_map(image) - codes).max() < 0.504


def test_auto_exposure_maps_mean_to_gray() -> None:
    generator = np.random.default_rng(0)
    image = np.exp(generator.normal(size=(40, 40, 1))).astype(np.float32) * np.ones(3, np.float32)
    stops = auto_exposure(image)
    assert np.exp(np.log(image * 2.0**stops).mean()) == pytest.approx(GRAY, rel=0.05)
    assert auto_exposure(image * np.float32(8.0)) == pytest.approx(stops - 3.0, abs=1e-4)


def test_auto_exposure_ignores_outliers_and_background() -> None:
    image = np.full((40, 40, 3), 0.5, np.float32)
    plain = auto_exposure(image)
    image[0, :20] = 5000.0
    assert auto_exposure(image) == pytest.approx(plain, abs=0.01)
    image[20:] = 0.0
    assert auto_exposure(image) == pytest.approx(plain, abs=0.01)
    assert auto_exposure(np.zeros((4, 4, 3), np.float32)) == 0.0


def test_auto_exposure_keeps_large_bright_areas_below_white() -> None:
    image = np.full((40, 40, 3), 0.01, np.float32)
    image[:, :8] = 50.0
    shown = 50.0 * 2.0 ** auto_exposure(image)
    assert shown <= GRAY * 2.0**5.0 * 1.001


@pytest.mark.parametrize("exposure", [0.15, -1.0, 2.3])
def test_radiance_shown_as_inverts_tone_map(exposure: float) -> None:
    for color in ((0, 0, 0), (127, 127, 127), (255, 255, 255), (60, 120, 90), (10, 200, 30)):
        radiance = np.full((1, 1, 3), radiance_shown_as(color, exposure), np.float32)
        assert np.abs(tone_map(radiance, exposure)[0, 0].astype(int) - color).max() <= 1
    red = tone_map(np.full((1, 1, 3), radiance_shown_as((255, 0, 0), exposure), np.float32), exposure)[0, 0]
    assert red[0] > 250  # what no radiance shows, as nearly as it goes
    assert red[0] > 1.5 * red[1:].max()
