# SPDX-License-Identifier: Apache-2.0
"""Streams that show differences to what never moves: when they do, and that it changes no more than the noise."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

import tiscene as ts
from tests.render.integrators.incremental.test_incremental_pass import check_equal_means
from tests.stream.test_stream import moving_scenario
from tiscene.render.integrators.incremental.incremental_pass import IncrementalPass
from tiscene.scene.description import DistantLight, SphereLight
from tiscene.scene.lights.light_groups import LightGroups, shine, shining
from tiscene.stream.incremental import moving

SMALL = {"width": 32, "height": 24, "spp": 2, "max_depth": 3, "buffers": ("hdr",)}


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


def test_short_streams_are_not_worth_it(prepared: list[int]) -> None:
    for frames, wanted in ((None, True), (50, True), (49, False)):
        assert ts.Stream(moving_scenario(), frames=frames, **SMALL).incremental == wanted
    ts.Stream(moving_scenario(), frames=3, **SMALL)[1]
    assert prepared == []
    ts.Stream(moving_scenario(), frames=3, incremental=True, **SMALL)[1]
    assert len(prepared) == 1


def test_what_rests_is_in_the_base_until_it_is_touched(prepared: list[int]) -> None:
    """An edit that touches it takes it out from its own frame on, whatever is asked for first."""
    scenario = moving_scenario()
    resting = ts.Object("rests", "Sphere", (0.5, 0.0, -0.5))
    stream = ts.Stream(replace(scenario, objects=[scenario.objects[0], resting]), **SMALL)
    before = stream[5].hdr
    stream.seek(4)
    stream.world.move("rests", (0.4, 0.3, 0.0))
    after = stream[5].hdr
    assert (before != after).any()
    assert (stream[3].hdr == ts.Stream(stream.scenario, **SMALL)[3].hdr).all()
    assert (stream[5].hdr == after).all()
    parts = np.diff(prepared)
    assert prepared[0] == prepared[2] < prepared[1] == prepared[-1]
    assert parts.any()


def test_no_difference_where_nothing_moves_or_the_camera_does(prepared: list[int]) -> None:
    scenario = moving_scenario()
    still = ts.Stream(replace(scenario, objects=[ts.Object("rests", "Sphere")]), **SMALL)
    assert (still[0].hdr != still[1].hdr).any()
    turning = replace(scenario.camera, dynamic=ts.Orbit(period=4.0))
    stream = ts.Stream(replace(scenario, camera=turning), **SMALL)
    for frame in (0, 4):
        stream[frame]
    assert prepared == []


def test_a_spawn_to_come_makes_no_differences(prepared: list[int]) -> None:
    """A replay is path traced up to the spawn, as the stream was that knew nothing of it."""
    rests = replace(moving_scenario(), objects=[ts.Object("rests", "Sphere")])
    stream = ts.Stream(rests, **SMALL)
    seen = next(stream).hdr
    stream.world.spawn("Cube", (0.5, 0.0, -0.5))
    stream[1]
    assert len(prepared) == 1
    assert (ts.Stream(stream.scenario, **SMALL)[0].hdr == seen).all()
    assert len(prepared) == 1


def test_base_spp_is_that_of_the_base() -> None:
    scenario = moving_scenario()
    scenario = replace(scenario, objects=[*scenario.objects, ts.Object("rests", "Sphere")])
    few, many = (ts.Stream(scenario, **SMALL, base_spp=spp) for spp in (2, 3))
    assert (few[2].hdr != many[2].hdr).any()
    with pytest.raises(ts.TisceneError, match="incremental"):
        few.load_state_dict(many.state_dict())
    with pytest.raises(ts.TisceneError, match="base_spp=0"):
        ts.Stream(moving_scenario(), **SMALL, base_spp=0)


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
    stream = ts.Stream(moving_scenario(), **SMALL, seed=99, progress=lambda doing, done: said.append((doing, done)))
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
        settings = {**SMALL, "spp": spp, "incremental": way, "report": lambda doing, done: said.append(doing)}
        return np.stack([ts.Stream(scenario, **settings, seed=seed)[frame].hdr for seed in range(6)])

    for frame in (6, 9):
        check_equal_means(pictures(True, 4, frame), pictures(False, 32, frame))
    stream = ts.Stream(scenario, **SMALL, progress=lambda doing, done: said.append(doing))
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
    stream = ts.Stream(scenario, **SMALL, progress=lambda doing, done: said.append(doing))
    row = next(row for row, light in enumerate(stream.world.stage.lights) if isinstance(light, DistantLight))
    lamp = stream.world.stage.lights[row]
    pictures = []
    for factor in (1.0, 0.0, 0.5, 3.0):
        stream.set_light(row, shining(lamp, tuple(factor * each for each in shine(lamp))))
        pictures.append(stream[5].hdr)
        if factor == 1.0:
            made = len(said)
    assert len(said) == made
    assert len(prepared) == 4
    own, dark, half, triple = pictures
    np.testing.assert_allclose(half, 0.5 * (own + dark), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(triple, 3.0 * own - 2.0 * dark, rtol=1e-4, atol=1e-5)
    assert (own - dark).max() > 0.1


def test_lamps_that_change_leave_no_base() -> None:
    """A frame counts if its lights are those of frames 0 and 1, compared by value."""

    def world(radiance: list[float]) -> SimpleNamespace:
        lights = [[SphereLight("l", "/l", np.eye(4), (value, 1.0, 1.0), 0.1)] for value in radiance]
        groups = [LightGroups(((0, light),), (0,), np.ones((1, 3), np.float32)) for (light,) in lights]
        moves = lambda frame: np.array([False, frame != 4])  # noqa: E731
        first = tuple(groups[:2])
        return SimpleNamespace(
            light_groups=groups.__getitem__, has_dynamic_lights=True, initial_lights=first, moving=moves
        )

    steady, swinging, late = world([1.0] * 5), world([1.0, 2.0, 1.0]), world([1.0, 1.0, 1.0, 2.0])
    assert moving(steady, 3).tolist() == [False, True]  # type: ignore[arg-type, union-attr]
    assert moving(steady, 4) is None  # type: ignore[arg-type]
    assert moving(swinging, 0) is moving(swinging, 2) is None  # type: ignore[arg-type]
    assert moving(late, 2) is not None  # type: ignore[arg-type]
    assert moving(late, 3) is None  # type: ignore[arg-type]
