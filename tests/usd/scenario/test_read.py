# SPDX-License-Identifier: Apache-2.0
"""Scenarios on stages: saved and read back exactly, authored by hand, by time samples, and damaged."""

from __future__ import annotations

import dataclasses
import math
import os
import random
import re
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdValidation

import tiscene as ts
import usd_scenes
from dynamics import UniformMovementRandomBounce
from tests.scenario.test_scenario import everything
from tests.usd.damage import READ, REFUSED, STOPPED, crate_bytes, damaged, read_all
from tests.usd.helpers import write
from tiscene.errors import ArgumentError, CameraNotFound, ExportError, ScenarioError, StageError, StageWarning
from tiscene.scenario.objects import Frustum, Object
from tiscene.scenario.scenario import Scenario
from tiscene.usd.core.layers import layer_digests
from tiscene.usd.core.stage import open_stage
from tiscene.usd.read.stage_reader import read_stage


@dataclasses.dataclass(frozen=True)
class Drift(ts.Stepped):
    """A trajectory that a user has written."""

    velocity: tuple[float, float, float] = (1.0, 0.0, 0.0)
    name: str = "d"

    def begin(self, start):
        return start.position

    def advance(self, state, number):
        return tuple(each + 0.01 * speed for each, speed in zip(state, self.velocity, strict=True))

    def pose(self, state):
        return ts.Waypoint(state)


ROOM = """
def Xform "Room"
{
    def Camera "Door"
    {
        double3 xformOp:translate = (0, 1, 5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Camera "Window"
    {
    }
    def Cube "Floor"
    {
        double3 xformOp:translate = (0, -1, 0)
        double3 xformOp:scale = (4, 0.1, 4)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
    def Xform "Chair" (
        kind = "component"
    )
    {
        double3 xformOp:translate = (1, 0, 2)
        float3 xformOp:rotateXYZ = (10, 20, 30)
        float3 xformOp:scale = (1, 2, 1)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
        def Cube "Seat"
        {
        }
    }
}
class "Templates"
{
    def Sphere "Ball"
    {
    }
}
"""
BLOCK = """
def Cube "Block" (
    kind = "component"
)
{
    double3 xformOp:translate = (7, 8, 9)
    float3 xformOp:scale = (2, 1, 1)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
}
"""


@pytest.fixture
def room(tmp_path: Path) -> Path:
    write(tmp_path, BLOCK, name="block.usda", more='defaultPrim = "Block"')
    return write(tmp_path, ROOM, name="room.usda", more='defaultPrim = "Room"')


def in_room(room: Path, scenario: Scenario) -> Scenario:
    """Return the scenario with files that exist."""
    block = str(room.with_name("block.usda"))
    templates = {"Cube": block, "folder/Thing.usda": block, "Chair 01": "/Room/Chair", "Dish 01": "Ball"}
    objects = [dataclasses.replace(each, template=templates[each.template]) for each in scenario.objects]
    return dataclasses.replace(scenario, scene=str(room), objects=objects)


def assert_kept(scenario: Scenario, path: Path) -> None:
    scenario.save(path)
    loaded = Scenario.load(path)
    assert loaded == scenario
    assert repr(loaded) == repr(scenario)
    first = path.read_bytes()
    loaded.save(path)
    assert path.read_bytes() == first


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usd"])
def test_scenario_survives_a_usd_layer_exactly(room, tmp_path, suffix):
    assert_kept(in_room(room, everything()), tmp_path / f"run{suffix}")


@pytest.mark.parametrize(
    "members",
    [
        {},
        {"camera": "Window", "timings": ts.AllTogether(), "frustum": Frustum()},
        {"camera": ts.Camera(lens_radius=0.0123, focus_distance=1 / 3, exposure=1e-9, near=0.1 + 1e-12, name="a b")},
        {"timings": ts.WaitUntilComplete(0.5, repeat=False)},
        {"timings": ts.DictTimings({"a": 1.0}), "objects": [Object("a", "Ball")]},
        {"objects": [Object("a", "Ball", dynamic=UniformMovementRandomBounce(0.8, seed=-32)), Object("A", "Ball")]},
        {
            "objects": [
                Object("a", "Ball", dynamic=Drift((1 / 3, 0, 0), "ünï \"'")),
                Object("b", "Ball", dynamic=Drift()),
            ]
        },
        {"camera": ts.Camera(dynamic=Drift((0.1, 0, 1e-9)))},
        {"objects": [Object("twice", "/Room/Chair"), Object("again", "/Room/Chair", scale=(1, 2, 3))]},
    ],
)
def test_each_member_survives_a_usd_layer(room, tmp_path, members):
    assert_kept(Scenario(str(room), **members), tmp_path / "run.usda")


