# SPDX-License-Identifier: Apache-2.0
"""Boxes in view of a camera, against linear programs."""

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from dynamics.rotation import matrix_from_quaternion
from tiscene.scene.camera import Camera
from tiscene.world.frustum_test import in_view

BOXES = 100


def depth_in_view(camera: Camera, aspect: float, box: np.ndarray, pose: np.ndarray) -> float:
    """Return how far inside all sides of the view a point of a box is, at most; negative for none."""
    axes, half = camera.axes(), camera.half_height(1.0)
    turn, place = axes.T @ pose[:, :3], axes.T @ (pose[:, 3] - camera.position)
    narrowing = 0.0 if camera.orthographic_height is not None else 1.0
    rows, limits = [turn[2]], [-place[2]]  # in front of the camera
    for axis, center, size in zip((0, 1), camera.image_center(1.0), (aspect * half, half), strict=True):
        for side in (1.0, -1.0):  # side (x - center z) <= size z, in a prism <= size; z is the depth
            slope = narrowing * (side * center + size)
            rows.append(side * turn[axis] + slope * turn[2])
            limits.append((1.0 - narrowing) * (size + side * center) - side * place[axis] - slope * place[2])
    margins = np.linalg.norm(rows, axis=1)
    found = linprog([0, 0, 0, -1], np.column_stack([rows, margins]), limits, bounds=[*box.T, (-100.0, 100.0)])
    return -found.fun


@pytest.mark.parametrize("is_orthographic", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_boxes_in_view_agree_with_linear_programs(seed, is_orthographic):
    random = np.random.default_rng(seed)
    turns = random.normal(size=(BOXES + 1, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    size = 10.0 ** random.uniform(-1, 1, (BOXES, 2, 3)) * [[[-1.0], [1.0]]]
    poses = np.concatenate([matrix_from_quaternion(turns[1:]), 2.5 * random.normal(size=(BOXES, 3, 1))], axis=2)
    camera = Camera(
        tuple(random.normal(size=3)),
        tuple(turns[0]),
        vertical_fov=random.uniform(0.1, 2.5),
        orthographic_height=random.uniform(0.5, 3.0) if is_orthographic else None,
        aperture_offset=tuple(0.3 * random.normal(size=2)),
    )
    aspect = math.exp(random.normal())
    depths = np.array([depth_in_view(camera, aspect, *each) for each in zip(size, poses, strict=True)])
    certain = np.abs(depths) > 1e-6
    assert certain.sum() > 0.9 * BOXES
    assert 5 < (depths > 0.0).sum() < BOXES - 5
    np.testing.assert_array_equal(in_view(camera, aspect, size, poses)[certain], depths[certain] > 0.0)
