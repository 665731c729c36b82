# SPDX-License-Identifier: Apache-2.0
"""Import of OBJ, glTF, PLY and STL models as templates."""

from __future__ import annotations

import base64
import json
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from pxr import Usd, UsdPhysics, UsdValidation

from tests.usd.helpers import QUAD, facing, write
from tiscene.errors import ArgumentError, ExportError, MissingFile, StageError, StageWarning
from tiscene.scene.description import TextureLookup
from tiscene.usd.importers.import_template import import_asset
from tiscene.usd.importers.imported_mesh import corner_normals
from tiscene.usd.importers.materials import from_phong
from tiscene.usd.importers.mesh_file import find_file
from tiscene.usd.read.template import read_template

BOX = """
mtllib box.mtl
v 0 0 0
v 2 0 0
v 2 1 0
v 0 1 0
v 0 0 -4
vt 0 0
vt 1 0
vt 1 1
usemtl oak_wood
f 1/1 2/2 3/3
f 1/1 3/3 4/1
usemtl steel
f 1/1 5/2 2/3
"""
MTL = "newmtl oak_wood\nKd 0.5 0.5 0.5\nNs 10\nmap_Kd Maps\\Oak.PNG\nnewmtl steel\nKd 0.8 0.8 0.8\n"


@pytest.fixture
def box(tmp_path):
    (tmp_path / "in" / "maps").mkdir(parents=True)
    (tmp_path / "in" / "box.obj").write_text(BOX)
    (tmp_path / "in" / "box.mtl").write_text(MTL)
    (tmp_path / "in" / "LICENSE.txt").write_text("Do as you like.")
    Image.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "in" / "maps" / "oak.png")
    return tmp_path / "in" / "box.obj"


def assert_valid(path) -> None:
    """Assert that none of USD's validators reports an error."""
    errors = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators()).Validate(
        Usd.Stage.Open(str(path))
    )
    assert not errors, [error.GetMessage() for error in errors]


def test_obj_becomes_a_valid_template(box, tmp_path):
    path = import_asset(box, tmp_path / "out", name="Chair 03", label="chair", author="Ann")
    assert path == tmp_path / "out" / "template.usda"
    assert_valid(path)
    template = read_template(path)
    assert (template.name, template.category) == ("Chair 03", "chair")
    np.testing.assert_allclose(template.description.bounds(), [(-1, -0.5, -2), (1, 0.5, 2)], atol=1e-6)
    looks = {material.name: material for material in template.description.materials}
    assert isinstance(looks["oak_wood"].diffuse_color, TextureLookup)
    assert (looks["oak_wood"].metallic, looks["steel"].metallic) == (0.0, 1.0)
    (image,) = template.description.textures
    assert tuple(image.pixels[0, 0]) == (200, 100, 50, 255)
    stage = Usd.Stage.Open(str(path))
    kept = stage.GetRootLayer().customLayerData["import"]
    assert kept == {"source": "box.obj", "license": "Do as you like.", "author": "Ann"}
    root = stage.GetDefaultPrim()
    assert UsdPhysics.RigidBodyAPI(root).GetKinematicEnabledAttr().Get()
    meshes = [prim for prim in Usd.PrimRange(root, Usd.TraverseInstanceProxies()) if prim.GetTypeName() == "Mesh"]
    assert len(meshes) == 2
    assert all(prim.HasAPI(UsdPhysics.CollisionAPI) for prim in meshes)


def test_physically_based_mtl_values_override_phong(box, tmp_path):
    library = box.parent / "box.mtl"
    lamp = "newmtl lamp metal\nKd 0.5 0.5 0.5\nNs 20\nPr 0.75\nPm 0.25\nKe 4 2 1\n"
    library.write_text(lamp)
    box.write_text("mtllib box.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl lamp metal\nf 1 2 3\n")
    (read,) = read_template(import_asset(box, tmp_path / "out")).description.materials
    assert (read.roughness, read.metallic, read.emissive_color) == (0.75, 0.25, (4.0, 2.0, 1.0))