def test_random_poses_and_cameras_survive_exactly(room, tmp_path):
    rng = np.random.default_rng(5)
    for _ in range(20):
        numbers = rng.normal(size=7)
        objects = [
            Object("a", "Ball", tuple(numbers[:3]), tuple(numbers[3:])),
            Object("b", "Ball", tuple(numbers[:3]), tuple(numbers[3:6] * 100)),
        ]
        camera = ts.Camera(tuple(numbers[:3]), tuple(numbers[3:]), vertical_fov=float(rng.uniform(0.2, 2)))
        scenario = Scenario(str(room), objects, camera=camera)
        scenario.save(tmp_path / "run.usdc")
        assert Scenario.load(tmp_path / "run.usdc") == scenario


def test_decimals_survive_a_stage_in_centimeters(tmp_path):
    room = write(tmp_path, ROOM, name="room.usda", meters=0.01)
    loop = ts.LinearWaypoints([ts.Waypoint((0.1, 1.23, -0.07)), ts.Waypoint((0.3, 0.7, 19.99))], total_time=3)
    objects = [
        Object("a", "Ball", (0.1, 1 / 3, math.pi), (1, 2, 3), dynamic=loop),
        Object("b", "Ball", dynamic=UniformMovementRandomBounce(0.35)),
    ]
    assert_kept(Scenario(str(room), objects, frustum=Frustum(7.7)), tmp_path / "run.usda")
    stage = Usd.Stage.Open(str(tmp_path / "run.usda"))
    prim = stage.GetPrimAtPath("/Scenario/Objects/a")
    assert prim.GetAttribute("tiscene:motion:positions").Get()[0] == Gf.Vec3d(10, 123, -7)
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.01


def test_saved_layer_shows_start_poses_without_the_schema(room, tmp_path):
    scenario = Scenario(
        str(room),
        [
            Object("chair", "/Room/Chair", (0, 0, -3), (0, 90, 0)),
            Object("block", str(room.with_name("block.usda")), (0, 5, 0), (30, 20, 10), scale=(1, 1, 3)),
            Object("ball", "Ball", (1, 1, 1), (0.5, 0.5, 0.5, 0.5)),
        ],
    )
    scenario.save(tmp_path / "run.usda")
    stream = ts.Stream(scenario, width=8, height=6, buffers=("depth",))
    placement = stream.world.state(0).placement
    want = placement.world_from_object[1][placement.instance_id > len(stream.world.stage.objects)]
    seen = read_stage(tmp_path / "run.usda")
    have = [each for each in seen.instances if seen.objects[each.object].prim_path.startswith("/Scenario")]
    np.testing.assert_allclose([each.world_from_object[:3] for each in have], want, atol=1e-12)
    assert len(seen.objects) == len(stream.world.stage.objects) + 3  # the chair is not drawn twice


def test_saved_layer_passes_usd_validation(room, tmp_path):
    in_room(room, everything()).save(tmp_path / "run.usda")
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(tmp_path / "run.usda")))
    assert not [error.GetMessage() for error in errors]


def test_asset_paths_in_saved_layer_are_relative(room, tmp_path):
    folder = tmp_path / "runs"
    folder.mkdir()
    Scenario(str(room), [Object("a", str(room.with_name("block.usda")))]).save(folder / "run.usda")
    layer = Sdf.Layer.FindOrOpen(str(folder / "run.usda"))
    assert list(layer.subLayerPaths) == ["../room.usda"]
    assert "@../block.usda@" in (folder / "run.usda").read_text()
    assert not layer.anonymous


