# SPDX-License-Identifier: Apache-2.0
"""Replaying cached paths: the picture of path tracing, and nothing changes where nothing moves."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.benchmarks.room import static_placement
from tests.render.path_scenes import BOX_CAMERA, CORNELL, WHITE, ball, box, described, matte, quad, towards
from tiscene.device.memory import upload
from tiscene.render.integrators.incremental import path_cache
from tiscene.render.integrators.incremental.base_lights import BaseLights
from tiscene.render.integrators.incremental.incremental_pass import (
    CACHED_PATHS_FRAME,
    EXTRA_PATHS_FRAME,
    IncrementalPass,
    cluster_boxes,
)
from tiscene.render.integrators.incremental.outlier_filter import filter_outliers
from tiscene.render.integrators.incremental.path_cache import BLOCK
from tiscene.render.integrators.incremental.path_recording import light_column
from tiscene.render.integrators.path.path_pass import PathImage, PathPass
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import DistantLight, DomeLight, Light, Material, RectLight, SphereLight
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.lights.light_groups import LightGroups, emission_of, with_emission
from tiscene.scene.placement import CURRENT, Placement

pytestmark = pytest.mark.usefixtures("taichi")

SIZE = (32, 24)
LAMP = RectLight("lamp", "/lamp", towards((0.0, 0.99, 0.0), (0.0, -1.0, 0.0)), (18.0, 15.0, 8.0), 0.6, 0.5)
LIGHTS: dict[str, list[Light]] = {
    "lamp": [LAMP],
    "sky and bulb": [
        DomeLight("sky", "/sky", np.eye(4), (0.5, 0.6, 0.9)),
        SphereLight("bulb", "/bulb", towards((0.5, 0.6, 0.2), (0.0, -1.0, 0.0)), (30.0, 20.0, 10.0), 0.1),
        DistantLight("sun", "/sun", towards((0.0, 0.0, 0.0), (0.2, -0.4, -1.0)), (2.0, 2.0, 2.0), 0.01),
    ],
    "shadowless": [
        replace(LAMP, casts_shadows=False),
        SphereLight("l", "/l", towards((0.5, 0.6, 0.2), (0.0, -1.0, 0.0)), (3.0, 3.0, 3.0), 0.1),
    ],
    "bounced otherwise": [
        replace(LAMP, indirect=0.3),
        SphereLight("l", "/l", towards((0.5, 0.6, 0.2), (0.0, -1.0, 0.0)), (3.0, 3.0, 3.0), 0.1, indirect=2.5),
    ],
    "point": [SphereLight("l", "/l", towards((0.0, 0.9, 0.3), (0.0, -1.0, 0.0)), (3.0, 3.0, 3.0), 0.0)],
}
RED, BLUE = matte("red", (0.6, 0.1, 0.1)), matte("blue", (0.1, 0.1, 0.6))
MIRROR = Material("mirror", diffuse_color=WHITE, metallic=1.0, roughness=0.0)
GLASS = Material("glass", diffuse_color=WHITE, opacity=0.0, roughness=0.0)
GLOSSY = Material("glossy", diffuse_color=(0.3, 0.5, 0.3), roughness=0.2, clearcoat=0.5)
GLOWING = matte("glowing", (0.2, 0.2, 0.2), emissive_color=(4.0, 3.0, 1.0))
LACE = matte("lace", (0.7, 0.7, 0.2), opacity=0.4, opacity_mode="presence")
MOVERS = {"matte": RED, "mirror": MIRROR, "glass": GLASS, "glossy": GLOSSY, "glowing": GLOWING}
AT = ((0.3, -0.1, 0.5), (-0.5, 0.3, 0.2))
SHARP = BOX_CAMERA
LENS = replace(BOX_CAMERA, lens_radius=0.1, focus_distance=3.0)
QUALITY = {"spp": 4, "max_depth": 5}


class Box:
    """Cornell's box with two balls that move."""

    def __init__(
        self, mover: Material = RED, wall: Material | None = None, lights: str = "lamp", camera: Camera = SHARP
    ) -> None:
        meshes, materials = box(CORNELL)
        if wall is not None:
            meshes.append(quad((-0.9, -0.9, 0.6), (-0.2, -0.9, 0.6), (-0.2, 0.6, 0.3), (-0.9, 0.6, 0.3), material=5))
        standing = len(meshes)
        meshes += [ball((0, 0, 0), 0.2, material=3, subdivisions=3), ball((0, 0, 0), 0.15, material=4, subdivisions=1)]
        self.lights = LIGHTS[lights]
        scene = described(meshes, [*materials, mover, BLUE, wall or BLUE], self.lights)
        self.device = DeviceScene()
        self.device.add(scene)
        self.placed = static_placement(scene)
        self.moving = np.arange(len(meshes)) >= standing
        self.groups: LightGroups | None = None
        self.view = View(camera, camera, camera, *SIZE)
        self.passes = IncrementalPass(self.device, *SIZE)

    def at(self, *positions: tuple[float, float, float]) -> Placement:
        """The balls at those positions; without one a ball is not there."""
        matrices, present = self.placed.world_from_object.copy(), self.placed.present.copy()
        for number, row in enumerate(np.flatnonzero(self.moving)):
            present[:, row] = number < len(positions)
            if number < len(positions):
                matrices[:, row, :, 3] = positions[number]
        groups, lights = self.groups, None
        if groups is not None:
            lights = tuple(
                (row, with_emission(light, tuple(groups.factors[number] * emission_of(light))))  # type: ignore[arg-type]
                for (row, light), number in zip(groups.lights, groups.group, strict=True)
            )
        return replace(self.placed, world_from_object=matrices, present=present, lights=lights, light_groups=groups)

    def dim(self, *factors: tuple[float, float, float]) -> None:
        """Each light by factors of its own, the last ones not."""
        lights = tuple((0, light) for light in self.lights)
        group = tuple(number + 1 if number < len(factors) else 0 for number in range(len(lights)))
        self.groups = LightGroups(lights, group, np.array([(1.0, 1.0, 1.0), *factors], np.float32))

    def replay(
        self, *positions: tuple[float, float, float], base_spp: int = 16, seed: int = 1, near_spp: int = 0
    ) -> PathImage:
        numbers = {"seed": seed, "base_spp": base_spp, "near_spp": near_spp, **QUALITY}
        self.passes.prepare(self.view, self.at(*positions), self.moving, **numbers)
        self.device.place(self.at(*positions))
        return self.passes.render(self.moving)

    def trace(self, *positions: tuple[float, float, float], frame: int = CACHED_PATHS_FRAME, spp: int = 4) -> PathImage:
        self.device.place(self.at(*positions))
        # What a mover emits is met, and not sampled, as in a difference.
        lights = self.device.lights
        stands = [number for number, each in enumerate(lights._meshes) if not self.moving[each[0]]]
        lights.place_meshes([lights._meshes[number] for number in stands], lights._places[stands])
        paths, scene = PathPass(self.device, *SIZE), None
        if self.groups is not None:  # lights are chosen as if they were at their brightest
            lights.place([light for _, light in self.groups.lights], [0] * len(self.lights))
            scene = paths.scene_arrays(BaseLights(self.device, self.groups).with_emission(self.groups.factors))
        return paths.render(self.view, frame_index=frame, seed=1, spp=spp, max_depth=QUALITY["max_depth"], scene=scene)

    def replayed_mean(self) -> NDArray[np.float32]:
        """[h, w, 9]: mean of the kept paths and what changed of it, in the last picture."""
        base, scratch = next(reversed(self.passes._bases.values())), self.passes._scratch
        assert scratch is not None
        mean = base.mean.to_numpy()
        if self.groups is not None:
            for group, factor in enumerate(self.groups.factors[1:], 1):
                mean[:, :3] += factor * mean[:, light_column(group) : light_column(group) + 3]
        total = mean[:, : light_column(1)] + scratch.change.to_numpy()[:, : light_column(1)]
        return total.reshape(SIZE[1], SIZE[0], 9)


