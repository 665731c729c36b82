# SPDX-License-Identifier: Apache-2.0
"""Streams that show differences to what never moves: when they do, and that it changes no more than the noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import tiscene as ts
from tests.render.incremental_scenes import check_equal_means
from tests.stream.test_stream import moving_scenario, same
from tiscene.render.integrators.incremental.incremental_pass import IncrementalPass
from tiscene.render.render_settings import PRESETS
from tiscene.render.view import View
from tiscene.scene.description import DistantLight
from tiscene.scene.lights.light_groups import emission_of, with_emission

SMALL = {"width": 32, "height": 24, "spp": 2, "max_depth": 3, "buffers": ("hdr",)}
INCREMENTAL = {**SMALL, "incremental": True}


@pytest.fixture
def prepared(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many instances moved, of every frame that was a difference."""
    seen: list[int] = []
    prepare = IncrementalPass.prepare

    def noted(self, view, placement, moving, **others):  # type: ignore[no-untyped-def]
        seen.append(int((placement.present[1] & moving).sum()))
        return prepare(self, view, placement, moving, **others)

    monkeypatch.setattr(IncrementalPass, "prepare", noted)
    return seen


def test_presets_decide_and_the_argument_overrides(prepared: list[int]) -> None:
    """Frames never depend on how many there are."""
    for preset, expected in (("fast", True), ("preview", True), ("standard", False), ("photo", False)):
        for frames in (None, 1, 1000):
            stream = ts.Stream(moving_scenario(), frames=frames, **SMALL, quality=preset)
            assert stream.render_settings.incremental == expected
            assert (
                ts.Stream(moving_scenario(), incremental=not expected, **SMALL).render_settings.incremental
                is not expected
            )
    for unsupported in ({"relative_error": 0.1}, {"clamp": 2.0}, {"pixel_filter": "mitchell"}):
        assert not ts.Stream(moving_scenario(), quality="fast", **SMALL, **unsupported).render_settings.incremental
        with pytest.raises(ts.TisceneError, match="incremental=True"):
            ts.Stream(moving_scenario(), incremental=True, **SMALL, **unsupported)
    ts.Stream(moving_scenario(), frames=3, **SMALL)[1]
    assert prepared == []
    ts.Stream(moving_scenario(), frames=3, incremental=True, **SMALL)[1]
    assert len(prepared) == 1


@pytest.mark.parametrize("quality", ["fast", "preview", "standard", "photo"])
def test_a_frame_does_not_depend_on_the_number_of_frames(quality: str) -> None:
    settings = {"width": 16, "height": 12, "buffers": ("rgb", "hdr"), "quality": quality, "base_spp": 4}
    settings["spp"] = min(4, PRESETS[quality].spp)
    first = ts.Stream(moving_scenario(), frames=1, **settings)[0]
    for frames in (1000, None):
        assert same(ts.Stream(moving_scenario(), frames=frames, **settings)[0], first)


@pytest.mark.parametrize("quality", ["fast", "preview"])
def test_a_scene_in_which_nothing_moves_does_not_flicker(quality: str) -> None:
    """Nor one in which objects moved only by edits, except at the edit; a late view has the same bytes."""
    still = replace(moving_scenario(), objects=[ts.Object("rests", "Sphere")])
    settings = {"width": 16, "height": 12, "buffers": ("rgb",), "quality": quality}
    stream = ts.Stream(still, **settings)
    first, later = stream[0], stream[7]
    assert (first.rgb == later.rgb).all()
    assert (ts.Stream(still, **settings)[7].rgb == later.rgb).all()
    stream.seek(9)
    stream.world.move("rests", (0.4, 0.3, 0.0))
    assert (stream[8].rgb == first.rgb).all()
    assert (stream[10].rgb == stream[20].rgb).all()
    camera = stream[0].camera.camera
    view = View(camera, camera, camera, 16, 12)
    assert (stream.render_view(20, view, ("rgb",)).rgb == stream[20].rgb).all()


