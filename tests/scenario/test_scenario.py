# SPDX-License-Identifier: Apache-2.0
"""Scenarios: frozen values, checked when made, kept by files to the bit."""

import dataclasses
import json
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

import tiscene as ts
from dynamics import Composite, Dynamic, Keyframes, LookAt, Orbit, Timing
from tiscene.errors import ArgumentError, ExportError, MissingFile, ScenarioError
from tiscene.scenario import serialization
from tiscene.scenario.edits import Move
from tiscene.scenario.objects import Frustum, Object
from tiscene.scenario.overrides import CameraOverride, LightOverride, MaterialOverride, ObjectOverride
from tiscene.scenario.scenario import FIELDS, Scenario

HERE = ts.Waypoint((0.1, 1 / 3, -2e-7), (10, 20, 30))
THERE = ts.Waypoint((1, 0, 1e-22), (0.1, 0.2, 0.3, 0.4))
AROUND = ts.Waypoint((1, 2, 3))
ENDLESS = Keyframes((0, 1), (HERE, AROUND))


def everything() -> Scenario:
    """One of each thing that a scenario can hold."""
    path = ts.CatmullWaypoints((HERE, THERE, AROUND), 3.3, pacing="arc_length")
    return Scenario(
        "room",
        (
            Object(
                "linear", "Chair 01", (1, 2, 3), (0, 90, 0), ts.LinearWaypoints((HERE, AROUND), 4, rotation="euler")
            ),
            Object("smooth", "Dish 01", dynamic=path, first_frame=50, last_frame=400, frustum_limited=False),
            Object('still é\n"', "Cube", (0, 0, 0), (1, 0, 0, 0), ts.Still(), collide=False, scale=(1, 2, 0.5)),
            Object("orbit", "folder/Thing.usda", dynamic=Orbit((1, 2, 3), 2.5, (0, 0, 1)), scale=3),
            Object("composite", "Cube", dynamic=Composite((path, Orbit()))),
            Object("keys", "Cube", dynamic=Keyframes((0.5, 1.25), (HERE, THERE), repeat=True)),
            Object("aim", "Cube", dynamic=LookAt((1, 2, 3), path, (0, 0, 1))),
        ),
        timings=ts.DictTimings({"smooth": 2.5, 0: 0.1}, repeat=False),
        frustum=Frustum(10),
        camera=ts.Camera.look_at((1, 2, 3), (0.3, 0.2, 0.1), dynamic=LookAt((0, 0, 0), ENDLESS), name="é", exposure=1),
        overrides=(
            LightOverride("/Lights/Sun", 1 / 3, (1, 0.9, 0.8), pitch=-3, yaw=1e-9),
            MaterialOverride("Oak", like="/Looks/Walnut", color=(0.1, 0.2, 1 / 3), roughness=0, metallic=1),
            MaterialOverride("Chair 01/Looks/Oak", tint=(2, 0, 1)),
            ObjectOverride("/Room/Sofa", (1, 0, 1 / 3), (0, 90, 0), visible=False),
            CameraOverride("Main", (1, 2, 3), (1, 0, 0, 0), vertical_fov=1, lens_radius=0.01, focus_distance=2),
            CameraOverride(),
        ),
        exposure_compensation=-1 / 3,
    )


@pytest.mark.parametrize(
    "scenario",
    [
        everything(),
        Scenario("room"),
        Scenario("room", camera="Front", timings=ts.AllTogether()),
        Scenario("room", [Object("a", "Cube")], timings=ts.WaitUntilComplete(0.5, repeat=False), frustum=Frustum()),
    ],
)
def test_a_file_keeps_a_scenario_to_the_bit(scenario, tmp_path):
    assert Scenario.from_json(scenario.to_json()) == scenario
    assert Scenario.from_json(json.loads(json.dumps(scenario.to_json()))) == scenario
    scenario.save(tmp_path / "run.json")
    loaded = Scenario.load(str(tmp_path / "run.json"))
    assert loaded == scenario
    assert repr(loaded) == repr(scenario)
    assert loaded.to_json() == scenario.to_json()
    loaded.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "run.json").read_bytes()


