# SPDX-License-Identifier: Apache-2.0
"""Conformance: stages as other programs and well-known asset collections write them."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdUtils, UsdValidation

from tests.usd.helpers import QUAD, STAGES, preview_material, read, read_with_warning, write
from tiscene.errors import StageWarning
from tiscene.scene.description import SphereLight, TextureLookup
from tiscene.usd.read.stage_reader import read_stage


def quietly(path, **options):
    """Read a stage that must not give a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return read_stage(path, **options)


def box_of(description, number=0):
    """Return the world bounds of one instance."""
    instance = description.instances[number]
    points = description.meshes[instance.mesh].positions @ instance.world_from_object[:3, :3].T
    points = points + instance.world_from_object[:3, 3]
    return points.min(axis=0).round(5).tolist(), points.max(axis=0).round(5).tolist()


def color_of(description, number=0):
    mesh = description.meshes[description.instances[number].mesh]
    return description.materials[mesh.materials[0]].diffuse_color


def test_kitchen_set_with_payloads_variants_and_instances():
    """Payloads, an inherited class that the set overrides, variants of both kinds, instances, purposes, centimeters."""
    description = quietly(STAGES / "kitchen" / "scene.usda")
    assert description.up_axis == "Z"
    assert [(each.name, each.category, each.parts) for each in description.objects] == [
        ("Chair_1", "Chair", ("Geom/Seat", "Geom/Back")),
        ("Chair_2", "Chair", ("Geom/Seat", "Geom/Back")),
        ("Chair_3", "Chair", ()),
    ]
    # Seats of 50 cm, by the set's class, a tenth as thick, 45 cm above the origin of each chair.
    assert box_of(description, 0) == ([0.75, -0.25, 0.525], [1.25, 0.25, 0.575])
    assert box_of(description, 1) == ([0.78, -0.2, 0.55], [0.82, 0.2, 0.95])
    # A quarter turn to the left: the back, behind along -x, is now behind along -y.
    assert box_of(description, 3) == ([0.8, 1.78, 0.45], [1.2, 1.82, 0.85])
    assert [color_of(description, row) for row in range(5)] == [(0.5, 0.0, 0.0)] * 4 + [(0.0, 0.0, 0.5)]
    assert description.instances[0].mesh == description.instances[2].mesh
    other = quietly(
        STAGES / "kitchen" / "scene.usda",
        variants={"/Kitchen_set/Props_grp/Chair_3": {"modelingVariant": "High", "shadingVariant": "Red"}},
    )
    assert len(other.instances) == 6
    assert color_of(other, 4) == (0.5, 0.0, 0.0)


def test_export_of_blender():
    description = quietly(STAGES / "blender.usda")
    (mesh,), (light,), (camera,) = description.meshes, description.lights, description.cameras
    assert box_of(description) == ([-2.0, -2.0, 1.0], [2.0, 2.0, 1.0])
    left = mesh.positions[mesh.triangles].mean(axis=1)[:, 0] < 0
    names = [description.materials[row].name for row in mesh.materials]
    assert names == ["Paint" if each else "Metal" for each in left]
    # The texture's coordinates, by a name that the material hands down: from 0 to 1 over both faces.
    np.testing.assert_allclose(mesh.uv, mesh.positions[:, :2] * 0.5 + 0.5)
    assert isinstance(description.materials[mesh.materials[left][0]].diffuse_color, TextureLookup)
    assert description.objects[0].parts == ("Plane/Metal", "Plane/Paint")
    # normalize: 318.3099 over the area 4 pi 0.1², so that the lamp's radiance is 2533.03.
    assert isinstance(light, SphereLight)
    assert light.radiance == pytest.approx((2533.03,) * 3, rel=1e-5)
    np.testing.assert_allclose(light.world_from_light[:3, 3], (1, 2, 6))
    # The camera looks along -x, with +z up; 0.5 and 0.2025 are tenths of a meter: 22.9 degrees.
    np.testing.assert_allclose(camera.axes() @ (0, 0, -1), (-1, 0, 0), atol=1e-6)
    np.testing.assert_allclose(camera.axes() @ (0, 1, 0), (0, 0, 1), atol=1e-6)
    assert np.degrees(camera.vertical_fov) == pytest.approx(22.895, abs=1e-3)


