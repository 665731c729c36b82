# SPDX-License-Identifier: Apache-2.0
"""Cloth simulation: lengths, contacts, pinning, repeatability."""

from __future__ import annotations

import numpy as np

from usd_scenes.author import cloth_simulation as cloth


def flat_sheet(size: float = 0.4, cell: float = 0.04, height: float = 0.3) -> tuple[np.ndarray, cloth.Cloth]:
    pattern = cloth.pattern(size, size, cell)
    start = np.insert(pattern.astype(float), 1, height, axis=-1)
    return pattern, cloth.sheet(pattern, start)


def test_sheet_comes_to_rest_on_floor() -> None:
    pattern, simulated = flat_sheet()
    simulated.relax(0.6, [cloth.floor(0.1)])
    np.testing.assert_allclose(simulated.sheet()[..., 1], 0.1, atol=1e-3)
    np.testing.assert_allclose(simulated.sheet()[..., [0, 2]], pattern, atol=1e-3)


def test_sheet_pinned_at_edge_hangs_without_stretching() -> None:
    _, simulated = flat_sheet()
    simulated.pin(simulated.sheets[0][0])
    simulated.relax(2.0, [], drag=6.0)
    points = simulated.sheet()
    np.testing.assert_allclose(points[0, :, 1], 0.3)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    np.testing.assert_allclose(lengths, 0.04, rtol=0.03)
    assert points[-1, :, 1].max() < 0.3 - 0.36


def test_bag_is_as_thick_as_its_filling() -> None:
    pattern = cloth.pattern(0.4, 0.4, 0.04)
    gap = np.where(np.abs(pattern).max(axis=-1) < 0.15, 0.06, 0.0)
    simulated = cloth.bag(pattern, np.insert(pattern.astype(float), 1, 0.05, axis=-1), gap)
    simulated.relax(0.3, [cloth.floor()])
    top, bottom = simulated.sheet(0), simulated.sheet(1)
    np.testing.assert_array_equal(top[0], bottom[0])
    middle = np.linalg.norm(top[5, 5] - bottom[5, 5])
    assert 0.05 < middle < 0.09
    assert simulated.points[:, 1].min() > -1e-6


def test_obstacles_return_distance_and_direction() -> None:
    points = np.array([[2.0, 0.0, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, -3.0]])
    distance, away = cloth.box((-1, -1, -1), (1, 1, 1), 0.1)(points)
    np.testing.assert_allclose(distance, [1.0, -0.6, 2.0])
    np.testing.assert_allclose(away, [[1, 0, 0], [0, 1, 0], [0, 0, -1]], atol=1e-12)
    distance, away = cloth.rod((-1, 0, 0), (1, 0, 0), 0.1)(np.array([[0.0, 0.5, 0.0], [2.0, 0.0, 0.0]]))
    np.testing.assert_allclose(distance, [0.4, 0.9])
    np.testing.assert_allclose(away, [[0, 1, 0], [1, 0, 0]], atol=1e-12)


def test_landscape_follows_points_up_to_maximum_slope() -> None:
    x, z = np.meshgrid(np.arange(-0.3, 0.3, 0.01), np.arange(-0.3, 0.3, 0.01))
    ground = np.stack([x.ravel(), np.where(np.abs(x) < 0.1, 0.5, 0.0).ravel(), z.ravel()], axis=-1)
    measure = cloth.landscape(ground, 0.02, 0.0, slope=2.0)
    distance, away = measure(np.array([[0.0, 0.7, 0.0], [0.2, 0.7, 0.0]]))
    np.testing.assert_allclose(distance[0], 0.2, atol=1e-9)
    np.testing.assert_allclose(away[0], (0, 1, 0), atol=1e-9)
    np.testing.assert_allclose(away[1], np.array((2, 1, 0)) / np.sqrt(5.0), atol=1e-9)


def test_simulation_repeats_bit_for_bit() -> None:
    first, second = flat_sheet()[1], flat_sheet()[1]
    for simulated in (first, second):
        simulated.relax(0.3, [cloth.box((-0.1, 0.0, -0.1), (0.1, 0.2, 0.1), 0.02), cloth.floor()])
    assert first.points.tobytes() == second.points.tobytes()
    assert first.points[:, 1].max() > 0.19


def test_refined_grid_passes_through_its_points() -> None:
    points = np.random.default_rng(1).normal(size=(4, 5, 3))
    fine = cloth.refined(points, 3)
    assert fine.shape == (10, 13, 3)
    np.testing.assert_allclose(fine[::3, ::3], points)