def test_edits_by_another_program_override_exact_values(room, tmp_path):
    scenario = Scenario(str(room), [Object("a", "Ball", (1, 2, 3), (0.1, 0.2, 0.3, 0.4))], camera=ts.Camera())
    scenario.save(tmp_path / "run.usda")
    stage = Usd.Stage.Open(str(tmp_path / "run.usda"))
    prim = stage.GetPrimAtPath("/Scenario/Objects/a")
    prim.GetAttribute("xformOp:translate").Set(Gf.Vec3d(5, 6, 7))
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/Scenario/Cameras/Camera"))
    camera.GetFocalLengthAttr().Set(2 * camera.GetFocalLengthAttr().Get())
    stage.Save()
    loaded = Scenario.load(tmp_path / "run.usda")
    assert loaded.objects[0].position == (5, 6, 7)
    np.testing.assert_allclose(loaded.objects[0].rotation, np.array((0.1, 0.2, 0.3, 0.4)) / math.sqrt(0.3))
    assert math.tan(loaded.camera.vertical_fov / 2) == pytest.approx(math.tan(math.radians(30)) / 2, rel=1e-6)


MOVING = """
def Xform "World" (
    prepend apiSchemas = ["TisceneScenarioAPI"]
)
{
    uniform double tiscene:scenario:waitTime = 0.75
    uniform double tiscene:scenario:frustumFar = -1
    double3 xformOp:translate = (0, 1, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Camera "Eye" (
        prepend apiSchemas = ["TisceneMotionAPI"]
    )
    {
        uniform token tiscene:motion:type = "orbit"
        uniform double tiscene:motion:period = 4
        double3 xformOp:translate = (0, 0, 5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Floor"
    {
        double3 xformOp:translate = (0, -3, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Xform "Chair" (
        prepend apiSchemas = ["TisceneMotionAPI", "TisceneObjectAPI", "SemanticsLabelsAPI:class"]
        kind = "component"
    )
    {
        token[] semantics:labels:class = ["chair"]
        uniform token tiscene:motion:type = "catmullWaypoints"
        uniform point3d[] tiscene:motion:positions = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        uniform double3[] tiscene:motion:rotations = [(0, 0, 0), (0, 90, 0), (0, 180, 0)]
        uniform double tiscene:motion:totalTime = 2
        uniform int64 tiscene:object:lastFrame = 20
        uniform bool tiscene:object:collide = 0
        double3 xformOp:translate = (1, 2, 3)
        float3 xformOp:rotateXYZ = (0, 90, 0)
        float3 xformOp:scale = (0.1, 0.2, 0.3)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
        def Cube "Seat"
        {
        }
    }
    def Scope "Spin" (
        prepend apiSchemas = ["TisceneMotionAPI"]
    )
    {
        uniform token tiscene:motion:type = "orbit"
    }
    def Scope "Swing" (
        prepend apiSchemas = ["TisceneMotionAPI"]
    )
    {
        uniform token tiscene:motion:type = "orbit"
        uniform double tiscene:motion:period = 2
    }
    def Sphere "Ball" (
        prepend apiSchemas = ["TisceneMotionAPI"]
    )
    {
        uniform token tiscene:motion:type = "composite"
        rel tiscene:motion:parts = [</World/Swing>, </World/Spin>]
    }
}
"""


def test_hand_authored_schema_plays(tmp_path):
    path = write(tmp_path, MOVING)
    scenario = Scenario.load(path)
    assert scenario.scene == str(path)
    assert scenario.timings == ts.AllTogether(0.75)
    assert scenario.frustum == Frustum(-1)
    assert scenario.camera.dynamic == ts.Orbit(period=4)
    assert scenario.camera.position == (0, 1, 5)
    chair, ball = scenario.objects
    assert (chair.id, chair.template) == ("Chair", "/World/Chair")
    assert (chair.last_frame, chair.collide, chair.position) == (20, False, (1, 3, 3))
    half = math.sqrt(0.5)
    np.testing.assert_allclose(chair.rotation, (half, 0, half, 0), atol=1e-12)
    waypoints = [ts.Waypoint((0, 0, 0)), ts.Waypoint((1, 0, 0), (0, 90, 0)), ts.Waypoint((0, 1, 0), (0, 180, 0))]
    assert chair.dynamic == ts.CatmullWaypoints(waypoints, total_time=2)
    assert ball.dynamic == ts.Composite((ts.Orbit(period=2), ts.Orbit()))

    stream = ts.Stream(path, width=32, height=24, buffers=("instance",))
    assert [each.name for each in stream.world.stage.objects] == ["Floor"]
    rows = {each.name: each for each in stream.world.state(0).objects}
    assert rows["Chair"].category == "chair"
    low, high = np.array(rows["Chair"].box)
    np.testing.assert_allclose(high, (0.1, 0.2, 0.3))  # the object keeps its prim's scale
    np.testing.assert_allclose(low, -high)
    assert "Chair" not in {each.name for each in stream.world.state(21).objects}
    assert_kept(scenario, tmp_path / "run.usda")