def test_unit_up_axis_and_origin_arguments(box, tmp_path):
    path = import_asset(box, tmp_path / "out", unit=0.01, up_axis="Z", centered=False)
    bounds = read_template(path).description.bounds()
    np.testing.assert_allclose(bounds, [(0, -0.04, -0.01), (0.02, 0, 0)], atol=1e-7)


def test_stl_is_in_millimeters_and_stands_on_z(tmp_path):
    trimesh.creation.box((1000, 2000, 3000)).export(tmp_path / "a.stl")
    template = read_template(import_asset(tmp_path / "a.stl", tmp_path / "out"))
    np.testing.assert_allclose(np.ptp(template.description.bounds(), axis=0), (1, 3, 2), rtol=1e-6)
    (mesh,) = template.description.meshes
    outward = np.einsum("ij,ij->i", facing(mesh.positions, mesh.triangles), mesh.positions[mesh.triangles].mean(axis=1))
    assert (outward > 0.0).all()
    np.testing.assert_allclose(np.abs(mesh.normals).max(axis=1), 1.0)  # normals of a box are not smoothed


def test_ply_vertex_colors_become_display_color(tmp_path):
    mesh = trimesh.creation.box()
    mesh.visual.vertex_colors = np.tile([255, 0, 0, 255], (8, 1)).astype(np.uint8)
    mesh.export(tmp_path / "a.ply")
    (material,) = read_template(import_asset(tmp_path / "a.ply", tmp_path / "out")).description.materials
    assert material.diffuse_color == (1.0, 0.0, 0.0)


def test_glb_material_and_transform_are_imported(tmp_path):
    image = Image.new("RGBA", (2, 2), (255, 255, 255, 0))
    material = trimesh.visual.material.PBRMaterial(
        name="leaf",
        baseColorTexture=image,
        baseColorFactor=[255, 128, 0, 255],
        metallicFactor=0.25,
        roughnessFactor=0.75,
        emissiveFactor=[0.5, 0, 0],
        alphaMode="MASK",
        alphaCutoff=0.4,
    )
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    mesh = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1, 2]], process=False)
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    scene = trimesh.Scene()
    scene.add_geometry(mesh, transform=trimesh.transformations.translation_matrix((5, 0, 0)))
    scene.export(tmp_path / "a.glb")
    description = read_template(import_asset(tmp_path / "a.glb", tmp_path / "out", centered=False)).description
    np.testing.assert_allclose(description.bounds(), [(5, 0, 0), (6, 1, 0)])
    (read,) = description.materials
    assert (read.metallic, read.roughness, read.emissive_color) == (0.25, 0.75, (0.5, 0.0, 0.0))
    assert read.diffuse_color.scale[:3] == pytest.approx((1.0, 128 / 255, 0.0), abs=1e-3)
    assert (read.opacity.channel, read.opacity_threshold, read.opacity_mode) == (
        "a",
        pytest.approx(0.4),
        "presence",
    )
    (found,) = description.meshes
    np.testing.assert_allclose(found.uv[found.positions[:, 1].argmax()], (1, 1))


def gltf_file(path, **parts):
    """Write a glTF file of one triangle; `parts` add to or replace top-level entries."""
    points = np.eye(3, dtype="<f4").tobytes()
    content = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": len(points)}],
        "buffers": [
            {
                "uri": f"data:application/octet-stream;base64,{base64.b64encode(points).decode()}",
                "byteLength": len(points),
            }
        ],
    }
    path.write_text(json.dumps(content | parts))
    return path


def test_gltf_material_extensions_are_read(tmp_path):
    extensions = {
        "KHR_materials_emissive_strength": {"emissiveStrength": 20.0},
        "KHR_materials_transmission": {"transmissionFactor": 0.75},
        "KHR_materials_ior": {"ior": 1.33},
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.25},
    }
    material = {"name": "Lamp", "emissiveFactor": [1.0, 0.5, 0.25], "extensions": extensions}
    path = gltf_file(tmp_path / "a.gltf", materials=[material], extensionsUsed=[*extensions])
    (read,) = read_template(import_asset(path, tmp_path / "out")).description.materials
    assert read.emissive_color == (20.0, 10.0, 5.0)
    assert (read.opacity, read.opacity_mode, read.ior) == (0.25, "transparent", pytest.approx(1.33))
    assert (read.clearcoat, read.clearcoat_roughness) == (0.5, 0.25)


