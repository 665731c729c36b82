# SPDX-License-Identifier: Apache-2.0
"""Scenarios saved as USD layers: read back exactly, and what other programs see and change."""

from __future__ import annotations

import dataclasses
import math
import re
import resource
import shutil
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdValidation

import tiscene as ts
import usd_scenes
from dynamics import UniformMovementRandomBounce
from tests.scenario.test_scenario import everything
from tests.usd.helpers import write
from tests.usd.scenario.room_stage import ROOM, assert_kept
from tiscene.errors import ArgumentError, CameraNotFound, ExportError, StageError
from tiscene.scenario.objects import Frustum, Object
from tiscene.scenario.scenario import Scenario
from tiscene.usd.core.layers import layer_digests
from tiscene.usd.core.stage import open_stage
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.template import read_template


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


def in_room(room: Path, scenario: Scenario) -> Scenario:
    """Return the scenario with files that exist."""
    block = str(room.with_name("block.usda"))
    templates = {"Cube": block, "folder/Thing.usda": block, "Chair 01": "/Room/Chair", "Dish 01": "Ball"}
    objects = [dataclasses.replace(each, template=templates[each.template]) for each in scenario.objects]
    return dataclasses.replace(scenario, scene=str(room), objects=objects)


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usd"])
def test_scenario_survives_a_usd_layer_exactly(room, tmp_path, suffix):
    assert_kept(in_room(room, everything()), tmp_path / f"run{suffix}")