def test_prim_of_the_stage_can_be_an_object_of_a_scenario(room):
    loop = ts.LinearWaypoints([ts.Waypoint((0, 0, 0)), ts.Waypoint((1, 0, 0))], total_time=2)
    scenario = Scenario(str(room), [Object("c", "/Room/Chair", dynamic=loop, collide=False)])
    world = ts.Stream(scenario, fps=10, width=8, height=6, buffers=("instance",)).world
    assert [each.name for each in world.stage.objects] == ["Floor"]
    (chair,) = (each for each in world.state(5).objects if each.name == "c")
    assert chair.position == pytest.approx((0.5, 0, 0))
    np.testing.assert_allclose(np.array(chair.box), [(-1, -2, -1), (1, 2, 1)], atol=1e-6)


def test_static_stage_is_an_empty_scenario(room):
    assert Scenario.load(room) == Scenario(str(room))
    assert Scenario.load("object_view") == Scenario("object_view")


MOTION = 'def Cube "A" (prepend apiSchemas = ["TisceneMotionAPI"])\n{{\n{}\n}}'


@pytest.mark.parametrize(
    ("body", "error", "message"),
    [
        (MOTION.format('uniform token tiscene:motion:type = "wobble"'), StageError, "</A> motion: .*'wobble'; it must"),
        (MOTION.format("uniform double tiscene:motion:totaltime = 2"), StageError, "did you mean .*totalTime'"),
        (
            MOTION.format(
                'uniform token tiscene:motion:type = "linearWaypoints"\n'
                "uniform point3d[] tiscene:motion:positions = [(0,0,0), (1,0,0)]\n"
                "uniform double3[] tiscene:motion:rotations = [(0,0,0)]"
            ),
            StageError,
            "2 positions, but 1 rotations",
        ),
        (
            MOTION.format('uniform token tiscene:motion:type = "linearWaypoints"'),
            ScenarioError,
            "</A> .*waypoints: a path needs 2 or more",
        ),
        (
            MOTION.format('uniform token tiscene:motion:type = "composite"\nrel tiscene:motion:parts = </A>'),
            StageError,
            "it is a part of itself",
        ),
        (
            MOTION.format('uniform token tiscene:motion:type = "composite"\nrel tiscene:motion:parts = </B>'),
            StageError,
            "its part </B> has no motion",
        ),
        (
            MOTION.format('uniform token tiscene:motion:type = "stepped"'),
            StageError,
            "tiscene:motion:class is empty",
        ),
        (
            MOTION.format(
                'uniform token tiscene:motion:type = "stepped"\n'
                'uniform string tiscene:motion:class = "Drift"\nuniform string tiscene:motion:fields = "[1]"'
            ),
            StageError,
            "it must be a JSON object",
        ),
        (
            MOTION.format(
                'uniform token tiscene:motion:type = "stepped"\nuniform string tiscene:motion:class = "Drifd"'
            ),
            ScenarioError,
            "</A> .*unknown type 'Drifd'. Did you mean 'Drift'",
        ),
        (
            'def Scope "S" (prepend apiSchemas = ["TisceneScenarioAPI"])\n{\n'
            'uniform token tiscene:scenario:timing = "never"\n}',
            StageError,
            "</S> scenario: .*'never'",
        ),
        (
            'def Scope "S" (prepend apiSchemas = ["TisceneScenarioAPI"])\n{\n}\n'
            'def Scope "T" (prepend apiSchemas = ["TisceneScenarioAPI"])\n{\n}',
            StageError,
            "</T> scenario: </S> is the scenario already",
        ),
        (
            'def Scope "S" (prepend apiSchemas = ["TisceneScenarioAPI"])\n{\n'
            "rel tiscene:scenario:objects = </Gone>\nrel tiscene:scenario:camera = </S>\n}",
            StageError,
            "</Gone> is not a transformable prim(.|\n)*</S> is not a Camera",
        ),
    ],
)
def test_invalid_schema_values_raise_errors_with_the_prim(tmp_path, body, error, message):
    with pytest.raises(error, match=message):
        Scenario.load(write(tmp_path, body))


