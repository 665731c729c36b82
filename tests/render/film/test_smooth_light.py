# SPDX-License-Identifier: Apache-2.0
"""Light that varies slowly is replaced; edges and what is not trusted stay. Changes are added."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tiscene.render.film.smooth_light import apply_reduced_light
from tiscene.render.film.upsample import demodulate

SIZE = 32, 48
Image = NDArray[np.float32]
NORMAL = np.broadcast_to(np.array([0.0, 0.0, 1.0], np.float32), (*SIZE, 3)).copy()
ALBEDO = np.random.default_rng(1).uniform(0.2, 0.8, (*SIZE, 3)).astype(np.float32)


def flat(values: object) -> Image:
    """Return irradiance times albedo; values: [h, w]."""
    irradiance = np.broadcast_to(np.asarray(values, np.float32)[..., None], (*SIZE, 3))
    return (irradiance * (ALBEDO + np.float32(0.08))).astype(np.float32)


def replaced(
    image: Image,
    light: Image,
    normal: Image = NORMAL,
    *,
    noise: float = 0.0,
    exact: bool = False,
    change: Image | None = None,
    kept: bool = False,
) -> Image:
    """Replace the image's smooth light by another image's, and add a change of radiance in the left half.

    The other image's light has noise, or with `exact` the image's own has none.
    """
    own, _, reduced = demodulate(image, ALBEDO, normal, 2)
    irradiance, _, _ = demodulate(light, ALBEDO, normal, 2)
    added = np.zeros_like(own) if change is None else demodulate(change, ALBEDO, normal, 2)[0]
    mask = np.zeros((*SIZE, 1), np.float32)
    mask[:, : SIZE[1] // 2] = 1.0
    result, guides = image.copy(), (ALBEDO, normal)
    noisy = own if exact else irradiance * (1.0 + np.random.default_rng(2).choice([-noise, noise], (*own.shape[:2], 1)))
    apply_reduced_light(
        result, own, irradiance, noisy.astype(np.float32), added, reduced, guides, np.full(SIZE, kept), mask, 2,
        contrast=0.15,
    )  # fmt: skip
    return result


def test_steps_between_blocks_of_a_plain_wall_vanish() -> None:
    blocks = 1.0 + 0.04 * (np.add.outer(np.arange(SIZE[0]) // 8, np.arange(SIZE[1]) // 8) % 2)
    wall = flat(np.full(SIZE, 1.02))
    np.testing.assert_allclose(replaced(flat(blocks), wall), wall, rtol=1e-4)


def test_larger_steps_vanish_where_light_is_noisy_and_only_there() -> None:
    blocks = 1.0 + 0.15 * (np.add.outer(np.arange(SIZE[0]) // 8, np.arange(SIZE[1]) // 8) % 2)
    image, wall = flat(blocks), flat(np.full(SIZE, 1.07))
    steps = [np.abs(replaced(image, wall, noise=noise) / wall - 1.0).max() for noise in (0.0, 0.2)]
    assert steps[1] < 1e-4 < 0.04 < steps[0]


def test_edges_of_light_and_of_surfaces_stay() -> None:
    sunlit = flat(np.where(np.arange(SIZE[1]) < 24, 1.0, 5.0) * np.ones((SIZE[0], 1)))
    edge = np.s_[:, 23:25]
    np.testing.assert_array_equal(replaced(sunlit, 1.1 * sunlit)[edge], sunlit[edge])
    wall, corner = flat(np.ones(SIZE)), NORMAL.copy()
    corner[:, 24:] = (1.0, 0.0, 0.0)
    result = replaced(wall, np.float32(1.1) * wall, corner)
    np.testing.assert_array_equal(result[edge], wall[edge])
    np.testing.assert_allclose(result[:, :16], 1.1 * wall[:, :16], rtol=1e-4)


def test_edges_that_the_denoiser_has_blurred_are_no_noise() -> None:
    """As of a bright lamp of which the image's first row shows a little."""
    wall = np.ones(SIZE)
    wall[:2] = 5.0
    blurred = np.ones(SIZE)
    blurred[:2], blurred[2:4], blurred[4:6] = 3.6, 1.3, 0.9
    result = replaced(flat(wall), flat(blurred), exact=True)
    np.testing.assert_allclose(result[:4], flat(wall)[:4], rtol=0.05)


def test_details_that_reduced_size_does_not_show_stay() -> None:
    seams = 1.0 - 0.2 * (np.arange(SIZE[1]) % 8 == 3)
    image = flat(np.broadcast_to(seams, SIZE))
    for factor in (1.0, 1.1):
        light = np.float32(factor) * image
        result = replaced(image, light)
        np.testing.assert_allclose(result, light, rtol=0.03)
        np.testing.assert_allclose(result[:, 3::8], light[:, 3::8], rtol=0.005)


def test_light_that_differs_much_is_not_trusted() -> None:
    wall = flat(np.ones(SIZE))
    np.testing.assert_array_equal(replaced(wall, 2.0 * wall), wall)


@pytest.mark.parametrize("factor", [0.5, -0.5, -2.0])
def test_changes_are_added_where_the_mask_says_and_light_does_not_become_negative(factor: float) -> None:
    wall, half = flat(np.ones(SIZE)), SIZE[1] // 2
    result = replaced(wall, wall, change=np.float32(factor) * wall)
    np.testing.assert_allclose(result[:, :half], max(1.0 + factor, 0.0) * wall[:, :half], rtol=1e-4)
    np.testing.assert_allclose(result[:, half:], wall[:, half:], rtol=1e-4)


def test_shadows_that_cross_an_edge_of_light_leave_no_black_beside_it() -> None:
    """Blocks at the edge mix both sides: what the lit side loses on average is more than the other side has."""
    columns = np.arange(SIZE[1]) * np.ones((SIZE[0], 1))
    sunlit, shade = flat(np.where((columns > 8) & (columns < 17), 5.0, 1.0)), flat(np.ones(SIZE))
    share = replaced(sunlit, sunlit, change=shade - sunlit)[:, :24] / shade[:, :24]
    assert share.min() > 0.3
    np.testing.assert_allclose(share[:, 12:14], 1.0, rtol=0.02)


def test_pixels_that_are_kept_do_not_change() -> None:
    wall = flat(np.ones(SIZE))
    np.testing.assert_array_equal(replaced(wall, np.float32(1.1) * wall, change=wall, kept=True), wall)
