# SPDX-License-Identifier: Apache-2.0
"""Scenarios on stages: authored by hand, by time samples, and damaged."""

from __future__ import annotations

import math
import os
import random
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import tiscene as ts
from tests.usd.damage import READ, REFUSED, STOPPED, crate_bytes, damaged, read_all
from tests.usd.helpers import write
from tests.usd.scenario.room_stage import assert_kept
from tiscene.errors import ScenarioError, StageError
from tiscene.scenario.objects import Frustum, Object
from tiscene.scenario.scenario import Scenario

MOVING = """
def Xform "World" (prepend apiSchemas = ["TisceneScenarioAPI"]) {
    uniform double tiscene:scenario:waitTime = 0.75
    uniform double tiscene:scenario:frustumFar = -1
    double3 xformOp:translate = (0, 1, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Camera "Eye" (prepend apiSchemas = ["TisceneMotionAPI"]) {
        uniform token tiscene:motion:type = "orbit"
        uniform double tiscene:motion:period = 4
        double3 xformOp:translate = (0, 0, 5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Floor" {
        double3 xformOp:translate = (0, -3, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Xform "Chair" (
        prepend apiSchemas = ["TisceneMotionAPI", "TisceneObjectAPI", "SemanticsLabelsAPI:class"]
        kind = "component"
    ) {
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
        def Cube "Seat" {}
    }
    def Scope "Spin" (prepend apiSchemas = ["TisceneMotionAPI"]) {
        uniform token tiscene:motion:type = "orbit"
    }
    def Scope "Swing" (prepend apiSchemas = ["TisceneMotionAPI"]) {
        uniform token tiscene:motion:type = "orbit"
        uniform double tiscene:motion:period = 2
    }
    def Sphere "Ball" (prepend apiSchemas = ["TisceneMotionAPI"]) {
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
                'uniform token tiscene:motion:type = "stepped"\nuniform string tiscene:motion:class = "LookAtt"'
            ),
            ScenarioError,
            "</A> .*unknown type 'LookAtt'; did you mean 'LookAt'",
        ),
        (
            'def Scope "S" (prepend apiSchemas = ["TisceneScenarioAPI"])\n{\n'
            'uniform token tiscene:scenario:timing = "never"\n}',
            StageError,
            "</S> scenario: .*'never'",
        ),
        (
            'def Scope "S" (prepend apiSchemas = ["TisceneScenarioAPI"]) {}\n'
            'def Scope "T" (prepend apiSchemas = ["TisceneScenarioAPI"]) {}',
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


ANIMATED = """
def Xform "World" {
    double3 xformOp:translate.timeSamples = { 10: (0, 0, 0), 20: (0, 0, 10) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Cube "Box" (kind = "component") {
        double3 xformOp:translate.timeSamples = { 10: (0, 0, 0), 15: (5, 0, 0) }
        float xformOp:rotateY.timeSamples = { 12: 0, 14: 270 }
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]
    }
}
def Camera "Eye" {
    double3 xformOp:translate.timeSamples = { 10: (0, 0, 9), 30: (2, 0, 9) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Cube "Floor" {
    float3 xformOp:scale.timeSamples = { 10: (1, 1, 1), 20: (2, 1, 1) }
    double3 xformOp:translate.timeSamples = { 10: (0, -5, 0), 20: (0, -6, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
}
"""


def test_time_samples_of_objects_and_cameras_play_exactly(tmp_path):
    path = write(tmp_path, ANIMATED, more="startTimeCode = 10\nendTimeCode = 30\ntimeCodesPerSecond = 5")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stream = ts.Stream(path, fps=5, width=8, height=6, buffers=("instance",))
    (box,) = stream.scenario.objects
    assert (box.first_frame, box.last_frame, box.collide) == (0, None, False)
    for frame in range(21):
        rows = {each.name: each for each in stream.world.state(frame).objects}
        assert stream.world.state(frame).cameras[0].current.position == pytest.approx((frame / 10, 0, 9))
        assert rows["Floor"].position == pytest.approx((0, -5 - min(frame, 10) / 10, 0))
        assert rows["Box"].position == pytest.approx((min(frame, 5), 0, min(frame, 10)))
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
    write(tmp_path, 'def Xform "Chair"\n{\ndef Cube "Seat" {}\n}', name="chair.usda", more='defaultPrim = "Chair"')
    scenario = Scenario.load(tmp_path / "scene.usda")
    (chair,) = scenario.objects
    assert (chair.id, chair.last_frame, scenario.timings) == ("Chair", 199, ts.AllTogether(0.25))
    assert chair.dynamic.total_time == 6
    assert [
        each.name for each in ts.Stream(scenario, width=8, height=6, buffers=("depth",)).world.state(0).objects
    ] == ["Chair"]


@pytest.mark.skipif(os.name != "posix", reason="limits of processes need POSIX")
@pytest.mark.parametrize(("count", "stopped"), [(30, 1), pytest.param(60, 3, marks=pytest.mark.slow)])
def test_randomly_damaged_scenarios_are_read_or_refused(tmp_path, count, stopped):
    text = "#usda 1.0\n" + MOVING + ANIMATED.replace('"World"', '"Other"')
    data, rng = crate_bytes(text, tmp_path), random.Random(3)
    files = [tmp_path / f"damaged_{number}.usdc" for number in range(count)]
    for path in files:
        path.write_bytes(damaged(data, rng))
    outcomes = read_all("tiscene.scenario.scenario:Scenario.load", files, seconds=20.0, total=180.0)
    assert {READ, REFUSED} <= set(outcomes)
    assert outcomes.count(STOPPED) <= stopped  # a damaged count can keep USD itself busy


ROBOT = """
def Xform "Robot" (kind = "component") {
    def Cube "Base" {}
    def Xform "Arm" (prepend apiSchemas = ["TisceneObjectAPI"]) {
        double3 xformOp:translate = (0, 2, 0)
        double3 xformOp:translate.timeSamples = { 0: (0, 2, 0), 10: (0, 3, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Cube "Hand" {
            double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 10: (0, 3, 0) }
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }
    }
    def Cube "Head" {
        double3 xformOp:translate.timeSamples = { 0: (0, 9, 0), 10: (0, 8, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""


def test_object_of_a_schema_within_a_component_is_an_object_of_its_own(tmp_path):
    """Converters of robots make one component of all bodies. Only what a schema names leaves it."""
    (arm,) = Scenario.load(write(tmp_path, ROBOT)).objects
    assert (arm.template, arm.position) == ("/Robot/Arm", (0.0, 2.0, 0.0))
