# SPDX-License-Identifier: Apache-2.0
"""Surfaces of several BSDFs and EDFs, as Blender writes its Mix and Add shaders, as one material."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from tests.usd.materials.test_materialx import document, given, linked, material_of, node, warned_material
from tests.usd.materials.test_materialx_blender import link, read, shader
from tiscene.errors import StageWarning
from tiscene.scene.description import ExtendedLobes, Material, TextureLookup

ROUGH = "float2 roughness = (0.25, 0.25)"
RED = shader("red", "ND_oren_nayar_diffuse_bsdf", "color3f color = (0.8, 0.2, 0.4)")
BLUE = shader("blue", "ND_oren_nayar_diffuse_bsdf", "color3f color = (0, 0.4, 0.8)")
METAL = shader("metal", "ND_conductor_bsdf", link("color3f ior", "tint"), ROUGH)
METAL += shader("tint", "ND_artistic_ior", "color3f reflectivity = (0.5, 0.5, 0.25)")
GLASS = shader("glass", "ND_dielectric_bsdf", "float ior = 1.25", 'string scatter_mode = "RT"', ROUGH)
GLOSS = shader("gloss", "ND_dielectric_bsdf", "float ior = 1.25", ROUGH)
SHEET = shader("sheet", "ND_translucent_bsdf", "color3f color = (0.5, 1, 0)")


def folded(tmp_path, *nodes: str, surface: str = "") -> Material:
    """Return the material of a surface whose BSDF is the node B."""
    head = shader("S", "ND_surface", link("token bsdf", "B"), *filter(None, [surface]))
    (material,) = read(tmp_path, head, *nodes).materials
    return material


def mixed(background: str, foreground: str, weight: float = 0.25) -> str:
    """Return the node B that mixes two others."""
    links = link("token bg", background), link("token fg", foreground)
    return shader("B", "ND_mix_bsdf", *links, f"float mix = {weight}")


def lobes_of(material: Material) -> ExtendedLobes:
    assert material.lobes is not None
    return material.lobes


def test_mixed_diffuse_reflections_have_mean_color(tmp_path):
    material = folded(tmp_path, mixed("red", "blue"), RED, BLUE)
    np.testing.assert_allclose(material.diffuse_color, (0.6, 0.25, 0.5), rtol=1e-6)
    assert (material.metallic, material.ior) == (0.0, 1.0)


def test_mostly_metal_is_metallic_and_shared_color_is_noted(tmp_path):
    with pytest.warns(StageWarning, match="one material: metal and diffuse reflection share one color"):
        material = folded(tmp_path, mixed("red", "metal", 0.75), RED, METAL)
    np.testing.assert_allclose(material.diffuse_color, (0.575, 0.425, 0.2875), rtol=1e-6)
    assert material.metallic == 0.75
    assert material.roughness == pytest.approx(0.5)


def test_some_metal_over_diffuse_reflects_as_a_dielectric(tmp_path):
    """F0 is the share of the metal, and the color below makes up for what the layer keeps."""
    material = folded(tmp_path, mixed("red", "metal"), RED, METAL)
    assert ((material.ior - 1.0) / (material.ior + 1.0)) ** 2 == pytest.approx(0.125)
    np.testing.assert_allclose(material.diffuse_color, 0.75 / 0.875 * np.array([0.8, 0.2, 0.4]), rtol=1e-6)
    np.testing.assert_allclose(lobes_of(material).specular_tint, (1.0, 1.0, 0.5), rtol=1e-6)
    assert material.metallic == 0.0


def test_mixed_glass_transmits_its_share(tmp_path):
    material = folded(tmp_path, mixed("red", "glass"), RED, GLASS)
    assert material.opacity == 0.75
    assert material.ior == 1.25
    np.testing.assert_allclose(material.diffuse_color, (0.8, 0.2, 0.4), rtol=1e-6)


def test_mixed_translucency_passes_its_share(tmp_path):
    material = folded(tmp_path, mixed("red", "sheet"), RED, SHEET)
    assert lobes_of(material).translucency == 0.25
    assert lobes_of(material).translucent_color == (0.5, 1.0, 0.0)
    np.testing.assert_allclose(material.diffuse_color, (0.8, 0.2, 0.4), rtol=1e-6)


def test_mixed_clear_bsdf_becomes_opacity(tmp_path):
    parts = ("float ior = 1", "float2 roughness = (0, 0)", 'string scatter_mode = "T"')
    clear = shader("clear", "ND_dielectric_bsdf", *parts)
    material = folded(tmp_path, mixed("red", "clear"), RED, clear, surface="float opacity = 0.5")
    assert (material.opacity, material.opacity_mode) == (0.375, "presence")
    np.testing.assert_allclose(material.diffuse_color, (0.8, 0.2, 0.4), rtol=1e-6)


@pytest.mark.parametrize("multiplied", [False, True])
def test_added_parts_share_the_light_by_their_colors(tmp_path, multiplied):
    """Two whole lobes add up to 2; by their brightest channels they are 0.4 and 0.5 of the light."""
    half = shader("half", "ND_multiply_bsdfF", link("token in1", "red"), "float in2 = 0.5")
    color = shader("half", "ND_multiply_bsdfC", link("token in1", "red"), "color3f in2 = (0.5, 0.5, 0.5)")
    added = shader("B", "ND_add_bsdf", link("token in1", "half"), link("token in2", "metal"))
    with pytest.warns(StageWarning, match="share one color"):
        material = folded(tmp_path, added, half if multiplied else color, RED, METAL)
    np.testing.assert_allclose(material.diffuse_color, (0.9, 0.6, 0.45), rtol=1e-6)
    assert material.metallic == pytest.approx(0.5)


def test_added_lobes_that_reflect_too_much_are_darkened(tmp_path):
    added = shader("B", "ND_add_bsdf", link("token in1", "red"), link("token in2", "blue"))
    with pytest.warns(StageWarning, match="reflect more light than falls on them"):
        material = folded(tmp_path, added, RED, BLUE)
    np.testing.assert_allclose(material.diffuse_color, np.array([0.8, 0.6, 1.2]) / 1.6, rtol=1e-6)


def test_added_pictures_keep_their_brightest_texel_within_1(tmp_path):
    """A picture of 0 and 0.8 that is half of each; its brightest channel is its part of the light."""
    Image.fromarray(np.uint8([[0, 204]])).save(tmp_path / "mask.png")
    image = shader("mask", "ND_image_color3", 'asset file = @mask.png@ (colorSpace = "lin_rec709_scene")')
    sheet = shader("sheet", "ND_translucent_bsdf", link("color3f color", "mask"))
    added = shader("B", "ND_add_bsdf", link("token in1", "sheet"), link("token in2", "metal"))
    with pytest.warns(StageWarning, match="reflect more light than falls on them"):
        lobes = lobes_of(folded(tmp_path, added, image, sheet, METAL))
    assert isinstance(lobes.translucent_color, TextureLookup)
    np.testing.assert_allclose(lobes.translucent_color.scale[:3], 1.25, rtol=1e-6)


def layer(name: str, top: str, base: str) -> str:
    return shader(name, "ND_layer_bsdf", link("token top", top), link("token base", base))


def test_layers_become_specular_coat_and_sheen(tmp_path):
    """As the graphs of Blender and of the library: coat over sheen over specular over diffuse."""
    coat = shader("coat", "ND_dielectric_bsdf", "float ior = 1.75", "float weight = 0.5", "float2 roughness = (0, 0)")
    sheen = shader("sheen", "ND_sheen_bsdf", "color3f color = (0.5, 0, 0)", "float weight = 0.5")
    material = folded(
        tmp_path, layer("B", "coat", "L"), layer("L", "sheen", "M"), layer("M", "gloss", "red"), coat, sheen, GLOSS, RED
    )
    np.testing.assert_allclose(material.diffuse_color, (0.8, 0.2, 0.4), rtol=1e-6)
    assert (material.ior, material.roughness) == (1.25, 0.5)
    assert (material.clearcoat, material.clearcoat_roughness, lobes_of(material).coat_ior) == (0.5, 0.0, 1.75)
    assert (lobes_of(material).sheen_color, lobes_of(material).sheen_roughness) == ((0.25, 0.0, 0.0), 0.3)


def test_parts_without_weight_are_not_noted(tmp_path, recwarn):
    below = shader("blue", "ND_subsurface_bsdf", "color3f color = (0, 0.4, 0.8)")
    material = folded(tmp_path, mixed("red", "blue", 0.0), RED, below)
    np.testing.assert_allclose(material.diffuse_color, (0.8, 0.2, 0.4), rtol=1e-6)
    assert not recwarn.list


def test_emission_is_mixed_added_and_multiplied(tmp_path):
    nodes = [
        shader("E", "ND_mix_edf", link("token bg", "sum"), link("token fg", "none"), "float mix = 0.5"),
        shader("sum", "ND_add_edf", link("token in1", "a"), link("token in2", "twice")),
        shader("twice", "ND_multiply_edfC", link("token in1", "b"), "color3f in2 = (2, 2, 2)"),
        *(shader(n, "ND_uniform_edf", f"color3f color = {c}") for n, c in (("a", "(1, 0, 0)"), ("b", "(0, 3, 1)"))),
        shader("none", "ND_uniform_edf", "color3f color = (0, 0, 0)"),
    ]
    (material,) = read(tmp_path, shader("S", "ND_surface", link("token edf", "E")), *nodes).materials
    assert material.emissive_color == (0.5, 3.0, 1.0)


def test_mask_between_diffuse_and_metal_gives_textures(tmp_path):
    """The mask is metallic itself; the color is computed from it."""
    mask = np.zeros((4, 4), np.uint8)
    mask[:, 2:] = 255
    Image.fromarray(mask).save(tmp_path / "mask.png")
    links = link("token bg", "red"), link("token fg", "metal"), link("float mix", "mask")
    image = shader("mask", "ND_image_float", "asset file = @mask.png@")
    head = shader("S", "ND_surface", link("token bsdf", "B"))
    description = read(tmp_path, head, shader("B", "ND_mix_bsdf", *links), image, RED, METAL)
    (material,) = description.materials
    assert isinstance(material.metallic, TextureLookup)
    assert isinstance(material.diffuse_color, TextureLookup)
    levels = description.textures[material.metallic.texture].pixels[0, :, 0]
    assert levels.tolist() == [0, 0, 255, 255]
    pixels = description.textures[material.diffuse_color.texture].pixels
    assert pixels[0, 0].tolist() == [231, 124, 170, 255]
    assert pixels[0, 3].tolist() == [188, 188, 137, 255]


def test_document_of_layered_bsdfs_is_read(tmp_path):
    nodes = node("oren_nayar_diffuse_bsdf", "BSDF", given("color", "0.5, 0.25, 1", "color3"), name="base")
    nodes += node(
        "dielectric_bsdf", "BSDF", given("ior", "1.25"), given("roughness", "0.25, 0.25", "vector2"), name="top"
    )
    nodes += node("layer", "BSDF", linked("top", "top", "BSDF"), linked("base", "base", "BSDF"), name="both")
    nodes += node("multiply", "BSDF", linked("in1", "both", "BSDF"), given("in2", "0.5"), name="half")
    text = document(linked("bsdf", "half", "BSDF"), nodes=nodes, model="surface")
    material = material_of(tmp_path, text)
    np.testing.assert_allclose(material.diffuse_color, (0.25, 0.125, 0.5), rtol=1e-6)
    assert material.roughness == pytest.approx(0.5)


@pytest.mark.parametrize("absorption", [0.0, 1.0])
def test_medium_below_a_layer_is_left_out_and_named_if_it_has_an_effect(tmp_path, absorption):
    """As the library's graph of open_pbr_surface, which layers transmission over a medium."""
    nodes = node("dielectric_bsdf", "BSDF", given("scatter_mode", "T", "string"), given("ior", "1.25"), name="top")
    nodes += node("absorption_vdf", "VDF", given("absorption", f"{absorption}, 0, 0", "vector3"), name="inside")
    nodes += node("layer", "BSDF", linked("top", "top", "BSDF"), linked("base", "inside", "VDF"), name="both")
    nodes += node("dielectric_bsdf", "BSDF", given("ior", "1.25"), name="reflection")
    nodes += node("layer", "BSDF", linked("top", "reflection", "BSDF"), linked("base", "both", "BSDF"), name="all")
    text = document(linked("bsdf", "all", "BSDF"), nodes=nodes, model="surface")
    if absorption:
        material = warned_material(tmp_path, text, "one material: media inside are left out")
    else:
        material = material_of(tmp_path, text)
    assert (material.opacity, material.ior, material.clearcoat) == (0.0, 1.25, 0.0)