def test_what_rests_is_in_the_base_until_it_is_touched(prepared: list[int]) -> None:
    """An edit that touches it takes it out from its own frame on, whatever is asked for first."""
    scenario = moving_scenario()
    resting = ts.Object("rests", "Sphere", (0.5, 0.0, -0.5))
    stream = ts.Stream(replace(scenario, objects=[scenario.objects[0], resting]), **INCREMENTAL)
    before = stream[5].hdr
    stream.seek(4)
    stream.world.move("rests", (0.4, 0.3, 0.0))
    after = stream[5].hdr
    assert (before != after).any()
    assert (stream[3].hdr == ts.Stream(stream.scenario, **INCREMENTAL)[3].hdr).all()
    assert (stream[5].hdr == after).all()
    parts = np.diff(prepared)
    assert prepared[0] == prepared[2] < prepared[1] == prepared[-1]
    assert parts.any()


def test_what_edits_do_at_frame_0_is_how_the_stream_starts(prepared: list[int]) -> None:
    """What is spawned or moved then, and rests, is in the base, as if it were part of the scenario from the start."""
    empty = replace(moving_scenario(), objects=[])
    others = {**INCREMENTAL, "buffers": ("hdr", "instance", "backward_flow")}
    spawned = ts.Stream(empty, **others)
    cube, ball = spawned.world.spawn("Cube", (0.4, 0.0, -0.5)), spawned.world.spawn("Sphere", (0.0, 3.0, 0.0))
    spawned.world.move(ball, (-0.4, 0.0, -0.5))
    parts = [ts.Object("c", "Cube", (0.4, 0.0, -0.5)), ts.Object("b", "Sphere", (-0.4, 0.0, -0.5))]
    authored = ts.Stream(replace(empty, objects=parts), **others)
    for frame in (0, 1, 9):
        assert same(spawned[frame], authored[frame])
    assert not any(prepared)
    spawned.seek(5)
    spawned.world.move(cube, (0.4, 0.2, -0.5))
    before, after = spawned[4], spawned[5]
    assert prepared[-2:] == [0, 1]
    assert same(before, authored[4])
    assert (after.hdr != before.hdr).any()


def test_a_moving_camera_is_path_traced(prepared: list[int]) -> None:
    scenario = moving_scenario()
    turning = replace(scenario.camera, dynamic=ts.Orbit(period=4.0))
    stream = ts.Stream(replace(scenario, camera=turning), **INCREMENTAL)
    for frame in (0, 4):
        stream[frame]
    assert prepared == []


def test_a_replay_does_not_anticipate_a_spawn(prepared: list[int]) -> None:
    rests = replace(moving_scenario(), objects=[ts.Object("rests", "Sphere")])
    stream = ts.Stream(rests, **INCREMENTAL)
    seen = next(stream).hdr
    stream.world.spawn("Cube", (0.5, 0.0, -0.5))
    stream[1]
    assert prepared[0] == 0 < prepared[1]
    assert (ts.Stream(stream.scenario, **INCREMENTAL)[0].hdr == seen).all()


def test_base_spp_is_that_of_the_base() -> None:
    scenario = moving_scenario()
    scenario = replace(scenario, objects=[*scenario.objects, ts.Object("rests", "Sphere")])
    few, many = (ts.Stream(scenario, **INCREMENTAL, base_spp=spp) for spp in (2, 3))
    assert (few[2].hdr != many[2].hdr).any()
    with pytest.raises(ts.TisceneError, match="incremental"):
        few.load_state_dict(many.state_dict())
    with pytest.raises(ts.TisceneError, match="base_spp=0"):
        ts.Stream(moving_scenario(), **INCREMENTAL, base_spp=0)


def test_settings_tell_differential_streams_apart() -> None:
    plain, incremental = (ts.Stream(moving_scenario(), incremental=way, **SMALL) for way in (False, True))
    with pytest.raises(ts.TisceneError, match="incremental"):
        plain.load_state_dict(incremental.state_dict())


