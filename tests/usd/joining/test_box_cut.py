# SPDX-License-Identifier: Apache-2.0
"""A box cut out of polygons removes exactly what is inside, and interpolates values linearly."""

from __future__ import annotations

import numpy as np
import trimesh

from tiscene.usd.joining.box_cut import CutFaces, cut_box


def mesh_of(shape: trimesh.Trimesh, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> tuple[np.ndarray, ...]:
    points = np.asarray(shape.vertices, np.float64) + offset
    return points, np.full(len(shape.faces), 3), np.asarray(shape.faces, np.int64).reshape(-1)


def corners_of(points: np.ndarray, indices: np.ndarray, cut: CutFaces) -> np.ndarray:
    """Return the positions of all corners that a cut leaves, [n, 3]."""
    return cut.blend(points[indices])


def areas(corners: np.ndarray, counts: np.ndarray) -> float:
    """Return the total area of polygons."""
    total, start = 0.0, 0
    for count in counts:
        p = corners[start : start + count]
        total += np.linalg.norm(np.cross(p[1:-1] - p[0], p[2:] - p[0]).sum(axis=0)) / 2.0
        start += count
    return float(total)


def test_hole_in_a_plane_has_the_area_of_the_box() -> None:
    points = np.array([[-3.0, -3.0, 0.2], [3.0, -3.0, 0.2], [3.0, 3.0, 0.2], [-3.0, 3.0, 0.2]])
    cut = cut_box(points, np.array([4]), np.arange(4))
    assert cut is not None
    corners = corners_of(points, np.arange(4), cut)
    assert np.isclose(areas(corners, cut.counts), 36.0 - 4.0)
    middle = np.add.reduceat(corners, np.cumsum(cut.counts) - cut.counts) / cut.counts[:, None]
    assert (np.abs(middle).max(axis=1) > 1.0).all()


def test_cut_of_a_sphere_leaves_nothing_inside_and_everything_outside() -> None:
    shape = trimesh.creation.icosphere(subdivisions=3, radius=1.3)
    points, counts, indices = mesh_of(shape, (0.4, 0.1, -0.2))
    cut = cut_box(points, counts, indices)
    assert cut is not None
    corners = corners_of(points, indices, cut)
    assert (np.abs(corners).max(axis=1) > 1.0 - 1e-6).all()
    samples, _ = trimesh.sample.sample_surface(shape, 200_000, seed=1)
    outside = np.abs(samples + np.array([0.4, 0.1, -0.2])).max(axis=1) > 1.0
    assert np.isclose(areas(corners, cut.counts), shape.area * outside.mean(), rtol=5e-3)


def test_values_of_new_corners_are_interpolated_linearly() -> None:
    shape = trimesh.creation.box((3.0, 3.0, 3.0))
    points, counts, indices = mesh_of(shape, (1.2, 0.9, 0.4))
    cut = cut_box(points, counts, indices)
    assert cut is not None
    assert cut.is_new.any()
    slope = np.array([0.3, -2.0, 1.5])
    values = points[indices] @ slope + 4.0
    np.testing.assert_allclose(cut.blend(values), cut.blend(points[indices]) @ slope + 4.0)
    numbers = cut.blend(np.arange(len(indices)))
    assert numbers.dtype == np.int64
    np.testing.assert_array_equal(numbers, cut.corners[:, 0])


def test_faces_that_only_touch_the_box_are_left_as_they_are() -> None:
    points, counts, indices = mesh_of(trimesh.creation.box((2.0, 2.0, 2.0)), (2.0, 0.0, 0.0))
    assert cut_box(points, counts, indices) is None
    points, counts, indices = mesh_of(trimesh.creation.box((1.0, 1.0, 1.0)), (4.0, 0.0, 0.0))
    assert cut_box(points, counts, indices) is None


def test_mesh_inside_the_box_is_removed_whole() -> None:
    points, counts, indices = mesh_of(trimesh.creation.icosphere(radius=0.5))
    cut = cut_box(points, counts, indices)
    assert cut is not None
    assert len(cut.counts) == len(cut.corners) == 0
