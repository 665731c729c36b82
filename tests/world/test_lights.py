# SPDX-License-Identifier: Apache-2.0
"""Lights that move and change, lights that objects carry, and several cameras: in a world made by hand."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import tiscene as ts
from tests.world.test_collisions import CUBE, TEMPLATE, at, mesh
from tiscene.errors import CameraNotFound, LightNotFound, ScenarioError
from tiscene.scene.description import Instance, RectLight, SceneDescription, SceneObject, SphereLight, Template
from tiscene.world.world import World

STAGE = SceneDescription(
    "room",
    (mesh(CUBE),),
    instances=(Instance(0, 0, at(5, 0, 0)),),
    objects=(SceneObject("Lamp", "/Lamp", "lamp"),),
    lights=(
        SphereLight("Bulb", "/Lamp/Bulb", at(5, 1, 0), (8.0, 8.0, 8.0), 0.1),
        RectLight("Panel", "/Panel", at(0, 3, 0), (2.0, 4.0, 6.0), 1.0, 1.0),
    ),
    cameras=(ts.Camera(name="Main"), ts.Camera((0, 5, 0), name="Top")),
)
TORCH = Template(
    "Torch",
    "lamp",
    SceneDescription(
        "Torch",
        (mesh(CUBE),),
        instances=(Instance(0, 0, np.eye(4)),),
        lights=(SphereLight("Flame", "/Torch/Flame", at(0, 0.5, 0), (1.0, 1.0, 1.0), 0.05),),
    ),
)


def world(*objects, fps=10.0, **others):
    scenario = ts.Scenario("room", objects, **others)
    return World(scenario, STAGE, lambda name: TORCH if name == "Torch" else TEMPLATE, fps)


def test_lights_are_the_stages_while_nothing_is_said_of_them():
    made = world(ts.Object("a", "Cube"))
    assert made.state(3).placement.lights is None
    assert made.state(3).lights == STAGE.lights


def test_color_and_intensity_are_keyframes():
    fade = ts.LightMotion("Panel", times=(1.0, 2.0), intensity=(1.0, 0.0))
    tint = ts.LightMotion("/Lamp/Bulb", times=(0.0, 4.0), color=((1, 1, 1), (1, 0, 0)), repeat=True)
    made = world(lights=[fade, tint])
    shown = {k: made.state(k).lights[1].radiance for k in (0, 10, 15, 20, 99)}
    assert shown[0] == shown[10] == (2.0, 4.0, 6.0), "held before the first"
    assert shown[15] == pytest.approx((1.0, 2.0, 3.0))
    assert shown[20] == shown[99] == (0.0, 0.0, 0.0), "and after the last"
    assert made.state(20).lights[0].radiance == made.state(60).lights[0].radiance == pytest.approx((8, 4, 4))
    same, other = made.state(30).placement.lights, made.state(40).placement.lights
    assert same[1][1] is other[1][1], "what has not changed is the same light, not an equal one"


def test_brightness_is_told_apart():
    """Lights that change alike are one group, at their brightest; where they are and what they are never changes."""
    fade = {"times": (0.0, 2.0), "intensity": (0.5, 4.0), "color": ((1, 1, 1), (0, 1, 1))}
    made = world(lights=[ts.LightMotion("Panel", **fade), ts.LightMotion("Bulb", **fade)])
    groups = [made.state(k).placement.light_groups for k in (0, 10, 20)]
    assert all(each.lights == groups[0].lights and each.group == (1, 1) for each in groups)
    assert [light.radiance for _, light in groups[0].lights] == [(32.0, 32.0, 32.0), (8.0, 16.0, 24.0)]
    wanted = [(0.125, 0.125, 0.125), (0.28125, 0.5625, 0.5625), (0.0, 1.0, 1.0)]
    np.testing.assert_allclose([each.factors[1] for each in groups], wanted)
    apart = world(lights=[ts.LightMotion("Panel", **fade), ts.LightMotion("Bulb", dynamic=ts.Orbit(period=1.0))])
    start, later = (apart.state(k).placement.light_groups for k in (0, 5))
    assert [each.group for each in (start, later)] == [(0, 1), (0, 1)]
    assert start.lights[0] != later.lights[0]
    assert not apart.state(5).starting_lights
    assert made.state(20).starting_lights
    assert world().state(4).placement.light_groups is None


def test_a_light_that_is_changed_by_hand_is_a_group_of_its_own():
    made = world()
    bulb = STAGE.lights[0]
    made.set_light(0, replace(bulb, radiance=(2.0, 4.0, 16.0)))
    groups = made.state(7).placement.light_groups
    assert groups.group == (1, 0)
    assert groups.lights[0][1].radiance == bulb.radiance
    np.testing.assert_allclose(groups.factors[1], (0.25, 0.5, 2.0))
    assert made.state(7).lights[0].radiance == (2.0, 4.0, 16.0)


def test_radiance_takes_the_place_of_the_lights_own():
    made = world(lights=[ts.LightMotion("Panel", times=(0, 1), radiance=((0, 0, 0), (1, 2, 3)), intensity=(1, 2))])
    assert made.state(0).lights[1].radiance == (0, 0, 0)
    assert made.state(10).lights[1].radiance == (2, 4, 6)


def test_lights_move_by_any_dynamic_whatever_the_timings():
    orbit = ts.LightMotion("Bulb", dynamic=ts.Orbit((0, 0, 0), period=4.0))
    made = world(lights=[orbit], timings=ts.AllTogether(3.0))
    np.testing.assert_allclose(made.state(10).lights[0].world_from_light[:3, 3], (0, 1, -5), atol=1e-12)
    assert made.state(10).lights[1] is STAGE.lights[1]
    assert made.state(10**6).lights[0].world_from_light.tobytes() == made.state(0).lights[0].world_from_light.tobytes()


def test_lights_stand_still_before_frame_0():
    turning, pulsing = ts.Orbit((0, 0, 0), period=4.0), {"times": (0, 4), "intensity": (1, 3), "repeat": True}
    made = world(lights=[ts.LightMotion("Bulb", turning, **pulsing)])
    start, before, after = (made.between(0, Fraction(half, 2))[0].lights[0][1] for half in (0, -1, 1))
    np.testing.assert_array_equal(before.world_from_light, start.world_from_light)
    assert before.radiance == start.radiance
    assert (after.world_from_light != start.world_from_light).any()
    assert after.radiance > start.radiance


def test_lamp_that_is_gone_at_frame_1_is_no_starting_light():
    made = world(ts.Object("a", "Torch", last_frame=0))
    assert not made.state(0).starting_lights
    assert not made.state(5).starting_lights


def test_lamp_that_is_spawned_at_frame_0_is_a_starting_light():
    made = world(ts.Object("a", "Torch"))
    assert made.state(5).starting_lights
    made.spawn("Torch", (0, 0, 7))
    assert made.state(5).starting_lights
    made.next_frame = 1
    made.spawn("Torch", (0, 0, 9))
    assert not made.state(5).starting_lights


def test_lights_of_a_template_travel_with_its_objects():
    path = ts.LinearWaypoints([ts.Waypoint((0, 0, 0)), ts.Waypoint((4, 0, 0), (0, 0, 90))], total_time=8.0)
    made = world(ts.Object("t", "Torch", dynamic=path, last_frame=50), ts.Object("s", "Torch", (0, 9, 0), scale=2.0))
    first, second = made.state(0).lights[2:]
    np.testing.assert_array_equal(first.world_from_light[:3, 3], (0, 0.5, 0))
    np.testing.assert_array_equal(second.world_from_light[:3, 3], (0, 10, 0))
    np.testing.assert_allclose(made.state(40).lights[2].world_from_light[:3, 3], (4 - 0.5, 0, 0), atol=1e-12)
    assert len(made.state(51).lights) == 3, "gone with its object"
    assert [row for row, _ in made.state(0).placement.lights] == [0, 0, 1, 1]
    number = made.spawn("Torch", (0, 0, 7))
    assert [light.world_from_light[2, 3] for light in made.state(0).lights].count(7) == 1
    assert number == 4


def test_a_light_in_a_thing_that_is_edited_goes_along():
    made = world()
    made.next_frame = 5
    made.move("/Lamp", (0, 0, 2))
    made.next_frame = 8
    made.despawn("/Lamp")
    np.testing.assert_array_equal(made.state(4).lights[0].world_from_light[:3, 3], (5, 1, 0))
    np.testing.assert_array_equal(made.state(5).lights[0].world_from_light[:3, 3], (0, 1, 2))
    assert [light.name for light in made.state(8).lights] == ["Panel"]


@pytest.mark.parametrize(
    ("fields", "match"),
    [
        ({"times": (0, 1), "intensity": (1,)}, "1 value for 2 times"),
        ({"times": (1, 0), "intensity": (1, 2)}, "increase"),
        ({"times": (0,)}, "give intensity"),
        ({"times": (0,), "intensity": (-1,)}, "negative"),
        ({"dynamic": "fast"}, "must be a dynamic"),
        ({"times": 3}, "times=3: must be numbers"),
        ({"times": (0, 1), "intensity": 3}, "intensity=3: must be numbers"),
        ({"times": (0, 1), "color": "ab"}, "color='ab': must be a sequence of 3 numbers each"),
        ({"times": (0, 1), "radiance": (1, 2)}, r"radiance\[0\]=1: must be 3 numbers"),
        ({"repeat": 1}, "repeat=1: must be True or False"),
    ],
)
def test_light_motions_are_checked(fields, match):
    with pytest.raises(ScenarioError, match=match):
        ts.LightMotion("Panel", **fields)


def test_a_light_motion_takes_any_iterable():
    fade = ts.LightMotion("Panel", times=np.arange(2), intensity=(k for k in (1, 0)), color=np.ones((2, 3)))
    assert (fade.times, fade.intensity, fade.color) == ((0.0, 1.0), (1.0, 0.0), ((1.0, 1.0, 1.0),) * 2)


def test_unknown_and_doubled_lights_are_refused():
    with pytest.raises(LightNotFound, match=r"no light 'Panle'.*Did you mean '/Panel'"):
        world(lights=[ts.LightMotion("Panle")])
    with pytest.raises(ScenarioError, match="a motion already"):
        ts.Scenario("room", lights=[ts.LightMotion("a"), ts.LightMotion("a")])
    with pytest.raises(ScenarioError, match=r"lights\[1\].light='/Panel': /Panel has a motion already"):
        world(lights=[ts.LightMotion("Panel"), ts.LightMotion("/Panel")])


def test_lights_are_written_and_read(tmp_path):
    motion = ts.LightMotion("Panel", ts.Orbit(period=3.0), (0, 1.1), (1, 0.5), ((1, 1, 1), (1, 0.3, 0)), repeat=True)
    scenario = ts.Scenario("room", lights=[motion], camera=("Main", ts.Camera(name="Own")))
    scenario.save(tmp_path / "run.json")
    assert ts.Scenario.load(tmp_path / "run.json") == scenario


def test_several_cameras_watch_one_world():
    turning = ts.Camera((0, 0, 4), name="Turning", dynamic=ts.Orbit((0, 0, 0), period=4.0))
    made = world(camera=("Top", turning), frustum=ts.Frustum(3.0))
    assert [camera.name for camera in made.cameras] == ["Top", "Turning"]
    assert made.camera.name == "Top"
    assert made.state(10).cameras[0].current is made.cameras[0]
    np.testing.assert_allclose(made.state(10).cameras[1].current.position, (4, 0, 0), atol=1e-12)
    assert world(camera=turning).state(10).cameras[0].current.position == made.state(10).cameras[1].current.position
    with pytest.raises(CameraNotFound):
        world(camera=("Top", "Nowhere"))
    with pytest.raises(ScenarioError, match="another one is called 'Top'"):
        ts.Scenario("room", camera=("Top", ts.Camera(name="Top")))
