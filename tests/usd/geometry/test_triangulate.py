# SPDX-License-Identifier: Apache-2.0
"""Polygon triangulation: exact areas, consistent winding, mixed batches."""

from __future__ import annotations

import numpy as np
import pytest

from tiscene.usd.geometry.triangulate import ear_clip, triangulate

L_SHAPE = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 3], [0, 3]], dtype=float)  # area 5
DART = np.array([[0, 0], [2, 1], [4, 0], [2, 4]], dtype=float)  # reflex at its second corner; area 6
COMB = np.array([[0, 0], [5, 0], [5, 2], [4, 2], [4, 1], [3, 1], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]], float)


def signed_areas(xy: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (xy[triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    return (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2.0


def lift(xy: np.ndarray) -> np.ndarray:
    return np.concatenate([xy, np.zeros((len(xy), 1))], axis=1)


@pytest.mark.parametrize(("polygon", "area"), [(L_SHAPE, 5.0), (DART, 6.0), (COMB, 8.0)])
def test_concave_polygon_keeps_area_and_winding(polygon, area):
    for start in range(len(polygon)):  # for every first corner
        xy = np.roll(polygon, -start, axis=0)
        corners, face = triangulate(lift(xy), np.array([len(xy)]), np.arange(len(xy)))
        areas = signed_areas(xy, corners)
        assert corners.shape == (len(xy) - 2, 3)
        assert (areas > -1e-12).all()
        assert areas.sum() == pytest.approx(area)
        assert not face.any()


@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)])
def test_polygon_in_any_plane_keeps_area(axes):
    points = lift(L_SHAPE)[:, axes] + (10.0, -20.0, 30.0)
    corners, _ = triangulate(points, np.array([6]), np.arange(6))
    p = points[corners]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]) / 2.0
    assert np.linalg.norm(normal.sum(axis=0)) == pytest.approx(5.0)
    assert np.linalg.norm(normal, axis=1).sum() == pytest.approx(5.0)


def test_faces_of_mixed_sizes_return_their_own_corners():
    points = np.concatenate([lift(L_SHAPE), lift(DART + 10.0), [[0, 0, 5], [1, 0, 5], [0, 1, 5]]])
    counts = np.array([3, 6, 2, 4])
    indices = np.array([10, 11, 12, 0, 1, 2, 3, 4, 5, 0, 1, 6, 7, 8, 9])
    corners, face = triangulate(points, counts, indices)
    assert face.tolist() == [0, 1, 1, 1, 1, 3, 3]
    assert corners[0].tolist() == [0, 1, 2]
    assert corners[1:5].min() >= 3
    assert corners[1:5].max() <= 8
    assert corners[5:].min() >= 11
    xy = points[indices][:, :2]
    assert signed_areas(xy, corners[1:5]).sum() == pytest.approx(5.0)
    assert (signed_areas(xy, corners[5:]) > 0.0).all()
    assert signed_areas(xy, corners[5:]).sum() == pytest.approx(6.0)


def test_random_star_shaped_polygons_keep_area_and_winding():
    rng = np.random.default_rng(5)
    for size in (5, 9, 40, 150):
        angle = np.sort(rng.uniform(0, 2 * np.pi, (6, size)), axis=1)
        angle = (np.arange(size) + 0.8 * (angle % 1.0)) * 2 * np.pi / size
        radius = rng.uniform(0.2, 1.0, (6, size))
        xy = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
        after = np.roll(xy, -1, axis=1)
        area = (xy[..., 0] * after[..., 1] - xy[..., 1] * after[..., 0]).sum(axis=1) / 2.0
        points = lift(xy.reshape(-1, 2))
        corners, face = triangulate(points, np.full(6, size), np.arange(6 * size))
        areas = signed_areas(points[:, :2], corners)
        assert (areas > -1e-12).all()
        np.testing.assert_allclose(np.bincount(face, areas), area, rtol=1e-9)


def test_hole_joined_by_bridge_keeps_area():
    outer = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0]]
    inner = [[1, 1], [1, 3], [3, 3], [3, 1], [1, 1]]
    xy = np.array(outer + inner, dtype=float)
    corners, _ = triangulate(lift(xy), np.array([len(xy)]), np.arange(len(xy)))
    areas = signed_areas(xy, corners)
    assert (areas > -1e-12).all()
    assert areas.sum() == pytest.approx(12.0)


def test_self_intersecting_polygon_terminates():
    star = np.array([[np.cos(a), np.sin(a)] for a in np.arange(5) * 4 * np.pi / 5])
    corners, _ = triangulate(lift(star), np.array([5]), np.arange(5))
    assert corners.shape == (3, 3)
    point = np.zeros((1, 7, 2))
    assert ear_clip(point).shape == (1, 5, 3)
