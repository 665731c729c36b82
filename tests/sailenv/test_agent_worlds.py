# SPDX-License-Identifier: Apache-2.0
"""Agents that share a world, and agents in worlds of their own; rooms of one scene."""

import gc

import numpy as np
import pytest
from taichi.lang._ndarray import Ndarray

from tests.sailenv.conftest import SCENE
from tests.usd.helpers import write
from tiscene.errors import ArgumentError, SceneNotFound
from tiscene.sailenv import Object, Scenario, agent_worlds
from tiscene.stream import stage_cache

OTHER = "solid_benchmark/scene"
LABELS = {"main_frame_active": False, "width": 24, "height": 18}
VIEWS = ("object", "category", "depth", "flow")


def seen(agent):
    frame = agent.get_frame()
    return [np.asarray(frame[name]).tobytes() for name in VIEWS], frame["deltaTime"], agent.frame_index


def scene_of(agent):
    return agent.environment.scene


def test_other_agents_keep_their_scene_their_clock_and_their_bytes(make_agent):
    def stay(agent):
        agent.spawn_object("Cube", (0, 1, 3))
        return [seen(agent)]

    alone = make_agent(port=1, **LABELS)
    expected = stay(alone) + [seen(alone) for _ in range(4)]
    staying, leaving = (make_agent(port=2, **LABELS) for _ in range(2))
    result = stay(staying)
    leaving.get_frame()
    leaving.change_scene(OTHER)
    leaving.set_light_intensity(leaving.lights_names[0], 0.0)
    leaving.spawn_object("Sphere", (0, 1, 2))
    for _ in range(2):
        result.append(seen(staying))
        leaving.get_frame()
    assert [scene_of(staying), scene_of(leaving)] == ["object_view", "solid_benchmark"]
    assert leaving.frame_index == 1
    leaving.load_scenario(Scenario("room_none/scene", []))  # an error, which is printed
    leaving.load_scenario(Scenario(OTHER, [Object("a", "Cube", (0, 1, 2), (0, 0, 0))]))
    leaving.change_scene(OTHER)
    leaving.change_scene("third/scene")
    result += [seen(staying) for _ in range(2)]
    assert result == expected


def test_agent_receives_the_frame_that_shows_its_edit_after_another_has_received_it(make_agent):
    one, two = (make_agent(**LABELS) for _ in range(2))
    before = one.get_frame(), two.get_frame()
    one.spawn_object("Cube", (0, 1, 3))
    shown = two.get_frame()
    assert (shown["object"] != before[1]["object"]).any()
    assert (one.get_frame()["object"] == shown["object"]).all()
    assert one.frame_index == two.frame_index == 1


def test_agents_that_change_to_one_scene_meet_there(make_agent):
    staying, first, second = (make_agent(**LABELS) for _ in range(3))
    first.change_scene(OTHER)
    for _ in range(3):
        first.get_frame()
    first.spawn_object("Cube", (0, 1, 3))
    second.change_scene(OTHER)
    assert second.environment is first.environment is not staying.environment
    one, two = seen(first), seen(second)
    assert one[0][0] == two[0][0]
    assert one[2] == two[2] == 3
    second.change_scene(SCENE)
    assert second.environment is staying.environment


def test_changing_to_the_own_scene_starts_it_again_unless_others_are_there(make_agent):
    first, second = (make_agent(**LABELS) for _ in range(2))
    first.spawn_object("Cube", (0, 1, 3))
    before = [seen(first), seen(first)][1]
    first.change_scene(SCENE)
    assert len(second.environment.stream.world.state(2).objects) == 1
    second.change_scene(OTHER)
    first.change_scene(SCENE)
    again = seen(first)
    assert again[2] == 0
    assert again[0] != before[0]


