# SPDX-License-Identifier: Apache-2.0
"""MaterialX: image nodes of glTF and UsdUVTexture, and normals and tangents that are connected."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from tests.usd.helpers import write
from tests.usd.materials.test_materialx import (
    PIXELS,
    REFERENCE,
    document,
    given,
    linked,
    material_of,
    node,
    picture,
    stage_of,
    warned_material,
)
from tiscene.errors import StageWarning
from tiscene.scene.color import decode_srgb
from tiscene.usd.materials.materialx_operations import hsv_to_rgb
from tiscene.usd.read.stage_reader import read_stage

TINT = node("geompropvalue", "color3", given("geomprop", "tint", "string"), name="tint")


def gltf_picture(category: str, kind: str, *more: str) -> str:
    return (
        picture(kind, name="N", more="".join(more))
        .replace("<image", f"<{category}")
        .replace("</image", f"</{category}")
    )


@pytest.mark.parametrize(
    ("category", "kind"), [("gltf_image", "vector3"), ("gltf_colorimage", "multioutput"), ("gltf_image", "color4")]
)
def test_images_of_gltf_are_placed(tmp_path, category, kind):
    """By KHR_texture_transform, which has v downwards: (u, v) to offset + turned (2 u, 4 v)."""
    place = given("scale", "2, 4", "vector2") + given("rotate", "90") + given("offset", "0.25, 0.5", "vector2")
    order = given("operationorder", "0", "integer")
    text = document(
        linked("base_color", "N", kind, 'output="outcolor"'), "gltf_pbr", gltf_picture(category, kind, place, order)
    )
    lookup = stage_of(tmp_path, text).materials[0].diffuse_color
    for u, v in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.25)):
        x, y = 0.25 + 4 * v, 0.5 - 2 * u
        np.testing.assert_allclose(np.reshape(lookup.uv_transform, (2, 3)) @ (u, 1 - v, 1), (x, 1 - y), atol=1e-6)


def test_color_and_alpha_of_a_gltf_image_have_its_factors(tmp_path):
    image = gltf_picture("gltf_colorimage", "multioutput", given("color", "0.5, 1, 0.25, 0.5", "color4"))
    surface = linked("base_color", "N", more='output="outcolor"') + linked("alpha", "N", "float", 'output="outa"')
    text = document(surface + given("alpha_mode", "2", "integer"), "gltf_pbr", image)
    material = stage_of(tmp_path, text).materials[0]
    assert material.diffuse_color.scale[:3] == (0.5, 1.0, 0.25)
    assert (material.opacity.channel, material.opacity.scale[3]) == ("a", 0.5)


def test_scale_of_a_gltf_normal_map_is_that_of_its_coordinates(tmp_path):
    image = gltf_picture("gltf_normalmap", "vector3", given("scale", "2, 2", "vector2"))
    normal = stage_of(tmp_path, document(linked("normal", "N", "vector3"), "gltf_pbr", image)).materials[0].normal
    assert (normal.scale[:3], normal.uv_transform[0]) == ((2.0, 2.0, 2.0), 2.0)


def test_outputs_of_a_texture_that_is_missing_are_those_of_its_fallback(tmp_path):
    file = '<input name="file" type="filename" value="gone.png" />'
    image = node("UsdUVTexture", "multioutput", file, given("fallback", "0.1, 0.2, 0.3, 0.4", "color4"))
    image = image.replace("<UsdUVTexture", '<UsdUVTexture nodedef="ND_UsdUVTexture_23"')
    surface = linked("specular_roughness", "N", "float", 'output="g"') + linked("metalness", "N", "float", 'output="a"')
    material = warned_material(tmp_path, document(surface, nodes=image), "there is no texture")
    assert (material.roughness, material.metallic) == pytest.approx((0.2, 0.4))


def test_normals_and_tangents_of_the_mesh_are_no_omission(tmp_path):
    nodes = node("normal", "vector3") + node("tangent", "vector3", name="T") + picture()
    surface = "".join(linked(name, "N", "vector3") for name in ("normal", "coat_normal")) + given("coat", "1")
    surface += linked("tangent", "T", "vector3") + given("specular_anisotropy", "0.5")
    assert material_of(tmp_path, document(surface, nodes=nodes)).normal is None


def test_normals_and_tangents_of_lobes_without_effect_are_no_omission(tmp_path):
    maps = linked("tangent", "picture", "vector3") + linked("coat_normal", "picture", "vector3")
    assert material_of(tmp_path, document(maps, nodes=picture())).lobes is None


@pytest.mark.parametrize("definition", ["ND_normalmap", "ND_normalmap_float", "ND_normalmap_vector2"])
def test_normal_map_has_three_components_whatever_the_type_of_its_scale(tmp_path, definition):
    """Those of MaterialX 1.39, as Blender writes them, were read as gray."""
    bumps = node("normalmap", "vector3", linked("in", "picture", "vector3"))
    nodes = picture("vector3") + bumps.replace("<normalmap", f'<normalmap nodedef="{definition}"')
    normal = material_of(tmp_path, document(linked("normal", "N", "vector3"), nodes=nodes)).normal
    assert (normal.channel, normal.scale[:3], normal.bias[:3]) == ("rgb", (2.0, 2.0, 2.0), (-1.0, -1.0, -1.0))


def test_coordinates_computed_in_three_dimensions_are_a_map_if_they_are_affine(tmp_path):
    """A Mapping node as Blender writes it: scale, turn about z, move."""
    nodes = (
        node("geompropvalue", "vector2", given("geomprop", "other", "string"), name="at")
        + node("convert", "vector3", linked("in", "at", "vector2"), name="in3").replace(
            "<convert", '<convert nodedef="ND_convert_vector2_vector3"'
        )
        + node("multiply", "vector3", linked("in1", "in3", "vector3"), given("in2", "2, 4, 1", "vector3"), name="sized")
        + node("rotate3d", "vector3", linked("in", "sized", "vector3"), given("amount", "90"),
               given("axis", "0, 0, 2", "vector3"), name="turned")
        + node("add", "vector3", linked("in1", "turned", "vector3"), given("in2", "0.1, 0.2, 7", "vector3"),
               name="moved")
        + node("convert", "vector2", linked("in", "moved", "vector3"), name="out2")
        + picture(name="mapped", more=linked("texcoord", "out2", "vector2")) + picture()
    )  # fmt: skip
    surface = linked("base_color", "picture") + linked("specular_color", "mapped")
    material = material_of(tmp_path, document(surface, nodes=nodes))
    lookup = material.lobes.specular_tint
    np.testing.assert_allclose(lookup.uv_transform, (0.0, 4.0, 0.1, -2.0, 0.0, 0.2), atol=1e-6)
    assert (lookup.uv_set, material.diffuse_color.uv_set) == (0, 1)


def test_coordinates_that_are_no_affine_map_are_named(tmp_path):
    nodes = node("sin", "vector2", linked("in", "at", "vector2"), name="bent") + node("texcoord", "vector2", name="at")
    nodes += picture(more=linked("texcoord", "bent", "vector2"))
    expected = "texture coordinates that are no affine map of the mesh's are not supported; the mesh's own are used"
    warned_material(tmp_path, document(linked("base_color", "picture"), nodes=nodes), expected)


def test_constant_coordinates_are_one_point(tmp_path):
    nodes = picture(more=given("texcoord", "0.75, 0.25", "vector2"))
    lookup = material_of(tmp_path, document(linked("base_color", "picture"), nodes=nodes)).diffuse_color
    assert lookup.uv_transform == (0.0, 0.0, 0.75, 0.0, 0.0, 0.25)


def test_component_of_a_second_uv_set_is_looked_up_there(tmp_path):
    nodes = node("geompropvalue", "vector2", given("geomprop", "other", "string"), name="at") + picture()
    nodes += node("extract", "float", linked("in", "at", "vector2"), given("index", "1", "integer"))
    text = document(linked("base_color", "picture") + linked("metalness", "N", "float"), nodes=nodes)
    assert material_of(tmp_path, text).metallic.uv_set == 1


@pytest.mark.parametrize("first", ["picture", "mapped"])
def test_default_coordinates_beside_a_named_set_stay_their_own(tmp_path, first):
    """Pictures without texture coordinates of their own were looked up in the set of the others."""
    other = {"picture": "mapped", "mapped": "picture"}[first]
    nodes = node("geompropvalue", "vector2", given("geomprop", "other", "string"), name="at")
    nodes += picture(name="mapped", more=linked("texcoord", "at", "vector2")) + picture()
    surface = linked("base_color", first) + linked("emission_color", other) + given("emission", "1")
    stage_of(tmp_path, document(surface, nodes=nodes))
    halved = REFERENCE.replace(
        "primvars:other = [(0, 0), (1, 0), (1, 1), (0, 1)]", "primvars:other = [(0, 0), (0.5, 0), (0.5, 1), (0, 1)]"
    )
    description = read_stage(write(tmp_path, halved))
    mesh, material = description.meshes[0], description.materials[0]
    assert (material.diffuse_color.uv_set, material.emissive_color.uv_set) == (0, 1)
    widest = {"picture": 1.0, "mapped": 0.5}
    assert (mesh.uv[:, 0].max(), mesh.second_uv[:, 0].max()) == (widest[first], widest[other])


@pytest.mark.parametrize(
    ("category", "more", "tiles"),
    [("hextiledimage", given("tiling", "3, 2", "vector2"), (3.0, 2.0)), ("triplanarprojection", "", (1.0, 1.0))],
)
def test_images_that_are_simplified_are_named_and_keep_their_file(tmp_path, category, more, tiles):
    image = picture(name="N", more=more).replace("<image", f"<{category}").replace("</image", f"</{category}")
    image = image.replace('"file"', '"filez"') if category == "triplanarprojection" else image
    lookup = warned_material(
        tmp_path, document(linked("base_color", "N"), nodes=image), f"'{category}' is drawn as"
    ).diffuse_color
    assert (lookup.uv_transform[0], lookup.uv_transform[4]) == tiles


def test_colors_of_vertices_that_are_computed_with_count_as_white_and_are_named(tmp_path):
    """They counted as 0.5, without a note."""
    nodes = TINT + picture() + node("add", "color3", linked("in1", "picture"), linked("in2", "tint"))
    warned_material(tmp_path, document(linked("base_color", "N"), nodes=nodes), "count as white here: </Looks/Mat/N>")
    with pytest.warns(StageWarning, match="count as white here"):
        description = read_stage(tmp_path / "stage.usda")
    lookup = description.materials[0].diffuse_color
    assert description.textures[lookup.texture].pixels[..., :3].min() >= 1.0  # white, and the picture


TINTED = node("multiply", "color3", linked("in1", "picture"), linked("in2", "tint"), name="product")


@pytest.mark.parametrize(
    ("image", "nodes", "scale"),
    [
        ("picture", node("multiply", "color3", linked("in1", "product"), given("in2", "0.5")), 0.5),
        ("picture", node("multiply", "color3", given("in1", "0.5"), linked("in2", "product")), 0.5),
        ("computed", node("multiply", "color3", linked("in1", "product"), given("in2", "0.5")), 1.0),
    ],
)
def test_colors_of_vertices_multiply_an_image(tmp_path, image, nodes, scale):
    computed = node("power", "color3", linked("in1", "picture"), given("in2", "2"), name="computed")
    nodes = TINT + picture() + computed + TINTED.replace('"picture"', f'"{image}"') + nodes
    description = stage_of(tmp_path, document(linked("base_color", "N") + given("base", "1"), nodes=nodes))
    lookup = description.materials[0].diffuse_color
    assert lookup.vertex_factor == "rgb"
    assert lookup.scale[:3] == (scale,) * 3
    read = decode_srgb(description.textures[lookup.texture].pixels[..., :3] / 255.0)
    original = decode_srgb(PIXELS / 255.0)
    np.testing.assert_allclose(read, original if image == "picture" else 0.5 * original**2, atol=0.004)


@pytest.mark.parametrize("channel", ["r", "b"])
def test_one_channel_of_an_image_times_colors_of_vertices_is_named(tmp_path, channel):
    extract = node("extract", "float", linked("in", "product"), given("index", str("rgb".index(channel)), "integer"))
    text = document(linked("specular_roughness", "N", "float"), nodes=TINT + picture() + TINTED + extract)
    lookup = warned_material(tmp_path, text, "count as white here").roughness
    assert (lookup.vertex_factor, lookup.channel) == ("", channel)


ACESCG = np.array([[1.70505, -0.62179, -0.08326], [-0.13026, 1.14080, -0.01055], [-0.02400, -0.12897, 1.15297]])


@pytest.mark.parametrize(
    ("space", "function"),
    [
        ("acescg", lambda color: color @ ACESCG.T),
        ("lin_ap1_scene", lambda color: color @ ACESCG.T),
        ("g22_rec709", lambda color: color**2.2),
        ("rec709_display", lambda color: color**2.4),
        ("g22_ap1", lambda color: color**2.2 @ ACESCG.T),
    ],
)
def test_color_spaces_are_those_of_the_library(tmp_path, space, function):
    """All but sRGB counted as linear Rec. 709. The numbers are those of MaterialX's cmlib."""
    value = given("base_color", "0.5, 0.4, 0.3", "color3")
    nodes = picture(file='p.png" colorspace="' + space).replace('colorspace="srgb_texture"', "")
    text = document(value + linked("emission_color", "picture") + given("emission", "1"), nodes=nodes)
    description = stage_of(tmp_path, text.replace("lin_rec709", space))
    material = description.materials[0]
    np.testing.assert_allclose(material.diffuse_color, function(np.array([0.5, 0.4, 0.3])), atol=1e-4)
    pixels = description.textures[material.emissive_color.texture].pixels
    np.testing.assert_allclose(pixels[..., :3], np.maximum(function(PIXELS / 255.0), 0.0), atol=1e-4)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_hues_of_any_turn_have_the_colors_of_their_remainder(dtype):
    """Remainders of few periods are computed by subtraction, to the bit."""
    hues = np.concatenate([np.random.default_rng(3).uniform(-0.16, 2.1, 1000), [0.0, 1.0, 2.0, -1e-9, 1.0 - 1e-9]])
    for turned in (hues, hues * 100.0):
        hsv = np.stack([turned, np.full_like(turned, 0.75), np.ones_like(turned)], axis=-1).astype(dtype)
        steps = np.stack([hsv[:, 0] * 6.0 + each for each in (5.0, 3.0, 1.0)], axis=-1) % 6.0
        expected = 1.0 - hsv[:, 1:2] * np.clip(np.minimum(steps, 4.0 - steps), 0.0, 1.0)
        np.testing.assert_array_equal(hsv_to_rgb(hsv), expected)


def test_images_are_computed_whole_whatever_their_rows(tmp_path):
    """Strips of 24 rows of a picture whose last one is narrower."""
    levels = np.random.default_rng(4).integers(0, 256, (100, 680), np.uint8)
    Image.fromarray(levels).save(tmp_path / "tall.png")
    squared = node("multiply", "float", linked("in1", "picture", "float"), linked("in2", "picture", "float"))
    text = document(linked("metalness", "N", "float"), nodes=picture("float", file="tall.png") + squared)
    description = stage_of(tmp_path, text)
    lookup = description.materials[0].metallic
    pixels = description.textures[lookup.texture].pixels[..., 0]
    np.testing.assert_array_equal(pixels, np.rint((np.float32(levels) / 255) ** 2 * 255))