BUMPS = shader("bumps", "ND_normalmap_float", link("float3 in", "map"))
BUMPS += shader("map", "ND_image_vector3", "asset file = @p.png@")
BUMPY = link("float3 normal", "bumps")


def test_normals_that_differ_between_lobes_are_named(tmp_path):
    bumpy = shader("red", "ND_oren_nayar_diffuse_bsdf", "color3f color = (0.8, 0.2, 0.4)", BUMPY)
    with pytest.warns(StageWarning, match="lobes share the first normal map"):
        material = folded(tmp_path, mixed("red", "blue"), bumpy, BLUE, BUMPS)
    assert material.normal is not None


def test_coat_over_bumps_has_their_normal_which_is_named(tmp_path):
    coat = shader("coat", "ND_dielectric_bsdf", "float ior = 1.75", "float weight = 0.5")
    gloss = shader("gloss", "ND_dielectric_bsdf", "float ior = 1.25", ROUGH, BUMPY)
    bumpy = shader("red", "ND_oren_nayar_diffuse_bsdf", "color3f color = (0.8, 0.2, 0.4)", BUMPY)
    layers = layer("B", "coat", "M"), layer("M", "gloss", "red")
    with pytest.warns(StageWarning, match="one material: the coat has the normal of the surface"):
        folded(tmp_path, *layers, coat, gloss, bumpy, BUMPS)


def test_normals_that_are_the_same_are_not_named(tmp_path, recwarn):
    mesh = shader("own", "ND_normal_vector3", 'string space = "world"')
    plain = shader("red", "ND_oren_nayar_diffuse_bsdf", "color3f color = (0.8, 0.2, 0.4)", link("float3 normal", "own"))
    assert folded(tmp_path, mixed("red", "blue"), plain, BLUE, mesh).normal is None
    assert not recwarn.list


@pytest.mark.parametrize(("levels", "is_named"), [((0, 255), False), ((64, 192), True)])
def test_share_of_metal_from_a_texture_is_named_where_it_is_neither_all_nor_nothing(
    tmp_path, recwarn, levels, is_named
):
    Image.fromarray(np.uint8([levels] * 2)).save(tmp_path / "mask.png")
    links = link("token bg", "red"), link("token fg", "metal"), link("float mix", "mask")
    image = shader("mask", "ND_image_float", "asset file = @mask.png@")
    folded(tmp_path, shader("B", "ND_mix_bsdf", *links), image, RED, METAL)
    assert ["share one color" in str(each.message) for each in recwarn.list] == [True] * is_named