def test_failed_save_leaves_the_existing_file_unchanged(room, tmp_path):
    target = tmp_path / "run.usda"
    target.write_text("mine")
    with pytest.raises(ArgumentError, match="'/Room/Gone' cannot serve as a template"):
        Scenario(str(room), [Object("a", "/Room/Gone")]).save(target)
    with pytest.raises(CameraNotFound, match=re.escape("no camera 'Dor'")):
        Scenario(str(room), camera="Dor").save(target)
    seed = UniformMovementRandomBounce(seed=2**64)
    with pytest.raises(StageError, match="not within 64 bits"):
        Scenario(str(room), [Object("a", "Ball", dynamic=seed)]).save(target)
    assert target.read_text() == "mine"
    with pytest.raises(ExportError, match="exists and is writable"):
        Scenario(str(room)).save(tmp_path / "nowhere" / "run.usda")
    with pytest.raises(ArgumentError, match=r"ends in \.json, \.usda, \.usdc, \.usd"):
        Scenario(str(room)).save(tmp_path / "run.usdz")


ANIMATED = """
def Xform "World"
{
    double3 xformOp:translate.timeSamples = { 10: (0, 0, 0), 20: (0, 0, 10) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Cube "Box" (kind = "component")
    {
        double3 xformOp:translate.timeSamples = { 10: (0, 0, 0), 15: (5, 0, 0) }
        float xformOp:rotateY.timeSamples = { 12: 0, 14: 270 }
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]
        token visibility.timeSamples = { 10: "invisible", 13: "inherited", 18: "invisible" }
    }
}
def Camera "Eye"
{
    double3 xformOp:translate.timeSamples = { 10: (0, 0, 9), 30: (2, 0, 9) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Cube "Floor"
{
    float3 xformOp:scale.timeSamples = { 10: (1, 1, 1), 20: (2, 1, 1) }
    double3 xformOp:translate.timeSamples = { 10: (0, -5, 0), 20: (0, -6, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
}
"""


def test_time_samples_of_objects_and_cameras_play_exactly(tmp_path):
    path = write(tmp_path, ANIMATED, more="startTimeCode = 10\nendTimeCode = 30\ntimeCodesPerSecond = 5")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        stream = ts.Stream(path, fps=5, width=8, height=6, buffers=("instance",))
    assert any("an animated scale keeps its first value: </Floor>" in str(each.message) for each in caught)
    assert all(isinstance(each.message, StageWarning) for each in caught)
    box, floor = stream.scenario.objects
    assert (box.first_frame, box.last_frame, box.collide, floor.last_frame) == (3, 7, False, None)
    for frame in range(21):
        rows = {each.name: each for each in stream.world.state(frame).objects}
        assert ("Box" in rows) == (3 <= frame <= 7)
        assert stream.world.state(frame).cameras[0].current.position == pytest.approx((frame / 10, 0, 9))
        assert rows["Floor"].position == pytest.approx((0, -5 - min(frame, 10) / 10, 0))
        if "Box" in rows:
            assert rows["Box"].position == pytest.approx((min(frame, 5), 0, frame))
            angle = math.radians(min(max(frame - 2, 0), 2) * 135)
            expected = np.array([math.cos(angle / 2), 0, math.sin(angle / 2), 0])
            assert abs(np.dot(rows["Box"].rotation, expected)) == pytest.approx(1)


def test_stream_at_a_time_code_is_static(tmp_path):
    path = write(tmp_path, ANIMATED, more="startTimeCode = 10\nendTimeCode = 30\ntimeCodesPerSecond = 5")
    stream = ts.Stream(path, time_code=15.0, width=8, height=6, buffers=("instance",))
    assert stream.scenario.objects == ()
    for frame in (0, 7):
        assert stream.world.state(frame).cameras[0].current.position == pytest.approx((0.5, 0, 9))
        rows = {each.name: each for each in stream.world.state(frame).objects}
        assert rows["Box"].position == pytest.approx((5, 0, 5))
    json = tmp_path / "run.json"
    ts.Scenario(str(path), [Object("ball", "Sphere", (1, 0, 0), dynamic=ts.Orbit((0, 0, 0), period=4))]).save(json)
    rows = ts.Stream(json, time_code=15.0, width=8, height=6, buffers=("instance",)).world.state(25).objects
    assert [row.velocity == (0, 0, 0) for row in rows] == [True, True, False]  # the scenario's object moves


