# SPDX-License-Identifier: Apache-2.0
"""Meshes whose points lie far from the origin of their prim, and stages far from the world's origin."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

import tiscene as ts
from tests.usd.characters import author_character
from tests.usd.helpers import write
from tiscene.errors import StageWarning
from tiscene.scene.animation import Deformation
from tiscene.usd.read.stage_reader import read_stage

FAR = (524288.0, -16384.0, 131072.0)  # m; near these numbers single precision keeps sixteenths
LABELS = ("instance", "part", "depth", "position", "normal", "uv", "object_coordinates")
MOTION = ("forward_flow", "backward_flow", "scene_flow")
RANGE = "startTimeCode = 0\n    endTimeCode = 8\n    timeCodesPerSecond = 8"

CUBE = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
CORNERS = "0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3"
MESH = f"""
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [{CORNERS}]
    texCoord2f[] primvars:st = [{", ".join(["(0, 0), (1, 0), (1, 1), (0, 1)"] * 6)}] (
        interpolation = "faceVarying"
    )
"""


SUBSET = """
def GeomSubset "Top" {
    uniform token elementType = "face"
    uniform token familyName = "parts"
    int[] indices = [3]
}
"""


def at(*place):
    return f"double3 xformOp:translate = {place}"


def vectors(values):
    return "[" + ", ".join(str(tuple(each)) for each in np.asarray(values).tolist()) + "]"


def cube(name, scale, operations, offset, *, points="", more=""):
    """Return a cube whose points are moved by an offset, m, and moved back by the first of its transforms."""
    names = [each.partition(" = ")[0].split()[-1].removesuffix(".timeSamples") for each in operations]
    order = ", ".join(f'"{each}"' for each in (*names, "xformOp:translate:back"))
    lines = (
        f'def Mesh "{name}"\n{{{MESH}',
        points or f"point3f[] points = {vectors(CUBE * scale + offset)}",
        *operations,
        f"double3 xformOp:translate:back = {tuple((-np.array(offset)).tolist())}",
        f"uniform token[] xformOpOrder = [{order}]",
        more + "}",
    )
    return "\n".join(lines)


def prims(offset):
    """Return prims whose points are moved by an offset, m, and moved back by transforms."""
    turn = "float xformOp:rotateY.timeSamples = {0: 0, 8: 40}"
    rotate, stretch = "float3 xformOp:rotateXYZ = (20, 30, 10)", "float3 xformOp:scale = (1, 0.5, 1.5)"
    shapes = {time: vectors(CUBE * size + offset) for time, size in ((0, (0.75, 0.75, 0.75)), (8, (0.75, 1.5, 0.75)))}
    growth = f"point3f[] points.timeSamples = {{0: {shapes[0]}, 8: {shapes[8]}}}"
    return f"""
{cube("Floor", (8.0, 0.25, 8.0), [at(0, -0.125, 0)], offset)}
{cube("Turned", 1.0, [at(-1, 0.75, 0), rotate, stretch], offset, more=SUBSET)}
{cube("Turning", 0.75, [at(1, 0.5, -1), turn], offset)}
{cube("Growing", 0.75, [at(1.25, 0.5, 1)], offset, points=growth)}
def Xform "Chair" (kind = "component") {{
    {cube("Seat", 0.5, [at(-0.5, 0.25, 1.5), turn], offset)}
    {cube("Back", (0.5, 1.0, 0.25), [at(-0.5, 0.75, 1.25)], offset)}
}}
def PointInstancer "Scatter" {{
    rel prototypes = [</Scatter/Stone>]
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0.25, 0.25, 0.5), (0.5, 0.25, 1.75)]
    {cube("Stone", 0.25, [turn], offset)}
}}
def DomeLight "Sky" {{}}
def SphereLight "Lamp" {{
    float inputs:radius = 0.25
    float inputs:intensity = 30
    {at(1.5, 3, 2)}
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
"""


@pytest.fixture(scope="module")
def stages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("far")
    near, far = (write(folder, prims(each), name=f"{each[0]}.usda", more=RANGE) for each in ((0, 0, 0), FAR))
    return near, far


def frame(path, index, buffers, **others):
    camera = ts.Camera(position=(0.5, 2.0, 5.0), rotation=(0.985, -0.174, 0.0, 0.0))
    options = {"width": 64, "height": 48, "fps": 8.0, "camera": camera, "denoise": False, "buffers": buffers}
    return ts.Stream(path, **options | others)[index]


@pytest.mark.parametrize("index", [0, 3])
def test_labels_and_boxes_are_those_of_the_same_meshes_near_the_origin(stages, index):
    near, far = (frame(path, index, (*LABELS, *MOTION)) for path in stages)
    same = near.instance == far.instance
    assert same.mean() > 0.999
    assert (near.part == far.part)[same].all()
    for name in LABELS[2:] + MOTION:
        np.testing.assert_allclose(far[name][same], near[name][same], atol=2e-4, err_msg=name)
    for one, other in zip(near.objects, far.objects, strict=True):
        assert (one.prim_path, one.parts) == (other.prim_path, other.parts)
        np.testing.assert_allclose(other.world_bounds, one.world_bounds, atol=1e-6)
        np.testing.assert_allclose(other.box_3d.center, one.box_3d.center, atol=1e-6)
        np.testing.assert_allclose(other.box_3d.size, one.box_3d.size, atol=1e-6)
        np.testing.assert_allclose(other.amodal_box, one.amodal_box, atol=1e-3)


def test_poses_of_objects_are_those_of_their_prims(stages):
    stage = Usd.Stage.Open(str(stages[1]))
    paths = {"Floor": "/Floor", "Turning": "/Turning", "Growing": "/Growing", "Chair": "/Chair"}
    for index in (0, 3):
        objects = {each.name: each for each in frame(stages[1], index, ("instance",)).objects}
        for name, path in paths.items():
            world = UsdGeom.Xformable(stage.GetPrimAtPath(path)).ComputeLocalToWorldTransform(index)
            np.testing.assert_allclose(objects[name].world_from_object, np.array(world).T, atol=1e-6)


def test_parts_that_turn_stay_in_place_between_samples(stages):
    near, far = (frame(path, 7, ("instance",), fps=16.0).objects for path in stages)
    for name in ("Chair", "Scatter[0]", "Scatter[1]"):
        np.testing.assert_allclose(far.by_name(name).world_bounds, near.by_name(name).world_bounds, atol=1e-6)


def test_an_override_places_the_origin_of_the_prim(stages):
    near, far = (
        ts.Scenario(
            scene=str(path),
            overrides=[ts.ObjectOverride("/Turned", position=place, rotation=(0.0, 0.0, 0.0))],
        )
        for path, place in zip(
            stages, ((0.5, 1.0, 0.5), (0.5 - FAR[0], 1.0 - 0.5 * FAR[1], 0.5 - 1.5 * FAR[2])), strict=True
        )
    )
    one, other = (frame(each, 0, LABELS).objects.by_name("Turned") for each in (near, far))
    np.testing.assert_allclose(other.world_bounds, one.world_bounds, atol=1e-6)


@pytest.mark.parametrize("meters", [1.0, 0.01])
def test_points_of_all_kinds_are_the_same_in_the_world(tmp_path, meters):
    offset = np.array(FAR) / meters if meters == 1.0 else np.array(FAR)
    near, far = (
        read_stage(write(tmp_path, prims(each), name=f"{number}.usda", more=RANGE, meters=meters))
        for number, each in enumerate((np.zeros(3), offset))
    )
    for one, other in zip(near.instances, far.instances, strict=True):
        assert near.meshes[one.mesh].origin == (0.0, 0.0, 0.0)
        mesh = far.meshes[other.mesh]
        np.testing.assert_allclose(mesh.origin, -meters * offset, rtol=1e-6)
        assert np.abs(mesh.corners()).max() < 10.0
        points = [
            shape.corners() @ each.world_from_object[:3, :3].T + each.world_from_object[:3, 3]
            for shape, each in ((near.meshes[one.mesh], one), (mesh, other))
        ]
        np.testing.assert_allclose(points[1], points[0], atol=1e-6)
    assert any(type(each.deformation) is Deformation for each in far.meshes)
    assert len(near.tracks) == len(far.tracks) > 0


def test_the_picture_is_as_bright_as_near_the_origin(stages):
    means = [[frame(path, 0, ("hdr",), seed=seed, spp=16).hdr.mean() for seed in range(8)] for path in stages]
    near, far = np.array(means, np.float64)
    error = np.sqrt((near.var(ddof=1) + far.var(ddof=1)) / 8.0)
    assert error < 1e-3 * near.mean()
    assert abs(far.mean() - near.mean()) < 4.0 * error


@pytest.mark.parametrize("blend_shapes", [False, True])
def test_a_skin_moves_the_points_as_it_does_near_the_origin(tmp_path, blend_shapes):
    path = author_character(tmp_path / "near.usda", samples=12, blend_shapes=blend_shapes)
    stage = Usd.Stage.Open(str(path))
    offset = Gf.Vec3d(2.0**20, 0.0, -(2.0**19))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Root/Mesh_0"))
    points = np.round(np.array(mesh.GetPointsAttr().Get(), np.float64) * 8.0) / 8.0
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    stage.Save()
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy((points + np.array(offset)).astype(np.float32)))
    bind = UsdSkel.BindingAPI(mesh).GetGeomBindTransformAttr()
    bind.Set(Gf.Matrix4d(1.0).SetTranslate(-offset) * bind.Get())
    mesh.AddTranslateOp(opSuffix="back").Set(-offset)
    stage.Export(str(tmp_path / "far.usda"))
    near, far = (read_stage(each) for each in (path, tmp_path / "far.usda"))
    (one,), (other,) = near.instances, far.instances
    for seconds in (0.0, 0.1, 0.3):
        shapes = [each.meshes[0].deformation.at(seconds)[0].astype(float) for each in (near, far)]
        placed = [
            shape @ each.world_from_object[:3, :3].T + each.world_from_object[:3, 3]
            for shape, each in zip(shapes, (one, other), strict=True)
        ]
        np.testing.assert_allclose(placed[1], placed[0], atol=1e-6)
    assert np.abs(far.meshes[0].corners()).max() < 100.0


def test_a_stage_far_from_the_origin_is_named_with_the_way_back(tmp_path):
    group = f'def Xform "Site"\n{{\n{at(200000, 0, -52428800)}\n'
    group += f'uniform token[] xformOpOrder = ["xformOp:translate"]\n{prims((0, 0, 0))}}}'
    group = group.replace("</Scatter", "</Site/Scatter")
    text = r"all of it lies 524 km or more .* rounded to 31 mm .* translate its root prims by \(-200000, 0, 52428800\)"
    path = write(tmp_path, group, meters=0.01, more=RANGE)
    with pytest.warns(StageWarning, match=text):
        read_stage(path)
    stage = Usd.Stage.Open(str(path))
    UsdGeom.Xformable(stage.GetPrimAtPath("/Site")).GetOrderedXformOps()[0].Set(Gf.Vec3d(0.0))
    stage.Save()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_stage(path)