def test_same_expectation_as_path_tracing() -> None:
    """Over independent seeds, of all pixels and of tiles; textures, glass and metal of real templates."""

    def pictures(way: bool, spp: int) -> list[NDArray[np.float32]]:
        settings = {**SMALL, "spp": spp, "incremental": way}
        return [ts.Stream(moving_scenario(), **settings, seed=seed)[6].hdr for seed in range(6)]

    check_equal_means(np.stack(pictures(True, 4)), np.stack(pictures(False, 32)))


def test_what_is_made_is_reported() -> None:
    said: list[tuple[str, float]] = []
    stream = ts.Stream(
        moving_scenario(), **INCREMENTAL, seed=99, progress=lambda doing, done: said.append((doing, done))
    )
    stream[0]
    assert [doing for doing, _ in said] == ["base image", "paths", "paths"]
    assert said[-1][1] == 1.0
    stream[1]
    assert len(said) == 3


PULSE = ts.LightMotion("KeyLight", times=(0.0, 0.4), intensity=(0.0, 2.0), color=((1, 1, 1), (1, 0.5, 0)), repeat=True)


def test_a_lamp_that_pulses_is_traced_once(prepared: list[int]) -> None:
    """Its base and its paths serve all frames; the pictures are those of path tracing."""
    said: list[str] = []
    scenario = replace(moving_scenario(), lights=[PULSE])

    def pictures(way: bool, spp: int, frame: int) -> NDArray[np.float32]:
        settings = {**SMALL, "spp": spp, "incremental": way, "progress": lambda doing, done: said.append(doing)}
        return np.stack([ts.Stream(scenario, **settings, seed=seed)[frame].hdr for seed in range(6)])

    for frame in (6, 9):
        check_equal_means(pictures(True, 4, frame), pictures(False, 32, frame))
    stream = ts.Stream(scenario, **INCREMENTAL, progress=lambda doing, done: said.append(doing))
    dark, bright = stream[0].hdr, stream[9].hdr
    assert (bright - dark).max() > 0.1
    said.clear()
    stream[4]
    assert not said
    assert (stream[0].hdr == dark).all()


def test_a_lamp_dimmed_by_hand_is_a_factor(prepared: list[int]) -> None:
    """Also where nothing moves."""
    said: list[str] = []
    scenario = replace(moving_scenario(), objects=[ts.Object("rests", "Sphere")])
    stream = ts.Stream(scenario, **INCREMENTAL, progress=lambda doing, done: said.append(doing))
    row = next(row for row, light in enumerate(stream.world.stage.lights) if isinstance(light, DistantLight))
    lamp = stream.world.stage.lights[row]
    pictures = []
    for factor in (1.0, 0.0, 0.5, 3.0):
        stream.set_light(row, with_emission(lamp, tuple(factor * each for each in emission_of(lamp))))
        pictures.append(stream[5].hdr)
        if factor == 1.0:
            made = len(said)
    assert len(said) == made
    assert len(prepared) == 4
    own, dark, half, triple = pictures
    np.testing.assert_allclose(half, 0.5 * (own + dark), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(triple, 3.0 * own - 2.0 * dark, rtol=1e-4, atol=1e-5)
    assert (own - dark).max() > 0.1


def test_moving_lamps_are_path_traced(prepared: list[int]) -> None:
    """A frame is incremental if its lights are those of frames 0 and 1 in all but intensity."""
    late = ts.LightMotion(
        "KeyLight", dynamic=ts.Keyframes((0.1, 0.4), (ts.Waypoint((0, 2, 0)), ts.Waypoint((1, 2, 0))))
    )
    stream = ts.Stream(replace(moving_scenario(), lights=[late]), **INCREMENTAL)
    stream[1]
    assert len(prepared) == 1
    stream[5]
    assert len(prepared) == 1