def test_unsupported_gltf_features_are_reported(tmp_path):
    path = gltf_file(
        tmp_path / "a.gltf",
        materials=[{"name": "Velvet", "extensions": {"KHR_materials_iridescence": {}}}],
        extensionsUsed=["KHR_materials_iridescence"],
        skins=[{"joints": [0]}],
    )
    with pytest.warns(StageWarning, match=r"a\.gltf: not imported: KHR_materials_iridescence$"):
        import_asset(path, tmp_path / "out")
    path = gltf_file(tmp_path / "b.gltf", materials=[{}], extensionsRequired=["EXT_meshopt_compression"])
    with pytest.raises(StageError, match="compressed by EXT_meshopt_compression: export it without"):
        import_asset(path, tmp_path / "out")
    for damaged in ({"extensionsUsed": 3}, {"extensionsRequired": 3, "materials": [3]}, {"materials": 3}):
        with pytest.raises(StageError, match=r"c\.gltf has 1 problem"):
            import_asset(gltf_file(tmp_path / "c.gltf", **{"materials": [{}], **damaged}), tmp_path / "out")


def test_file_of_the_same_case_is_preferred():
    files = dict.fromkeys(["Wood.png", "wood.png", "maps/OAK.png", "maps/oak.png", "oak.png"], b"")
    assert [find_file(name, files) for name in ("wood.png", "WOOD.png", "old/wood.png")] == [
        "wood.png",
        "Wood.png",
        "wood.png",
    ]
    assert find_file("maps\\oak.png", files) == "maps/oak.png"
    assert find_file("birch.png", files) is None


def test_missing_textures_are_reported(box, tmp_path):
    (box.parent / "maps" / "oak.png").unlink()
    with pytest.warns(StageWarning, match=r"box.obj refers to missing files: Maps\\Oak.PNG"):
        path = import_asset(box, tmp_path / "out")
    assert not read_template(path).description.textures


def test_texture_in_a_folder_beside_the_models_is_found(box, tmp_path):
    (tmp_path / "in" / "maps").rename(tmp_path / "maps")
    box.with_suffix(".mtl").write_text(MTL.replace("Maps\\Oak.PNG", "..\\maps\\oak.png"))
    assert read_template(import_asset(box, tmp_path / "out")).description.textures


def test_textures_without_coordinates_are_reported(box, tmp_path):
    box.write_text(re.sub(r"(\d+)/\d+", r"\1", BOX))
    with pytest.warns(StageWarning, match="box.obj: not imported: textures whose coordinates the mesh lacks"):
        path = import_asset(box, tmp_path / "out")
    assert not read_template(path).description.textures


def test_invalid_arguments_and_files_raise(box, tmp_path):
    with pytest.raises(MissingFile, match="no file"):
        import_asset(tmp_path / "gone.obj", tmp_path / "out")
    with pytest.raises(ArgumentError, match=r"files of type .mtl cannot be imported; expected one of .obj"):
        import_asset(box.with_suffix(".mtl"), tmp_path / "out")
    with pytest.raises(ArgumentError, match="unit=0"):
        import_asset(box, tmp_path / "out", unit=0.0)
    with pytest.raises(ArgumentError, match="up_axis='X'"):
        import_asset(box, tmp_path / "out", up_axis="X")
    (tmp_path / "bad.glb").write_bytes(b"garbage")
    with pytest.raises(StageError, match=r"bad\.glb"):
        import_asset(tmp_path / "bad.glb", tmp_path / "out")
    (tmp_path / "empty.obj").write_text("v 0 0 0\n")
    with pytest.raises(StageError, match=r"empty\.obj"):
        import_asset(tmp_path / "empty.obj", tmp_path / "out")
    (tmp_path / "file").write_text("")
    with pytest.raises(ExportError, match="cannot be written"):
        import_asset(box, tmp_path / "file" / "out")
    usd = write(tmp_path, f'def Mesh "A"\n{{{QUAD}}}')
    with pytest.raises(ArgumentError, match="defines its unit and up axis"):
        import_asset(usd, tmp_path / "out", unit=1.0)


