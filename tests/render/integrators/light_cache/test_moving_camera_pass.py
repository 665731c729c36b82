# SPDX-License-Identifier: Apache-2.0
"""MovingCameraPass against path tracing, and independence of its frames from what was rendered before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.render.incremental_scenes import (
    BALLS,
    EMISSIVE,
    GLASS,
    GLOSSY,
    LACE,
    MIRROR,
    RED,
    SIZE,
    MovingBalls,
    Position,
)
from tests.render.path_scenes import BOX_CAMERA
from tiscene.render.integrators.light_cache import light_cache, moving_camera_pass
from tiscene.render.integrators.light_cache.moving_camera_pass import MovingCameraPass
from tiscene.render.integrators.path.path_pass import PathImage, PathPass
from tiscene.render.view import View
from tiscene.scene.description import Material

pytestmark = pytest.mark.usefixtures("taichi")

DEPTH = 5
ONE = BALLS[:1]


class CachedBalls(MovingBalls):
    """The Cornell box with moving balls, rendered with a light cache from a camera that moves."""

    def __init__(self, mover: Material = RED, wall: Material | None = None, lights: str = "lamp") -> None:
        super().__init__(mover, wall, lights)
        self.paths = PathPass(self.device, *SIZE)
        self.reported: list[str] = []
        self.cached = self.new_pass()

    def new_pass(self, memory_limit: int = 1 << 24) -> MovingCameraPass:
        return MovingCameraPass(
            self.paths,
            cell_spp=64,
            cell_width=1.0,
            memory_limit=memory_limit,
            progress=lambda stage, done: self.reported.append(stage),
        )

    def view_at(self, index: int) -> View:
        x, y, z = BOX_CAMERA.position
        camera = replace(BOX_CAMERA, position=(x + 0.02 * index, y, z - 0.03 * index))
        return View(camera, camera, camera, *SIZE)

    def image(self, *positions: Position, index: int = 0, spp: int = 4) -> PathImage | None:
        placement = self.at(*positions)
        self.device.place(placement)
        return self.cached.render(
            self.view_at(index), placement, self.moving, frame_index=index, seed=1, spp=spp, max_depth=DEPTH
        )

    def from_cache(self, *positions: Position, index: int = 0, spp: int = 4) -> NDArray[np.float32]:
        image = self.image(*positions, index=index, spp=spp)
        assert image is not None
        return image.hdr

    def traced(self, *positions: Position, spp: int = 256, seed: int = 2) -> NDArray[np.float32]:
        self.device.place(self.at(*positions))
        return self.paths.render(self.view_at(0), frame_index=0, seed=seed, spp=spp, max_depth=DEPTH).hdr


@pytest.mark.parametrize(
    ("wall", "lights"),
    [(None, "sky and bulb"), (GLOSSY, "lamp"), (MIRROR, "lamp"), (EMISSIVE, "lamp"), (LACE, "shadowless")],
    ids=lambda each: getattr(each, "name", str(each)),
)
def test_mean_light_equals_that_of_path_tracing(wall: Material | None, lights: str) -> None:
    scene = CachedBalls(wall=wall, lights=lights)
    for positions in ((), ONE):
        # Pixels that show a light are noisy and brighter than 1.
        images = scene.from_cache(*positions, spp=128), scene.traced(*positions)
        found, expected = (np.minimum(image, 1.0).mean() for image in images)
        assert found == pytest.approx(expected, rel=0.02), positions


@pytest.mark.parametrize("mover", [RED, GLASS, GLOSSY], ids=lambda each: each.name)
def test_movers_and_their_shadows_are_those_of_path_tracing(mover: Material) -> None:
    """Where a mover changes the light, the change has the right size; without it the error would be 100 %."""
    scene = CachedBalls(mover, lights="sky and bulb")
    image, empty = scene.from_cache(*ONE, spp=64), scene.from_cache(spp=64)
    truth, truth_empty = scene.traced(*ONE), scene.traced()
    changed = np.abs(truth - truth_empty).mean(axis=-1) > 0.1 * truth_empty.mean(axis=-1)
    assert 0.02 < changed.mean() < 0.5
    change, expected = (image - empty)[changed], (truth - truth_empty)[changed]
    assert change.mean() == pytest.approx(expected.mean(), rel=0.1, abs=0.003)
    assert np.abs(change - expected).mean() < 0.4 * np.abs(expected).mean()


def test_frames_do_not_depend_on_frames_rendered_before() -> None:
    scene = CachedBalls(wall=GLOSSY, lights="sky and bulb")
    forth = {index: scene.from_cache(*BALLS, index=index) for index in (0, 3, 6)}
    scene.cached = scene.new_pass()
    for index in (6, 0, 3):
        again = scene.from_cache(*BALLS, index=index)
        np.testing.assert_array_equal(again, forth[index], err_msg=str(index))


def test_full_cache_is_cleared_and_filled_again_with_the_same_light(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = CachedBalls(lights="sky and bulb")
    images = [scene.from_cache(*BALLS, index=index) for index in (0, 8)]
    needed = scene.cached.caches[-1].count
    monkeypatch.setattr(light_cache, "LEAST_CAPACITY", 64)
    scene.cached = small = scene.new_pass(
        int(0.9 * needed) * 4 * light_cache.SLOT_BYTES * moving_camera_pass.MAX_CACHES
    )
    for index, image in [(0, images[0]), (8, images[1]), (0, images[0])]:
        again = scene.from_cache(*BALLS, index=index)
        np.testing.assert_array_equal(again, image)
    cache = small.caches[-1]
    assert cache.count < needed
    assert cache.bytes <= small.memory_limit


def test_cache_belongs_to_the_static_scene_and_its_lights() -> None:
    scene = CachedBalls(lights="sky and bulb")
    lit = scene.from_cache()
    scene.from_cache(*BALLS)
    assert len(scene.cached.caches) == 1
    scene.dim((0.0, 0.0, 0.0))
    dimmed = scene.from_cache()
    assert len(scene.cached.caches) == 2
    assert dimmed.mean() < 0.9 * lit.mean()
    alone = CachedBalls(lights="sky and bulb")
    alone.dim((0.0, 0.0, 0.0))
    first = alone.from_cache()
    np.testing.assert_array_equal(dimmed, first)


def test_frame_is_path_traced_where_a_mover_emits_light_or_changes_most_pixels() -> None:
    assert CachedBalls(EMISSIVE).image(*BALLS) is None
    near_camera = tuple(np.add(BOX_CAMERA.position, (0.0, 0.0, -0.25)).tolist())
    assert CachedBalls().image(near_camera) is None
