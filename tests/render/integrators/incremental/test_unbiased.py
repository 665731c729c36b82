# SPDX-License-Identifier: Apache-2.0
"""Incremental rendering of whole scenarios against path tracing: no bias (z-tests over independent bases), no flicker.

Each test takes minutes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import tiscene as ts
from tests.usd.helpers import preview_material, write
from tiscene.cli import demo

pytestmark = pytest.mark.slow

SIZE = (128, 96)
SEEDS = 8
TILE = 16


def living_room(count: int = 3, *others: ts.Object) -> ts.Scenario:
    """Return the living room with `count` objects of the demo, and others."""
    scenario = demo.scenario()
    return replace(scenario, objects=[*scenario.objects[:count], *others])


def crowd() -> ts.Scenario:
    """Return the living room with ten objects, seven of which bounce."""
    names = ("Ball 01", "Pillow 01", "Dish 01", "Cube", "Sphere", "Torus", "Cone")
    others = [
        ts.Object(
            f"mover_{row}",
            name,
            (-1.5 + 0.35 * row, 0.6 + 0.15 * row, -2.4 - 0.2 * (row % 3)),
            dynamic=ts.UniformMovementRandomBounce(0.6, seed=row),
            scale=0.3,
            collide=False,
        )
        for row, name in enumerate(names)
    ]
    return living_room(3, *others)


def near_the_lamp() -> ts.Scenario:
    """Return balls in front of the floor lamp's shade and in the light of the window."""
    before = ts.Object(
        "lamp_ball", "Ball 01", (0.75, 1.2, -3.6), dynamic=ts.Orbit((0.75, 1.2, -3.8), 2.0), collide=False
    )
    window = ts.Object(
        "sun_ball", "Ball 01", (-1.9, 1.2, -2.2), dynamic=ts.Orbit((-1.9, 1.2, -2.4), 3.0), collide=False
    )
    return living_room(0, before, window)


GLASS_BALL = """
def Xform "Ball" {
    def Sphere "Shape" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        double radius = 0.3
        rel material:binding = </Ball/Glass>
    }
    %s
}
"""
GLASS = preview_material(
    "/Ball/Glass", "float inputs:opacity = 0", "float inputs:roughness = 0", "float inputs:ior = 1.5"
)


def glass_ball(folder: Path) -> ts.Scenario:
    """Return a clear glass ball before the window, through which the demo's chair is sometimes visible."""
    file = write(folder, GLASS_BALL % GLASS, name="glass_ball.usda", more='defaultPrim = "Ball"')
    orbit = ts.Orbit((-0.6, 1.1, -2.2), 3.0)
    return living_room(1, ts.Object("glass", str(file), (-0.3, 1.1, -2.2), dynamic=orbit, collide=False))


def changing_lamps() -> ts.Scenario:
    """Return the living room with a lamp that dims and turns red, one that switches off, and a fading sun."""
    return replace(
        living_room(),
        lights=[
            ts.LightMotion("FloorLampLight", times=(0.0, 1.0), color=((1.0, 1.0, 1.0), (1.0, 0.2, 0.1))),
            ts.LightMotion("PendantLight", times=(0.0, 0.3), intensity=(1.0, 0.0)),
            ts.LightMotion("Sun", times=(0.0, 2.0), intensity=(0.5, 1.0)),
        ],
    )


def in_a_room(scene: str) -> ts.Scenario:
    """Return three objects on circles, 2 m ahead of the scene's camera."""
    camera = ts.Stream(scene, width=8, height=6, buffers=("depth",)).world.camera
    ahead = np.asarray(camera.position) - 2.0 * camera.axes()[:, 2]
    objects = []
    for row, name in enumerate(("Chair 01", "Ball 01", "Pillow 01")):
        x, y, z = (ahead + np.array((0.5 * (row - 1), 0.2 * (row - 1), 0.0))).tolist()
        objects.append(
            ts.Object(f"mover_{row}", name, (x + 0.3, y, z), dynamic=ts.Orbit((x, y, z), 2.0 + row), collide=False)
        )
    return ts.Scenario(scene, objects)


SCENARIOS: dict[str, Callable[[Path], ts.Scenario]] = {
    "three in the living room": lambda _: living_room(),
    "three in the bedroom": lambda _: in_a_room("room_01"),
    "three in the bathroom": lambda _: in_a_room("room_03"),
    "ten": lambda _: crowd(),
    "near the lamp": lambda _: near_the_lamp(),
    "glass": glass_ball,
    "changing lamps": lambda _: changing_lamps(),
    "three solids": lambda _: in_a_room("object_view"),
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_incremental_frame_has_expectation_of_path_tracing(name: str, tmp_path: Path) -> None:
    """Of the whole image and of tiles of 16 x 16 pixels; every seed has its own base image and paths."""
    scenario = SCENARIOS[name](tmp_path)

    def images_of(incremental: bool, spp: int) -> NDArray[np.float64]:
        settings = {"spp": spp, "max_depth": 5, "buffers": ("hdr",), "incremental": incremental}
        quality = "fast" if incremental else "preview"  # "fast" has more paths where movers are visible
        images = []
        for seed in range(SEEDS):
            with ts.Stream(scenario, width=SIZE[0], height=SIZE[1], quality=quality, seed=seed, **settings) as stream:
                images.append(stream[9].hdr.mean(axis=-1, dtype=float))
        return np.stack(images)

    incremental_images, traced = images_of(True, 4), images_of(False, 32)
    for z in (z_of(incremental_images, traced, SIZE[::-1]), z_of(incremental_images, traced, (TILE, TILE))):
        print(name, "largest z", float(np.abs(z).max()), "rms z", float(np.sqrt((z**2).mean())))
        assert np.abs(z).max() < 5.0
        assert np.sqrt((z**2).mean()) < 1.0 + 3.0 / np.sqrt(2.0 * z.size)


@pytest.mark.parametrize("quality", ["fast", "preview"])
def test_unchanged_pixels_do_not_flicker(quality: str) -> None:
    """Where radiance is unchanged, the difference between frames is at most a tenth of denoised path tracing's."""
    settings = {"width": SIZE[0], "height": SIZE[1], "quality": quality, "buffers": ("rgb", "hdr")}
    incremental_images, traced = (
        [stream[9], stream[10]]
        for stream in (ts.Stream(living_room(), incremental=way, **settings) for way in (True, False))
    )
    same = (incremental_images[0].hdr == incremental_images[1].hdr).all(axis=-1)
    assert same.mean() > 0.5
    flicker, plain = (
        np.abs(frames[0].rgb.astype(float) - frames[1].rgb)[same].mean() for frames in (incremental_images, traced)
    )
    print(quality, "8-bit levels", flicker, "path tracing", plain)
    assert flicker <= 0.1 * plain


def z_of(a: NDArray[np.float64], b: NDArray[np.float64], tile: tuple[int, int]) -> NDArray[np.float64]:
    """Return Welch's z of the means of tiles over images [n, h, w], scaled to a normal distribution."""
    tiles = [
        images.reshape(len(images), images.shape[1] // tile[0], tile[0], images.shape[2] // tile[1], tile[1])
        .mean(axis=(2, 4))
        .reshape(len(images), -1)
        for images in (a, b)
    ]
    variance = sum(each.var(axis=0, ddof=1) / len(each) for each in tiles)
    t = (tiles[0].mean(axis=0) - tiles[1].mean(axis=0)) / np.sqrt(variance + 1e-12)
    degrees = 2.0 * (len(a) - 1)
    return t * np.sqrt((degrees - 2.0) / degrees)
