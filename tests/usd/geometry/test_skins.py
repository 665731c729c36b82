# SPDX-License-Identifier: Apache-2.0
"""Skins evaluated on demand: against USD's own baking, sharing, bounds, and reading in another process."""

from __future__ import annotations

import pickle
import warnings

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

import tiscene as ts
from tests.usd.characters import author_character
from tests.usd.helpers import write
from tiscene.errors import StageWarning
from tiscene.scene import skinned_deformation
from tiscene.scene.skinned_deformation import SkinnedDeformation
from tiscene.usd.core.transform import to_matrix
from tiscene.usd.geometry.catmull_clark import Cage, limit, refine
from tiscene.usd.geometry.subdivision_maps import limit_map, refine_map
from tiscene.usd.read.stage_reader import read_stage

CUBE = [0, 1, 3, 2, 2, 3, 5, 4, 4, 5, 7, 6, 6, 7, 1, 0, 1, 7, 5, 3, 6, 0, 2, 4]


@pytest.mark.parametrize("case", ["smooth", "creases", "corner", "open", "fading"])
def test_maps_equal_refinement_and_limit(case):
    random = np.random.default_rng(3)
    edges, points, faces = np.zeros(24), np.zeros(9), 6  # the last point belongs to no face
    if case == "creases":
        edges[:4], edges[5] = 1.5, np.inf
    elif case == "corner":
        points[2] = 0.4
    elif case == "open":
        faces = 5
    elif case == "fading":
        edges[3], edges[7], edges[11] = 0.3, 2.2, 0.7
    cage = Cage(np.full(faces, 4), np.array(CUBE[: 4 * faces]), edges[: 4 * faces], points)
    values = random.normal(size=(9, 3))
    for _ in range(3):
        mapped = refine_map(cage).applied(values)
        cage, values = refine(cage, values)
        np.testing.assert_allclose(mapped, values, atol=1e-12)
    np.testing.assert_allclose(limit_map(cage).applied(values), limit(cage, values), atol=1e-12)


@pytest.mark.parametrize(
    "options", [{}, {"normals": True}, {"blend_shapes": True}, {"normals": True, "blend_shapes": True}]
)
def test_vertices_equal_those_that_usd_bakes(tmp_path, options):
    path = author_character(tmp_path / "character.usda", samples=8, **options)
    (mesh,) = read_stage(path).meshes
    assert isinstance(mesh.deformation, SkinnedDeformation)
    stage = Usd.Stage.Open(str(path))
    session = stage.GetSessionLayer()
    session.timeCodesPerSecond = 24
    with Usd.EditContext(stage, session):
        rotations = stage.GetPrimAtPath("/Root/Skeleton/Animation").GetAttribute("rotations")
        for time, value in [(time, rotations.Get(time)) for time in range(8)]:
            rotations.Set(value, time)
        UsdSkel.BakeSkinning(UsdSkel.Root.Get(stage, "/Root"), Gf.Interval.GetFullInterval())
    baked = UsdGeom.Mesh.Get(stage, "/Root/Mesh_0")
    for row in range(8):
        positions, normals = mesh.deformation.sample(row)
        points = np.asarray(baked.GetPointsAttr().Get(row)) * np.float32(0.01)
        np.testing.assert_allclose(positions, points, atol=1e-6)
        if "normals" in options:
            expected = np.asarray(baked.GetNormalsAttr().Get(row))
            expected = expected / np.linalg.norm(expected, axis=1, keepdims=True)
            np.testing.assert_allclose(normals, expected, atol=1e-6)
        else:
            assert normals is None


@pytest.mark.parametrize("method", ["classicLinear", "dualQuaternion"])
def test_skin_with_a_transform_out_of_range_is_named(tmp_path, method):
    """Of a pair of meshes, one of which has a scale of 0 that USD inverts to numbers beyond single precision."""
    path = author_character(tmp_path / "character.usda", samples=2, meshes=2)
    stage = Usd.Stage.Open(str(path))
    mesh = stage.GetPrimAtPath("/Root/Mesh_0")
    UsdSkel.BindingAPI(mesh).CreateSkinningMethodAttr(method)
    UsdGeom.XformCommonAPI(mesh).SetScale((0.0, 1.0, 1.0))
    stage.Save()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        description = read_stage(path)
    assert [each.category for each in caught] == [StageWarning]
    assert "</Root/Mesh_0> skinning: its transform holds numbers above 1e+18" in str(caught[0].message)
    assert [each.name for each in description.objects] == ["Mesh_1"]