def stacked(image: PathImage) -> NDArray[np.float32]:
    return np.concatenate([image.hdr, image.albedo, image.normal], axis=-1)


@pytest.mark.parametrize("mover", MOVERS)
@pytest.mark.parametrize(
    "others",
    [
        {},
        {"wall": MIRROR, "lights": "sky and bulb"},
        {"wall": GLASS, "camera": LENS},
        {"wall": LACE, "lights": "point"},
        {"wall": GLOWING},
    ],
    ids=lambda others: "-".join(getattr(each, "name", str(each)) for each in others.values()) or "plain",
)
def test_every_path_is_the_one_that_tracing_would_give(mover: str, others: dict[str, object]) -> None:
    """With the same random numbers, base paths and what changes of them add up to path tracing, path by path."""
    scene = Box(MOVERS[mover], **others)  # type: ignore[arg-type]
    scene.replay(*AT)
    np.testing.assert_allclose(scene.replayed_mean(), stacked(scene.trace(*AT)), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("mover", ["matte", "glass", "glowing"])
@pytest.mark.parametrize("wall", [MIRROR, LACE, GLOWING], ids=lambda wall: wall.name)
def test_every_path_is_the_one_that_tracing_would_give_under_lamps_that_change(mover: str, wall: Material) -> None:
    """Sky, bulb and sun by factors of their own; a shadowless lamp, too, whose light comes with a path's segments."""
    for lights, factors in (
        ("sky and bulb", [(0.2, 0.5, 1.5), (0.0, 0.0, 0.0), (2.0, 0.0, 1.0)]),
        ("sky and bulb", [(0.3, 1.0, 1.0)]),
        ("shadowless", [(0.2, 0.5, 1.5)]),
    ):
        scene = Box(MOVERS[mover], wall=wall, lights=lights)
        scene.dim(*factors)
        scene.replay(*AT)
        np.testing.assert_allclose(
            scene.replayed_mean()[..., :3], scene.trace(*AT).hdr, rtol=1e-4, atol=1e-4, err_msg=lights
        )


@pytest.mark.parametrize("mover", ["matte", "glass"])
def test_lights_whose_bounces_count_otherwise(mover: str) -> None:
    """A mover cuts direct and bounced light, each by its multiplier; as they are, and dimmed."""
    for factors in ((), ((0.5, 0.2, 2.0),)):
        scene = Box(MOVERS[mover], wall=GLOSSY, lights="bounced otherwise")
        if factors:
            scene.dim(*factors)
        scene.replay(*AT)
        traced = scene.trace(*AT).hdr
        np.testing.assert_allclose(scene.replayed_mean()[..., :3], traced, rtol=1e-4, atol=1e-4)
    usual = Box(MOVERS[mover], wall=GLOSSY, lights="bounced otherwise")
    usual.lights = [replace(light, indirect=1.0) for light in usual.lights]
    usual.dim(*factors)
    assert np.abs(usual.trace(*AT).hdr - traced).mean() > 0.02 * traced.mean()


@pytest.mark.parametrize("block", [BLOCK, 600])
def test_pixels_in_which_a_mover_is_seen_have_more_paths(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Theirs is the mean of both sets of paths; that of all others is what it was."""
    monkeypatch.setattr(path_cache, "BLOCK", block)
    scene = Box(GLASS, wall=MIRROR, lights="sky and bulb")
    before = stacked(scene.replay(*AT))
    after = stacked(scene.replay(*AT, near_spp=3))
    seen = (after != before).any(axis=-1)
    assert 0.02 < seen.mean() < 0.3
    both = (4.0 * stacked(scene.trace(*AT)) + 3.0 * stacked(scene.trace(*AT, frame=EXTRA_PATHS_FRAME, spp=3))) / 7.0
    np.testing.assert_allclose(scene.replayed_mean()[seen], both[seen], rtol=1e-4, atol=1e-4)
    np.testing.assert_array_equal(stacked(scene.replay(*AT, near_spp=3)), after)


def test_light_adds_up() -> None:
    """Changed brightness makes no new base, and each group's picture is a part of what is seen."""
    scene = Box(lights="sky and bulb")
    pictures = []
    for factors in ((1.0, 0.0), (0.0, 1.0), (0.25, 2.0), (0.0, 0.0)):
        scene.dim(*((factor, factor, factor) for factor in factors))
        pictures.append(scene.replay(*AT, base_spp=4).hdr)
    sky, bulb, both, sun = pictures
    assert len(scene.passes._bases) == 1
    np.testing.assert_allclose(both, 0.25 * (sky - sun) + 2.0 * (bulb - sun) + sun, rtol=1e-4, atol=1e-4)
    assert (sky.mean(), bulb.mean()) > (1.2 * sun.mean(), 1.2 * sun.mean())


def test_a_difference_pays_where_most_paths_are_left_alone() -> None:
    """Small movers, none, and one that fills the picture; the answer is the frame's own, whatever was asked before."""
    scene = Box()
    ask = {"seed": 1, "max_depth": 5}
    near = scene.view.current.position
    filling = (near[0], near[1], near[2] - 0.21)
    answers = [
        scene.passes.pays(scene.view, scene.at(*places), scene.moving, **ask)
        for places in (AT, (), (filling, AT[1]), AT)
    ]
    assert answers == [True, True, False, True]
    scene.passes.prepare(scene.view, scene.at(*AT), scene.moving, base_spp=16, spp=4, **ask)
    assert not scene.passes.pays(scene.view, scene.at(filling, AT[1]), scene.moving, **ask)


def test_nothing_changes_where_nothing_moves() -> None:
    """No noise at all: the base image to the bit, without movers and where they are out of all paths' way."""
    scene = Box()
    base = scene.replay()
    np.testing.assert_array_equal(stacked(scene.replay((0.0, 0.0, 30.0))), stacked(base))
    np.testing.assert_array_equal(stacked(base), stacked(scene.trace(frame=-1, spp=16)))
    moved = scene.replay((0.85, -0.85, -0.8)).hdr
    same = (moved == base.hdr).all(axis=-1)
    assert 0.3 < same.mean() < 1.0


def test_a_picture_is_the_same_at_any_time() -> None:
    """After other pictures, after another base, and by another pass."""
    scene = Box(GLASS)
    first = stacked(scene.replay(*AT))
    scene.replay(AT[1], AT[0])
    np.testing.assert_array_equal(stacked(scene.replay(*AT)), first)
    assert (stacked(scene.replay(*AT, seed=2)) != first).any()
    np.testing.assert_array_equal(stacked(scene.replay(*AT)), first)
    np.testing.assert_array_equal(stacked(Box(GLASS).replay(*AT)), first)


DIGEST = """
import hashlib, sys
from tiscene.device import runtime
runtime.start(threads=int(sys.argv[1]))
from tests.render.test_replay import AT, LACE, Box, stacked
print(hashlib.sha256(stacked(Box(LACE).replay(*AT)).tobytes()).hexdigest())
"""


def test_bytes_do_not_depend_on_threads() -> None:
    here = hashlib.sha256(stacked(Box(LACE).replay(*AT)).tobytes()).hexdigest()
    for threads in ("1", "3"):
        done = subprocess.run([sys.executable, "-c", DIGEST, threads], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert done.stdout.strip() == here


def test_movers_that_are_partly_there() -> None:
    """Their shadows are drawn by chance: only the expectation is that of path tracing."""
    scene = Box(LACE, wall=LACE)
    replayed = np.stack([scene.replay(*AT, base_spp=64, seed=seed).hdr for seed in range(8)])
    traced = np.stack([scene.trace(*AT, frame=frame, spp=16).hdr for frame in range(8)])
    check_equal_means(replayed, traced)


def check_equal_means(a: NDArray[np.float32], b: NDArray[np.float32], tile: int = 8) -> None:
    """Means over pictures [n, h, w, 3] agree by Welch's test, of all pixels and of tiles."""
    for size in (a.shape[1:3], (tile, tile)):
        means = []
        for images in (a, b):
            n, height, width, _ = images.shape
            parts = images.mean(axis=-1).reshape(n, height // size[0], size[0], width // size[1], size[1])
            means.append(parts.mean(axis=(2, 4)).reshape(n, -1).astype(np.float64))
        spread = sum(each.var(axis=0, ddof=1) / len(each) for each in means)
        rounding = 1e-5 * np.abs(means[0]).mean(axis=0)  # a background has no other error
        z = (means[0].mean(axis=0) - means[1].mean(axis=0)) / np.sqrt(spread + rounding**2)
        # Student's t of some 14 degrees of freedom: beyond 5 once in 5,000, and there are 12 tiles.
        assert np.abs(z).max() < 5.0, z
        assert np.sqrt((z**2).mean()) < 2.5, z


def test_spikes_are_evened_out_and_no_light_is_lost() -> None:
    """A lone change is spread; one among its like, and one where something else is seen now, stays."""
    width, height = 50, 40
    change, hdr = np.zeros((height, width, 9), np.float32), np.full((height, width, 3), 0.5, np.float32)
    lone, block, mover = (5, 4), (slice(8, 13), slice(14, 20)), (2, 18)
    change[lone][:3] = -2.0
    change[block][..., :3] = -0.4
    change[mover][:3], change[mover][5] = 3.0, 0.2
    hdr += change[..., :3]
    even = filter_outliers(upload(change.reshape(-1, 9)), hdr)
    assert even.sum(dtype=float) == pytest.approx(hdr.sum(dtype=float), rel=1e-6)
    assert 0.3 < even[lone][0] < 0.5
    assert np.abs(even - hdr)[hdr == 0.5].max() < 0.02
    np.testing.assert_allclose(even[mover], hdr[mover], atol=0.02)
    np.testing.assert_allclose(even[block], hdr[block], atol=0.03)


@pytest.mark.parametrize("size", [(16, 16), (17, 33), (5, 3), (64, 48)])
def test_no_light_of_a_spike_is_lost_at_the_edges(size: tuple[int, int]) -> None:
    width, height = size
    for y, x in ((0, 0), (height - 1, width - 1), (height // 2, width // 2)):
        change, hdr = np.zeros((height, width, 9), np.float32), np.full((height, width, 3), 0.5, np.float32)
        change[y, x, :3] = 0.3
        hdr += change[..., :3]
        even = filter_outliers(upload(change.reshape(-1, 9)), hdr)
        assert even.sum(dtype=float) == pytest.approx(hdr.sum(dtype=float), rel=1e-5)
        assert even[y, x, 0] < 0.7


def test_a_spike_that_is_too_large_to_spread_is_no_blotch() -> None:
    """What a bright path had brought to a dark wall, and is now cut: the wall is hardly darker around."""
    change, hdr = np.zeros((48, 64, 9), np.float32), np.full((48, 64, 3), 0.01, np.float32)
    change[20, 30, :3] = -7.0
    even = filter_outliers(upload(change.reshape(-1, 9)), hdr + change[..., :3])
    assert even.min() > 0.006
    assert np.median(even) > 0.0095


def test_a_tight_memory_keeps_fewer_paths() -> None:
    scene = Box()
    scene.replay(*AT)
    assert scene.passes.cached_spp == 4
    whole = scene.passes.cached_bytes
    scene.replay(*AT, seed=2)
    assert scene.passes.cached_bytes > 1.9 * whole  # both are kept
    scene.passes = IncrementalPass(scene.device, *SIZE, memory_limit=whole * 6 // 10)
    scene.replay(*AT, seed=2)
    scene.replay(*AT)
    assert scene.passes.cached_spp == 2
    assert scene.passes.cached_bytes <= whole * 6 // 10
    np.testing.assert_allclose(scene.replayed_mean(), stacked(scene.trace(*AT, spp=2)), rtol=1e-4, atol=1e-4)


def test_boxes_about_boxes() -> None:
    random = np.random.default_rng(3)
    low = random.uniform(-2.0, 2.0, (50, 3))
    boxes = np.concatenate([low, low + random.uniform(0.0, 0.5, (50, 3))], axis=1)
    groups = cluster_boxes(boxes)
    assert groups.shape == (8, 6)
    inside = (groups[:, None, :3] <= boxes[:, :3]).all(axis=-1) & (groups[:, None, 3:] >= boxes[:, 3:]).all(axis=-1)
    assert inside.any(axis=0).all()
    assert (cluster_boxes(boxes[:3])[3:, :3] > 1e29).all()


def test_the_base_follows_what_stands_still() -> None:
    """Another thing that stands still moves: a new base, not a ghost of the old one."""
    scene = Box()
    before = scene.replay().hdr
    block = np.flatnonzero(~scene.moving)[-1]
    scene.placed.world_from_object[:, block, 0, 3] -= 0.3
    after = scene.replay().hdr
    assert (after != before).any()
    np.testing.assert_array_equal(after, scene.trace(frame=-1, spp=16).hdr)
    assert scene.placed.present[CURRENT, block]
