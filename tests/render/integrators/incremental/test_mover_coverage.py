# SPDX-License-Identifier: Apache-2.0
"""What tells where movers are, and what the denoiser is shown of them: smooth edges, bounding_regions of what has changed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.render.integrators.incremental.test_incremental_pass import AT, LENS, RED, SIZE, Box
from tiscene.device.memory import upload
from tiscene.render.integrators.incremental.changed_regions import CELL, MARGIN, STEP, bounding_regions, changed_regions
from tiscene.render.integrators.incremental.incremental_pass import IncrementalImage
from tiscene.render.integrators.incremental.mover_coverage import NO_MOVER_NEAR, SUBPIXELS

pytestmark = pytest.mark.usefixtures("taichi")

WIDTH, HEIGHT = SIZE
RADII = (0.2, 0.15)


def coverage(scene: Box, across: int = 16) -> NDArray[np.float64]:
    """How much of each pixel the balls cover, by many rays against spheres."""
    camera = scene.view.current
    steps = (np.arange(across) + 0.5) / across - 0.5
    y, x = np.meshgrid(*(np.add.outer(np.arange(size), steps).ravel() for size in (HEIGHT, WIDTH)), indexing="ij")
    scale = 2.0 * np.tan(0.5 * camera.vertical_fov) / HEIGHT
    right, up, back = camera.axes().T
    rays = (x - 0.5 * (WIDTH - 1))[..., None] * scale * right - (y - 0.5 * (HEIGHT - 1))[..., None] * scale * up - back
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    hit = np.zeros(rays.shape[:2], bool)
    for center, radius in zip(AT, RADII, strict=True):
        offset = np.array(center) - camera.position
        along = rays @ offset
        hit |= (along > 0.0) & (offset @ offset - along**2 < radius**2)
    return hit.reshape(HEIGHT, across, WIDTH, across).mean(axis=(1, 3))


def looks_of(scene: Box, all_places: bool = True) -> NDArray[np.int32]:
    scene.replay(*AT)
    passes, base = scene.passes, next(reversed(scene.passes._bases.values()))
    groups, scratch = passes._groups(scene.moving), passes._scratch
    assert scratch is not None
    looks = base.looks.covered(lambda rays, n: passes._test(rays, n, groups, scratch), scratch.cut, all_places)
    return looks.copy()


def test_places_tell_how_much_of_a_pixel_is_covered() -> None:
    """The small ball has few faces and is a little smaller than its sphere."""
    scene = Box()
    exact, looks = coverage(scene), looks_of(scene)
    assert (looks[exact > 0.25] != NO_MOVER_NEAR).all()
    known = np.maximum(looks, 0) / SUBPIXELS
    edges = (known > 0.0) & (known < 1.0)
    assert 10 < edges.sum() < 200
    assert np.abs(known - exact).max() < 0.4
    assert np.sqrt(np.mean((known - exact)[edges] ** 2)) < 0.12
    first = np.maximum(looks_of(scene, all_places=False), 0) / SUBPIXELS
    assert set(np.unique(first)) <= {0.0, 0.5, 1.0}
    assert np.abs(first - exact).sum() > 1.5 * np.abs(known - exact).sum()


def test_the_denoiser_sees_edges_without_noise() -> None:
    """Four paths a pixel hit and miss a mover's edge by chance; behind a lens they are what tells."""
    scene = Box(RED)
    truth = scene.trace(*AT, frame=7, spp=256)
    looks = looks_of(scene)
    edges = (looks > 0) & (looks < SUBPIXELS)
    image = scene.passes.render(scene.moving)
    assert isinstance(image, IncrementalImage)
    seen, chance = np.zeros((2, HEIGHT, WIDTH))
    for seed in range(4):
        scene.replay(*AT, seed=seed)
        image = scene.passes.render(scene.moving)
        seen += np.abs(image.albedo - truth.albedo).sum(axis=-1)
        few = scene.replayed_mean()[..., 3:6]
        chance += np.abs(few - truth.albedo).sum(axis=-1)
    assert seen[edges].mean() < 0.6 * chance[edges].mean()
    blurred = Box(RED, camera=LENS)
    blurred.replay(*AT)
    hdr = blurred.passes.render(blurred.moving)
    inside = looks == SUBPIXELS
    np.testing.assert_allclose(hdr.albedo[inside], blurred.replayed_mean()[..., 3:6][inside], atol=1e-5)


def test_patches_hold_what_has_changed() -> None:
    random = np.random.default_rng(5)
    height, width = 180, 250
    for _ in range(20):
        cells = np.zeros((-(-height // CELL), -(-width // CELL)), bool)
        for _ in range(3):
            y, x = random.integers(0, cells.shape[0]), random.integers(0, cells.shape[1])
            cells[y : y + random.integers(1, 5), x : x + random.integers(1, 5)] = True
        held = np.zeros((height, width), bool)
        for rows, columns in bounding_regions(cells, height, width):
            assert 0 <= rows.start < rows.stop <= height
            assert 0 <= columns.start < columns.stop <= width
            assert (rows.stop - rows.start) % STEP == 0 or rows.stop - rows.start == height
            held[rows, columns] = True
        wanted = np.kron(cells, np.ones((CELL, CELL), bool))[:height, :width]
        around = np.pad(wanted, MARGIN)
        for shift in (-MARGIN, MARGIN):
            for axis in (0, 1):
                moved = np.roll(around, shift, axis)[MARGIN:-MARGIN, MARGIN:-MARGIN]
                assert held[moved].all()
    assert bounding_regions(np.zeros((4, 4), bool), 32, 32) == []
    assert bounding_regions(np.ones((4, 4), bool), 32, 32) == [(slice(0, 32), slice(0, 32))]


def test_shadows_count_and_specks_do_not() -> None:
    width, height = 96, 64
    change, below = np.zeros((height, width, 10), np.float32), np.full((height, width, 3), 0.5, np.float32)
    unmoved = np.ones((height, width, 1), np.float32)
    change[16:24, 24:32, :3] = -0.3  # a shadow
    change[50, 80, :3] = 1.0  # a speck
    drawn = below + change[..., :3]
    (shadow,) = changed_regions(upload(change.reshape(-1, 10)), drawn, drawn, unmoved)
    assert shadow == (slice(4, 36), slice(12, 44))
    unmoved[60, 90] = 0.0
    assert len(changed_regions(upload(change.reshape(-1, 10)), drawn, drawn, unmoved)) == 2
