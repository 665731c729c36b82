# SPDX-License-Identifier: Apache-2.0
"""Inputs of MaterialX surface models that UsdPreviewSurface lacks, as extended lobes; numbers derived by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from PIL import Image

from tests.render.path_scenes import render
from tests.usd.helpers import write
from tests.usd.materials.test_materialx import (
    PIXELS,
    QUAD,
    REFERENCE,
    document,
    given,
    linked,
    material_of,
    picture,
    rounded,
    stage_of,
    warned_material,
)
from tiscene.errors import StageWarning
from tiscene.scene.camera import Camera
from tiscene.scene.description import ExtendedLobes, TextureLookup
from tiscene.usd.read.stage_reader import read_stage

COLOR = "0.5, 0.25, 1"


def lobes_of(folder, surface: str, model: str = "standard_surface", nodes: str = "") -> ExtendedLobes | None:
    """Return the lobes, rounded to the precision of the files."""
    found = material_of(folder, document(surface, model, nodes)).lobes
    return None if found is None else rounded(found)


@pytest.mark.parametrize(
    ("model", "surface"),
    [
        ("standard_surface", given("sheen", "0") + given("thin_walled", "true", "boolean")),
        ("standard_surface", given("transmission_color", COLOR, "color3") + given("specular_rotation", "0.3")),
        ("standard_surface", given("coat_color", COLOR, "color3") + given("transmission", "0.5")),
        ("standard_surface", given("coat_color", "1, 1, 1", "color3") + given("coat", "0.5")),
        ("open_pbr_surface", given("coat_ior", "2") + given("coat_color", COLOR, "color3")),
        ("open_pbr_surface", given("fuzz_color", COLOR, "color3") + given("transmission_depth", "2")),
        ("gltf_pbr", given("attenuation_color", COLOR, "color3") + given("thickness", "2")),
    ],
)  # fmt: skip
def test_inputs_without_effect_add_no_lobes(tmp_path, model, surface):
    assert lobes_of(tmp_path, surface, model) is None


@pytest.mark.parametrize(("model", "factor"), [("open_pbr_surface", 0.25), ("standard_surface", 1.0)])
def test_specular_weight_of_openpbr_scales_metal(tmp_path, model, factor):
    """As in MaterialX's graphs: the weight of OpenPBR's metal, and of no metal of standard_surface."""
    names = {"open_pbr_surface": ("base_metalness", "specular_weight"), "standard_surface": ("metalness", "specular")}
    surface = given("base_color", COLOR, "color3") + given(names[model][0], "1") + given(names[model][1], "0.25")
    if model == "standard_surface":
        surface += given("base", "1")
    material = material_of(tmp_path, document(surface, model))
    assert material.diffuse_color == pytest.approx((0.5 * factor, 0.25 * factor, factor))


def test_sheen_and_coat_color(tmp_path):
    surface = given("sheen", "0.5") + given("sheen_color", COLOR, "color3") + given("coat_color", "1, 0, 0", "color3")
    surface += given("coat", "0.5")
    expected = ExtendedLobes(sheen_color=(0.25, 0.125, 0.5), sheen_roughness=0.3, coat_color=(1.0, 0.0, 0.0))
    assert lobes_of(tmp_path, surface) == expected
    fuzz = given("fuzz_weight", "1") + given("fuzz_color", COLOR, "color3")
    assert lobes_of(tmp_path, fuzz, "open_pbr_surface") == ExtendedLobes(
        sheen_color=(0.5, 0.25, 1.0), sheen_roughness=0.5
    )
    cloth = given("sheen_color", COLOR, "color3") + given("sheen_roughness", "0.5")
    assert lobes_of(tmp_path, cloth, "gltf_pbr") == ExtendedLobes(sheen_color=(0.5, 0.25, 1.0), sheen_roughness=0.25)


def test_coats_reflect_by_their_index_of_refraction(tmp_path):
    varnish = given("coat", "1") + given("coat_IOR", "2")
    assert lobes_of(tmp_path, varnish) == ExtendedLobes(coat_ior=2.0)
    bright = given("coat_weight", "1") + given("coat_darkening", "0")
    assert lobes_of(tmp_path, bright, "open_pbr_surface") == ExtendedLobes(coat_ior=1.6)


@pytest.mark.parametrize(
    ("model", "coat", "emission", "f0"),
    [
        ("standard_surface", "coat", "emission", 0.04),
        ("open_pbr_surface", "coat_weight", "emission_luminance", 0.053254),
    ],
)
@pytest.mark.parametrize("weight", [1.0, 0.5])
def test_coats_tint_and_reflect_back_what_is_emitted_below(tmp_path, model, coat, emission, f0, weight):
    surface = given(emission, "2") + given(coat, str(weight)) + given("coat_color", COLOR, "color3")
    material = material_of(tmp_path, document(surface, model))
    expected = [2.0 * (1.0 + weight * ((1.0 - f0) * each - 1.0)) for each in (0.5, 0.25, 1.0)]
    assert material.emissive_color == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("surface", "reflectance"),
    [
        (given("base_color", "0.8, 0.5, 0", "color3"), (0.8, 0.5, 0.0)),
        (given("base_color", "1, 1, 1", "color3") + given("base_weight", "0.5"), (0.5, 0.5, 0.5)),
        (given("base_metalness", "1") + given("specular_weight", "0.5"), (0.4, 0.4, 0.4)),
    ],
)
@pytest.mark.parametrize(("weight", "strength", "color"), [(1.0, 1.0, 1.0), (0.5, 0.5, 0.5)])
def test_light_reflected_inside_of_a_coat_darkens_the_base(tmp_path, surface, reflectance, weight, strength, color):
    """At an index of 1.5, 0.96 / 2.25 of the base's light passes the coat from inside, and the rest returns."""
    coat = given("coat_weight", str(weight)) + given("coat_darkening", str(strength)) + given("coat_ior", "1.5")
    coat += given("coat_color", f"{color}, {color}, {color}", "color3")
    lobes = lobes_of(tmp_path, surface + coat, "open_pbr_surface")
    for found, base in zip(lobes.coat_color, reflectance, strict=True):
        passes = 0.96 / 2.25
        darker = passes / (1.0 - base * (1.0 - passes))
        expected = (1.0 + weight * strength * (darker - 1.0)) * (1.0 + weight * (color - 1.0))
        assert 1.0 + weight * (found - 1.0) == pytest.approx(expected, abs=1e-5)


