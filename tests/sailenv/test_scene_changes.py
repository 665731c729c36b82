# SPDX-License-Identifier: Apache-2.0
"""Changes of the scene: memory, and what other agents see of them."""

import contextlib
import gc
import io
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from taichi.lang._ndarray import Ndarray

import usd_scenes
from tests.sailenv.conftest import SCENE, zipped
from tests.stress.process_resources import resident_memory
from tests.usd.helpers import write
from tiscene.errors import SceneNotFound, TisceneError
from tiscene.sailenv import Object, Scenario
from tiscene.sailenv.asset_names import catalog_scene

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"


def device_arrays():
    return sum(issubclass(type(each), Ndarray) for each in gc.get_objects())  # isinstance asks lazy modules


@contextlib.contextmanager
def no_garbage_collector():
    """Free memory by the counts of references alone."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@pytest.fixture
def small_scenes(tmp_path, monkeypatch):
    """Return SAILenv's names of three small scenes."""
    copy = tmp_path / "third_view"
    shutil.copytree(Path(usd_scenes.__file__).parent / "object_view", copy)
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path))
    return SCENE, "solid_benchmark/scene", "third_view/scene"


@pytest.mark.parametrize("changes", [12, pytest.param(40, marks=pytest.mark.slow)])
def test_changing_between_scenes_frees_device_memory(make_agent, small_scenes, changes):
    agent = make_agent(width=16, height=12, max_depth=2)
    with no_garbage_collector():  # device memory is freed at once
        counts = []
        for number in range(changes):
            agent.change_scene(small_scenes[number % 3])
            agent.spawn_object("Cube", (0, 1, 3))
            agent.get_frame()
            counts.append(device_arrays())
    assert counts[-3:] == counts[6:9]  # the arrays of all scenes are kept for their next visit by then


def test_uploaded_models_are_freed_with_the_scene(make_agent):
    agent = make_agent(width=16, height=12)
    path = agent.send_obj_zip(io.BytesIO(zipped({"square.obj": SQUARE})), "square.zip")
    with no_garbage_collector():
        counts = []
        for _ in range(4):
            agent.change_scene(SCENE)
            assert agent.spawn_object("file:" + path, (0, 1, 3))
            assert agent.get_frame()["object"].any()
            agent.change_scene(SCENE)
            agent.get_frame()
            counts.append(device_arrays())
    assert counts[1:] == counts[1:2] * 3


def test_deleting_the_last_agent_frees_the_world(make_agent):
    agent = make_agent(width=16, height=12)
    agent.get_frame()
    agent.delete()
    with no_garbage_collector():
        before = device_arrays()
        agent.register()
        agent.get_frame()
        assert device_arrays() > before
        agent.delete()
        assert device_arrays() <= before


def test_a_scene_that_is_started_again_gives_the_same_frames(make_agent, small_scenes):
    agent = make_agent()

    def frames():
        agent.spawn_object("Sphere", (0, 1, 3))
        return [agent.get_frame()["main"].tobytes() for _ in range(2)]

    seen = {}
    for name in (*small_scenes, *small_scenes):
        agent.change_scene(name)
        assert seen.setdefault(name, rendered := frames()) == rendered


def test_scene_without_exposure_is_metered_from_its_start_camera(make_agent, tmp_path, monkeypatch):
    """In the first scenario as in later ones, and whatever the pose of the agent."""
    folder = tmp_path / "unmetered"
    folder.mkdir()
    box = "double size = 4\ndouble3 xformOp:translate = (0, 0, -6)\n"
    box += 'uniform token[] xformOpOrder = ["xformOp:translate"]\n'
    lamp = 'def SphereLight "Lamp" {\n    float inputs:intensity = 40\n}\n'
    write(folder, f'def Cube "Box" {{\n{box}}}\n{lamp}def Camera "Agent" {{}}\n', name="scene.usda")
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path))
    exposures = []
    for position in ((0, 0, 1), (0, 0, -40)):
        agent = make_agent(port=position[2] + 50, scene="unmetered/scene")
        agent.set_position(position)
        agent.load_scenario(Scenario("unmetered/scene", [Object("a", "Cube", (0, 0, 3), (0, 0, 0))]))
        assert agent.get_frame()["main"].max() > 0.0
        exposures.append(agent.environment.stream.exposure)
    assert exposures[0] == exposures[1]


@pytest.mark.parametrize("keep", [False, True])
def test_clock_restarts_at_a_change_of_the_scene_or_goes_on(make_agent, small_scenes, keep):
    named = {"at": None, "width": 16, "height": 12, "main_frame_active": False, "keep_clock": keep, "together": True}
    agent, other = (make_agent(**named) for _ in range(2))
    for _ in range(3):
        agent.get_frame(), other.get_frame()
    agent.change_scene(small_scenes[1])
    there = [agent.get_frame(), other.get_frame()]
    first = 3 if keep else 0
    assert [agent.frame_index, other.frame_index] == [first, first]
    assert there[0]["depth"].tobytes() == there[1]["depth"].tobytes()
    assert not there[0]["flow"].any()
    assert [each["deltaTime"] for each in there] == pytest.approx([0.04, 0.04])
    agent.spawn_object("Cube", (0, 1, 3))
    seen = agent.get_frame()
    assert agent.frame_index == first + 1
    assert seen["object"].tobytes() != there[0]["object"].tobytes()
    agent.load_scenario(Scenario(small_scenes[0], []))
    agent.get_frame()
    assert agent.frame_index == 0


