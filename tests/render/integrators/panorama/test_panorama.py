# SPDX-License-Identifier: Apache-2.0
"""Cells of panoramas: which one a direction belongs to."""

import numpy as np
import pytest
import taichi as ti
from numpy.lib.stride_tricks import sliding_window_view

from tests.render.path_scenes import BOX_CAMERA
from tiscene.device.kernel_types import Floats2, Ints2
from tiscene.render.integrators.panorama.panorama import (
    CELL_OF_ANCHOR,
    CELL_OF_CENTER,
    CONTRAST,
    PanoramaSettings,
    contrast_of,
)
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
from tiscene.render.view import TANGENT, CubeView, View, camera_ray
from tiscene.scene.placement import CURRENT


@ti.kernel
def cells_of_pixels(view: Floats2, width: ti.i32, height: ti.i32, size: ti.i32, cells: Ints2):
    for pixel in range(width * height):
        _, direction = camera_ray(view, CURRENT, pixel % width, pixel // width, width, height)
        cell = cell_of(2.5 * direction, size)
        for c in ti.static(range(3)):
            cells[pixel, c] = cell[c]


def test_pixels_of_the_view_are_the_cells_that_their_rays_go_through() -> None:
    settings = PanoramaSettings((0.3, -1.2, 2.0), 0.35, 5 * BLOCK, 16, 4, 0)
    view = settings.cells_view()
    cells = np.empty((view.width * view.height, 3), np.int32)
    cells_of_pixels(view.array(), view.width, view.height, settings.faces, cells)
    face, row, column = np.indices((6, view.width, view.width)).reshape(3, -1)
    places = np.column_stack([face, row - TILE, column - TILE])
    inside = ((places[:, 1:] >= 0) & (places[:, 1:] < settings.faces)).all(axis=-1)
    assert inside.mean() > 0.8
    np.testing.assert_array_equal(cells[inside], places[inside])
    assert (cells[~inside, 0] != face[~inside]).all()  # a margin continues the plane of its face


def test_cells_subtend_about_the_same_angle() -> None:
    size = 64
    edges = np.tan((np.arange(size + 1) / size - 0.5) * 0.5 * np.pi)
    u, v = np.meshgrid(edges, edges)
    # Solid angle of a rectangle from its corners (Eriksson's formula in the form of an arctangent).
    corner = np.arctan(u * v / np.sqrt(1.0 + u**2 + v**2))
    angles = np.diff(np.diff(corner, axis=0), axis=1)
    assert 6.0 * angles.sum() == pytest.approx(4.0 * np.pi)
    view = CubeView((0.0, 0.0, 0.0), size)
    film = 2.0 * view.rows()[0, TANGENT] / view.height  # a pixel's angle
    assert angles.max() == pytest.approx(film**2, rel=0.01)
    assert 0.7 < angles.min() / angles.max() < 0.72


def test_places_of_pixels_are_distinct_and_near_each_other_in_tiles() -> None:
    view = CubeView((0.0, 0.0, 0.0), 280, TILE)
    places = view.places(np.arange(view.width * view.height, dtype=np.int32))
    assert len(np.unique(places)) == len(places)
    tiles = places.reshape(-1, TILE, view.width // TILE, TILE).swapaxes(1, 2).reshape(-1, TILE * TILE)
    assert (np.ptp(tiles, axis=1) == TILE * TILE - 1).mean() > 0.9  # but where faces begin


def test_cells_are_a_fraction_of_a_pixel_wide_at_the_center() -> None:
    view = View(BOX_CAMERA, BOX_CAMERA, BOX_CAMERA, 64, 48)
    pixel = 2.0 * np.tan(0.5 * BOX_CAMERA.vertical_fov) / 48
    for center, cell in ((BOX_CAMERA.position, CELL_OF_CENTER), ((0.0, 0.0, 2.9), CELL_OF_ANCHOR)):
        settings = PanoramaSettings.of(view, center, spp=64, max_depth=4, seed=1)
        assert settings.faces % BLOCK == 0
        assert 0.5 * np.pi / settings.faces <= cell * pixel < 0.5 * np.pi / (settings.faces - BLOCK)


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
