# SPDX-License-Identifier: Apache-2.0
"""Cells of panoramas: which one a direction belongs to."""

import numpy as np
import pytest
import taichi as ti

from tests.render.path_scenes import BOX_CAMERA
from tiscene.device.kernel_types import Floats2, Ints2
from tiscene.render.integrators.panorama.panorama import CELL, CONTRAST, PAGE, PanoramaSettings, contrast_of
from tiscene.render.integrators.panorama.panorama_kernels import BLOCK, TILE
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
