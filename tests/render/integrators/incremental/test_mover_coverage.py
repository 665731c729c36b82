# SPDX-License-Identifier: Apache-2.0
"""Coverage of pixels by movers, and what it does for the denoiser: smooth silhouettes, regions of changed light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tests.render.incremental_scenes import BALLS, LENS, RADII, RED, SIZE, MovingBalls, corrected_path_mean
from tiscene.device.memory import upload
from tiscene.render.integrators.incremental.changed_regions import (
    CELL,
    MARGIN,
    NARROW_MARGIN,
    STEP,
    bounding_regions,
    changed_regions,
    regions_of,
)
from tiscene.render.integrators.incremental.mover_coverage import NO_MOVER_NEAR, SUBPIXELS

WIDTH, HEIGHT = SIZE


def exact_coverage(scene: MovingBalls, side: int = 16) -> NDArray[np.float64]:
    """Return the fraction of each pixel that the balls cover, by side * side rays against exact spheres."""
    camera = scene.view.current
    steps = (np.arange(side) + 0.5) / side - 0.5
    y, x = np.meshgrid(*(np.add.outer(np.arange(size), steps).ravel() for size in (HEIGHT, WIDTH)), indexing="ij")
    scale = 2.0 * np.tan(0.5 * camera.vertical_fov) / HEIGHT
    right, up, back = camera.axes().T
    rays = (x - 0.5 * (WIDTH - 1))[..., None] * scale * right - (y - 0.5 * (HEIGHT - 1))[..., None] * scale * up - back
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    hit = np.zeros(rays.shape[:2], bool)
    for center, radius in zip(BALLS, RADII, strict=True):
        offset = np.array(center) - camera.position
        along = rays @ offset
        hit |= (along > 0.0) & (offset @ offset - along**2 < radius**2)
    return hit.reshape(HEIGHT, side, WIDTH, side).mean(axis=(1, 3))


def covered_subpixels(scene: MovingBalls, all_subpixels: bool = True) -> NDArray[np.int32]:
    """Render the balls at their default positions and count the subpixels that they cover."""
    scene.render(*BALLS)
    scene.incremental._retracer.place_movers(scene.moving)
    return scene.incremental._count_covered(all_subpixels)


def test_covered_subpixels_approximate_exact_coverage() -> None:
    """The small ball has few faces and is slightly smaller than its sphere."""
    scene = MovingBalls()
    exact, covered = exact_coverage(scene), covered_subpixels(scene)
    assert (covered[exact > 0.25] != NO_MOVER_NEAR).all()
    fraction = np.maximum(covered, 0) / SUBPIXELS
    edges = (fraction > 0.0) & (fraction < 1.0)
    assert 10 < edges.sum() < 200
    assert np.abs(fraction - exact).max() < 0.4
    assert np.sqrt(np.mean((fraction - exact)[edges] ** 2)) < 0.12
    probes_only = np.maximum(covered_subpixels(scene, all_subpixels=False), 0) / SUBPIXELS
    assert set(np.unique(probes_only)) <= {0.0, 0.5, 1.0}
    assert np.abs(probes_only - exact).sum() > 1.5 * np.abs(fraction - exact).sum()


def test_denoiser_features_have_smooth_edges_unless_lens_blurs_them() -> None:
    """Four paths per pixel hit or miss a mover's edge by chance; with a lens they are used nevertheless."""
    scene = MovingBalls(RED)
    truth = scene.trace(*BALLS, frame=7, spp=256)
    covered = covered_subpixels(scene)
    edges = (covered > 0) & (covered < SUBPIXELS)
    smooth_error, path_error = np.zeros((2, HEIGHT, WIDTH))
    for seed in range(4):
        image = scene.render(*BALLS, seed=seed)
        smooth_error += np.abs(image.albedo - truth.albedo).sum(axis=-1)
        path_error += np.abs(corrected_path_mean(scene.incremental).albedo - truth.albedo).sum(axis=-1)
    assert smooth_error[edges].mean() < 0.6 * path_error[edges].mean()
    blurred = MovingBalls(RED, camera=LENS)
    image = blurred.render(*BALLS)
    inside = covered == SUBPIXELS
    path_mean = corrected_path_mean(blurred.incremental).albedo
    np.testing.assert_allclose(image.albedo[inside], path_mean[inside], atol=1e-5)