def test_the_file_is_for_people_too():
    path = ts.LinearWaypoints([ts.Waypoint((0, 0, 0)), ts.Waypoint((1, 0, 0), (0, 90, 0))], total_time=4)
    text = serialization.dumps(Scenario("room", [Object("a", "Cube", dynamic=path)]).to_json())
    assert '\n  "format": "tiscene.scenario",\n  "version": 1,\n  "scene": "room",\n' in text
    assert '\n          {"position": [1.0, 0.0, 0.0], "rotation": [0.0, 90.0, 0.0]}\n' in text
    assert max(map(len, text.splitlines())) <= serialization.LINE_LENGTH


def test_what_a_file_leaves_out_has_its_default():
    content = {
        "format": "tiscene.scenario",
        "version": 1,
        "scene": "room",
        "objects": [{"id": "a", "template": "Cube"}],
    }
    assert Scenario.from_json(content) == Scenario("room", [Object("a", "Cube")])


def test_values_are_plain_and_frozen():
    scenario = Scenario(Path("scenes/room.usda"), [Object("a", "Cube", np.arange(3), np.zeros(3), scale=2)])
    assert scenario.scene == "scenes/room.usda"
    assert scenario.objects[0].position == (0.0, 1.0, 2.0)
    assert all(type(number) is float for number in scenario.objects[0].position)
    assert scenario.objects[0].scale == (2.0, 2.0, 2.0)
    assert isinstance(scenario.objects, tuple)
    with pytest.raises(dataclasses.FrozenInstanceError):
        scenario.scene = "other"
    assert hash(scenario) == hash(Scenario("scenes/room.usda", scenario.objects))
    assert dataclasses.replace(scenario, timings=ts.AllTogether(2)).timings.wait_time == 2.0


def test_life_spans_include_both_ends():
    mayfly = Object("a", "Cube", first_frame=3, last_frame=5)
    assert [mayfly.alive(frame) for frame in range(2, 7)] == [False, True, True, True, False]
    assert Object("a", "Cube").alive(10**9)


@pytest.mark.parametrize(
    ("message", "make"),
    [
        ("id='': must be a string", lambda: Object("", "Cube")),
        ("id=3: must be a string", lambda: Object(3, "Cube")),
        (r"id='a\\ud800': must be a string .*without lone surrogates", lambda: Object("a\ud800", "Cube")),
        ("template=None: must be a string", lambda: Object("a", None)),
        ("position=.*must be 3 numbers, not 2", lambda: Object("a", "Cube", (1, 2))),
        (r"position=.*must be numbers from -1e\+09", lambda: Object("a", "Cube", (0, 2e9, 0))),
        (r"position=.*must be numbers from -1e\+09", lambda: ts.PrismaticJoint("a", position=(0, 2e9, 0))),
        (r"position=.*must be numbers from -1e\+09", lambda: Move(0, "a", (0, 2e9, 0))),
        ("rotation=.*must be 3 or 4 numbers, not 1", lambda: Object("a", "Cube", rotation=(1,))),
        ("rotation=.*must not be zero", lambda: Object("a", "Cube", rotation=(0, 0, 0, 0))),
        ("dynamic='fast': must be a dynamic, such as", lambda: Object("a", "Cube", dynamic="fast")),
        ("an instance, not the class", lambda: Object("a", "Cube", dynamic=ts.Still)),
        ("first_frame=-1: must be at least 0", lambda: Object("a", "Cube", first_frame=-1)),
        ("first_frame=1.5: must be a whole number", lambda: Object("a", "Cube", first_frame=1.5)),
        ("last_frame=True: must be a whole number", lambda: Object("a", "Cube", last_frame=True)),
        ("last_frame=4 is before first_frame=5", lambda: Object("a", "Cube", first_frame=5, last_frame=4)),
        ("frustum_limited=1: must be True or False", lambda: Object("a", "Cube", frustum_limited=1)),
        ("collide=None: must be True or False", lambda: Object("a", "Cube", collide=None)),
        ("scale=0: must be greater than 0", lambda: Object("a", "Cube", scale=0)),
        ("scale=.*must be 3 numbers, not 2", lambda: Object("a", "Cube", scale=(1, 2))),
        (r"scale=\(1, -1, 1\): must be greater", lambda: Object("a", "Cube", scale=(1, -1, 1))),
        ("far=0: must be greater than 0, or -1", lambda: Frustum(0)),
        ("far=nan: must be finite", lambda: Frustum(math.nan)),
        ("scene='': must be a string", lambda: Scenario("")),
        ("objects=.*must be a sequence of Object", lambda: Scenario("room", Object("a", "Cube"))),
        (r"objects\[1\]='b': must be an Object", lambda: Scenario("room", [Object("a", "Cube"), "b"])),
        (
            r"objects\[2\].id='a': objects\[0\] has this id already",
            lambda: Scenario("room", [Object("a", "Cube"), Object("b", "Cube"), Object("a", "Chair 01")]),
        ),
        ("timings=0.5: must be a timing", lambda: Scenario("room", timings=0.5)),
        ("frustum=10: must be a Frustum", lambda: Scenario("room", frustum=10)),
        ("camera=3: must be a Camera", lambda: Scenario("room", camera=3)),
        ("camera.dynamic='slow': must be a dynamic", lambda: Scenario("room", camera=ts.Camera(dynamic="slow"))),
        ("timings: DictTimings: no body 'b'", lambda: Scenario("room", timings=ts.DictTimings({"b": 1.0}))),
        (
            "timings: WaitUntilComplete waits for each loop to end, but the Keyframes of 'a' never",
            lambda: Scenario("room", [Object("a", "Cube", dynamic=ENDLESS)], timings=ts.WaitUntilComplete(1.0)),
        ),
    ],
)
def test_scenarios_that_contradict_themselves_are_refused(message, make):
    with pytest.raises(ScenarioError, match=message):
        make()