@pytest.mark.parametrize(
    "members",
    [
        {},
        {"camera": "Window", "timings": ts.AllTogether(), "frustum": Frustum()},
        {"camera": ts.Camera(lens_radius=0.0123, focus_distance=1 / 3, exposure=1e-9, near=0.1 + 1e-12, name="a b")},
        {
            "camera": ts.Camera(
                lens=ts.LensKeyframes(
                    (0.0, 1 / 3), vertical_fov=(1.0, 0.1 + 1e-12), aperture_offset=((0, 0), (1 / 7, 0))
                )
            )
        },
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


def test_lights_of_a_template_in_another_unit_are_as_bright_in_the_layer(room, tmp_path):
    lamp = """def Xform "Lamp" {
    def Cube "Base" {
        double size = 10
    }
    def SphereLight "Bulb" {
        bool inputs:normalize = 1
        float inputs:intensity = 30000
        float inputs:radius = 4
    }
}"""
    file = write(tmp_path, lamp, name="lamp.usda", meters=0.01, up="Z", more='defaultPrim = "Lamp"')
    Scenario(str(room), [Object("lamp", str(file), (0, 1, 0))]).save(tmp_path / "run.usda")
    (own,) = read_template(file).description.lights
    light = next(each for each in read_stage(tmp_path / "run.usda").lights if each.prim_path.endswith("/Bulb"))
    assert light.radiance == pytest.approx(own.radiance)
    assert light.radius == pytest.approx(0.04)


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
    with pytest.raises(ExportError, match=r"cannot write .*run\.usda.*: there is no folder .*nowhere"):
        Scenario(str(room)).save(tmp_path / "nowhere" / "run.usda")
    with pytest.raises(ArgumentError, match=r"ends in \.json, \.usda, \.usdc, \.usd"):
        Scenario(str(room)).save(tmp_path / "run.usdz")


@pytest.mark.parametrize("name", ["run.usda", "run.usdc"])
def test_full_disk_leaves_the_existing_file_unchanged(room, tmp_path, name):
    target = tmp_path / name
    Scenario(str(room)).save(target)
    before = target.read_bytes()
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (256, limit[1]))
    try:
        with pytest.raises(ExportError, match=f"cannot write .*{name}"):
            Scenario(str(room), frustum=Frustum(3.0)).save(target)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert target.read_bytes() == before
    assert not list(tmp_path.glob(".*"))


def test_saved_layer_finds_files_that_were_named_from_another_folder(room, tmp_path, monkeypatch):
    """Scene and template are named by paths from the working directory, in the layer as in Python."""
    project = tmp_path / "my project"
    shutil.copytree(room.parent, project)
    monkeypatch.chdir(project)
    scenario = Scenario(room.name, [Object("a", "block.usda", (1, 2, 3)), Object("b", "block.usda{size=big}")])
    scenario.save("run.usda")
    assert Scenario.load("run.usda") == scenario
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    Path(room.name).write_text("not the scene")
    loaded = Scenario.load("../my project/run.usda")
    assert loaded.scene == f"../my project/{room.name}"
    templates = [each.template for each in loaded.objects]
    assert templates == ["../my project/block.usda", "../my project/block.usda{size=big}"]
    absolute = dataclasses.replace(scenario, scene=str(project / room.name), objects=[])
    absolute.save(project / "absolute.usda")
    shutil.move(project, tmp_path / "moved")
    assert Scenario.load("../moved/absolute.usda").scene == str(tmp_path / "moved" / room.name)


MOVING = """
def Cube "Block" (kind = "component") {
    double3 xformOp:translate.timeSamples = {0: (0, 2, -3), 24: (2, 2, -3)}
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Camera "Main" {
    double3 xformOp:translate.timeSamples = {0: (0, 0, 3), 24: (2, 0, 3)}
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "Lamp" {
    float inputs:intensity.timeSamples = {0: 1, 24: 10}
}
"""


@pytest.mark.parametrize("camera", [None, "Main", ("Main", ts.Camera(name="Other"))])
@pytest.mark.parametrize("objects", [(), (Object("a", "/Block", (0, 1, -2)),)])
def test_saved_scenario_without_the_motion_of_its_scene_keeps_it_still(tmp_path, camera, objects):
    scenario = Scenario(str(write(tmp_path, MOVING)), objects, camera=camera)
    scenario.save(tmp_path / "run.usda")
    assert Scenario.load(tmp_path / "run.usda") == scenario
    assert Scenario.load(scenario.scene).lights  # it moves where the stage is played by itself


def test_scenario_by_hand_that_names_its_scene_has_the_objects_of_the_schema(tmp_path):
    body = """
    def Scope "Scenario" (prepend apiSchemas = ["TisceneScenarioAPI"]) {
        uniform string tiscene:scenario:scene = "scene.usda"
    }
    over "Block" (prepend apiSchemas = ["TisceneMotionAPI"]) {
        uniform token tiscene:motion:type = "orbit"
    }
    """
    scene = write(tmp_path, MOVING.replace("Block", "Other") + 'def Cube "Block" {}\n', name="scene.usda")
    layer = write(tmp_path, body, name="run.usda", more="subLayers = [@scene.usda@]")
    loaded = Scenario.load(layer)
    assert [(each.template, type(each.dynamic)) for each in loaded.objects] == [("/Block", ts.Orbit)]
    assert Path(loaded.scene).resolve() == scene.resolve()  # it is beside the layer


VARIANTS = """
def Xform "Room" (
    variants = { string lighting = "day" }
    prepend variantSets = "lighting"
) {
    variantSet "lighting" = {
        "day" {
            def Cube "Window" {}
        }
        "night" {
            def Sphere "Lamp" (kind = "component") {}
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


@pytest.mark.parametrize("method", ["save", "to_usd"])
@pytest.mark.parametrize("scene", ["room.usda", "over.usda"])
def test_files_of_the_scene_are_not_overwritten(tmp_path, monkeypatch, method, scene):
    """The layer refers to them: it would refer to itself, and the scene would be lost."""
    monkeypatch.chdir(tmp_path)
    Path("room.usda").write_text('#usda 1.0\n(\n    defaultPrim = "Box"\n)\ndef Cube "Box" {}\n')
    Path("over.usda").write_text("#usda 1.0\n(\n    subLayers = [@room.usda@]\n)\n")
    before = Path("room.usda").read_bytes()
    scenario = ts.Scenario(scene, [ts.Object("ball", "Sphere", (0, 1, -3))])
    writer = scenario if method == "save" else ts.Stream(scenario, width=8, height=8, buffers=("depth",), frames=2)
    with pytest.raises(ArgumentError, match=r"'room\.usda': is a file of the scene"):
        getattr(writer, method)("room.usda")
    assert Path("room.usda").read_bytes() == before


def test_saved_scenario_can_be_saved_into_its_own_file(tmp_path):
    scenario = ts.Scenario("object_view", [ts.Object("ball", "Sphere", (0, 1, -3))])
    scenario.save(tmp_path / "run.usda")
    loaded = ts.Scenario.load(tmp_path / "run.usda")
    loaded.save(tmp_path / "run.usda")
    assert ts.Scenario.load(tmp_path / "run.usda").objects == loaded.objects == scenario.objects


def test_object_whose_prim_has_operations_in_single_precision_keeps_its_pose(tmp_path):
    """The layer's own operations are in double precision: a quaternion of another type is refused by USD."""
    body = """
def Cube "Block" {
    float3 xformOp:translate = (0.5, 0, 0)
    quatf xformOp:orient = (0.8, 0.6, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
}
"""
    scene = write(tmp_path, body)
    rotation = (0.1, 0.7, 0.5, 0.5)
    assert_kept(Scenario(str(scene), [Object("a", "/Block", (1 / 3, 0, 0), rotation)]), tmp_path / "run.usda")
    saved = Usd.Stage.Open(str(tmp_path / "run.usda"))
    (block,) = (prim for prim in saved.Traverse() if prim.GetName() == "a")
    types = [operation.GetTypeName() for operation in UsdGeom.Xformable(block).GetOrderedXformOps()]
    assert types == [Sdf.ValueTypeNames.Double3, Sdf.ValueTypeNames.Quatd]