@pytest.mark.slow
def test_memory_is_flat_over_200_changes_of_scenes(make_agent, small_scenes):
    agent = make_agent(width=32, height=24, max_depth=2)
    used, seconds = [], []
    for number in range(200):
        began = time.perf_counter()
        agent.change_scene(small_scenes[number % 3])
        agent.spawn_object(("Cube", "Chair 01", "Sphere")[number % 3], (0, 1, 3))
        agent.get_frame()
        seconds.append(time.perf_counter() - began)
        used.append(resident_memory())
    print(f"{used[20] >> 20} MB after 20 changes, {used[-1] >> 20} MB after 200; {np.median(seconds[20:]):.3f} s each")
    assert used[-1] < 1.05 * max(used[:30]), used


BOUNCE = {"type": "uniform_movement_random_bounce", "description": {}}
INVALID = [
    {"scene_name": "nowhere/scene", "objects": []},
    {"objects": []},
    {"scene_name": "solid_benchmark/scene", "objects": {}},
    {"scene_name": "solid_benchmark/scene", "objects": [1]},
    {"scene_name": "solid_benchmark/scene", "objects": [], "timings": 5},
    {"scene_name": "solid_benchmark/scene", "objects": [], "timings": {"type": "at_random"}},
    {"scene_name": "solid_benchmark/scene", "objects": [], "timings": {"type": "all_together", "description": [1]}},
    {
        "scene_name": "solid_benchmark/scene",
        "objects": [{"id": "a", "prefab": "Cube", "dynamic": BOUNCE}],
        "timings": {"type": "wait_until_complete", "description": {"wait_time": 1.0}},
    },
    {"scene_name": "broken/scene", "objects": []},
    {"scene_name": "solid_benchmark/scene", "objects": [], "frustum": {"spawn": True, "far_clip_plane": "x"}},
]


def test_invalid_scenarios_change_nothing_for_anybody(make_agent, tmp_path, monkeypatch):
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "scene.usda").write_text("#usda 1.0\ndef (\n")
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path))

    def frames(port, contents):
        sender, other = (make_agent(port=port, width=32, height=24) for _ in range(2))
        environment = sender.environment
        sender.load_scenario(Scenario(SCENE, [Object("a", "Cube", (0, 1, 3), (0, 0, 0))]))
        sender.spawn_object("Sphere", (0.5, 1, 2))
        sender.set_light_color("Main Light", 255, 100, 0)
        other.set_position((0.1, 1, 0))
        other.spawn_collidable_view_frustum()
        seen = [agent.get_frame() for agent in (sender, other)]
        sender.set_light_intensity("Main Light", 0.5)  # shows in the next frame
        for each in contents:
            with pytest.raises(TisceneError):
                environment.load_scenario(environment.agents[sender.id], each)
        seen += [agent.get_frame() for _ in range(2) for agent in (other, sender)]
        return seen, environment.clock, sender.get_position(), other.get_position(), environment.stream.settings()

    expected, *others = frames(1, [])
    seen, *same = frames(2, INVALID * 2)
    assert same == others
    for here, there in zip(seen, expected, strict=True):
        assert {name: np.asarray(view).tobytes() for name, view in here.items() if name != "sizes"} == {
            name: np.asarray(view).tobytes() for name, view in there.items() if name != "sizes"
        }


def test_invalid_first_scenario_leaves_the_first_scene(make_agent):
    agent = make_agent(scene="solid_benchmark/scene", width=16, height=12)
    environment = agent.environment
    with pytest.raises(TisceneError):
        environment.load_scenario(environment.agents[agent.id], INVALID[5] | {"scene_name": SCENE})
    assert environment.stream.scenario.scene == "solid_benchmark"


@pytest.mark.parametrize("name", ["room01", "Room_01/Scene", "room 01", "room-01/scene", "room_01"])
def test_scenes_are_found_in_other_spellings(name):
    assert catalog_scene(name) == "room_01"


@pytest.mark.parametrize("name", ["", "room", "room1", "/scene", "room_01/scene/scene"])
def test_unknown_scene_names_are_errors(name):
    with pytest.raises(SceneNotFound):
        catalog_scene(name)


def test_spelling_that_fits_two_scenes_is_an_error(tmp_path, monkeypatch):
    for folder in ("a_view", "aview"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "scene.usda").write_text("#usda 1.0\n")
    monkeypatch.setenv("TISCENE_PATH", str(tmp_path))
    assert catalog_scene("aview/scene") == "aview"
    with pytest.raises(SceneNotFound):
        catalog_scene("A-View")