def test_bounding_regions_contain_cells_and_margin() -> None:
    random = np.random.default_rng(5)
    height, width = 180, 250
    for _ in range(20):
        cells = np.zeros((-(-height // CELL), -(-width // CELL)), bool)
        for _ in range(3):
            y, x = random.integers(0, cells.shape[0]), random.integers(0, cells.shape[1])
            cells[y : y + random.integers(1, 5), x : x + random.integers(1, 5)] = True
        contained = np.zeros((height, width), bool)
        for rows, columns in bounding_regions(cells, height, width):
            assert 0 <= rows.start < rows.stop <= height
            assert 0 <= columns.start < columns.stop <= width
            assert (rows.stop - rows.start) % STEP == 0 or rows.stop - rows.start == height
            contained[rows, columns] = True
        wanted = np.kron(cells, np.ones((CELL, CELL), bool))[:height, :width]
        padded = np.pad(wanted, MARGIN)
        for shift in (-MARGIN, MARGIN):
            for axis in (0, 1):
                shifted = np.roll(padded, shift, axis)[MARGIN:-MARGIN, MARGIN:-MARGIN]
                assert contained[shifted].all()
    assert bounding_regions(np.zeros((4, 4), bool), 32, 32) == []
    assert bounding_regions(np.ones((4, 4), bool), 32, 32) == [(slice(0, 32), slice(0, 32))]


def test_a_group_is_covered_by_several_rectangles_where_they_are_smaller() -> None:
    cells = np.zeros((24, 32), bool)
    cells[2:22, 3:5] = cells[20:22, 3:28] = True  # an L
    regions = bounding_regions(cells, 192, 256)
    assert len(regions) == 2
    assert sum((rows.stop - rows.start) * (columns.stop - columns.start) for rows, columns in regions) < 0.5 * 176 * 216
    assert len(bounding_regions(cells[:8], 64, 256)) == 1  # a straight line


def test_regions_of_pixels_contain_them_with_a_narrow_margin() -> None:
    rng = np.random.default_rng(2)
    for height, width in ((150, 203), (48, 40), (17, 300)):
        mask = rng.random((height, width)) < 3e-3
        mask[:20, :3] = True
        counts = np.zeros((height, width), int)
        for rows, columns in regions_of(mask):
            counts[rows, columns] += 1
            assert all(
                (span.stop - span.start) % STEP == 0 or (span.stop - span.start) in mask.shape
                for span in (rows, columns)
            )
        wanted = np.pad(mask, NARROW_MARGIN)
        wanted = np.lib.stride_tricks.sliding_window_view(wanted, (2 * NARROW_MARGIN + 1,) * 2).any(axis=(2, 3))
        assert (counts[wanted] > 0).all()
    mask = np.zeros((192, 256), bool)
    mask[80:104, 100:120] = True  # in 4 x 3 cells, 32 x 24 px
    assert regions_of(mask) == [(slice(76, 108), slice(94, 126))]
    assert regions_of(np.zeros((9, 9), bool)) == []


def test_changed_regions_contain_shadows_and_movers_but_not_single_pixels() -> None:
    width, height = 96, 64
    correction, base = np.zeros((height, width, 10), np.float32), np.full((height, width, 3), 0.5, np.float32)
    static_mask = np.ones((height, width, 1), np.float32)
    correction[16:24, 24:32, :3] = -0.3  # a shadow
    correction[50, 80, :3] = 1.0  # a single pixel
    image = base + correction[..., :3]
    (shadow,) = changed_regions(upload(correction.reshape(-1, 10)), image, image, static_mask)
    assert shadow == (slice(4, 36), slice(12, 44))
    static_mask[60, 90] = 0.0
    assert len(changed_regions(upload(correction.reshape(-1, 10)), image, image, static_mask)) == 2