def test_light_scattered_below_the_surface_counts_for_the_darkening(tmp_path):
    skin = given("subsurface_weight", "0.5") + given("subsurface_color", "0.2, 0.2, 0.2", "color3")
    coat = given("coat_weight", "1") + given("coat_ior", "1.5")
    material = warned_material(tmp_path, document(skin + coat, "open_pbr_surface"), "subsurface scattering")
    passes = 0.96 / 2.25
    assert material.lobes.coat_color == pytest.approx((passes / (1.0 - 0.5 * (1.0 - passes)),) * 3)


def test_darkening_of_a_textured_base_is_computed_per_texel(tmp_path):
    Image.fromarray(PIXELS).save(tmp_path / "p.png")
    surface = given("coat_weight", "1") + linked("base_color", "picture")
    lobes = lobes_of(tmp_path, surface, "open_pbr_surface", picture())
    assert isinstance(lobes.coat_color, TextureLookup)


def test_base_below_an_openpbr_coat_reflects_by_its_relative_index(tmp_path):
    for coat, expected in (("0", 1.5), ("0.5", 0.5 * (1.5 + 1.6 / 1.5)), ("1", 1.6 / 1.5)):
        surface = document(given("coat_weight", coat), "open_pbr_surface")
        assert material_of(tmp_path, surface).ior == pytest.approx(expected)
    glass = given("coat_weight", "1") + given("transmission_weight", "1")
    assert material_of(tmp_path, document(glass, "open_pbr_surface")).ior == pytest.approx(1.5)
    unreal = given("coat_weight", "1") + given("specular_ior", "0")
    assert material_of(tmp_path, document(unreal, "open_pbr_surface")).ior == 0.0


@pytest.mark.parametrize("model", ["standard_surface", "open_pbr_surface"])
def test_transmission_color_tints_boundaries_without_a_depth(tmp_path, model):
    weight = "transmission" if model == "standard_surface" else "transmission_weight"
    surface = given(weight, "1") + given("transmission_color", COLOR, "color3")
    assert lobes_of(tmp_path, surface, model) == ExtendedLobes(transmission_color=(0.5, 0.25, 1.0))


@pytest.mark.parametrize(
    "depth", ['value="2"', 'value="20" unit="millimeter" unittype="distance"', 'value="2" unit="centimeter"']
)
def test_transmission_depth_gives_absorption_in_meters(tmp_path, depth):
    """The color remains at a depth of 2 units of 1 cm: coefficients are -ln(color) / 0.02 m."""
    surface = given("transmission", "1") + given("transmission_color", COLOR, "color3")
    surface += f'<input name="transmission_depth" type="float" {depth}/>'
    (tmp_path / "doc.mtlx").write_text(document(surface))
    body = 'def Scope "Looks" (references = @./doc.mtlx@</MaterialX/Materials>)\n{\n}\n' + QUAD
    lobes = read_stage(write(tmp_path, body, meters=0.01)).materials[0].lobes
    assert lobes is not None
    assert lobes.absorption == pytest.approx((math.log(2.0) / 0.02, math.log(4.0) / 0.02, 0.0), rel=1e-6)
    assert lobes.transmission_color == (1.0, 1.0, 1.0)