def change(content: object, path: list[object], value: object) -> object:
    """The JSON values with one replaced, added, or, where the value is Ellipsis, removed."""
    changed = json.loads(json.dumps(content))
    place = changed
    for step in path[:-1]:
        place = place[step]
    if value is ...:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return changed


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["version"], 2, "version: 2, but this tiscene reads version 1"),
        (["format"], "usd", 'not a scenario: .*"format": "tiscene.scenario"'),
        (["scene"], ..., "scene: is missing"),
        (["scene"], 3, "scene=3: must be a string"),
        (["seed"], 3, "seed: Scenario has no such key"),
        (["objects"], {}, "objects: must be a list"),
        (["objects"], "abc", "objects='abc': must be a sequence of Object"),
        (["objects", 1], 3, r"objects\[1\]=3: must be an Object"),
        (["objects", 1], [], r"objects\[1\]=\(\): must be an Object"),
        (["objects", 1, "template"], ..., r"objects\[1\].template: is missing"),
        (["objects", 1, "positon"], [0, 0, 0], r"objects\[1\].positon: .*; did you mean 'position'\?"),
        (["objects", 1, "position", 1], "x", r"objects\[1\].position\[1\]='x': must be a number"),
        (["objects", 1, "position"], {"x": 1}, r"objects\[1\].position: must be a plain value"),
        (["objects", 1, "id"], "linear", r"objects\[1\].id='linear': objects\[0\] has this id already"),
        (["objects", 1, "last_frame"], 4, r"objects\[1\].last_frame=4 is before first_frame=50"),
        (["objects", 1, "dynamic", "type"], ..., r"objects\[1\].dynamic.type: is missing; must be one of CatmullWay"),
        (["objects", 1, "dynamic", "type"], "Catmull", r"objects\[1\].dynamic.type: unknown type 'Catmull'"),
        (["objects", 1, "dynamic", "type"], [1], r"objects\[1\].dynamic.type: unknown type \[1\]"),
        (["objects", 1, "dynamic", "type"], "Still", r"objects\[1\].dynamic.waypoints: Still has no such key"),
        (["objects", 1, "dynamic"], "Still", r"objects\[1\].dynamic='Still': must be a dynamic"),
        (["objects", 1, "dynamic", "total_time"], -1, r"objects\[1\].dynamic.total_time=-1: must be greater than 0"),
        (["objects", 1, "dynamic", "pacing"], "fast", r"objects\[1\].dynamic.pacing='fast': must be one of"),
        (["objects", 1, "dynamic", "waypoints"], [], r"objects\[1\].dynamic.waypoints: a path needs 2 or more"),
        (["objects", 1, "dynamic", "waypoints", 2], 5, r"objects\[1\].dynamic.waypoints\[2\]=5: must be a Waypoint"),
        (
            ["objects", 1, "dynamic", "waypoints", 2, "rotation"],
            [0, 0],
            r"objects\[1\].dynamic.waypoints\[2\].rotation=\(0, 0\): must be 3 or 4 numbers",
        ),
        (["objects", 4, "dynamic", "parts", 1, "period"], 0, r"objects\[4\].dynamic.parts\[1\].period=0: must be gr"),
        (["objects", 6, "dynamic", "motion", "type"], "X", r"objects\[6\].dynamic.motion.type: unknown type 'X'"),
        (["timings", "times", 0], ["nobody", 1], "timings: DictTimings: no body 'nobody'"),
        (["timings", "times", 0], 3, "timings.times: 3 must be a pair"),
        (["timings", "type"], "Waypoint", "timings.type: unknown type 'Waypoint'.*; there are AllTogether, Dict"),
        (["frustum", "far"], 0, "frustum.far=0: must be greater than 0"),
        (["frustum", "type"], "Frustum", "frustum.type: Frustum has no such key"),
        (["camera", "vertical_fov"], 60, "camera.vertical_fov=60.0: must lie between 0 and pi"),
        (["camera", "position"], [0, None, 0], "camera.position=.*must be finite numbers"),
        (["camera", "exposure"], "bright", "camera.exposure='bright': must be a number"),
        (["camera", "dynamic"], {"type": "Camera"}, "camera.dynamic.type: unknown type 'Camera'"),
    ],
)
def test_what_is_wrong_in_a_file_is_named_with_its_place(path, value, message, tmp_path):
    content = change(everything().to_json(), path, value)
    with pytest.raises(ScenarioError, match="^" + message):
        Scenario.from_json(content)
    file = tmp_path / "run.json"
    file.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"run\.json: " + message):
        Scenario.load(file)


