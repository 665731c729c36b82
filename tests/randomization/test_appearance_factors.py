# SPDX-License-Identifier: Apache-2.0
"""The factors illumination, materials and views: overrides within the ranges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tiscene as ts
from tests.randomization.rooms import write_room
from tests.usd.helpers import write
from tiscene import catalog
from tiscene.errors import CameraNotFound, ScenarioError
from tiscene.randomization.factor_ranges import IlluminationRanges
from tiscene.randomization.scene_files import stage_of
from tiscene.scenario.overrides import CameraOverride, LightOverride
from tiscene.scenario.scenario import Scenario


def test_illumination_by_name_stops_and_ranges(drawn):
    night = drawn.with_factor("illumination", "night")
    assert dict(night.variants) == {"/SolidBenchmark{lighting}": "night"}
    assert not night.overrides
    assert drawn.with_factor("illumination", -1.5).exposure_compensation == -1.5
    lit = drawn.with_factor("illumination", {"strength": (0.5, 0.9), "color": 0.2, "yaw": 20}, seed=1)
    lights = [each for each in lit.overrides if isinstance(each, LightOverride)]
    assert len(lights) == len(stage_of(drawn).lights)
    assert all(0.5 <= each.intensity <= 0.9 and each.color != (1, 1, 1) for each in lights)
    assert all(each.yaw == 0.0 for each in lights)  # a rectangle and a sphere
    sky = Scenario("object_view").with_factor("illumination", {"yaw": (5, 20)}, seed=1)
    assert all(5 <= abs(each.yaw) <= 20 for each in sky.overrides)


def test_another_time_of_day_drops_overrides_of_lights_that_it_lacks():
    """By day the lamps of this room are off, so that its stage does not have them."""
    night = Scenario("room_01").with_factor("illumination", {"lighting": "night", "strength": (0.5, 2)}, seed=1)
    paths = {each.prim for each in night.overrides}
    assert any("Lamp" in path for path in paths)
    day = night.with_factor("illumination", {"lighting": ("day",)})
    assert not day.overrides
    moved = replace(night, variants={}).with_factor("speed", 1.0)
    assert {each.prim for each in moved.overrides} < paths


def test_mapping_changes_only_what_it_names():
    assert IlluminationRanges.of({"yaw": 3}, "illumination") == IlluminationRanges(yaw=(3, 3))


def test_materials_change_what_labels_and_color_show(drawn):
    """The buffer `albedo` shows overridden colors; labels stay."""
    painted = drawn.with_factor("materials", 0.6, seed=2)
    frames = []
    for scenario in (drawn, painted, replace(drawn, exposure_compensation=1.0)):
        with ts.Stream(scenario, width=32, height=24, buffers=("albedo", "instance"), quality="fast") as stream:
            frames.append((stream[0], stream.exposure))
    assert np.array_equal(frames[0][0].instance, frames[1][0].instance)
    assert np.abs(frames[0][0].albedo - frames[1][0].albedo).max() > 0.05
    assert frames[1][0].albedo.max() <= 0.9
    assert frames[2][1] == frames[0][1] + 1.0


def test_lighting_is_that_of_the_scene_else_of_all_rooms(tmp_path):
    room = """
    def Xform "{name}" (
        variants = {{ string lighting = "day" }}
        prepend variantSets = "lighting"
    ) {{
        variantSet "lighting" = {{ "day" {{ }} "night" {{ }} }}
    }}"""
    rooms = room.format(name="A") + room.format(name="B")
    joined = Scenario(str(write(tmp_path, f'def Xform "Home"\n{{{rooms}\n}}', name="home.usda")))
    assert joined.with_factor("illumination", "night").variants == {
        "/Home/A{lighting}": "night",
        "/Home/B{lighting}": "night",
    }
    whole = Scenario("home_01") if "home_01" in catalog.scenes() else Scenario("room_01")
    assert len(whole.with_factor("illumination", "night").variants) == 1


def test_views_turn_and_zoom_within_ranges(drawn):
    authored = stage_of(drawn).camera()
    for seed in range(6):
        turned = drawn.with_factor("views", {"yaw": (5, 10), "zoom": 2.0, "shift": (0.1, 0.3)}, seed=seed)
        (override,) = turned.overrides
        with ts.Stream(turned, width=8, height=6, buffers=("depth",)) as stream:
            camera = stream.world.camera
        cosine = float(camera.axes()[:, 2] @ authored.axes()[:, 2])
        assert 4.9 * np.cos(0.3) <= np.degrees(np.arccos(cosine)) <= 10.1
        assert np.tan(authored.vertical_fov / 2) / np.tan(camera.vertical_fov / 2) == pytest.approx(2.0, rel=1e-5)
        assert 0.1 <= np.linalg.norm(np.subtract(camera.position, authored.position)) <= 0.3001
        assert override.prim == ""
        assert camera.exposure == authored.exposure
    assert drawn.with_factor("views", "Left").camera == "Left"
    with pytest.raises(CameraNotFound):
        drawn.with_factor("views", "Lift")
    moving = replace(drawn, camera=ts.Camera(dynamic=ts.Orbit()))
    with pytest.raises(ScenarioError, match="moves along a trajectory"):
        moving.with_factor("views")


def test_views_replace_the_override_of_their_camera_by_any_name(drawn):
    others = (CameraOverride("Left", vertical_fov=0.5), LightOverride("Daylight", 0.5))
    for name in ("", "Main", "/SolidBenchmark/Cameras/Main"):
        overrides = [CameraOverride(name, vertical_fov=0.8), *others]
        made = replace(drawn, overrides=overrides).with_factor("views", 10)
        assert [each.prim for each in made.overrides] == ["Daylight", "Left", ""]


def test_views_shift_a_camera_over_a_floor_without_walls_in_all_directions(tmp_path):
    eye = np.array((0.0, 0.3, 2.5))
    scenario = Scenario(write_room(tmp_path, (0, 0.3, 2.5), {"Floor": ((0, -0.05, 0), (3, 0.05, 3))}))
    places = [scenario.with_factor("views", {"shift": (0.1, 0.3)}, seed=n).overrides[0].position for n in range(12)]
    shifts = np.array(places) - eye
    lengths = np.linalg.norm(shifts, axis=1)
    assert ((lengths >= 0.1 - 1e-5) & (lengths <= 0.3 + 1e-5)).all()
    assert (shifts.min(axis=0) < -0.03).all()
    assert (shifts.max(axis=0) > 0.03).all()
    assert (np.array(places)[:, 1] > 0.12).all()  # clear of the floor
