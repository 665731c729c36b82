# SPDX-License-Identifier: Apache-2.0
"""Views: camera rays and camera coordinates against the intrinsic matrix, and the device array."""

import numpy as np
import pytest
import taichi as ti

from tiscene.device.kernel_types import Floats2
from tiscene.errors import ArgumentError
from tiscene.render.integrators.incremental.frame_scratch import CORRECTION_COLUMNS, MOVER_COLUMNS
from tiscene.render.integrators.path.path_state import FILM_COLUMNS
from tiscene.render.view import MAX_PIXELS, View, camera_ray, check_image_size
from tiscene.scene.camera import Camera
from tiscene.scene.placement import CURRENT, NEXT

CAMERA = Camera.look_at((1.0, 2.0, 3.0), (-0.5, 0.2, 0.1), vertical_fov=0.9)
OTHER = Camera.look_at((-2.0, 1.0, 2.0), (0.3, 0.2, 0.1), vertical_fov=1.2)
WIDTH, HEIGHT = 64, 48


@ti.kernel
def rays_through(view: Floats2, time: ti.i32, pixels: Floats2, w: ti.i32, h: ti.i32, rays: Floats2):
    for i in range(pixels.shape[0]):
        origin, direction = camera_ray(view, time, pixels[i, 0], pixels[i, 1], w, h)
        for c in ti.static(range(3)):
            rays[i, c] = origin[c]
            rays[i, 3 + c] = direction[c]


@pytest.mark.parametrize(("time", "camera"), [(CURRENT, CAMERA), (NEXT, OTHER)])
def test_camera_rays_match_intrinsics(time: int, camera: Camera) -> None:
    pixels = np.array([[0, 0], [63, 47], [31.5, 23.5], [10.25, 40.75], [-30, 90]], np.float32)
    rays = np.zeros((len(pixels), 6), np.float32)
    rays_through(View(CAMERA, CAMERA, OTHER, WIDTH, HEIGHT).array(), time, pixels, WIDTH, HEIGHT, rays)
    np.testing.assert_allclose(np.linalg.norm(rays[:, 3:], axis=1), 1.0, atol=1e-6)
    points = rays[:, :3].astype(float) + 3.0 * rays[:, 3:]
    inverse = np.linalg.inv(camera.world_from_camera())
    seen = (points @ inverse[:3, :3].T + inverse[:3, 3]) @ camera.intrinsics(WIDTH, HEIGHT).T
    np.testing.assert_allclose(seen[:, :2] / seen[:, 2:], pixels, atol=1e-4)


def test_camera_coordinates_match_intrinsics() -> None:
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 3))
    view = View(CAMERA, CAMERA, OTHER, WIDTH, HEIGHT)
    inverse = np.linalg.inv(OTHER.world_from_camera())
    expected = (points @ inverse[:3, :3].T + inverse[:3, 3]) @ OTHER.intrinsics(WIDTH, HEIGHT).T
    matrix = view.camera_from_world()[NEXT]
    seen = points @ matrix[:, :3].T + matrix[:, 3]
    pixels = seen[:, :2] / seen[:, 2:] * view.focal_lengths()[NEXT] + (0.5 * (WIDTH - 1), 0.5 * (HEIGHT - 1))
    np.testing.assert_allclose(pixels, expected[:, :2] / expected[:, 2:], atol=1e-9)


def test_array_is_cached_and_empty_size_raises() -> None:
    view = View(CAMERA, CAMERA, CAMERA, WIDTH, HEIGHT)
    assert view.array() is view.array()
    np.testing.assert_array_equal(view.array().to_numpy(), view.rows())
    with pytest.raises(ArgumentError, match="0x48 pixels"):
        View(CAMERA, CAMERA, CAMERA, 0, HEIGHT)


def test_images_whose_arrays_kernels_cannot_count_are_refused() -> None:
    check_image_size(16384, 8192)
    assert MAX_PIXELS == 16384 * 8192
    assert MAX_PIXELS * max(FILM_COLUMNS, CORRECTION_COLUMNS, MOVER_COLUMNS) < 2**31
    with pytest.raises(ArgumentError, match="image of 16384x16384 pixels: at most 134217728 pixels"):
        View(CAMERA, CAMERA, CAMERA, 16384, 16384)