@pytest.mark.parametrize("case", ["uneven", "rigid", "dual quaternions"])
def test_places_of_vertices_equal_those_that_usd_bakes(tmp_path, case, monkeypatch):
    """Weights that do not sum to 1, and blend shapes of meshes that are not skinned point by point."""
    monkeypatch.setattr(skinned_deformation, "_FEW_POINTS", 0)
    path = author_character(tmp_path / "character.usda", samples=4, spacing=1, blend_shapes=True)
    stage = Usd.Stage.Open(str(path))
    binding = UsdSkel.BindingAPI(stage.GetPrimAtPath("/Root/Mesh_0"))
    if case == "uneven":
        weights = np.asarray(binding.GetJointWeightsPrimvar().Get())
        scaled = weights * np.linspace(0.8, 1.2, len(weights), dtype=np.float32)
        binding.GetJointWeightsPrimvar().Set(Vt.FloatArray.FromNumpy(scaled))
    elif case == "rigid":
        binding.CreateJointIndicesPrimvar(True, 2).Set([3, 7])
        binding.CreateJointWeightsPrimvar(True, 2).Set([0.6, 0.4])
    else:
        binding.CreateSkinningMethodAttr("dualQuaternion")
    stage.Save()
    described = read_stage(path)
    (mesh,), (instance,) = described.meshes, described.instances
    UsdSkel.BakeSkinning(UsdSkel.Root.Get(stage, "/Root"), Gf.Interval.GetFullInterval())
    baked = UsdGeom.Mesh.Get(stage, "/Root/Mesh_0")
    low, high = mesh.corners().min(axis=0), mesh.corners().max(axis=0)
    for row in range(4):
        matrix = to_matrix(UsdGeom.XformCache(row).GetLocalToWorldTransform(baked.GetPrim()), 0.01)
        points = np.asarray(baked.GetPointsAttr().Get(row)) * 0.01
        positions, _ = mesh.deformation.at(row / 24.0)
        np.testing.assert_allclose(placed(instance.world_from_object, positions), placed(matrix, points), atol=2e-6)
        assert (positions >= low - 1e-6).all()
        assert (positions <= high + 1e-6).all()


