# SPDX-License-Identifier: Apache-2.0
"""IncrementalPass against path tracing with the same random numbers, its cost estimate, and its caches."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from tests.render.incremental_scenes import (
    BALLS,
    EMISSIVE,
    GLASS,
    GLOSSY,
    LACE,
    LENS,
    MIRROR,
    MOVERS,
    SIZE,
    MovingBalls,
    check_equal_means,
    corrected_path_mean,
    stacked,
)
from tests.render.path_scenes import BOX_CAMERA
from tiscene.device.memory import upload
from tiscene.render.integrators.incremental import path_cache
from tiscene.render.integrators.incremental.incremental_pass import EXTRA_PATHS_FRAME, IncrementalPass
from tiscene.render.integrators.incremental.mover_bounds import cluster_boxes
from tiscene.render.integrators.incremental.outlier_filter import filter_outliers
from tiscene.render.integrators.incremental.path_cache import BLOCK
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.description import Material
from tiscene.scene.placement import CURRENT


@pytest.mark.parametrize("mover", MOVERS)
@pytest.mark.parametrize(
    "others",
    [
        {},
        {"wall": MIRROR, "lights": "sky and bulb"},
        {"wall": GLASS, "camera": LENS},
        {"wall": LACE, "lights": "point"},
        {"wall": EMISSIVE},
    ],
    ids=lambda others: "-".join(getattr(each, "name", str(each)) for each in others.values()) or "plain",
)
def test_corrected_paths_equal_path_tracing(mover: str, others: dict[str, object]) -> None:
    """With the same random numbers, cached paths plus corrections equal path tracing, path by path."""
    scene = MovingBalls(MOVERS[mover], **others)  # type: ignore[arg-type]
    scene.render(*BALLS)
    corrected = stacked(corrected_path_mean(scene.incremental))
    np.testing.assert_allclose(corrected, stacked(scene.trace(*BALLS)), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("mover", ["matte", "glass", "emissive"])
@pytest.mark.parametrize("wall", [MIRROR, LACE, EMISSIVE], ids=lambda wall: wall.name)
def test_corrected_paths_equal_path_tracing_with_scaled_lights(mover: str, wall: Material) -> None:
    """Sky, bulb and sun scaled separately; also a shadowless light, whose contribution is recorded with segments."""
    for lights, factors in (
        ("sky and bulb", [(0.2, 0.5, 1.5), (0.0, 0.0, 0.0), (2.0, 0.0, 1.0)]),
        ("sky and bulb", [(0.3, 1.0, 1.0)]),
        ("shadowless", [(0.2, 0.5, 1.5)]),
    ):
        scene = MovingBalls(MOVERS[mover], wall=wall, lights=lights)
        scene.dim(*factors)
        scene.render(*BALLS)
        corrected = corrected_path_mean(scene.incremental).hdr
        np.testing.assert_allclose(corrected, scene.trace(*BALLS).hdr, rtol=1e-4, atol=1e-4, err_msg=lights)


@pytest.mark.parametrize("mover", ["matte", "glass"])
def test_corrected_paths_equal_path_tracing_with_indirect_multipliers(mover: str) -> None:
    """A mover removes direct and indirect light, each by its multiplier; at full and at reduced intensity."""
    for factors in ((), ((0.5, 0.2, 2.0),)):
        scene = MovingBalls(MOVERS[mover], wall=GLOSSY, lights="indirect multipliers")
        if factors:
            scene.dim(*factors)
        scene.render(*BALLS)
        traced = scene.trace(*BALLS).hdr
        np.testing.assert_allclose(corrected_path_mean(scene.incremental).hdr, traced, rtol=1e-4, atol=1e-4)
    unscaled = MovingBalls(MOVERS[mover], wall=GLOSSY, lights="indirect multipliers")
    unscaled.lights = [replace(light, indirect=1.0) for light in unscaled.lights]
    unscaled.dim(*factors)
    assert np.abs(unscaled.trace(*BALLS).hdr - traced).mean() > 0.02 * traced.mean()


@pytest.mark.parametrize("block", [BLOCK, 600])
def test_near_spp_adds_paths_where_movers_are_visible(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pixels that show a mover have the mean of both sets of paths; all others are unchanged."""
    monkeypatch.setattr(path_cache, "BLOCK", block)
    scene = MovingBalls(GLASS, wall=MIRROR, lights="sky and bulb")
    before = stacked(scene.render(*BALLS))
    after = stacked(scene.render(*BALLS, near_spp=3))
    near = (after != before).any(axis=-1)
    assert 0.02 < near.mean() < 0.3
    corrected = stacked(corrected_path_mean(scene.incremental))
    both = (4.0 * stacked(scene.trace(*BALLS)) + 3.0 * stacked(scene.trace(*BALLS, frame=EXTRA_PATHS_FRAME, spp=3))) / 7
    np.testing.assert_allclose(corrected[near], both[near], rtol=1e-4, atol=1e-4)
    np.testing.assert_array_equal(stacked(scene.render(*BALLS, near_spp=3)), after)