def test_model_converted_for_phones():
    description = quietly(STAGES / "phone.usda")
    (mesh,), (look,) = description.meshes, description.materials
    # 1 cm turned about y and made a hundred times as large: a meter along -z, 10 cm up.
    assert box_of(description) == ([0.0, 0.1, -1.0], [0.0, 1.1, 0.0])
    np.testing.assert_allclose(mesh.uv, [(0, 1), (1, 1), (1, 0), (0, 0)])
    turned = (1.0, 0.0, 0.0, 0.0, -1.0, 1.0)
    assert look.diffuse_color == TextureLookup(0, uv_transform=turned)
    assert (look.opacity.channel, look.opacity_threshold) == ("a", 0.5)
    assert (look.metallic.channel, look.metallic.scale[2]) == ("b", 0.25)
    assert (look.roughness.channel, look.roughness.scale[1]) == ("g", 0.5)
    assert look.normal is not None
    assert look.normal.scale[:3] == (2.0, 2.0, 2.0)
    assert look.normal.bias[:3] == (-1.0, -1.0, -1.0)
    assert [(each.encoding, each.wrap_s, each.wrap_t) for each in description.textures] == [
        ("srgb", "mirror", "clamp"),
        ("raw", "repeat", "repeat"),
    ]


@pytest.mark.parametrize("name", ["phone.usda", "blender.usda", "kitchen/scene.usda"])
def test_package_reads_like_its_files(tmp_path, name):
    """As .usdz with textures and payloads inside."""
    package = tmp_path / "packed.usdz"
    assert UsdUtils.CreateNewUsdzPackage(str(STAGES / name), str(package))
    loose, packed = quietly(STAGES / name), quietly(package)
    assert packed.objects == loose.objects
    assert [each.mesh for each in packed.instances] == [each.mesh for each in loose.instances]
    for mine, theirs in zip(packed.meshes, loose.meshes, strict=True):
        np.testing.assert_array_equal(mine.positions, theirs.positions)
    for mine, theirs in zip(packed.textures, loose.textures, strict=True):
        np.testing.assert_array_equal(mine.pixels, theirs.pixels)


def test_exports_of_houdini_and_omniverse():
    """Collection bindings, MaterialX beside UsdPreviewSurface, MDL alone, purposes on transforms, single samples."""
    with pytest.warns(StageWarning) as caught:
        description = read_stage(STAGES / "houdini.usda")
    (warning,) = caught
    lines = str(warning.message).split("\n")[1:]
    assert lines == ["  shader 'OmniPBR' is not supported; displayColor is used: </set/mtl/omni>"]
    (table,) = description.objects
    assert (table.name, table.parts) == ("table", ("render/top", "render/plate"))
    assert color_of(description, 0) == pytest.approx((0.4, 0.2, 0.1))
    assert color_of(description, 1) == pytest.approx((0.1, 0.2, 0.7))
    for number, height in ((0, 0.0), (1, 1.0)):
        assert box_of(description, number) == ([3.0, height, 0.0], [4.0, height, 1.0])
        mesh = description.meshes[description.instances[number].mesh]
        a, b, c = (mesh.positions[mesh.triangles[:, corner]] for corner in range(3))
        assert (np.cross(b - a, c - a)[:, 1] > 0.0).all()  # both face up: one is left-handed, one winds backwards
        assert mesh.deformation is None
    (camera,) = description.cameras
    assert (camera.name, camera.orthographic_height) == ("OmniverseKit_Top", 4.0)


def test_udim_textures_bound_by_face_subsets(tmp_path):
    """As in ALab: UDIM tiles, and a collection that binds materials to all prims."""
    from PIL import Image

    for tile, shade in ((1001, 0), (1002, 255)):
        Image.fromarray(np.full((4, 4, 3), shade, np.uint8)).save(tmp_path / f"wall.{tile}.png")
    body = """
def Xform "asset" (prepend apiSchemas = ["MaterialBindingAPI", "CollectionAPI:mat"]) {
    uniform token collection:mat:expansionRule = "expandPrims"
    rel collection:mat:includes = </asset/geo>
    rel material:binding:collection:mat = [</asset.collection:mat>, </asset/Look>]
    def Scope "geo" {
        def Mesh "wall" {
            uniform token subdivisionScheme = "none"
            int[] faceVertexCounts = [4, 4]
            int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
            point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]
            texCoord2f[] primvars:st = [
                (0.1, 0), (0.9, 0), (1.1, 0), (1.9, 0), (0.9, 1), (0.1, 1), (1.9, 1), (1.1, 1)
            ] (interpolation = "faceVarying")
            int[] primvars:st:indices = [0, 1, 4, 5, 2, 3, 6, 7]
        }
    }
    def Material "Look" {
        token outputs:surface.connect = </asset/Look/S.outputs:surface>
        def Shader "S" {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </asset/Look/T.outputs:rgb>
            token outputs:surface
        }
        def Shader "T" {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @./wall.<UDIM>.png@
            float2 inputs:st.connect = </asset/Look/R.outputs:result>
            float3 outputs:rgb
        }
        def Shader "R" {
            uniform token info:id = "UsdPrimvarReader_float2"
            token inputs:varname = "st"
            float2 outputs:result
        }
    }
}
"""
    import tiscene as ts

    path = write(tmp_path, body)
    camera = ts.Camera(position=(1.0, 0.5, 3.0), orthographic_height=1.0)
    frame = ts.Stream(path, width=40, height=20, buffers=("albedo",), camera=camera)[0]
    np.testing.assert_allclose(frame.albedo[:, :18], 0.0, atol=1e-6)
    np.testing.assert_allclose(frame.albedo[:, 22:], 1.0, atol=1e-6)