@pytest.mark.parametrize("content", [None, [], "text", {}, {"scene": "room"}])
def test_other_json_is_not_a_scenario(content):
    with pytest.raises(ScenarioError, match="not a scenario"):
        Scenario.from_json(content)


SCENE = (
    '{"format": "tiscene.scenario", "version": 1, "scene": "room", '
    '"objects": [{"id": "a", "template": "Cube", "position": %s}]}'
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1, column 1: not JSON"),
        ('{\n  "scene": room\n}', "line 2, column 12: not JSON"),
        ('{"scene": "a", "scene": "b"}', "the key 'scene' stands twice"),
        ('{"far": NaN}', "NaN is not a number"),
        ("[" * 100_000, "not JSON that can be read: maximum recursion"),
        ("1" * 5_000, "not JSON that can be read: .*digits"),
        (SCENE % f"[{'1' * 400}, 0, 0]", r"objects\[0\].position\[0\]=1+...: must be finite"),
    ],
)
def test_files_that_are_not_strict_json_are_refused(text, message, tmp_path):
    file = tmp_path / "run.json"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError, match=message):
        Scenario.load(file)


def test_a_byte_order_mark_does_no_harm(tmp_path):
    file = tmp_path / "run.json"
    file.write_text(SCENE % "[1, 2, 3]", encoding="utf-8-sig")
    assert Scenario.load(file).objects[0].position == (1.0, 2.0, 3.0)


def test_files_that_are_not_there_not_text_or_not_json(tmp_path):
    with pytest.raises(MissingFile, match=r"no file .*run\.json"):
        Scenario.load(tmp_path / "run.json")
    binary = tmp_path / "binary.json"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match="not a text file"):
        Scenario.load(binary)
    (tmp_path / "folder.json").mkdir()
    with pytest.raises(ScenarioError, match=r"folder\.json: cannot be read: Is a directory"):
        Scenario.load(tmp_path / "folder.json")
    with pytest.raises(ArgumentError, match=r"ends in \.json"):
        Scenario("room").save(tmp_path / "run.txt")
    with pytest.raises(ExportError, match=r"cannot write .*run\.json.*no folder"):
        Scenario("room").save(tmp_path / "nowhere" / "run.json")