def test_corrected_paths_equal_path_tracing_before_a_background_of_one_color() -> None:
    """Each light group is traced by itself, but the background is there once."""
    scene = MovingBalls(lights="sky and bulb")
    camera = replace(BOX_CAMERA, vertical_fov=2.0 * BOX_CAMERA.vertical_fov)  # shows more than the box
    scene.view = View(camera, camera, camera, *SIZE, background=(0.2, 0.4, 0.6))
    scene.dim((0.5, 0.5, 0.5), (2.0, 2.0, 2.0))
    image = scene.render(*BALLS)
    np.testing.assert_allclose(stacked(corrected_path_mean(scene.incremental)), stacked(scene.trace(*BALLS)), atol=1e-5)
    empty = np.isclose(image.hdr, scene.view.background, rtol=1e-5).all(axis=-1)
    assert 0.1 < empty.mean() < 0.9


def test_frame_is_linear_in_light_intensity_and_shares_one_base() -> None:
    scene = MovingBalls(lights="sky and bulb")
    images = []
    for factors in ((1.0, 0.0), (0.0, 1.0), (0.25, 2.0), (0.0, 0.0)):
        scene.dim(*((factor, factor, factor) for factor in factors))
        images.append(scene.render(*BALLS, base_spp=4).hdr)
    sky, bulb, both, sun = images
    assert len(scene.incremental._bases) == 1
    np.testing.assert_allclose(both, 0.25 * (sky - sun) + 2.0 * (bulb - sun) + sun, rtol=1e-4, atol=1e-4)
    assert (sky.mean(), bulb.mean()) > (1.2 * sun.mean(), 1.2 * sun.mean())


def test_is_cheaper_unless_movers_invalidate_most_paths() -> None:
    """Small movers, none, and one that fills the image; the answer does not depend on earlier calls."""
    scene = MovingBalls()
    ask = {"seed": 1, "max_depth": 5}
    x, y, z = scene.view.current.position
    filling = (x, y, z - 0.21)
    answers = [
        scene.incremental.is_cheaper(scene.view, scene.at(*positions), scene.moving, **ask)
        for positions in (BALLS, (), (filling, BALLS[1]), BALLS)
    ]
    assert answers == [True, True, False, True]
    scene.incremental.prepare(scene.view, scene.at(*BALLS), scene.moving, base_spp=16, spp=4, **ask)
    assert not scene.incremental.is_cheaper(scene.view, scene.at(filling, BALLS[1]), scene.moving, **ask)


def test_frame_equals_base_image_where_movers_change_nothing() -> None:
    """Bit by bit: without movers, with movers out of the way of all paths, and in pixels that movers do not affect."""
    scene = MovingBalls()
    base = scene.render()
    np.testing.assert_array_equal(stacked(scene.render((0.0, 0.0, 30.0))), stacked(base))
    np.testing.assert_array_equal(stacked(base), stacked(scene.trace(frame=-1, spp=16)))
    moved = scene.render((0.85, -0.85, -0.8)).hdr
    unchanged = (moved == base.hdr).all(axis=-1)
    assert 0.3 < unchanged.mean() < 1.0


def test_frame_does_not_depend_on_earlier_frames() -> None:
    """The same bytes after other frames, after another base, and by another pass."""
    scene = MovingBalls(GLASS)
    first = stacked(scene.render(*BALLS))
    scene.render(BALLS[1], BALLS[0])
    np.testing.assert_array_equal(stacked(scene.render(*BALLS)), first)
    assert (stacked(scene.render(*BALLS, seed=2)) != first).any()
    np.testing.assert_array_equal(stacked(scene.render(*BALLS)), first)
    np.testing.assert_array_equal(stacked(MovingBalls(GLASS).render(*BALLS)), first)


DIGEST = """
import hashlib, sys
from tiscene.device import runtime
runtime.start(threads=int(sys.argv[1]))
from tests.render.incremental_scenes import BALLS, LACE, MovingBalls, stacked
print(hashlib.sha256(stacked(MovingBalls(LACE).render(*BALLS)).tobytes()).hexdigest())
"""


