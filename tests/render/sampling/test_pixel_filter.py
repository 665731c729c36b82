# SPDX-License-Identifier: Apache-2.0
"""Pixel filters: offsets follow the filter, and images equal filtered images of a higher resolution."""

import math

import numpy as np
import pytest

from tests.render.path_scenes import described, device_scene, matte, quad
from tiscene.errors import ArgumentError
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.sampling.pixel_filter import PIXEL_FILTERS, pixel_filter
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import DomeLight


def offsets_of(name: str, u: np.ndarray) -> np.ndarray:
    """Return what `sample_offset` returns, in numpy."""
    cells = pixel_filter(name).table()[2:]
    place = u * (len(cells) - 1)
    cell = np.minimum(place.astype(int), len(cells) - 2)
    return cells[cell] + (place - cell) * (cells[cell + 1] - cells[cell])


@pytest.mark.parametrize("name", PIXEL_FILTERS)
def test_offsets_follow_the_filter(name: str) -> None:
    filter = PIXEL_FILTERS[name]
    table = filter.table()
    x = offsets_of(name, (np.arange(400_000) + 0.5) / 400_000)
    assert (np.diff(x) >= 0.0).all()  # strata stay strata
    np.testing.assert_array_equal(table[2:], -table[:1:-1])
    counts, _ = np.histogram(x, 40, (-filter.radius, filter.radius))
    fine = np.abs(filter.weight(np.linspace(-filter.radius, filter.radius, 40 * 256 + 1)[:-1] + filter.radius / 10240))
    expected = fine.reshape(40, 256).sum(axis=1) / fine.sum()
    np.testing.assert_allclose(counts / len(x), expected, atol=0.0006)
    signs = np.where(np.abs(x) > table[1], -1.0, 1.0)
    assert (signs.mean() * math.sqrt(table[0])) == pytest.approx(1.0, abs=2e-3)  # a white image stays white white
    assert (table[0] > 1.0) == (name == "mitchell") == math.isfinite(table[1])


def test_box_filter_covers_the_pixel() -> None:
    u = np.arange(1 << 12).astype(np.float32) / (1 << 12)
    np.testing.assert_array_equal(offsets_of("box", u).astype(np.float32), u - np.float32(0.5))


def test_unknown_filter_raises() -> None:
    with pytest.raises(ArgumentError, match="pixel_filter='sinc': must be one of box, triangle, gaussian, mitchell"):
        pixel_filter("sinc")


@pytest.mark.parametrize("name", PIXEL_FILTERS)
def test_image_equals_filtered_image_of_higher_resolution(name: str) -> None:
    """A white screen with an edge at a third of a pixel, in front of a black sky."""
    screen = quad((0.0, -9.0, 0.0), (9.0, -9.0, 0.0), (9.0, 9.0, 0.0), (0.0, 9.0, 0.0))
    dome = DomeLight("sky", "/sky", np.eye(4), (1.0, 1.0, 1.0))
    scene = device_scene(described([screen], [matte("white", (1.0, 1.0, 1.0))], [dome]))
    size = 11
    camera = Camera(position=(-0.05, 0.0, 1.0), vertical_fov=2.0 * math.atan(0.5 * size * 0.15))
    view = View(camera, camera, camera, size, size, background=(0.0, 0.0, 0.0))
    paths = PathPass(scene, size, size, pixel_filter=name)
    hdr = paths.render(view, frame_index=0, seed=1, spp=1024, max_depth=2).hdr[..., 0].astype(float)
    filter = PIXEL_FILTERS[name]
    x = np.linspace(-filter.radius, filter.radius, 20001)
    weights = filter.weight(0.5 * (x[1:] + x[:-1]))
    edge = 5.0 + 0.05 / 0.15  # px
    expected = [weights[0.5 * (x[1:] + x[:-1]) + column > edge].sum() / weights.sum() for column in range(size)]
    np.testing.assert_allclose(hdr.mean(axis=0), expected, atol=0.012)
    assert (hdr.mean(axis=0).min() < -0.01) == (name == "mitchell")  # its lobes