ODD = [
    # Read without a warning.
    ("float2[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = \"vertex\")", ""),
    ("texCoord2h[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = \"varying\")", ""),
    ("texCoord2d[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = \"faceVarying\")", ""),
    ("normal3f[] primvars:normals = [(0, 0, 1)] (interpolation = \"constant\")", ""),
    ("point3f[] points.timeSamples = { 7: [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)] }", ""),
    ("point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (9, 9, 9)]", ""),
    ("int[] faceVertexCounts = [4, 4]\n int[] faceVertexIndices = [0, 1, 2, 3, 0, 0, 1, 1]", ""),
    ("uniform token faceVaryingLinearInterpolation = \"all\"", ""),
    ("uniform bool doubleSided = 0", ""),
    ("int[] holeIndices = []\n int[] creaseIndices = []\n vector3f[] velocities = []", ""),
    # Approximated, with a warning.
    ("int[] faceVertexCounts = [4, 2]\n int[] faceVertexIndices = [0, 1, 2, 3, 0, 1]", "faces of fewer than 3 vert"),
    ("texCoord2f[] primvars:st = [(0, 0)] (interpolation = \"vertex\")", "primvars:st: 1 value, but vertex inter"),
    ("color3f[] primvars:displayColor = [(0, 0, 0), (1, 1, 1)] (interpolation = \"vertex\")", "displayColor: 2 values"),
]  # fmt: skip


@pytest.mark.parametrize(("line", "warning"), ODD)
def test_unit_square_is_read_with_unusual_attributes(tmp_path, line, warning):
    """The result is a unit square."""
    names = {each.strip().split(" = ")[0].split(".timeSamples")[0] for each in line.split("\n")}
    kept = "\n".join(each for each in QUAD.split("\n") if each.strip().split(" = ")[0] not in names)
    body = f'def Mesh "M"\n{{\n{kept}\n{line}\n}}'
    description = read_with_warning(tmp_path, body, warning) if warning else read(tmp_path, body)
    assert box_of(description) == ([0.0, 0.0, 0.0], [1.0, 1.0, 0.0])


def test_instanced_prototypes_with_subsets(tmp_path):
    """Each instance has the materials of its subsets, and its own where it has a stronger binding."""
    red = preview_material("/Looks/A", "color3f inputs:diffuseColor = (1, 0, 0)")
    blue = preview_material("/Looks/B", "color3f inputs:diffuseColor = (0, 0, 1)")
    body = f'def Scope "Looks"\n{{\n{red}{blue}}}\n'
    body += """class Xform "Proto" {
    def Mesh "M" {
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
        def GeomSubset "First" (prepend apiSchemas = ["MaterialBindingAPI"]) {
            uniform token familyName = "materialBind"
            int[] indices = [0]
            rel material:binding = </Looks/A>
        }
    }
}
def "One" (
    instanceable = true
    inherits = </Proto>
) {}
def "Two" (
    instanceable = true
    inherits = </Proto>
    prepend apiSchemas = ["MaterialBindingAPI"]
) {
    rel material:binding = </Looks/B> (
        bindMaterialAs = "strongerThanDescendants"
    )
}
"""
    description = read(tmp_path, body)
    looks = [
        [description.materials[row].diffuse_color for row in description.meshes[each.mesh].materials]
        for each in description.instances
    ]
    gray = (0.18, 0.18, 0.18)
    assert looks == [[(1.0, 0.0, 0.0), gray], [(0.0, 0.0, 1.0)] * 2]


def test_stages_of_the_tests_pass_usd_validation():
    """Those that imitate the faults of other programs are left out."""
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    for path in sorted(STAGES.rglob("*.usda")):
        if path.stem in ("broken", "houdini", "phone", "blender"):
            continue
        errors = context.Validate(Usd.Stage.Open(str(path)))
        messages = [f"{Path(path).name}: {error.GetMessage()}" for error in errors]
        assert not messages, messages