def test_gltf_volume_and_sheet(tmp_path):
    """Without a thickness the surface is a sheet; the base color tints each crossing."""
    clear = given("transmission", "1") + given("metallic", "0")
    colored = clear + given("base_color", COLOR, "color3")
    sheet = ExtendedLobes(transmission_color=(0.5, 0.25, 1.0), thin_walled=True)
    assert lobes_of(tmp_path, colored, "gltf_pbr") == sheet
    volume = (
        given("thickness", "1") + given("attenuation_distance", "0.5") + given("attenuation_color", COLOR, "color3")
    )
    expected = (round(math.log(2.0) / 0.5, 6), round(math.log(4.0) / 0.5, 6), 0.0)
    assert lobes_of(tmp_path, clear + volume, "gltf_pbr") == ExtendedLobes(absorption=expected)


def test_transmission_from_a_texture(tmp_path):
    surface = linked("transmission", "picture", "float") + given("thin_walled", "true", "boolean")
    material = material_of(tmp_path, document(surface, nodes=picture("float")))
    assert material.opacity_mode == "transmission"
    assert isinstance(material.opacity, TextureLookup)
    assert (material.opacity.scale[0], material.opacity.bias[0]) == (-1.0, 1.0)
    assert material.lobes == ExtendedLobes(thin_walled=True)
    assert material.lobes.thin_walled is True  # no number of NumPy, which the reading process may not return


@pytest.mark.parametrize(
    ("model", "surface", "alphas"),
    [
        # standard_surface: r² over and times the root of 1 - a.
        ("standard_surface", given("specular_anisotropy", "0.75"), (0.18, 0.045)),
        # OpenPBR: r² times the root of 2 / (1 + (1 - a)²), and that times 1 - a.
        ("open_pbr_surface", given("specular_roughness_anisotropy", "0.75"), (0.123479, 0.030870)),
        # glTF: r² mixed with 1 by a², and r².
        ("gltf_pbr", given("anisotropy_strength", "0.5") + given("anisotropy_rotation", "3.14159265"), (0.3175, 0.09)),
    ],
)
def test_anisotropy_of_each_model_becomes_that_of_openpbr(tmp_path, model, surface, alphas):
    roughness = given("roughness" if model == "gltf_pbr" else "specular_roughness", "0.3")
    material = material_of(tmp_path, document(surface + roughness, model))
    assert material.lobes is not None
    aspect = 1.0 - material.lobes.anisotropy
    along = material.roughness**2 * math.sqrt(2.0 / (1.0 + aspect**2))
    assert (along, aspect * along) == pytest.approx(alphas, rel=1e-4)
    assert material.lobes.rotation == pytest.approx(0.5 if model == "gltf_pbr" else 0.0)


def test_textured_anisotropy_and_roughness_are_computed_per_texel(tmp_path):
    surface = linked("specular_anisotropy", "picture", "float") + given("specular_roughness", "0.5")
    description = stage_of(tmp_path, document(surface, nodes=picture("float")))
    material = description.materials[0]
    assert material.lobes is not None
    assert isinstance(material.lobes.anisotropy, TextureLookup)
    assert isinstance(material.roughness, TextureLookup)
    image = description.textures[material.roughness.texture].pixels[..., 0] / 255.0
    strengths = [[0, 255], [8, 128]]
    for row in range(2):
        for column in range(2):
            q = 1.0 - min(strengths[row][column] / 255.0, 0.98)
            along = min(0.25 / math.sqrt(q), 1.0)
            mean = (0.5 * (along**2 + (0.25 * math.sqrt(q)) ** 2)) ** 0.25
            assert image[row, column] == pytest.approx(mean, abs=3e-3)


@pytest.mark.parametrize("coordinates", [True, False])
def test_anisotropy_of_a_mesh_without_texture_coordinates_is_named(tmp_path, coordinates):
    (tmp_path / "doc.mtlx").write_text(document(given("specular_anisotropy", "0.5")))
    lines = [line for line in REFERENCE.splitlines() if coordinates or "texCoord2f" not in line]
    path = write(tmp_path, "\n".join(lines))
    if coordinates:
        assert read_stage(path).materials[0].lobes is not None  # warnings are errors
    else:
        with pytest.warns(StageWarning, match="no texture coordinates; its direction differs between triangles: </M>"):
            read_stage(path)