def test_what_cannot_be_written_leaves_the_file_that_was_there(tmp_path, monkeypatch):
    path = tmp_path / "run.json"
    Scenario("room").save(path)
    before = path.read_bytes()

    def cut_off(target, data):
        with target.open("wb") as file:
            file.write(data[: len(data) // 2])
        raise OSError("No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", cut_off)
    with pytest.raises(ExportError, match=r"cannot write .*run\.json.*No space left"):
        Scenario("room", [Object("a", "Chair 01")]).save(path)
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == ["run.json"]


class PlainDynamic(Dynamic):
    """Not a dataclass, so that files cannot hold it."""

    loop_time = 0.0


class OwnTiming(ts.AllTogether):
    """Of a class that files do not know."""


def test_classes_unknown_to_files_cannot_be_written():
    with pytest.raises(ScenarioError, match=r"objects\[0\].dynamic=.*PlainDynamic.*: cannot be written"):
        Scenario("room", [Object("a", "Cube", dynamic=PlainDynamic())]).to_json()
    with pytest.raises(ScenarioError, match="timings: a OwnTiming cannot be written"):
        Scenario("room", timings=OwnTiming()).to_json()


def test_every_dynamic_and_timing_of_the_package_can_be_written():
    def subclasses(kind: type) -> set[type]:
        below = {each for child in kind.__subclasses__() for each in subclasses(child)}
        return {kind} | below

    def ours(kinds: Iterable[type]) -> set[type]:
        return {kind for kind in kinds if kind.__module__.startswith("dynamics.")}  # other tests have their own

    own = ours(subclasses(Dynamic) | subclasses(Timing))
    bases = {kind for kind in own if getattr(kind, "__abstractmethods__", None)}
    assert own - bases == ours({*FIELDS["dynamic"].values(), *FIELDS["timings"].values()})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: LightOverride("Sun", intensity=-1), "intensity=-1"),
        (lambda: LightOverride("", 1), "prim"),
        (lambda: LightOverride("Sun", yaw="left"), "yaw='left'"),
        (lambda: MaterialOverride("Oak", color=(0, 0, 1.1)), r"color=.*must lie within 0\.\.1"),
        (lambda: MaterialOverride("Oak", tint=(0, -1, 0)), "tint=.*must be 0 or more"),
        (lambda: MaterialOverride("Oak", roughness=2), "roughness=.*within"),
        (lambda: ObjectOverride("/Sofa", (1, 2)), "position"),
        (lambda: ObjectOverride("/Sofa", visible=1), "visible=1"),
        (lambda: CameraOverride("Main", vertical_fov=4), "vertical_fov"),
        (lambda: CameraOverride("Main", focus_distance=0), "focus_distance"),
        (lambda: Scenario("room", overrides=[Object("a", "Cube")]), r"overrides\[0\]="),
        (lambda: Scenario("room", overrides=[LightOverride("Sun")] * 2), r"overrides\[1\].prim='Sun'"),
        (lambda: Scenario("room", exposure_compensation=math.inf), "exposure_compensation"),
    ],
)
def test_invalid_overrides_raise(make, message):
    with pytest.raises(ScenarioError, match=message):
        make()


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: ts.Scenario("room", exposure_compensation=1e6), "exposure_compensation=1000000.0: must be from"),
        (lambda: ts.Scenario("room").save(5), "path=5: must be the name of a file"),
        (lambda: ts.DistanceJoint("a"), "max_distance: is missing"),
        (lambda: ts.Scenario.sample("object_view", objects=None), "objects=None: must be a number or a range"),
    ],
)
def test_values_without_a_meaning_are_refused(make, match):
    with pytest.raises(ts.TisceneError, match=match):
        make()


def test_turns_that_take_ages_are_refused():
    """No object but the first would ever have had a turn."""
    long = ts.Composite((ts.Orbit(period=3.123456789012345), ts.Orbit(period=1.987654321098765)))
    objects = [ts.Object("spinner", "Cube", dynamic=long), ts.Object("b", "Cube", dynamic=ts.Orbit(period=2.0))]
    with pytest.raises(ts.TisceneError, match=r"'spinner' takes .* s: give its parts periods"):
        ts.Scenario("room", objects, timings=ts.WaitUntilComplete(1.0))