def test_agent_without_a_scene_of_its_own_enters_the_one_that_was_started_last(make_agent):
    first, second = (make_agent(at=None, **LABELS) for _ in range(2))
    first.change_scene(OTHER)
    assert scene_of(second) == "solid_benchmark"
    assert second.environment is first.environment


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"spp": 4}, "spp=4: the worlds of localhost:.* have spp=1"),
        ({"quality": "photo"}, "quality='photo': the worlds of .* have quality='preview'"),
        ({"scene": "room_02"}, "scene='room_02': the worlds of .* have scene='object_view/scene'"),
        ({"together": True}, "together=True: .* share them. Leave together out, or choose another port"),
    ],
)
def test_settings_that_contradict_those_of_the_port_are_refused(make_agent, other, message):
    """They were ignored."""
    make_agent(**LABELS)
    with pytest.raises(ArgumentError, match=message):
        make_agent(**LABELS, **other)
    same = {"scene": "Object View", "fps": 25, "quality": "preview", "together": False}
    agent = make_agent(**LABELS | {"width": 16, "height": 12, "object_frame_active": True}, **same)
    assert agent.get_frame()["object"].shape == (12, 16, 3)  # sizes and views are those of each agent


def test_together_all_agents_go_along(make_agent):
    first, second = (make_agent(together=True, **LABELS) for _ in range(2))
    second.get_frame()
    first.change_scene(OTHER)
    assert [scene_of(first), scene_of(second)] == ["solid_benchmark"] * 2
    second.load_scenario(Scenario(SCENE, [Object("a", "Cube", (0, 0, 3), (0, 0, 0))]))
    assert scene_of(first) == "object_view"
    assert seen(first)[0][0] == seen(second)[0][0]


def test_scenario_in_the_scene_of_others_is_for_all_and_one_in_another_scene_for_its_agent(make_agent):
    first, second = (make_agent(at=None, **LABELS) for _ in range(2))
    cube = [Object("a", "Cube", (0, 0, 0), (0, 0, 0))]
    first.get_frame(), second.get_frame()
    ids = first.load_scenario(Scenario(SCENE, cube))
    assert ids[0][0]
    assert seen(first)[0][0] == seen(second)[0][0]
    assert any(second.get_frame()["object"].ravel())
    assert second.load_scenario(Scenario(OTHER, cube))[0][0]
    assert [scene_of(first), scene_of(second)] == ["object_view", "solid_benchmark"]
    assert first.frame_index == 0


def test_world_without_agents_is_freed_and_its_scene_is_not_read_again(make_agent, monkeypatch):
    arrays = []
    agents = [make_agent(**LABELS) for _ in range(2)]
    read, load = [], stage_cache.load
    monkeypatch.setattr(stage_cache, "load", lambda *given, **named: read.append(given[0]) or load(*given, **named))
    gc.collect()
    gc.disable()
    try:
        for _ in range(4):
            agents[0].change_scene(OTHER)
            agents[0].get_frame(), agents[1].get_frame()
            agents[0].change_scene(SCENE)
            agents[0].get_frame(), agents[1].get_frame()
            arrays.append(sum(issubclass(type(each), Ndarray) for each in gc.get_objects()))
    finally:
        gc.enable()
    assert arrays[1:] == arrays[1:2] * 3
    assert len(read) == 1


def test_too_many_scenes_at_once_are_an_error_that_changes_nothing(make_agent, monkeypatch):
    monkeypatch.setattr(agent_worlds, "MAX_WORLDS", 1)
    first, second = (make_agent(strict=True, **LABELS) for _ in range(2))
    with pytest.raises(ArgumentError, match="which is the limit"):
        first.change_scene(OTHER)
    with pytest.raises(ArgumentError, match="which is the limit"):
        first.load_scenario(Scenario(OTHER, []))
    assert scene_of(first) == scene_of(second) == "object_view"
    second.delete()
    first.change_scene(OTHER)
    assert scene_of(first) == "solid_benchmark"