@pytest.mark.slow
@pytest.mark.parametrize("threads", ["1", "3"])
def test_bytes_do_not_depend_on_threads(threads: str) -> None:
    here = hashlib.sha256(stacked(MovingBalls(LACE).render(*BALLS)).tobytes()).hexdigest()
    done = subprocess.run([sys.executable, "-c", DIGEST, threads], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == here


def test_partially_opaque_movers_are_unbiased() -> None:
    """Their shadows are sampled with other random numbers, so only the expectation equals path tracing."""
    scene = MovingBalls(LACE, wall=LACE)
    incremental = np.stack([scene.render(*BALLS, base_spp=64, seed=seed).hdr for seed in range(8)])
    traced = np.stack([scene.trace(*BALLS, frame=frame, spp=16).hdr for frame in range(8)])
    check_equal_means(incremental, traced)


def test_filter_outliers_distributes_isolated_corrections_and_preserves_energy() -> None:
    """An isolated correction is distributed; one among similar ones, and one on a mover, is kept."""
    width, height = 50, 40
    correction, hdr = np.zeros((height, width, 9), np.float32), np.full((height, width, 3), 0.5, np.float32)
    isolated, block, mover = (5, 4), (slice(8, 13), slice(14, 20)), (2, 18)
    correction[isolated][:3] = -2.0
    correction[block][..., :3] = -0.4
    correction[mover][:3], correction[mover][5] = 3.0, 0.2
    hdr += correction[..., :3]
    filtered = filter_outliers(upload(correction.reshape(-1, 9)), hdr)
    assert filtered.sum(dtype=float) == pytest.approx(hdr.sum(dtype=float), rel=1e-6)
    assert 0.3 < filtered[isolated][0] < 0.5
    assert np.abs(filtered - hdr)[hdr == 0.5].max() < 0.02
    np.testing.assert_allclose(filtered[mover], hdr[mover], atol=0.02)
    np.testing.assert_allclose(filtered[block], hdr[block], atol=0.03)


@pytest.mark.parametrize("size", [(16, 16), (17, 33), (5, 3), (64, 48)])
def test_filter_outliers_preserves_energy_at_image_borders(size: tuple[int, int]) -> None:
    width, height = size
    for y, x in ((0, 0), (height - 1, width - 1), (height // 2, width // 2)):
        correction, hdr = np.zeros((height, width, 9), np.float32), np.full((height, width, 3), 0.5, np.float32)
        correction[y, x, :3] = 0.3
        hdr += correction[..., :3]
        filtered = filter_outliers(upload(correction.reshape(-1, 9)), hdr)
        assert filtered.sum(dtype=float) == pytest.approx(hdr.sum(dtype=float), rel=1e-5)
        assert filtered[y, x, 0] < 0.7


def test_filter_outliers_limits_what_it_distributes() -> None:
    """A blocked bright path on a dark wall darkens its surroundings only slightly."""
    correction, hdr = np.zeros((48, 64, 9), np.float32), np.full((48, 64, 3), 0.01, np.float32)
    correction[20, 30, :3] = -7.0
    filtered = filter_outliers(upload(correction.reshape(-1, 9)), hdr + correction[..., :3])
    assert filtered.min() > 0.006
    assert np.median(filtered) > 0.0095


def test_memory_limit_reduces_cached_spp() -> None:
    scene = MovingBalls()
    scene.render(*BALLS)
    assert scene.incremental._prepared()[0].cache.spp == 4
    one_base = scene.incremental.cached_bytes
    scene.render(*BALLS, seed=2)
    assert scene.incremental.cached_bytes > 1.9 * one_base  # both are in memory
    scene.incremental = IncrementalPass(PathPass(scene.device, *SIZE), memory_limit=one_base * 6 // 10)
    scene.render(*BALLS, seed=2)
    scene.render(*BALLS)
    assert scene.incremental._prepared()[0].cache.spp == 2
    assert scene.incremental.cached_bytes <= one_base * 6 // 10
    corrected = stacked(corrected_path_mean(scene.incremental))
    np.testing.assert_allclose(corrected, stacked(scene.trace(*BALLS, spp=2)), rtol=1e-4, atol=1e-4)


def test_base_that_returns_has_room_for_its_paths() -> None:
    """Neither of two bases needs less room than the other: one has more paths, the other longer ones."""
    scene = MovingBalls()
    images = []
    for spp, max_depth in ((16, 2), (1, 6), (16, 2)):
        numbers = {"seed": 1, "base_spp": 1, "spp": spp, "max_depth": max_depth}
        scene.incremental.prepare(scene.view, scene.at(*BALLS), scene.moving, **numbers)
        base, scratch = scene.incremental._prepared()
        assert scratch.rows >= base.cache.max_rows
        assert scratch.steps >= base.cache.steps
        scene.device.place(scene.at(*BALLS))
        images.append(scene.incremental.render(scene.moving).hdr)
    np.testing.assert_array_equal(images[2], images[0])


def test_cluster_boxes_contain_all_boxes() -> None:
    random = np.random.default_rng(3)
    low = random.uniform(-2.0, 2.0, (50, 3))
    boxes = np.concatenate([low, low + random.uniform(0.0, 0.5, (50, 3))], axis=1)
    clusters = cluster_boxes(boxes)
    assert clusters.shape == (8, 6)
    inside = (clusters[:, None, :3] <= boxes[:, :3]).all(axis=-1) & (clusters[:, None, 3:] >= boxes[:, 3:]).all(axis=-1)
    assert inside.any(axis=0).all()
    assert (cluster_boxes(boxes[:3])[3:, :3] > 1e29).all()


def test_moving_a_static_object_makes_a_new_base() -> None:
    scene = MovingBalls()
    before = scene.render().hdr
    block = np.flatnonzero(~scene.moving)[-1]
    scene.placed.world_from_object[:, block, 0, 3] -= 0.3
    after = scene.render().hdr
    assert (after != before).any()
    np.testing.assert_array_equal(after, scene.trace(frame=-1, spp=16).hdr)
    assert scene.placed.present[CURRENT, block]