def test_specular_color_tints_dielectrics_and_is_named_for_metal(tmp_path):
    surface = given("specular_color", COLOR, "color3")
    assert lobes_of(tmp_path, surface) == ExtendedLobes(specular_tint=(0.5, 0.25, 1.0))
    text = "specular_color is not applied to metal"
    assert warned_material(tmp_path, document(surface + given("metalness", "1")), text).lobes is None


def test_subsurface_of_a_sheet_is_translucency(tmp_path):
    """standard_surface transmits the fraction; OpenPBR half of it, and reflects the other half."""
    thin = given("thin_walled", "true", "boolean")
    common = given("subsurface", "0.4") + given("subsurface_color", COLOR, "color3")
    expected = ExtendedLobes(translucency=0.4, translucent_color=(0.5, 0.25, 1.0))
    assert lobes_of(tmp_path, common + thin) == expected
    leaf = (
        given("subsurface_weight", "1") + given("subsurface_color", COLOR, "color3")
        + given("geometry_thin_walled", "true", "boolean")
    )  # fmt: skip
    material = rounded(material_of(tmp_path, document(leaf, "open_pbr_surface")))
    assert material.lobes == replace(expected, translucency=0.5)
    assert material.diffuse_color == (0.5, 0.25, 1.0)


def test_tangents_that_are_connected_are_named(tmp_path):
    surface = given("specular_anisotropy", "0.5") + linked("tangent", "picture", "vector3")
    text = "tangent is not applied; the direction of u is used"
    assert warned_material(tmp_path, document(surface, nodes=picture("vector3")), text).lobes is not None


def test_tangents_and_coat_normals_without_effect_are_not_named(tmp_path):
    surface = linked("tangent", "picture", "vector3") + linked("coat_normal", "picture", "vector3")
    assert material_of(tmp_path, document(surface, nodes=picture("vector3"))).lobes is None


PREVIEW = """def Scope "Looks"
{
    def Material "Mat"
    {
        token outputs:surface.connect = </Looks/Mat/S.outputs:surface>
        def Shader "S"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </Looks/Mat/T.outputs:rgb>
            float inputs:roughness = 0.4
            float inputs:clearcoat = 0.5
            float inputs:clearcoatRoughness = 0.1
            token outputs:surface
        }
        def Shader "T"
        {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @p.png@
            token inputs:sourceColorSpace = "sRGB"
            token inputs:wrapS = "repeat"
            token inputs:wrapT = "repeat"
            float2 inputs:st.connect = </Looks/Mat/R.outputs:result>
            float3 outputs:rgb
        }
        def Shader "R"
        {
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }
    }
}
"""
LIGHT = 'def DomeLight "Sky"\n{\nfloat inputs:intensity = 1\n}\n'


def test_same_material_in_both_languages_gives_the_same_picture(tmp_path):
    """The same bytes: a textured, coated standard_surface and a UsdPreviewSurface."""
    surface = (
        given("base", "1") + linked("base_color", "picture") + given("specular_roughness", "0.4") + given("coat", "0.5")
    )  # fmt: skip
    text = document(surface, nodes=picture())
    pictures = []
    for folder, body in ((tmp_path / "mtlx", REFERENCE), (tmp_path / "preview", PREVIEW + QUAD)):
        folder.mkdir()
        Image.fromarray(PIXELS).save(folder / "p.png")
        (folder / "doc.mtlx").write_text(text)
        description = read_stage(write(folder, body + LIGHT))
        camera = Camera.look_at((0.5, 0.5, 2.0), (0.5, 0.5, 0.0))
        pictures.append(render(description, camera, (12, 8), spp=8).hdr)
    assert pictures[0].std() > 0.05
    assert pictures[0].tobytes() == pictures[1].tobytes()


@pytest.mark.parametrize(
    ("alpha", "expected"),
    [("0.5", (0.25, "transparent", 0.0)), ("0.25", (0.25, "presence", 0.5))],
)
def test_mask_that_cuts_nothing_out_keeps_the_transmission(tmp_path, alpha, expected):
    surface = given("transmission", "0.75") + given("alpha", alpha) + given("alpha_mode", "1", "integer")
    text = document(surface, "gltf_pbr")
    if expected[1] == "presence":
        material = warned_material(tmp_path, text, "transmission of a surface that is partly absent is not drawn")
    else:
        material = material_of(tmp_path, text)
    assert (material.opacity, material.opacity_mode, material.opacity_threshold) == expected