def placed(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def test_subdivided_skin_equals_the_stage_read_at_that_time(tmp_path):
    """Reading at one time code subdivides the posed cage; playing maps the cage's points by sparse matrices."""
    path = author_character(tmp_path / "character.usda", samples=8, scheme="catmullClark", blend_shapes=True)
    (mesh,) = read_stage(path).meshes
    for row in (0, 3, 7):
        (still,) = read_stage(path, time_code=float(row)).meshes
        positions, normals = mesh.deformation.sample(row)
        assert still.deformation is None
        np.testing.assert_array_equal(still.triangles, mesh.triangles)
        np.testing.assert_allclose(positions, still.positions, atol=1e-6)
        np.testing.assert_allclose(normals, still.normals, atol=1e-5)


@pytest.mark.parametrize("few", [0, 1 << 18])
@pytest.mark.parametrize("scheme", ["none", "catmullClark"])
def test_corners_hold_all_samples(tmp_path, scheme, few, monkeypatch):
    monkeypatch.setattr(skinned_deformation, "_FEW_POINTS", few)
    path = author_character(tmp_path / "character.usda", samples=8, scheme=scheme, blend_shapes=True)
    (mesh,) = read_stage(path).meshes
    low, high = mesh.corners().min(axis=0), mesh.corners().max(axis=0)
    for row in range(8):
        positions, _ = mesh.deformation.sample(row)
        assert (positions >= low - 1e-6).all()
        assert (positions <= high + 1e-6).all()
    assert (high - low).max() < 4.0  # a chain of 1.1 m that bends everywhere
    if few and scheme == "none":
        samples = [mesh.deformation.sample(row)[0] for row in range(8)]
        np.testing.assert_allclose(high - low, np.ptp(np.concatenate(samples), axis=0), rtol=1e-6)


def test_vertices_between_samples_are_interpolated_linearly(tmp_path):
    (mesh,) = read_stage(author_character(tmp_path / "character.usda", samples=4)).meshes
    before, after = (mesh.deformation.sample(row)[0] for row in (1, 2))
    found, _ = mesh.deformation.at(1.25 / 24.0)
    np.testing.assert_allclose(found, 0.75 * before + 0.25 * after, atol=1e-6)


def test_instances_of_one_animation_share_one_skin(tmp_path):
    path = author_character(tmp_path / "character.usda", samples=4)
    one = 'def "C%d" (\n instanceable = true\n references = @character.usda@\n)\n{\n%s}\n'
    place = 'double3 xformOp:translate = (%d, 0, 0)\nuniform token[] xformOpOrder = ["xformOp:translate"]\n'
    body = "".join(one % (number, place % number) for number in range(5))
    more = "startTimeCode = 0\n endTimeCode = 3\n timeCodesPerSecond = 24"
    crowd = read_stage(write(tmp_path, body, meters=0.01, more=more))
    assert (len(crowd.meshes), len(crowd.instances), len(crowd.objects)) == (1, 5, 5)
    plain = read_stage(write(tmp_path, body.replace(" instanceable = true\n", ""), meters=0.01, more=more))
    assert (len(plain.meshes), len(plain.instances)) == (1, 5)
    (alone,) = read_stage(path).meshes
    np.testing.assert_array_equal(crowd.meshes[0].deformation.sample(2)[0], alone.deformation.sample(2)[0])


def test_skins_are_read_in_another_process(tmp_path):
    path = author_character(tmp_path / "character.usda", samples=4, meshes=2)
    here, there = read_stage(path), read_stage(path, isolate=True)
    for a, b in zip(here.meshes, there.meshes, strict=True):
        assert a.deformation.sample(3)[0].tobytes() == b.deformation.sample(3)[0].tobytes()
    first, second = (mesh.deformation.skin for mesh in there.meshes)
    assert first.poses is second.poses
    assert pickle.loads(pickle.dumps(here.meshes[0])).deformation.sample(1)[0].tobytes() == (
        here.meshes[0].deformation.sample(1)[0].tobytes()
    )


def test_few_shapes_are_kept(tmp_path):
    (mesh,) = read_stage(author_character(tmp_path / "character.usda", samples=30)).meshes
    for row in range(30):
        mesh.deformation.sample(row)
    assert len(vars(mesh.deformation)["_known"]) == 3
    assert mesh.deformation.positions.size == 0


def test_joint_indices_that_do_not_match_are_named(tmp_path):
    path = author_character(tmp_path / "character.usda", samples=4)
    text = path.read_text().replace("int[] primvars:skel:jointIndices = [0", "int[] primvars:skel:jointIndices = [99")
    path.write_text(text)
    with pytest.warns(match="</Root/Mesh_0> skinning: its joint indices and weights do not match"):
        (mesh,) = read_stage(path).meshes
    assert mesh.deformation is None


def test_dual_quaternions_and_rigid_prims_are_baked(tmp_path):
    path = author_character(tmp_path / "character.usda", samples=4)
    stage = Usd.Stage.Open(str(path))
    UsdSkel.BindingAPI(stage.GetPrimAtPath("/Root/Mesh_0")).CreateSkinningMethodAttr("dualQuaternion")
    ball = UsdGeom.Sphere.Define(stage, "/Root/Ball")
    binding = UsdSkel.BindingAPI.Apply(ball.GetPrim())
    binding.CreateJointIndicesPrimvar(True, 1).Set([11])
    binding.CreateJointWeightsPrimvar(True, 1).Set([1.0])
    stage.Save()
    described = read_stage(path)
    tube = described.meshes[0]
    assert tube.deformation.positions.shape[0] == 4
    (track,) = described.tracks
    assert described.meshes[described.instances[track.instances[0]].mesh].name == "Ball"
    cache = UsdSkel.Cache()
    cache.Populate(UsdSkel.Root.Get(stage, "/Root"), Usd.PrimDefaultPredicate)
    tip = cache.GetSkelQuery(UsdSkel.Skeleton.Get(stage, "/Root/Skeleton")).ComputeSkinningTransforms(3)[11]
    np.testing.assert_allclose(track.matrices[3, 0, :, 3], 0.01 * np.array(tip.ExtractTranslation()), atol=1e-6)


def test_rigid_prim_of_a_moving_root_follows_its_joint(tmp_path):
    """The scenario has not animated it by the transform that it has without its skeleton."""
    path = author_character(tmp_path / "character.usda", samples=4)
    stage = Usd.Stage.Open(str(path))
    walk = UsdSkel.Root.Get(stage, "/Root").AddTranslateOp()
    walk.Set((0, 0, 0), 0)
    walk.Set((300, 0, 0), 3)
    ball = UsdGeom.Sphere.Define(stage, "/Root/Ball")
    binding = UsdSkel.BindingAPI.Apply(ball.GetPrim())
    binding.CreateJointIndicesPrimvar(True, 1).Set([11])
    binding.CreateJointWeightsPrimvar(True, 1).Set([1.0])
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1).SetTranslate(Gf.Vec3d(0, 110, 0)))
    stage.Save()
    stream = ts.Stream(path, fps=24, width=8, height=6, buffers=("instance",), camera=ts.Camera((0, 0, 9)))
    assert [each.id for each in stream.scenario.objects] == ["Mesh_0"]
    UsdSkel.BakeSkinning(UsdSkel.Root.Get(stage, "/Root"), Gf.Interval.GetFullInterval())
    for frame in (0, 3):
        world = UsdGeom.XformCache(frame).GetLocalToWorldTransform(ball.GetPrim())
        (position,) = (each.position for each in stream.world.state(frame).objects if each.name == "Ball")
        np.testing.assert_allclose(position, 0.01 * np.array(world.ExtractTranslation()), atol=1e-6)
