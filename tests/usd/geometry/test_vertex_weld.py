# SPDX-License-Identifier: Apache-2.0
"""Welding of face corners into vertices, distinct rows, normals."""

from __future__ import annotations

import numpy as np
import pytest

from tiscene.usd.geometry.vertex_weld import Attribute, smooth_normals, unique_rows, unit_normals, weld

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float32)
CORNER_POINT = np.array([0, 1, 2, 0, 2, 3])
TRIANGLES = np.array([[0, 1, 2], [3, 4, 5]])


def test_distinct_rows_are_numbered_in_order_of_first_appearance():
    first, row = unique_rows([np.array([7, 3, 7, 3]), np.array([[0.0], [1.0], [-0.0], [2.0]], dtype=np.float32)])
    assert first.tolist() == [0, 1, 3]
    assert row.tolist() == [0, 1, 0, 2]


def test_distinct_random_rows_agree_with_numpy():
    rng = np.random.default_rng(0)
    numbers, values = rng.integers(0, 50, 5000), rng.integers(0, 3, (5000, 2)).astype(np.float32)
    first, row = unique_rows([numbers, values])
    table = np.concatenate([numbers[:, None], values], axis=1)
    np.testing.assert_array_equal(table[first][row], table)
    assert len(first) == len(np.unique(table, axis=0))
    assert (np.diff(first) > 0).all()


def test_corners_with_equal_attributes_share_a_vertex():
    uv = Attribute(np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]], dtype=np.float32), per_corner=True)
    surface = weld(SQUARE, CORNER_POINT, TRIANGLES, np.zeros(2), None, uv)
    assert len(surface.positions) == 4
    np.testing.assert_array_equal(surface.uv[surface.triangles].reshape(-1, 2), uv.values)


def test_corners_with_different_attributes_split_the_vertex():
    uv = Attribute(np.array([[0, 0], [1, 0], [1, 1], [5, 5], [1, 1], [0, 1]], dtype=np.float32), per_corner=True)
    surface = weld(SQUARE, CORNER_POINT, TRIANGLES, np.zeros(2), None, uv)
    assert len(surface.positions) == 5
    np.testing.assert_array_equal(surface.uv[surface.triangles].reshape(-1, 2), uv.values)
    np.testing.assert_array_equal(surface.positions[surface.triangles].reshape(-1, 3), SQUARE[CORNER_POINT])


@pytest.mark.parametrize("per_corner", [False, True])
def test_corners_of_vertices_are_at_their_points(per_corner):
    uv = Attribute(np.arange(12, dtype=np.float32).reshape(6, 2), per_corner)
    surface = weld(SQUARE, CORNER_POINT[::-1], TRIANGLES, np.zeros(2), None, uv)
    np.testing.assert_array_equal(CORNER_POINT[::-1][surface.corner], surface.point)


def test_points_without_triangle_are_dropped():
    points = np.concatenate([[[9, 9, 9]], SQUARE]).astype(np.float32)
    surface = weld(points, CORNER_POINT + 1, TRIANGLES[:1], np.zeros(1), None, None)
    np.testing.assert_array_equal(surface.positions, SQUARE[:3])


def test_zero_normals_are_replaced_by_smooth_ones():
    vectors = np.array([[0, 0, 5], [0, 0, 0], [3, 0, 4], [0, 0, 1]], dtype=np.float32)
    result = unit_normals(vectors, SQUARE, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32))
    np.testing.assert_allclose(result, [[0, 0, 1], [0, 0, 1], [0.6, 0, 0.8], [0, 0, 1]], atol=1e-7)


def test_smooth_normals_are_area_weighted():
    points = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float32)
    normals = smooth_normals(points, np.array([[0, 1, 2], [0, 2, 3]]))
    np.testing.assert_allclose(normals[0], np.array([1, 0, 2]) / np.sqrt(5), atol=1e-6)
    np.testing.assert_allclose(normals[1], [0, 0, 1], atol=1e-6)
