# SPDX-License-Identifier: Apache-2.0
"""Streams whose camera turns or walks: what panoramas may change, and what not."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import tiscene as ts
from tiscene.render.integrators.incremental.incremental_pass import IncrementalPass
from tiscene.render.integrators.panorama.panoramas import Panoramas
from tiscene.render.view import View

SIZE = {"width": 32, "height": 24}
LABELS = ("depth", "instance", "forward_flow")
FAST: dict[str, Any] = {"quality": "fast", "buffers": ("hdr", *LABELS), **SIZE}
HERE = (0.0, 1.2, 0.5)


@pytest.fixture(scope="module", params=["turns", "walks", "zooms"])
def scenario(request: pytest.FixtureRequest) -> ts.Scenario:
    """A ball that bounces, and a camera that turns or walks to and fro, or zooms in."""
    ball = ts.Object("ball", "Ball 01", (0.0, 1.0, 0.6), dynamic=ts.UniformMovementRandomBounce(speed=1.0, seed=3))
    if request.param == "zooms":
        lens = ts.LensKeyframes((0.0, 1.0), vertical_fov=(1.0, 0.6))
        return ts.Scenario("solid_benchmark", [ball], camera=ts.Camera(HERE, (0.996, -0.087, 0.0, 0.0), lens=lens))
    if request.param == "turns":
        ends = [ts.Waypoint(HERE, (-10.0, yaw, 0.0)) for yaw in (0, 60, 0)]
    else:
        ends = [ts.Waypoint((x, HERE[1], HERE[2] - x), (-10.0, 0.0, 0.0)) for x in (0.0, 0.6, 0.0)]
    return ts.Scenario(
        "solid_benchmark", [ball], camera=ts.Camera(HERE, dynamic=ts.Keyframes((0.0, 2.0, 4.0), ends, repeat=True))
    )


@pytest.fixture(scope="module")
def stream(scenario: ts.Scenario) -> ts.Stream:
    return ts.Stream(scenario, **FAST)


def test_frames_of_a_moving_camera_do_not_depend_on_earlier_frames(scenario: ts.Scenario, stream: ts.Stream) -> None:
    frames = {index: stream[index] for index in (2, 30, 70)}
    with ts.Stream(scenario, **FAST) as fresh:
        for index in (70, 2, 30):
            for name in FAST["buffers"]:
                np.testing.assert_array_equal(fresh[index][name], frames[index][name], err_msg=f"{index}: {name}")


def test_labels_are_those_of_path_traced_frames_and_light_is_alike(scenario: ts.Scenario, stream: ts.Stream) -> None:
    frame = stream[12]
    with ts.Stream(scenario, incremental=False, spp=64, **FAST) as traced:
        truth = traced[12]
    for name in LABELS:
        np.testing.assert_array_equal(frame[name], truth[name])
    assert frame.hdr.mean() == pytest.approx(truth.hdr.mean(), rel=0.05)


def test_frames_are_path_traced_where_the_image_must_be_unbiased(scenario: ts.Scenario) -> None:
    options = FAST | {"quality": "standard", "spp": 1}
    with ts.Stream(scenario, incremental=True, **options) as on, ts.Stream(scenario, **options) as off:
        np.testing.assert_array_equal(on[12].hdr, off[12].hdr)


def test_pinhole_cameras_that_turn_or_walk_are_rendered_over_panoramas() -> None:
    camera = ts.Camera(HERE)
    turned, moved = replace(camera, rotation=(0.9, 0.0, 0.1, 0.0)), replace(camera, position=(0.0, 1.2, 0.51))
    thick = replace(turned, lens_radius=0.01)
    flat = replace(turned, orthographic_height=1.0)
    found = [View(camera, each, camera, 32, 24).pinhole_moves for each in (camera, turned, moved, thick, flat)]
    assert found == [False, True, True, False, False]
    assert View(camera, camera, camera, 32, 24, is_dynamic=True).pinhole_moves


def test_a_panorama_serves_a_range_of_fields_of_view(monkeypatch: pytest.MonkeyPatch) -> None:
    """A zoom from 1 to 1/1.9 traces cells for at most three widths of pixels, and a pause in it none."""
    made = []
    new = Panoramas._new

    def recorded(self: Panoramas, *arguments: Any, **named: Any) -> Any:
        made.append(arguments[2])
        return new(self, *arguments, **named)

    monkeypatch.setattr(Panoramas, "_new", recorded)
    monkeypatch.setattr(IncrementalPass, "prepare", lambda *_, **__: pytest.fail("a base image was rendered"))
    lens = ts.LensKeyframes((0.0, 0.2, 0.6, 0.8), vertical_fov=(1.1, 0.9, 0.9, 0.642))
    with ts.Stream(ts.Scenario("solid_benchmark", camera=ts.Camera(HERE, lens=lens)), **FAST) as stream:
        frames = list(itertools.islice(stream, 25))
    assert 2 <= len(made) == len({settings.faces for settings in made}) <= 3
    for frame in frames[7:14]:
        np.testing.assert_array_equal(frame.hdr, frames[6].hdr)


def test_a_camera_that_walks_by_edits_and_stops_stays_with_its_anchor() -> None:
    reported: list[str] = []
    with ts.Stream(ts.Scenario("solid_benchmark", camera=ts.Camera(HERE)), **FAST) as stream:
        stream._renderer._progress = lambda stage, done: reported.append(stage)
        frames = iter(stream)
        next(frames)
        for _ in range(2):
            stream.world.move_camera((0.02, 0.0, -0.02), relative=True)
            walked = next(frames)
        reported.clear()
        stopped = [next(frames) for _ in range(2)]
        assert not reported
        edited = stream.scenario
    np.testing.assert_allclose(stopped[0].hdr.mean(), walked.hdr.mean(), rtol=0.02)
    np.testing.assert_array_equal(stopped[0].hdr, stopped[1].hdr)
    with ts.Stream(edited, **FAST) as replayed:
        for frame in (*stopped, walked):
            np.testing.assert_array_equal(replayed[frame.index].hdr, frame.hdr)


@pytest.mark.parametrize("turned", [0.0, 3.0])
def test_lamps_that_move_light_the_room_before_any_camera(turned: float) -> None:
    """Lamps are objects whose surfaces emit. A camera at rest has a panorama then, as one that was turned has."""
    lamp = ts.Object("lamp", "Lamp Floor 01", (-0.9, 0.0, -1.2), dynamic=ts.Orbit((-0.9, 0.0, -1.3), period=8.0))
    dim = [ts.LightOverride(f"/SolidBenchmark/Lights/{name}", intensity=0.02) for name in ("Daylight", "LampLight")]
    scenario = ts.Scenario("solid_benchmark", [lamp], camera=ts.Camera(HERE), overrides=dim)
    means = []
    for quality in ({"quality": "fast"}, {"quality": "standard", "spp": 128, "incremental": False}):
        options = {**FAST, "width": 64, "height": 48, "buffers": ("hdr", "denoised", "instance"), **quality}
        with ts.Stream(scenario, **options) as stream:
            if turned:
                stream.world.turn_camera(turned)
            frame = stream[5]
        others = frame.instance != frame.objects[-1].id
        assert 0.9 < others.mean() < 0.98
        means.append((frame.hdr[others].mean(), frame.denoised[others].mean()))
    np.testing.assert_allclose(*means, rtol=0.08)


def test_a_camera_that_stops_needs_no_base_image_and_its_noise_stands_still(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(IncrementalPass, "prepare", lambda *_, **__: pytest.fail("a base image was rendered"))
    cube, pause = ts.Object("cube", "Cube", (0.2, 1.0, -0.6)), ts.Waypoint(HERE, (-10.0, 20.0, 0.0))
    stops = ts.Keyframes((0.0, 0.2, 1.0), [ts.Waypoint(HERE, (-10.0, 0.0, 0.0)), pause, pause])
    scenario = ts.Scenario("solid_benchmark", [cube], camera=ts.Camera(HERE, dynamic=stops))
    with ts.Stream(scenario, **FAST) as stream:
        stream.world.move("cube", (0.3, 1.0, -0.6))  # a mover from now on
        turning, *still = (stream[index] for index in (2, 10, 11))
    assert (turning.hdr != still[0].hdr).any()
    np.testing.assert_array_equal(still[0].hdr, still[1].hdr)


def test_cameras_roam_that_have_a_trajectory_or_were_placed() -> None:
    fixed, path = ts.Camera(HERE), ts.Keyframes((0.0, 1.0), [ts.Waypoint(HERE), ts.Waypoint(HERE, (0.0, 10.0, 0.0))])
    scenario = ts.Scenario("solid_benchmark", camera=(fixed, ts.Camera(HERE, name="panning", dynamic=path)))
    with ts.Stream(scenario, buffers=("depth",), **SIZE) as stream:
        assert [stream.world.camera_is_dynamic(5, row) for row in range(2)] == [False, True]
        stream.world.turn_camera(10.0)
        placed = stream.world.next_frame
        assert [stream.world.camera_is_dynamic(frame, 0) for frame in (placed, placed + 5)] == [True, True]
