# SPDX-License-Identifier: Apache-2.0
"""Rules that every shipped template and scene obeys, including OpenUSD's validators."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Kind, Usd, UsdGeom, UsdLux, UsdPhysics, UsdSemantics, UsdShade, UsdValidation

import usd_scenes

PACKAGE = Path(usd_scenes.__file__).parent
TEMPLATES = sorted(path.parent.name for path in PACKAGE.glob("templates/*/template.usda"))
SCENES = sorted(path.parent.name for path in PACKAGE.glob("*/scene.usda"))
REQUIRED = """
    chair_01 chair_02 armchair_01 sofa_01 pillow_01 pouf_01 dish_01 bowl_01 cup_01 ewer_01 fork_01 spoon_01 candle_01
    book_01 laptop_01 cellphone_01 remote_controller_01 pen_01 box_01 recycle_bin_02 statue_01 painting_01 lamp_floor_01
    alarm_clock_01 towel_01 toilet_paper_01 soap_01 plunger_01 pot_01 tennis_racket_01 ball_01 teddy_bear_01 plant_01
    cube sphere cylinder capsule cone torus
"""
SIZES = {  # m; of the real objects
    "chair_01": (0.45, 0.90, 0.50),
    "laptop_01": (0.33, 0.22, 0.30),
    "dish_01": (0.27, 0.03, 0.27),
    "pillow_01": (0.45, 0.45, 0.16),
    "tennis_racket_01": (0.26, 0.69, 0.034),
    "cup_01": (0.12, 0.095, 0.085),
    "book_01": (0.15, 0.034, 0.22),
    "chair_02": (0.47, 0.82, 0.50),
    "sofa_01": (1.80, 0.92, 0.97),
    "cellphone_01": (0.073, 0.011, 0.147),
    "pen_01": (0.011, 0.014, 0.142),
    "box_01": (0.41, 0.27, 0.31),
    "recycle_bin_02": (0.276, 0.32, 0.213),
    "lamp_floor_01": (0.55, 1.51, 0.54),
    "toilet_paper_01": (0.131, 0.10, 0.116),
    "soap_01": (0.09, 0.029, 0.058),
    "plunger_01": (0.14, 0.52, 0.14),
    "teddy_bear_01": (0.33, 0.367, 0.265),
    "cube": (0.4, 0.4, 0.4),
    "sphere": (0.4, 0.4, 0.4),
    "cylinder": (0.3, 0.5, 0.3),
}


def open_stage(path: Path) -> Usd.Stage:
    stage = Usd.Stage.Open(str(path))
    assert not stage.GetCompositionErrors()
    return stage


def meshes(stage: Usd.Stage) -> list[UsdGeom.Mesh]:
    prims = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
    return [UsdGeom.Mesh(prim) for prim in prims if prim.IsA(UsdGeom.Mesh)]


def triangles(stage: Usd.Stage) -> int:
    return sum(int((np.asarray(mesh.GetFaceVertexCountsAttr().Get()) - 2).sum()) for mesh in meshes(stage))


def world_bounds(stage: Usd.Stage) -> np.ndarray:
    box = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_], useExtentsHint=False)
    aligned = box.ComputeWorldBound(stage.GetDefaultPrim()).ComputeAlignedRange()
    return np.array([aligned.GetMin(), aligned.GetMax()])


def parts(root: Usd.Prim) -> list[Usd.Prim]:
    """Return the part prims of a template."""
    return [prim for prim in root.GetChildren() if prim.GetName() != "Looks"]


def bound_material(prim: Usd.Prim) -> UsdShade.Material:
    return UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]


STAGES = [PACKAGE / name / "scene.usda" for name in SCENES]
STAGES += [PACKAGE / "templates" / name / "template.usda" for name in TEMPLATES]


@pytest.fixture(scope="module", params=STAGES, ids=lambda path: path.parent.name)
def stage(request: pytest.FixtureRequest) -> Usd.Stage:
    """Each scene and template, not to be changed."""
    return open_stage(request.param)


def test_required_templates_and_scenes_exist() -> None:
    assert {"object_view", "room_02"} <= set(SCENES)
    assert set(REQUIRED.split()) <= set(TEMPLATES)


def test_package_stays_small() -> None:
    files = [path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    assert sum(path.stat().st_size for path in files) < 60e6


def test_stage_is_in_meters_with_y_up(stage: Usd.Stage) -> None:
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y
    assert stage.GetDefaultPrim()


def test_stage_passes_openusd_validators(stage: Usd.Stage) -> None:
    registry = UsdValidation.ValidationRegistry()
    context = UsdValidation.ValidationContext(registry.GetOrLoadAllValidators())
    errors = context.Validate(stage)
    assert [f"{error.GetName()}: {error.GetMessage()}" for error in errors] == []


@pytest.mark.parametrize("name", TEMPLATES)
def test_template_is_one_labeled_component(name: str) -> None:
    stage = open_stage(PACKAGE / "templates" / name / "template.usda")
    root = stage.GetDefaultPrim()
    assert Usd.ModelAPI(root).GetKind() == Kind.Tokens.component
    labels = UsdSemantics.LabelsAPI(root, "class").GetLabelsAttr().Get()
    assert len(labels) == 1
    assert labels[0]
    assert UsdPhysics.RigidBodyAPI(root).GetKinematicEnabledAttr().Get() is True


@pytest.mark.parametrize("name", TEMPLATES)
def test_template_is_centered_with_few_triangles(name: str) -> None:
    stage = open_stage(PACKAGE / "templates" / name / "template.usda")
    low, high = world_bounds(stage)
    np.testing.assert_allclose(low + high, 0.0, atol=5e-5)
    assert 0 < triangles(stage) <= 30_000
    assert all(mesh.GetPrim().HasAPI(UsdPhysics.CollisionAPI) for mesh in meshes(stage))
    if name in SIZES:
        np.testing.assert_allclose(high - low, SIZES[name], rtol=0.12)


@pytest.mark.parametrize("name", TEMPLATES)
def test_template_has_three_colors_and_three_appearances(name: str) -> None:
    stage = open_stage(PACKAGE / "templates" / name / "template.usda")
    root = stage.GetDefaultPrim()
    colors, appearances = (root.GetVariantSet(each) for each in ("color", "appearance"))
    assert set(appearances.GetVariantNames()) == {"photoreal", "untextured", "primitives"}
    assert appearances.GetVariantSelection() == "photoreal"
    seen = set()
    for color in colors.GetVariantNames():
        colors.SetVariantSelection(color)
        seen.add(tuple(str(bound_material(prim).GetPath()) for prim in parts(root)))
    assert len(seen) == len(colors.GetVariantNames()) >= 3


@pytest.mark.parametrize("appearance", ["untextured", "primitives"])
@pytest.mark.parametrize("name", TEMPLATES)
def test_untextured_appearances_have_same_parts_in_plain_colors(name: str, appearance: str) -> None:
    stage = open_stage(PACKAGE / "templates" / name / "template.usda")
    root = stage.GetDefaultPrim()
    detailed, bounds = [prim.GetName() for prim in parts(root)], world_bounds(stage)
    root.GetVariantSet("appearance").SetVariantSelection(appearance)
    assert not stage.GetCompositionErrors()
    assert [prim.GetName() for prim in parts(root)] == detailed
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    assert [f"{error.GetName()}: {error.GetMessage()}" for error in context.Validate(stage)] == []
    gprims = [UsdGeom.Gprim(prim) for prim in Usd.PrimRange(root) if prim.IsA(UsdGeom.Gprim)]
    assert 0 < len(gprims) <= 120
    assert all(gprim.GetPrim().HasAPI(UsdPhysics.CollisionAPI) for gprim in gprims)
    for gprim in gprims:
        surface, _, _ = bound_material(gprim.GetPrim()).ComputeSurfaceSource()
        assert not any(entry.HasConnectedSource() for entry in surface.GetInputs()), gprim.GetPath()
    size = bounds[1] - bounds[0]
    np.testing.assert_allclose(world_bounds(stage), bounds, atol=0.12 * size.max())


def test_every_mesh_is_valid_and_has_a_material(stage: Usd.Stage) -> None:
    for mesh in meshes(stage):
        points = np.asarray(mesh.GetPointsAttr().Get())
        normals = np.asarray(mesh.GetNormalsAttr().Get())
        indices = np.asarray(mesh.GetFaceVertexIndicesAttr().Get())
        st = np.asarray(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get())
        assert np.isfinite(points).all()
        assert np.isfinite(st).all()
        assert len(points) == len(normals) == len(st)
        assert 0 <= indices.min() <= indices.max() < len(points)
        assert len(indices) == np.asarray(mesh.GetFaceVertexCountsAttr().Get()).sum()
        used = np.unique(indices)
        np.testing.assert_allclose(np.linalg.norm(normals[used], axis=1), 1.0, atol=1e-3, err_msg=str(mesh.GetPath()))
        material, _ = UsdShade.MaterialBindingAPI(mesh.GetPrim()).ComputeBoundMaterial()
        assert material, mesh.GetPath()


def test_faces_point_along_their_normals(stage: Usd.Stage) -> None:
    for mesh in meshes(stage):
        points = np.asarray(mesh.GetPointsAttr().Get(), dtype=np.float64)
        normals = np.asarray(mesh.GetNormalsAttr().Get(), dtype=np.float64)
        counts = np.asarray(mesh.GetFaceVertexCountsAttr().Get())
        indices = np.asarray(mesh.GetFaceVertexIndicesAttr().Get())
        first = np.cumsum(counts) - counts
        a, b, c = (points[indices[first + k]] for k in range(3))
        face = np.cross(b - a, c - a)
        mean = sum(normals[indices[first + k]] for k in range(3))
        area = np.linalg.norm(face, axis=1)
        agree = np.einsum("ij,ij->i", face, mean) > 0.0
        assert area[~agree].sum() < 0.01 * area.sum(), mesh.GetPath()


@pytest.mark.parametrize("name", SCENES)
def test_scene_has_cameras_lights_and_labeled_components(name: str) -> None:
    stage = open_stage(PACKAGE / name / "scene.usda")
    prims = list(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    cameras = [UsdGeom.Camera(prim) for prim in prims if prim.IsA(UsdGeom.Camera)]
    assert cameras[0].GetPrim().GetName() == "Main"
    assert all(camera.GetExposureAttr().HasAuthoredValue() for camera in cameras)
    assert any(prim.HasAPI(UsdLux.LightAPI) for prim in prims)
    for mesh in meshes(stage):
        ancestors = [mesh.GetPrim()]
        while ancestors[-1].GetParent():
            ancestors.append(ancestors[-1].GetParent())
        components = [p for p in ancestors if Usd.ModelAPI(p).GetKind() == Kind.Tokens.component]
        assert len(components) == 1, mesh.GetPath()
        assert UsdSemantics.LabelsAPI(components[0], "class").GetLabelsAttr().Get(), mesh.GetPath()