def test_corner_normals_are_smooth_below_crease_angle():
    """Faces that meet at 20 degrees share a normal; faces that meet at 90 do not."""
    for degrees, smooth in ((20.0, True), (90.0, False)):
        turn = np.radians(degrees)
        points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -np.cos(turn), -np.sin(turn)]], float)
        normals = corner_normals(points, np.array([[0, 1, 2], [0, 3, 1]]))
        assert np.allclose(normals[0, 0], normals[1, 0]) == smooth
        np.testing.assert_allclose(normals[0, 2], (0, 0, 1), atol=1e-12)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("ChromeLeg", {"metallic": 1.0, "roughness": 0.08}),
        ("chrome_plastic", {"roughness": 0.4}),
        ("Seat_Fabric.002", {"roughness": 0.9}),
        ("mirror", {"metallic": 1.0, "roughness": 0.0}),
        ("window glass", {"opacity": 0.1, "opacityMode": "presence"}),
    ],
)
def test_phong_material_kind_is_guessed_from_name(name, expected):
    inputs = from_phong(name, (0.5, 0.5, 0.5)).inputs
    assert {key: inputs[key] for key in expected} == expected


def test_phong_roughness_follows_shininess_for_unknown_names():
    dull, shiny = (from_phong("x", (1.0, 1.0, 1.0), shininess=s).inputs for s in (1.0, 500.0))
    assert dull["roughness"] > 0.8 > 0.3 > shiny["roughness"]
    assert dull["diffuseColor"] == (0.85, 0.85, 0.85)


def test_unlistable_folders_beside_model_are_ignored(box, tmp_path, monkeypatch):
    """Such as private folders in a shared temporary folder."""
    (box.parent / "private").mkdir()
    listed = Path.iterdir

    def iterdir(folder):
        if folder.name == "private":
            raise PermissionError(13, "Permission denied", str(folder))
        return listed(folder)

    monkeypatch.setattr(Path, "iterdir", iterdir)
    (image,) = read_template(import_asset(box, tmp_path / "out")).description.textures
    assert tuple(image.pixels[0, 0]) == (200, 100, 50, 255)


def test_template_source_can_be_imported_into_same_template(tmp_path):
    """A failed import leaves the previous template as it was."""
    quad = f'def Mesh "Quad"\n{{{QUAD}}}'
    out = tmp_path / "out"
    import_asset(write(tmp_path, quad, name="quad.usda", more='defaultPrim = "Quad"'), out)
    copy = out / "source" / "quad.usda"
    path = import_asset(copy, out, name="Again")
    assert len(read_template(path).description.meshes) == 1
    assert copy.is_file()
    broken = write(tmp_path, 'def "A" (references = @gone.usda@</A>)\n{\n}', name="b.usda", more='defaultPrim = "A"')
    with pytest.raises(StageError):
        import_asset(broken, out)
    assert read_template(path).name == "Again"
    assert sorted(each.name for each in out.iterdir()) == ["source", "template.usda"]


@pytest.mark.parametrize("blocked", ["template.usda", "geometry.usdc", "textures"])
def test_unwritable_template_raises_export_error(box, tmp_path, blocked):
    (tmp_path / "out").mkdir()
    if blocked == "textures":
        (tmp_path / "out" / blocked).write_text("a file where the folder should be")
    else:
        (tmp_path / "out" / blocked).mkdir()
    with pytest.raises(ExportError, match="out cannot be written"):
        import_asset(box, tmp_path / "out")


def test_complete_model_is_imported_without_warning(box, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        import_asset(box, tmp_path / "out")
