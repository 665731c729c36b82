# SPDX-License-Identifier: Apache-2.0
"""Color buffers of a frame: `hdr`, `denoised` and `rgb`."""

from typing import Any

import numpy as np
import pytest

from tests.benchmarks.room import static_placement
from tests.render.path_scenes import BOX_CAMERA, CORNELL, box, described, device_scene, matte, quad, towards
from tiscene.render.film.tone_map import tone_map
from tiscene.render.render_settings import RenderSettings
from tiscene.render.renderer import Renderer
from tiscene.render.view import View
from tiscene.scene.description import RectLight

EXPOSURE = 1.25
COLOR_BUFFERS = ("rgb", "hdr", "denoised")


def color_buffers(
    denoise: bool, buffers: tuple[str, ...] = COLOR_BUFFERS, spp: int = 4
) -> dict[str, np.ndarray[Any, Any]]:
    lamp = RectLight("lamp", "/lamp", towards((0.0, 0.99, 0.0), (0.0, -1.0, 0.0)), (18.0, 15.0, 8.0), 0.6, 0.5)
    room = described(*box(CORNELL), [lamp])
    renderer = Renderer(device_scene(room), 40, 30, RenderSettings(spp=spp, max_depth=4, denoise=denoise))
    view = View(BOX_CAMERA, BOX_CAMERA, BOX_CAMERA, 40, 30)
    return renderer.render(view, static_placement(room), buffers, frame_index=0, seed=1, exposure=EXPOSURE)


def test_denoise_false_leaves_radiance_unchanged() -> None:
    found = color_buffers(denoise=False)
    assert found["denoised"].tobytes() == found["hdr"].tobytes()
    assert found["rgb"].tobytes() == tone_map(found["hdr"], EXPOSURE).tobytes()


def test_color_buffers_are_consistent_and_independent() -> None:
    found, raw = color_buffers(denoise=True), color_buffers(denoise=False)
    assert list(found) == list(COLOR_BUFFERS)
    assert found["hdr"].tobytes() == raw["hdr"].tobytes()
    assert found["rgb"].tobytes() == tone_map(found["denoised"], EXPOSURE).tobytes()
    assert found["denoised"].mean() == pytest.approx(raw["hdr"].mean(), rel=0.05)

    exact = color_buffers(denoise=False, buffers=("hdr",), spp=512)["hdr"]

    def error(image: np.ndarray[Any, Any]) -> float:
        return float(np.median(np.abs(image - exact)[exact > 0.0]))

    assert error(found["denoised"]) < 0.5 * error(raw["hdr"])
    alone = color_buffers(denoise=True, buffers=("denoised",))
    assert alone["denoised"].tobytes() == found["denoised"].tobytes()


def test_black_lamp_is_no_surface_in_much_light() -> None:
    """At reduced size, its light does not make a wall that faces like it brighter than the lamp."""
    lamp = quad((-0.5, -0.4, 0.2), (0.1, -0.4, 0.2), (0.1, 0.6, 0.2), (-0.5, 0.6, 0.2))
    wall = quad((-2.0, -2.0, -0.8), (2.0, -2.0, -0.8), (2.0, 2.0, -0.8), (-2.0, 2.0, -0.8), material=1)
    shining = matte("lamp", (0.0, 0.0, 0.0), emissive_color=(3.0, 3.0, 3.0))
    room = described([lamp, wall], [shining, matte("wall", (0.5, 0.5, 0.5))], [])
    settings = RenderSettings(spp=4, max_depth=4, denoiser="fast", downscale=2)
    view = View(BOX_CAMERA, BOX_CAMERA, BOX_CAMERA, 64, 48)
    found = Renderer(device_scene(room), 64, 48, settings).render(
        view, static_placement(room), ("hdr", "denoised"), frame_index=0, seed=1, exposure=0.0
    )
    assert found["denoised"].max() < 1.5 * 3.0
    assert found["denoised"].mean() == pytest.approx(found["hdr"].mean(), rel=0.06)
