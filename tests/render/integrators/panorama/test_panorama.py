# SPDX-License-Identifier: Apache-2.0
"""Cells of panoramas: which one a direction belongs to."""

import numpy as np
import pytest
import taichi as ti
from numpy.lib.stride_tricks import sliding_window_view

from tests.render.path_scenes import BOX_CAMERA
from tiscene.device.kernel_types import Floats2, Ints2
from tiscene.render.integrators.panorama.panorama import CELL, CONTRAST, PAGE, PanoramaSettings, contrast_of
from tiscene.render.integrators.panorama.panorama_kernels import (
    BLOCK,
    BLOCK_ROWS,
    COARSE,
    DISTANCE_RANGE,
    NORMAL_RANGE,
    TILE,
    WINDOW,
    fill_blocks,
)
from tiscene.render.sampling.cube import cell_of
from tiscene.render.view import View, camera_ray
from tiscene.scene.placement import CURRENT

pytestmark = pytest.mark.usefixtures("taichi")


@ti.kernel
def cells_of_pixels(view: Floats2, size: ti.i32, cells: Ints2):
    for pixel in range(PAGE * PAGE):
        _, direction = camera_ray(view, CURRENT, pixel % PAGE, pixel // PAGE, PAGE, PAGE)
        cell = cell_of(2.5 * direction, size)
        for c in ti.static(range(3)):
            cells[pixel, c] = cell[c]


@pytest.mark.parametrize("face", range(6))
def test_pixels_of_pages_are_the_cells_that_their_rays_go_through(face: int) -> None:
    size = 2 * PAGE + BLOCK
    settings = PanoramaSettings((0.3, -1.2, 2.0), size, 16, 4, 0)
    rows, columns = (each.ravel() for each in np.mgrid[:PAGE, :PAGE])
    for row, column in ((0, 0), (1, 0), (0, 1)):
        cells = np.empty((PAGE * PAGE, 3), np.int32)
        cells_of_pixels(settings.page_view(face, row, column).array(), size, cells)
        places = np.column_stack([row * PAGE + rows, column * PAGE + columns]) - TILE  # pages begin at the margin
        inside = ((places >= 0) & (places < size)).all(axis=-1)
        assert inside.mean() > 0.9
        np.testing.assert_array_equal(cells[inside], np.column_stack([np.full(len(places), face), places])[inside])


def test_cells_are_a_fraction_of_a_pixel_wide_at_the_center() -> None:
    view = View(BOX_CAMERA, BOX_CAMERA, BOX_CAMERA, 64, 48)
    settings = PanoramaSettings.of(view, BOX_CAMERA.position, spp=64, max_depth=4, seed=1)
    pixel = 2.0 * np.tan(0.5 * BOX_CAMERA.vertical_fov) / 48
    assert 2.0 / settings.faces == pytest.approx(CELL * pixel, rel=0.1)
    assert settings.faces % BLOCK == 0


def test_cells_far_from_the_center_of_a_face_have_fewer_samples() -> None:
    settings = PanoramaSettings((0.0, 0.0, 0.0), 4 * PAGE - 2 * TILE, 256, 4, 0)
    samples = [settings.samples(settings.page_view(0, row, 1)) for row in range(4)]
    assert samples[0] == samples[3] < samples[1] == samples[2]


def test_contrast_is_that_of_light_between_the_quarters_of_a_tile() -> None:
    noise = np.random.default_rng(3)
    shape = TILE, TILE, 3
    albedo = noise.uniform(0.2, 0.8, shape)  # a texture
    split = np.where(np.arange(TILE)[:, None] < TILE // 2, 1.0, 4.0)[..., None]
    noisy = noise.exponential(1.0, shape)
    cells = np.stack(
        [
            np.concatenate([light, albedo], axis=-1).reshape(TILE * TILE, 6)
            for light in ((albedo + 0.08), (albedo + 0.08) * split, (albedo + 0.08) * noisy, 1e-4 * split * albedo)
        ]
    ).astype(np.float32)
    textured, shadowed, noisy_tile, dark = contrast_of(cells, 0.01)
    assert textured < 0.02
    assert shadowed == pytest.approx((4.0 - 1.0) / (4.0 + 1.0 + 0.02), rel=0.02)
    assert noisy_tile < CONTRAST
    assert dark < 0.1


def test_coarse_cells_are_means_and_even_where_normals_and_distances_are_alike() -> None:
    noise = np.random.default_rng(5)
    shape = 2, WINDOW, WINDOW
    light = noise.exponential(1.0, (*shape, 3))
    # Surfaces with creases, steps, and cells behind edges, whose distance is negative.
    normal = np.where(noise.random((*shape, 1)) < 0.02, (0.0, 0.6, 0.8), (0.0, 0.0, 1.0))
    distance = np.where(noise.random(shape) < 0.02, 2.5, 2.0) * np.where(noise.random(shape) < 0.01, -1.0, 1.0)
    windows = np.concatenate([light, normal, distance[..., None]], axis=-1).astype(np.float32)
    cells = np.empty((2, BLOCK_ROWS, 7), np.float32)
    fill_blocks(windows.reshape(2, WINDOW * WINDOW, 7), 3, cells)
    inside = windows[:, TILE : TILE + BLOCK, TILE : TILE + BLOCK]
    np.testing.assert_array_equal(cells[:, : BLOCK * BLOCK], inside.reshape(2, BLOCK * BLOCK, 7))
    coarse = cells[:, BLOCK * BLOCK :].reshape(2, COARSE, COARSE, 7)
    means = inside.reshape(2, COARSE, 2, COARSE, 2, 7).mean(axis=(2, 4))
    np.testing.assert_allclose(coarse[..., :6], means[..., :6], rtol=1e-5)
    around = windows[:, TILE - 1 : TILE + BLOCK + 1, TILE - 1 : TILE + BLOCK + 1, 3:]
    squares = sliding_window_view(around, (4, 4), axis=(1, 2))[:, ::2, ::2]
    least, most = squares.min(axis=(-2, -1)), squares.max(axis=(-2, -1))
    even = ((most - least)[..., :3] < NORMAL_RANGE).all(axis=-1)
    even &= (least[..., 3] > 0.0) & (most[..., 3] < DISTANCE_RANGE * least[..., 3])
    assert 0.2 < even.mean() < 0.8
    np.testing.assert_allclose(coarse[..., 6], np.where(even, means[..., 6], 0.0), rtol=1e-5)
