# SPDX-License-Identifier: Apache-2.0
"""Motion baked as time samples, read back at every time code."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdValidation

import tiscene as ts
from tests.usd.helpers import write
from tiscene.errors import ArgumentError
from tiscene.scene.description import Mesh
from tiscene.usd.core.stage import open_stage
from tiscene.usd.read.stage_reader import read_stage

SCENE = """
def Xform "Room" {
    def Camera "Door" {
        double3 xformOp:translate = (0, 1, 5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Floor" {
        double3 xformOp:translate = (0, -100, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Mover" (kind = "component") {
        double3 xformOp:translate = (50, 0, 0)
        float3 xformOp:scale = (1, 20, 1)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
}
"""
BLOCK = """
def Xform "Block" (kind = "component") {
    float3 xformOp:rotateXYZ = (0, 0, 45)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
    def Cube "Cube" {
        float3 xformOp:scale = (0.1, 0.2, 0.3)
        uniform token[] xformOpOrder = ["xformOp:scale"]
    }
}
"""
FRAMES = 12


@pytest.fixture(params=[1.0, 0.01], ids=["meters", "centimeters"])
def stream(request, tmp_path) -> ts.Stream:
    room = write(tmp_path, SCENE, name="room.usda", meters=request.param, more='defaultPrim = "Room"')
    block = str(write(tmp_path, BLOCK, name="block.usda", up="Z", more='defaultPrim = "Block"'))
    way = [ts.Waypoint((0, 0, 0)), ts.Waypoint((1, 0, 0), (0, 170, 0)), ts.Waypoint((0, 1, -1), (80, 0, 300))]
    scenario = ts.Scenario(
        str(room),
        [
            ts.Object("smooth", block, dynamic=ts.CatmullWaypoints(way, total_time=1), collide=False, scale=(1, 2, 1)),
            ts.Object("short", block, (1, 0, 1), (1, 2, 3), first_frame=3, last_frame=6, collide=False),
            ts.Object("late", block, dynamic=ts.Orbit((1, 2, 3), 2), first_frame=9, collide=False),
            ts.Object("never", block, first_frame=100, collide=False),
            ts.Object("mover", "/Room/Mover", dynamic=ts.LinearWaypoints(way, total_time=2), collide=False),
        ],
        camera=ts.Camera.look_at((0, 1, 6), (0, 0, 0), dynamic=ts.LookAt((0, 0, 0), ts.Orbit(period=3))),
    )
    return ts.Stream(scenario, fps=10, width=24, height=18, frames=FRAMES, buffers=("instance", "depth"))


def moving(stream: ts.Stream, path: object, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the world positions of all vertices of the scenario's objects: in the layer, and in the stream's world."""
    stage = read_stage(path, time_code=frame)
    rows = [each for each in stage.instances if "/Motion" in stage.objects[each.object].prim_path]
    have = [vertices(stage.meshes[each.mesh], each.world_from_object) for each in rows]
    placement = stream.world.state(frame).placement
    meshes = [mesh for description in stream.world.descriptions for mesh in description.meshes]
    added = placement.present[1] & (placement.instance_id > len(stream.world.stage.objects))
    want = [vertices(meshes[placement.mesh[k]], placement.world_from_object[1, k]) for k in np.flatnonzero(added)]
    assert len(stage.instances) - len(have) == len(stream.world.stage.objects)
    return np.array(have), np.array(want)


def vertices(mesh: Mesh, matrix: np.ndarray) -> np.ndarray:
    return mesh.positions.astype(float) @ matrix[:3, :3].T + matrix[:3, 3]


def test_baked_poses_at_each_time_code_match_the_frame(stream, tmp_path):
    stream.to_usd(tmp_path / "motion.usda")
    counts = set()
    scaled = stream.world.stage.meshes[0].positions.max() < 0.5  # m: there float32 vertices are rounded otherwise
    for frame in range(FRAMES):
        have, want = moving(stream, tmp_path / "motion.usda", frame)
        np.testing.assert_allclose(have, want, rtol=0, atol=1e-6 if scaled else 1e-12)
        counts.add(len(have))
        camera = read_stage(tmp_path / "motion.usda", time_code=frame).cameras[-1]
        expected = stream.world.state(frame).cameras[0].current
        np.testing.assert_allclose(camera.position, expected.position, atol=1e-12)
        assert abs(np.dot(camera.rotation, expected.rotation)) == pytest.approx(1, abs=1e-12)
        assert camera.vertical_fov == pytest.approx(expected.vertical_fov, rel=1e-6)
    assert counts == {2, 3}


def test_baked_layer_streams_like_the_original(stream, tmp_path):
    stream.to_usd(tmp_path / "motion.usda")
    again = ts.Stream(tmp_path / "motion.usda", fps=10, width=24, height=18, buffers=("instance", "depth"))
    assert {each.id for each in again.scenario.objects} >= {"smooth", "short", "late", "mover"}
    for frame in (0, 3, 6, 7, 11):
        np.testing.assert_array_equal(again[frame].instance > 1, stream[frame].instance > 1)
        ours, theirs = np.minimum(stream[frame].depth, 1e3), np.minimum(again[frame].depth, 1e3)
        assert np.mean(np.abs(ours - theirs) < 1e-4) > 0.99


PLAYING = """
def Cube "Block" (kind = "component") {
    double size.timeSamples = {START: 0.5, END: 2.5}
    double3 xformOp:translate = (0, 0, -9)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


@pytest.mark.parametrize(("start", "fps"), [(1, 24), (1001, 12), (-10, 30)])
@pytest.mark.parametrize("has_range", [True, False])
def test_baked_layer_plays_the_shapes_of_a_stage_that_does_not_start_at_0(tmp_path, start, fps, has_range):
    """Frame 0 is the start of the stage, and time code 0 of the layer."""
    body = PLAYING.replace("START", str(start)).replace("END", str(start + 24))
    more = f"startTimeCode = {start}\n    endTimeCode = {start + 24}" if has_range else ""
    scene = str(write(tmp_path, body, name="scene.usda", more=f"timeCodesPerSecond = 24\n    {more}"))
    options = {"fps": fps, "width": 24, "height": 18, "buffers": ("depth",)}
    late = str(write(tmp_path, body.replace("-9)", "0)"), name="late.usda", more=f'defaultPrim = "Block"\n    {more}'))
    stream = ts.Stream(ts.Scenario(scene, [ts.Object("a", late, (3, 0, -9))]), **options)
    stream.to_usd(tmp_path / "motion.usda", frames=fps + 1)
    again = ts.Stream(tmp_path / "motion.usda", **options)
    assert not np.array_equal(stream[0].depth, stream[fps].depth)
    for frame in (0, 5, fps):
        np.testing.assert_array_equal(again[frame].depth, stream[frame].depth)


SETTINGS = """
def Camera "First" {}
def Camera "Main" {
    double3 xformOp:translate = (0, 0, 9)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Scope "Render" {
    def RenderSettings "Settings" {
        rel camera = </Main>
        uniform int2 resolution = (16, 8)
    }
}
def FancyCube "Fancy" (kind = "component") {}
def "Named" (references = @`"./${NAME}.usda"`@) {}
"""
ROOT_METADATA = """renderSettingsPrimPath = "/Render/Settings"
    fallbackPrimTypes = {
        token[] FancyCube = ["Cube"]
    }
    expressionVariables = {
        string NAME = "block"
    }"""


@pytest.mark.parametrize("written", ["motion.usda", "run.usda"])
def test_layers_over_a_scene_have_the_metadata_that_usd_reads_from_root_layers(tmp_path, written):
    write(tmp_path, BLOCK, name="block.usda", more='defaultPrim = "Block"')
    scene = str(write(tmp_path, SETTINGS, name="scene.usda", more=ROOT_METADATA))
    scenario = ts.Scenario(scene, [ts.Object("moved", "/Fancy", (0, 1, 0))])
    stream = ts.Stream(scenario, buffers=("depth",))
    scenario.save(tmp_path / "run.usda")
    stream.to_usd(tmp_path / "motion.usda", frames=2)
    again = ts.Stream(tmp_path / written, buffers=("depth",))
    assert again[0].depth.shape == (8, 16)
    np.testing.assert_array_equal(again[0].depth, stream[0].depth)
    seen = read_stage(tmp_path / written)  # of the layer itself, as other programs show it
    assert [each.name for each in seen.objects] == ["Named", "moved"]
    assert seen.cameras[0].name == "Main"


POINTS = """
def PointInstancer "Wood" {
    point3f[] positions = [(-2, 0, -6), (2, 0, -6)]
    int[] protoIndices = [0, 1]
    rel prototypes = [<Fir01>, <Oak_2>]
    def Cube "Fir01" {}
    def Sphere "Oak_2" {}
}
def Cube "Stone7" (kind = "component") {
    double3 xformOp:translate = (0, 0, -9)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


@pytest.mark.parametrize("template", ["Cube", "block.usda"])
def test_baked_layer_keeps_categories_of_a_scene_without_labels(tmp_path, monkeypatch, template):
    """Names are the categories on a stage without labels alone. Objects of the layer add some."""
    monkeypatch.chdir(tmp_path)
    write(tmp_path, BLOCK, name="block.usda", more='defaultPrim = "Block"')
    scene = str(write(tmp_path, POINTS, name="wood.usda"))
    objects = [ts.Object(name, template, (0, y, -4), scale=0.3) for name, y in (("a", 0), ("b", 1))]
    options = {"fps": 10, "width": 32, "height": 24, "buffers": ("instance",)}
    stream = ts.Stream(ts.Scenario(scene, objects), **options)
    want = {(row.name, row.category, row.asset) for row in stream[0].objects}
    assert {"Fir", "Oak", "Stone"} < {category for _, category, _ in want}
    stream.to_usd("motion.usda", frames=2)
    assert {(row.name, row.category, row.asset) for row in ts.Stream("motion.usda", **options)[0].objects} == want


def test_baked_layer_has_the_motion_of_the_last_frame_of_a_lifespan(tmp_path):
    room = str(write(tmp_path, SCENE, name="room.usda", more='defaultPrim = "Room"'))
    block = str(write(tmp_path, BLOCK, name="block.usda", more='defaultPrim = "Block"'))
    way = [ts.Waypoint((0, 0, 0)), ts.Waypoint((9, 0, 0), (0, 170, 0))]
    thing = ts.Object("thing", block, dynamic=ts.LinearWaypoints(way, total_time=2), last_frame=4, collide=False)
    options = {"fps": 10, "width": 8, "height": 6, "frames": 8, "buffers": ("instance",)}
    stream = ts.Stream(ts.Scenario(room, [thing]), **options)
    stream.to_usd(tmp_path / "motion.usda")
    again = ts.Stream(tmp_path / "motion.usda", **options)
    have, want = (each.world.state(4).placement for each in (again, stream))
    np.testing.assert_array_equal(have.present, want.present)
    np.testing.assert_allclose(have.world_from_object, want.world_from_object, atol=1e-9)


def test_baked_layer_is_valid_usd_with_few_samples(stream, tmp_path):
    stream.to_usd(tmp_path / "motion.usdc", range(2, 9))
    stage = Usd.Stage.Open(str(tmp_path / "motion.usdc"))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (2, 8, 10)
    assert stage.GetDefaultPrim().GetName() == "Room"
    assert UsdGeom.GetStageMetersPerUnit(stage) in (1.0, 0.01)
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    short = UsdGeom.Xformable(stage.GetPrimAtPath("/Motion/Objects/short"))
    assert short.GetVisibilityAttr().GetTimeSamples() == [2, 3, 7]
    assert not short.GetTimeSamples()  # a static object has a default value only
    smooth = UsdGeom.Xformable(stage.GetPrimAtPath("/Motion/Objects/smooth"))
    assert smooth.GetTimeSamples() == [float(frame) for frame in range(2, 9)]
    orientations = [smooth.GetOrderedXformOps()[1].Get(frame) for frame in range(2, 9)]
    for before, after in itertools.pairwise(orientations):
        assert before.real * after.real + before.imaginary * after.imaginary > 0
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert not [error.GetMessage() for error in errors]


def test_baking_twice_writes_identical_files(stream, tmp_path):
    for name in ("a.usda", "b.usda"):
        stream.to_usd(tmp_path / name)
    assert (tmp_path / "a.usda").read_bytes() == (tmp_path / "b.usda").read_bytes()


def test_static_camera_of_the_stage_is_not_baked(tmp_path):
    room = write(tmp_path, SCENE, name="room.usda")
    ts.Stream(str(room), width=8, height=6, buffers=("depth",)).to_usd(tmp_path / "motion.usda", 2)
    assert [each.name for each in read_stage(tmp_path / "motion.usda").cameras] == ["Door"]


def test_baking_invalid_frames_raises_argument_error(tmp_path):
    room = write(tmp_path, SCENE, name="room.usda")
    stream = ts.Stream(str(room), width=8, height=6, buffers=("depth",))
    for frames in (0, -1, [], [3, 2], [-1, 2], 1.5, "abc"):
        with pytest.raises(ArgumentError, match="frames="):
            stream.to_usd(tmp_path / "motion.usda", frames)
    with pytest.raises(ArgumentError, match="endless"):
        stream.to_usd(tmp_path / "motion.usda")


def test_baked_layer_replaces_motion_authored_on_the_scene(tmp_path):
    motion = (
        '{ uniform token tiscene:motion:type = "orbit"\n uniform double tiscene:motion:period = 2\n'
        "uniform bool tiscene:object:collide = 0\n uniform int64 tiscene:object:firstFrame = 2\n"
        'double3 xformOp:translate = (3, 0, 0)\n uniform token[] xformOpOrder = ["xformOp:translate"]\n}'
    )
    apis = 'prepend apiSchemas = ["TisceneMotionAPI", "TisceneObjectAPI"]'
    path = write(
        tmp_path, SCENE + f'def Sphere "Ball" ({apis})\n{motion}', name="room.usda", more='defaultPrim = "Room"'
    )
    stream = ts.Stream(path, fps=10, width=8, height=6, frames=FRAMES, buffers=("instance",))
    stream.to_usd(tmp_path / "motion.usda")
    again = ts.Stream(tmp_path / "motion.usda", fps=10, width=8, height=6, frames=FRAMES, buffers=("instance",))
    for frame in range(FRAMES):
        have = {each.name: each.position for each in again.world.state(frame).objects}
        want = {each.name: each.position for each in stream.world.state(frame).objects}
        assert have.keys() == want.keys()
        assert ("Ball" in have) == (frame >= 2)
        for name in have:
            assert have[name] == pytest.approx(want[name], abs=1e-12)


def test_variants_of_templates_are_selected_in_the_layer(tmp_path):
    objects = [ts.Object(color, f"Cube{{color={color}}}", (0, 1, -2)) for color in ("teal", "white")]
    stream = ts.Stream(ts.Scenario("object_view", objects), width=16, height=12, frames=1)
    stream.to_usd(tmp_path / "motion.usda")
    stage = open_stage(tmp_path / "motion.usda")
    chosen = {
        prim.GetName(): prim.GetVariantSet("color").GetVariantSelection()
        for prim in stage.Traverse()
        if prim.HasVariantSets() and prim.GetName() in ("teal", "white")
    }
    assert chosen == {"teal": "teal", "white": "white"}
    assert sorted(stream.world.templates) == ["Cube{color=teal}", "Cube{color=white}"]


def test_variants_of_the_scene_are_selected_in_the_layer(tmp_path):
    body = """
def "Room" (
    variants = { string light = "day" }
    prepend variantSets = "light"
) {
    variantSet "light" = {
        "day" {}
        "night" {
            def Sphere "Lamp" {}
        }
    }
}
"""
    path = write(tmp_path, body)
    stream = ts.Stream(path, variants={"/Room{light}": "night"}, width=8, height=6, buffers=("instance",))
    stream.to_usd(tmp_path / "motion.usda", 2)
    assert not read_stage(path).objects
    assert [each.name for each in read_stage(tmp_path / "motion.usda").objects] == ["Lamp"]
