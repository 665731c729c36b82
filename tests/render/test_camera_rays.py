# SPDX-License-Identifier: Apache-2.0
"""Distribution of camera rays: over the pixel by its filter, uniformly over the lens, and independent of each other."""

from dataclasses import replace

import numpy as np
import pytest

from tests.reference.chi_square import MIN_P_VALUE, chi_square
from tiscene.device.memory import upload
from tiscene.render.integrators.path import wavefront_kernels
from tiscene.render.integrators.path.frame_stack import FrameStack
from tiscene.render.integrators.path.path_state import PathState
from tiscene.render.intersect.ray_queue import tiled_order, upload_pixels
from tiscene.render.sampling.pixel_filter import PIXEL_FILTERS, pixel_filter
from tiscene.render.sampling.sobol import frame_key
from tiscene.render.view import View
from tiscene.scene.camera import Camera

SIZE = 256
CAMERA = Camera.look_at((0.3, 1.0, 2.0), (0.0, 0.2, -1.0), vertical_fov=0.6)
LENS = replace(CAMERA, lens_radius=0.2, focus_distance=1.7)


def camera_rays(camera: Camera, filter: str = "box", seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Generate one ray per pixel.

    Returns:
        Position on the lens [n, 2], m; offset from the pixel center in the focal plane [n, 2], px; direction [n, 3].
    """
    view, order = View(camera, camera, camera, SIZE, SIZE), tiled_order(SIZE, SIZE)
    s = PathState(SIZE * SIZE)
    wavefront_kernels.start_paths(
        view.array(), upload(pixel_filter(filter).table()), upload_pixels(order, SIZE, SIZE), SIZE, SIZE,
        0, SIZE * SIZE, 1, 0, frame_key(seed, 0), s.rays, s.state, s.status, s.queue, 0,
        *FrameStack.single().arguments,
    )  # fmt: skip
    rays = s.rays.to_numpy().astype(np.float64)
    right, up, backward = camera.axes().T
    origin, direction = rays[:, :3] - camera.position, rays[:, 4:7]
    lens = np.column_stack([origin @ right, origin @ up])
    focus = origin + direction * (camera.focus_distance / -(direction @ backward))[:, None]
    scale = 0.5 * SIZE / np.tan(0.5 * camera.vertical_fov) / camera.focus_distance
    place = np.column_stack([focus @ right, -(focus @ up)]) * scale + 0.5 * (SIZE - 1)
    return lens, place - np.column_stack([order % SIZE, order // SIZE]), direction


@pytest.mark.parametrize("name", PIXEL_FILTERS)
def test_pixel_offsets_follow_filter(name: str) -> None:
    _, offset, _ = camera_rays(CAMERA, name)
    filter = PIXEL_FILTERS[name]
    fine = np.linspace(-filter.radius, filter.radius, 100_001)
    total = np.abs(filter.weight(0.5 * (fine[1:] + fine[:-1]))).mean() * 2.0 * filter.radius

    def density(at: np.ndarray) -> np.ndarray:
        return np.abs(filter.weight(at[:, 0]) * filter.weight(at[:, 1])) / total**2

    offset = np.clip(offset, -filter.radius, filter.radius)  # rounding
    low, high = (-filter.radius, -filter.radius), (filter.radius, filter.radius)
    assert chi_square(offset, density, low, high, (20, 20)) > MIN_P_VALUE


def test_lens_samples_are_uniform_and_independent_of_pixel() -> None:
    lens, offset, direction = camera_rays(LENS)
    assert np.abs(offset).max() < 0.501  # the focal plane is sharp for every point on the lens
    assert np.abs(np.linalg.norm(direction, axis=1) - 1.0).max() < 1e-6
    squared = (lens**2).sum(axis=1) / LENS.lens_radius**2
    assert squared.max() < 1.0 + 1e-4
    angle = np.arctan2(lens[:, 1], lens[:, 0]) % (2.0 * np.pi)
    disk = np.column_stack([np.minimum(squared, 1.0 - 1e-9), angle])

    def even(at: np.ndarray) -> np.ndarray:
        return np.full(len(at), 0.5 / np.pi)

    assert chi_square(disk, even, (0.0, 0.0), (1.0, 2.0 * np.pi)) > MIN_P_VALUE
    # Positions on the pixel and on the lens are independent.
    for column in (0, 1):
        for other in (disk[:, 0], disk[:, 1] / (2.0 * np.pi)):
            both = np.column_stack([np.clip(offset[:, column] + 0.5, 0.0, 1.0 - 1e-9), other])
            assert chi_square(both, lambda at: np.ones(len(at)), (0.0, 0.0), (1.0, 1.0), (16, 16)) > MIN_P_VALUE