ROOM = """
def Xform "Room" (kind = "assembly") {{
    def Cube "Box" (
        kind = "component"
        prepend apiSchemas = ["SemanticsLabelsAPI:class"]
    ) {{
        token[] semantics:labels:class = ["{thing}"]
        double size = 1
        double3 xformOp:translate = (0, 0, -1.4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
    def DistantLight "Sun" {{ }}
    def Camera "Agent" {{
        double3 xformOp:translate = (0, 0, 1.5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
}}
"""
HOUSE = """
def Xform "House" (kind = "assembly") {
    def Xform "den" (prepend references = @../den/scene.usda@) {
        def Cube "Volume" (prepend apiSchemas = ["SemanticsLabelsAPI:room"]) {
            token[] semantics:labels:room = ["den"]
            token purpose = "guide"
            double size = 4
        }
    }
    def Xform "loft" (prepend references = @../loft/scene.usda@) {
        def Cube "Volume" (prepend apiSchemas = ["SemanticsLabelsAPI:room"]) {
            token[] semantics:labels:room = ["the loft"]
            token purpose = "guide"
            double size = 4
        }
        double3 xformOp:translate = (4, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Camera "Agent" {
        double3 xformOp:translate = (2, 0, 1)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""


@pytest.fixture
def house(tmp_path, monkeypatch):
    """Add a house to the scenes: a den, and a loft 4 m to its right."""
    rooms = {"den": ("Room", ROOM.format(thing="ball")), "loft": ("Room", ROOM.format(thing="chair"))}
    for name, (prim, text) in (rooms | {"house": ("House", HOUSE)}).items():
        (tmp_path / name).mkdir()
        write(tmp_path / name, text, name="scene.usda", more=f'defaultPrim = "{prim}"')
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path))


def test_changing_to_a_room_of_the_world_is_a_walk_that_loads_nothing(make_agent, house, monkeypatch):
    walking, standing = (make_agent(scene=None, world="house", at=None, **LABELS) for _ in range(2))
    assert walking.get_position()[0] == standing.get_position()[0] == pytest.approx(2.0)
    assert scene_of(walking) == "house"
    before = [seen(walking), seen(standing)]
    monkeypatch.setattr(
        "tiscene.sailenv.scene_session.SceneSession.start", lambda *_: pytest.fail("a scene was started")
    )
    for name, x, thing in (("loft/scene", 4.0, "chair"), ("den", 0.0, "ball"), ("The Loft", 4.0, "chair")):
        walking.change_scene(name)
        position = walking.get_position()
        assert (position[0], position[1], position[2]) == pytest.approx((x, 0.0, -1.5))
        frame = walking.get_frame()
        assert not frame["flow"].any()
        assert walking.categories[int(frame["category"][9, 12])] == thing
        there = seen(standing)
        assert there[0] == before[1][0]
        assert there[2] == walking.frame_index
    assert walking.frame_index == 3
    assert walking.environment is standing.environment


def test_world_is_entered_from_other_scenes_and_left_for_scenes_that_are_no_rooms(make_agent, house):
    agent = make_agent(scene=None, world="house", at=None, **LABELS)
    agent.change_scene(SCENE)
    assert scene_of(agent) == "object_view"
    agent.change_scene("loft")
    assert scene_of(agent) == "house"
    assert agent.get_position()[0] == pytest.approx(4.0)
    agent.change_scene("house/scene")
    assert agent.get_position()[0] == pytest.approx(2.0)


def test_rooms_are_scenes_of_their_own_without_a_world(make_agent, house):
    agent = make_agent(scene="house", at=None, strict=True, **LABELS)
    agent.change_scene("loft/scene")
    assert scene_of(agent) == "loft"
    with pytest.raises(SceneNotFound):
        agent.change_scene("the loft")


def test_unknown_room_is_an_error_that_names_scenes_and_rooms(make_agent, house):
    agent = make_agent(scene=None, world="house", at=None, strict=True, **LABELS)
    with pytest.raises(SceneNotFound, match="the loft"):
        agent.change_scene("attic")
