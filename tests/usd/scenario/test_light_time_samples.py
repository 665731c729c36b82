# SPDX-License-Identifier: Apache-2.0
"""Animated lights, edits and several cameras: on stages, in saved scenarios and in baked layers."""

import math

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import write
from tiscene.errors import ArgumentError
from tiscene.scenario.edits import Despawn, Move, SetFrustumWalls
from tiscene.usd.read.stage_reader import read_stage
from tiscene.world.world import World

RANGE = "startTimeCode = 10\n    endTimeCode = 40\n    timeCodesPerSecond = 10"
STAGE = """
def Xform "Room" {
    def Mesh "Floor" {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)]
    }
    def Xform "Box" ( kind = "component" ) {
        double3 xformOp:translate = (1, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Cube "Body" {
            double size = 0.5
        }
        def SphereLight "Bulb" {
            float inputs:radius = 0.1
            float inputs:intensity.timeSamples = { 10: 0, 20: 4 }
            color3f inputs:color = (1, 0.5, 0.25)
        }
    }
    def Xform "Arm" {
        double3 xformOp:translate.timeSamples = { 10: (0, 3, 0), 30: (2, 3, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def RectLight "Panel" {
            float inputs:intensity = 3
            double3 xformOp:scale = (2, 1, 1)
            uniform token[] xformOpOrder = ["xformOp:scale"]
        }
    }
    def DistantLight "Sun" {
        float inputs:intensity = 2
    }
    def Camera "Main" {
        double3 xformOp:translate = (0, 1, 6)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Camera "Side" {
        double3 xformOp:translate = (1, 1, 6)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""


@pytest.fixture
def file(tmp_path):
    return write(tmp_path, STAGE, more=RANGE, name="scene.usda")


def world(scenario, fps=10.0):
    return World(scenario, read_stage(scenario.scene), lambda name: pytest.fail(name), fps)


def named(lights):
    return {light.name: light for light in lights}


def test_time_samples_of_lights_become_light_motions(file):
    scenario = ts.Scenario.load(file)
    assert [motion.light for motion in scenario.lights] == ["/Room/Box/Bulb", "/Room/Arm/Panel"]
    assert scenario.objects == ()
    made = world(scenario)
    assert [named(made.state(k).lights)["Bulb"].radiance for k in (0, 5, 10, 30)] == [
        (0, 0, 0), (2, 1, 0.5), (4, 2, 1), (4, 2, 1),
    ]  # fmt: skip
    panel = {k: named(made.state(k).lights)["Panel"] for k in (0, 10, 20, 50)}
    assert [light.world_from_light[0, 3] for light in panel.values()] == pytest.approx([0, 1, 2, 2])
    assert (panel[10].width, panel[10].height) == (2, 1)
    assert named(made.state(10).lights)["Sun"] is named(made.stage.lights)["Sun"]
    # A stage read at a time code has the same lights.
    for code, frame in ((10, 0), (15, 5), (24, 14)):
        for there, here in zip(read_stage(file, time_code=code).lights, made.state(frame).lights, strict=True):
            np.testing.assert_allclose(there.world_from_light, here.world_from_light, atol=1e-6)


def edited(file):
    return ts.Scenario(
        str(file),
        lights=[
            ts.LightMotion("/Room/Arm/Panel", ts.Orbit((0, 0, 0), period=4.0), (0, 2), (1.0, 0.0)),
            ts.LightMotion("Sun", times=(0, 1), color=((1, 1, 1), (1, 0, 0))),
        ],
        camera=("Side", ts.Camera((0, 2, 5), name="Own", dynamic=ts.Orbit((0, 0, 0), period=8.0))),
        edits=[
            Move(4, "/Room/Box", (0.0, 1.0, 0.5), (0, 30, 0)),
            SetFrustumWalls(5, ts.Frustum(3.0), ts.Camera(), 1.5),
            Despawn(8, "/Room/Box"),
        ],
    )


def test_scenario_with_edits_lights_and_cameras_survives_saving_as_usd(file, tmp_path):
    scenario = edited(file)
    scenario.save(tmp_path / "run.usda")
    again = ts.Scenario.load(tmp_path / "run.usda")
    assert again.lights == scenario.lights
    assert again.edits == scenario.edits
    assert [each if isinstance(each, str) else each.name for each in again.cameras] == ["Side", "Own"]
    assert again == scenario


def test_baked_layer_has_edited_objects_lights_and_cameras(file, tmp_path):
    stream = ts.Stream(edited(file), width=16, height=12, fps=10.0, buffers=("instance",))
    stream.to_usd(tmp_path / "motion.usda", 12)
    for frame in (0, 3, 4, 7, 8, 11):
        there = read_stage(tmp_path / "motion.usda", time_code=frame)
        boxes = [each for each in there.objects if each.prim_path == "/Room/Box"]
        assert len(boxes) == (1 if frame < 8 else 0)
        if boxes:
            first = next(i for i in there.instances if there.objects[i.object].prim_path == "/Room/Box")
            box = next(each for each in stream.world.initial_objects if each.name == "Box")
            placement = stream.world.state(frame).placement
            part = int(np.flatnonzero(placement.instance_id == box.id)[0])
            expected = placement.world_from_object[1, part]
            np.testing.assert_allclose(first.world_from_object[:3], expected, atol=1e-6)
        here, lights = named(stream.world.state(frame).lights), named(there.lights)
        for name in {"Panel", "Sun"} & set(lights):
            np.testing.assert_allclose(lights[name].world_from_light, here[name].world_from_light, atol=1e-6)
        np.testing.assert_allclose(lights["Panel"].radiance, here["Panel"].radiance, atol=1e-6)
        np.testing.assert_allclose(lights["Sun"].irradiance, here["Sun"].irradiance, rtol=1e-5)
        assert lights["Panel"].width == pytest.approx(2.0)
        own = next(camera for camera in there.cameras if camera.name.startswith("Own"))
        np.testing.assert_allclose(own.position, stream.world.state(frame).cameras[1].current.position, atol=1e-6)
    played = ts.Stream(tmp_path / "motion.usda", width=16, height=12, fps=10.0, buffers=("instance",))
    assert [camera.name for camera in played.world.cameras] == ["Side", "Own"]
    box = next(row for row in played.world.state(5).objects if row.name == "Box")
    np.testing.assert_allclose(
        box.position, next(r for r in stream.world.state(5).objects if r.name == "Box").position, atol=0.6
    )
    assert not [row for row in played.world.state(9).objects if row.name == "Box"]


def test_several_cameras_give_one_view_each(file):
    stream = ts.Stream(edited(file), width=16, height=12, fps=10.0, buffers=("instance", "depth"))
    alone = ts.Stream(edited(file), width=16, height=12, fps=10.0, buffers=("instance", "depth"), camera="Side")
    frame = stream[3]
    assert list(frame.views) == ["Side", "Own"]
    assert frame.views["Side"] is frame
    assert frame.depth.tobytes() == alone[3].depth.tobytes()
    own = frame.views["Own"]
    assert own.camera.position == stream.world.state(3).cameras[1].current.position
    assert own.index == frame.index
    assert own.depth.tobytes() != frame.depth.tobytes()
    assert own.views == {"Own": own}
    np.testing.assert_allclose(own.camera.position[0], 5.0 * math.sin(2 * math.pi * 0.3 / 8.0), atol=1e-9)


def test_baking_an_edited_instancer_point_raises_argument_error(file, tmp_path):
    points = """
    def PointInstancer "Row" {
        rel prototypes = </Room/Row/Ball>
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 1, 0), (1, 1, 0)]
        def Sphere "Ball" {
            double radius = 0.1
        }
    }
    """
    body = STAGE.replace('    def DistantLight "Sun"', points + '    def DistantLight "Sun"')
    write(tmp_path, body, more=RANGE, name=file.name)
    scenario = ts.Scenario(str(file), edits=[Move(1, "/Room/Row[1]", (0, 2, 0))])
    stream = ts.Stream(scenario, width=16, height=12, buffers=("instance",))
    assert next(row for row in stream.world.state(2).objects if row.name == "Row[1]").position == (0, 2, 0)
    with pytest.raises(ArgumentError, match=r"/Room/Row\[1\].*not a prim of its own"):
        stream.to_usd(tmp_path / "motion.usda", 3)