def test_stage_of_the_documentation_plays(tmp_path):
    page = Path(__file__).parents[3] / "docs" / "usd_scenarios.md"
    (text,) = re.findall(r"```usda\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "scene.usda").write_text(text)
    write(tmp_path, 'def Xform "Chair"\n{\ndef Cube "Seat"\n{\n}\n}', name="chair.usda", more='defaultPrim = "Chair"')
    scenario = Scenario.load(tmp_path / "scene.usda")
    (chair,) = scenario.objects
    assert (chair.id, chair.last_frame, scenario.timings) == ("Chair", 199, ts.AllTogether(0.25))
    assert chair.dynamic.total_time == 6
    assert [
        each.name for each in ts.Stream(scenario, width=8, height=6, buffers=("depth",)).world.state(0).objects
    ] == ["Chair"]


@pytest.mark.skipif(os.name != "posix", reason="limits of processes need POSIX")
def test_randomly_damaged_scenarios_are_read_or_refused(tmp_path):
    text = "#usda 1.0\n" + MOVING + ANIMATED.replace('"World"', '"Other"')
    data, rng = crate_bytes(text, tmp_path), random.Random(3)
    files = [tmp_path / f"damaged_{number}.usdc" for number in range(60)]
    for path in files:
        path.write_bytes(damaged(data, rng))
    outcomes = read_all("tiscene.scenario.scenario:Scenario.load", files, seconds=20.0, total=180.0)
    assert {READ, REFUSED} <= set(outcomes)
    assert outcomes.count(STOPPED) <= 3  # a damaged count can keep USD itself busy


VARIANTS = """
def Xform "Room" (
    variants = { string lighting = "day" }
    prepend variantSets = "lighting"
)
{
    variantSet "lighting" = {
        "day" {
            def Cube "Window"
            {
            }
        }
        "night" {
            def Sphere "Lamp" (kind = "component")
            {
            }
        }
    }
}
"""


def test_saved_layer_keeps_variants(tmp_path):
    path = write(tmp_path, VARIANTS)
    scenario = Scenario(str(path), [Object("a", "/Room/Lamp", (1, 2, 3))], variants={"/Room{lighting}": "night"})
    scenario.save(tmp_path / "run.usda")
    assert Scenario.load(tmp_path / "run.usda") == scenario
    names = {each.name for each in read_stage(tmp_path / "run.usda").objects}
    assert names == {"a"}  # the layer itself selects them: any program shows the lamp where the object is


def test_saved_layer_finds_the_catalog_of_another_environment(tmp_path, monkeypatch):
    """The paths in the file are those in the catalog, of which a copy is found by TISCENE_PATH."""
    Scenario("object_view", [Object("a", "Cube", (1, 2, 3))]).save(tmp_path / "runs.usda")
    text = (tmp_path / "runs.usda").read_text()
    assert "@object_view/scene.usda@" in text
    assert "@templates/cube/template.usda@" in text
    package = Path(usd_scenes.__path__[0])
    assert str(package) not in text
    assert ".." not in text
    elsewhere = tmp_path / "elsewhere"
    for name in ("object_view", "templates/cube"):
        shutil.copytree(package / name, elsewhere / "data" / name)
    moved = shutil.move(tmp_path / "runs.usda", elsewhere / "moved.usda")
    digests = layer_digests(moved)
    assert {"moved.usda", "object_view/scene.usda", "templates/cube/template.usda"} <= set(digests)
    monkeypatch.setenv("TISCENE_PATH", str(elsewhere / "data"))
    assert layer_digests(moved) == digests
    stage = open_stage(moved)
    used = {Path(layer.realPath) for layer in stage.GetUsedLayers() if layer.realPath}
    assert elsewhere / "data" / "object_view" / "scene.usda" in used
    assert not [path for path in used if path.is_relative_to(package)]
    assert Scenario.load(moved).objects[0].position == (1, 2, 3)
