# SPDX-License-Identifier: Apache-2.0
"""MaterialX: borders and pixels of images, units, ramps, black bodies, and choices between branches."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from tests.usd.helpers import write
from tests.usd.materials.test_materialx import (
    PIXELS,
    REFERENCE,
    color_from,
    document,
    given,
    linear,
    linked,
    material_of,
    node,
    picture,
    stage_of,
    warned_material,
)
from tests.usd.materials.test_materialx_blender import read, shader
from tiscene.errors import StageWarning
from tiscene.scene.description import TextureLookup
from tiscene.usd.materials.materialx_operations import blackbody
from tiscene.usd.read.stage_reader import read_stage

CONSTANT = "".join(given(f"{axis}addressmode", "constant", "string") for axis in "uv")
WHITE = given("default", "1, 1, 1", "color3")


def border_of(lookup: TextureLookup) -> tuple[float, ...]:
    """Return what a lookup gives outside of its image, which is transparent black there."""
    return lookup.bias[:3]


def test_closest_pixels_keep_their_edges(tmp_path):
    """Interpolation goes from pixel to pixel of the enlarged image: over a sixteenth of a texel."""
    description = stage_of(
        tmp_path,
        document(linked("base_color", "N"), nodes=picture(name="N", more=given("filtertype", "closest", "string"))),
    )
    texture = description.textures[description.materials[0].diffuse_color.texture]
    assert texture.pixels.shape == (32, 32, 4)
    assert texture.encoding == "srgb"
    assert (texture.pixels[::16, ::16, :3] == PIXELS).all()
    assert (texture.pixels[15, 15] == texture.pixels[0, 0]).all()
    assert (texture.pixels[16, 16] == texture.pixels[31, 31]).all()


def test_large_pictures_are_not_enlarged(tmp_path):
    Image.new("RGB", (1500, 2)).save(tmp_path / "wide.png")
    nodes = picture(name="N", file="wide.png", more=given("filtertype", "closest", "string"))
    (texture,) = stage_of(tmp_path, document(linked("base_color", "N"), nodes=nodes)).textures
    assert texture.pixels.shape == (2, 1500, 4)


def test_constant_border_is_the_default(tmp_path):
    lookup, pixels = color_from(tmp_path, picture(name="N", more=CONSTANT + WHITE))
    assert border_of(lookup) == (1.0, 1.0, 1.0)
    np.testing.assert_allclose(pixels, linear(), atol=1e-6)


def test_border_of_a_computed_picture_is_computed(tmp_path):
    """The root of 1 - 0.75; it was black."""
    border = CONSTANT + given("default", "0.75, 0.75, 0.75", "color3")
    inverted = node("invert", "color3", linked("in", "picture"), name="less")
    nodes = picture(more=border) + inverted + node("power", "color3", linked("in1", "less"), given("in2", "0.5"))
    lookup, pixels = color_from(tmp_path, nodes)
    assert border_of(lookup) == pytest.approx((0.5, 0.5, 0.5))
    np.testing.assert_allclose(pixels, np.sqrt(1.0 - linear()), atol=1e-5)


def test_decal_does_not_smear_over_what_is_around_it(tmp_path):
    """A picture in the middle quarter of the unit square; around it, the other color is kept."""
    place = node("place2d", "vector2", given("scale", "0.5, 0.5", "vector2"), given("pivot", "0.5, 0.5", "vector2"),
                 name="place")  # fmt: skip
    decal = picture(more=CONSTANT + linked("texcoord", "place", "vector2"))
    ramp = node("ramplr", "color3", given("valuel", "0.5, 0.5, 0.5", "color3"),
                given("valuer", "0.5, 0.5, 0.5", "color3"), name="gray")  # fmt: skip
    nodes = place + decal + ramp + node("add", "color3", linked("in1", "picture"), linked("in2", "gray"))
    _, pixels = color_from(tmp_path, nodes)
    np.testing.assert_allclose(pixels[:, :64], 0.5, atol=0.005)
    np.testing.assert_allclose(pixels[256 + 64, 256 + 64], 0.5 + linear()[1, 1], atol=0.005)


def test_angles_in_radians_are_turned_to_degrees(tmp_path):
    angle = given("rotate", "1.5707963").replace("/>", 'unittype="angle" unit="radian" />')
    place = node("place2d", "vector2", angle, name="place")
    nodes = place + picture(name="N", more=linked("texcoord", "place", "vector2"))
    lookup = material_of(tmp_path, document(linked("base_color", "N"), nodes=nodes)).diffuse_color
    np.testing.assert_allclose(lookup.uv_transform, (0.0, 1.0, 0.0, -1.0, 0.0, 0.0), atol=1e-6)


def test_sizes_of_tiles_may_have_different_units(tmp_path):
    """Tiles of 50 cm and 25 cm of a picture of 2 m; the stage is in meters."""
    sizes = given("realworldtilesize", "50, 25", "vector2").replace("/>", 'unittype="distance" unit="centimeter" />')
    nodes = picture(name="N", more=sizes + given("realworldimagesize", "2, 2", "vector2"))
    nodes = nodes.replace("<image", "<tiledimage").replace("</image", "</tiledimage")
    lookup = material_of(tmp_path, document(linked("base_color", "N"), nodes=nodes)).diffuse_color
    np.testing.assert_allclose(np.array(lookup.uv_transform)[[0, 4]], (0.25, 0.125), rtol=1e-6)


def test_unit_of_an_input_on_a_stage_is_in_its_custom_data(tmp_path):
    """As issues of OpenUSD propose it; USD has no unit of an input. Half the color remains at 1 mm."""
    depth = 'float transmission_depth = 1 (customData = { string unit = "millimeter" })'
    parts = "float transmission_weight = 1", "color3f transmission_color = (0.5, 0.5, 0.5)"
    (material,) = read(tmp_path, shader("S", "ND_open_pbr_surface_surfaceshader", *parts, depth)).materials
    assert material.lobes.absorption == pytest.approx((np.log(2.0) / 0.001,) * 3)


@pytest.mark.parametrize("source", ["picture", "less"])
def test_converted_colors_and_vectors_are_opaque(tmp_path, source):
    """A fourth component of 1: it was that of blue."""
    nodes = picture() + node("power", "color3", linked("in1", "picture"), name="less")
    nodes += node("convert", "color4", linked("in", source), name="four").replace(
        "<convert", '<convert nodedef="ND_convert_color3_color4"'
    )
    nodes += node("separate4", "multioutput", linked("in", "four", "color4"), name="parts")
    parts = (linked(f"in{row + 1}", "parts", "float", f'output="out{name}"') for row, name in enumerate("rga"))
    _, pixels = color_from(tmp_path, nodes + node("combine3", "color3", *parts))
    np.testing.assert_allclose(pixels, np.insert(linear()[..., :2], 2, 1.0, axis=-1), atol=0.005)


def test_switch_chooses_by_texel(tmp_path):
    """The second branch where red is above 0.5: which was that of the mean, everywhere."""
    index = node("ifgreater", "float", linked("value1", "red", "float"), given("value2", "0.5"), given("in1", "1"),
                 given("in2", "0"), name="which")  # fmt: skip
    red = node("extract", "float", linked("in", "picture"), given("index", "0", "integer"), name="red")
    branches = given("in1", "1, 0, 0", "color3") + given("in2", "0, 0, 1", "color3")
    nodes = picture() + red + index + node("switch", "color3", branches, linked("which", "which", "float"))
    _, pixels = color_from(tmp_path, nodes)
    expected = np.where(linear()[..., :1] > 0.5, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    np.testing.assert_allclose(pixels, expected, atol=1e-6)


@pytest.mark.parametrize(("category", "values", "expected"), [
    ("ifgreater", given("value1", "0.7") + given("value2", "0.5"), 1.0),
    ("ifgreater", given("value1", "0.3") + given("value2", "0.5"), 0.0),
    ("ifequal", given("value2", "0"), 1.0),
])  # fmt: skip
def test_comparison_without_values_to_choose_from_is_a_boolean(tmp_path, category, values, expected):
    """It was always false; `ifequal` compares 0 with 0 by default."""
    nodes = node(category, "boolean", values, name="test")
    nodes += node("convert", "float", linked("in", "test", "boolean"))
    text = document(linked("specular_roughness", "N", "float"), nodes=nodes)
    assert material_of(tmp_path, text).roughness == expected


@pytest.mark.parametrize(("kind", "at", "expected"), [
    (0, (0.375, 0.9), 0.25),
    (0, (0.9, 0.5), 1.0),
    (1, (0.5, 0.9), 0.5),  # half of a turn
    (2, (0.5, 0.5 + 0.375 / 1.414), 0.25),
    (3, (0.3125, 0.6), 0.25),
])  # fmt: skip
def test_ramp_of_colors_is_computed(tmp_path, kind, at, expected):
    """Black up to 0.25, white from 0.75; as the graph of the library."""
    stops = given("type", str(kind), "integer") + given("interpolation", "0", "integer")
    stops += given("num_intervals", "3", "integer") + given("interval1", "0.25") + given("interval2", "0.75")
    if kind == 1:
        stops = stops.replace('value="0.25"', 'value="0"').replace('value="0.75"', 'value="1"')
    stops += given("color3", "1, 1, 1, 1", "color4")
    ramp = node("ramp", "color4", stops, name="R")
    nodes = ramp + node("convert", "color3", linked("in", "R", "color4")).replace(
        "<convert", '<convert nodedef="ND_convert_color4_color3"'
    )
    _, pixels = color_from(tmp_path, nodes)
    row, column = int((1.0 - at[1]) * 512), int(at[0] * 512)
    assert pixels[row, column] == pytest.approx((expected,) * 3, abs=0.01)


def test_black_body_has_the_color_of_its_temperature():
    """At 6504 K close to the white of Rec. 709, D65 (the locus itself is a little pinker); red below."""
    color = blackbody(np.array([6504.0]))
    np.testing.assert_allclose(color, (1.0, 1.0, 1.0), atol=0.06)
    for kelvin in (800.0, 1500.0, 3000.0, 12000.0):
        assert blackbody(np.array([kelvin])) @ (0.2126, 0.7152, 0.0722) == pytest.approx(1.0, abs=0.04)
    red, _, blue = blackbody(np.array([1500.0]))
    assert (red > 2.0, blue) == (True, 0.0)


def test_emission_of_a_black_body_is_read(tmp_path):
    nodes = node("blackbody", "color3", given("temperature", "3000"))
    material = material_of(tmp_path, document(linked("emission_color", "N") + given("emission", "2"), nodes=nodes))
    np.testing.assert_allclose(material.emissive_color, 2.0 * blackbody(np.array([3000.0])), rtol=1e-6)


@pytest.mark.parametrize(("nodes", "text"), [
    (picture(name="N", more=given("layer", "beauty", "string")), "layer of an image are not applied: </Looks/Mat/N>"),
    (
        picture("float", name="turn", file="p.png")
        + node("place2d", "vector2", linked("rotate", "turn", "float"), name="place")
        + picture(name="N", more=linked("texcoord", "place", "vector2")),
        "rotate cannot come from a texture; its mean is used: </Looks/Mat/place>",
    ),
])  # fmt: skip
def test_inputs_of_images_that_are_not_applied_are_named(tmp_path, nodes, text):
    warned_material(tmp_path, document(linked("base_color", "N"), nodes=nodes), text)


def test_missing_tiles_have_the_default(tmp_path):
    for tile in (1001, 1004):
        Image.new("RGB", (1, 1), (255, 0, 0)).save(tmp_path / f"p.{tile}.png")
    nodes = picture(name="N", file="p.&lt;UDIM&gt;.png", more=given("default", "0, 1, 0", "color3"))
    (tmp_path / "doc.mtlx").write_text(document(linked("base_color", "N"), nodes=nodes))
    (texture,) = read_stage(write(tmp_path, REFERENCE)).textures
    assert texture.pixels[0, :, :3].tolist() == [[255, 0, 0], [0, 255, 0], [0, 255, 0], [255, 0, 0]]


def normal_map(*inputs: str, scale: str = "") -> str:
    """Return a normal map of the picture, as the node N."""
    definition = "ND_normalmap_vector2" if "vector2" in scale else "ND_normalmap_float"
    bumps = node("normalmap", "vector3", linked("in", "picture", "vector3"), scale, *inputs)
    return picture("vector3") + bumps.replace("<normalmap", f'<normalmap nodedef="{definition}"')


def test_normal_map_has_a_scale_for_each_axis(tmp_path):
    nodes = normal_map(scale=given("scale", "0.5, 0.25", "vector2"))
    normal = material_of(tmp_path, document(linked("normal", "N", "vector3"), nodes=nodes)).normal
    assert (normal.scale[:3], normal.bias[:3]) == ((1.0, 0.5, 2.0), (-0.5, -0.25, -1.0))


def test_computed_scale_of_a_normal_map_is_applied(tmp_path):
    nodes = normal_map(scale=linked("scale", "half", "float")) + node(
        "multiply", "float", given("in1", "2"), given("in2", "0.25"), name="half"
    )
    normal = material_of(tmp_path, document(linked("normal", "N", "vector3"), nodes=nodes)).normal
    assert normal.scale[:3] == (1.0, 1.0, 2.0)


@pytest.mark.parametrize(("nodes", "text", "is_kept"), [
    (normal_map(given("space", "object", "string")), "another space than that of tangents", False),
    (
        normal_map(linked("normal", "detail", "vector3")) + picture("vector3", name="detail"),
        "normal of a normal map are not applied; the mesh's are used: </Looks/Mat/N>",
        True,
    ),
    (
        normal_map(linked("tangent", "side", "vector3"), linked("bitangent", "up", "vector3"))
        + picture("vector3", name="side") + node("bitangent", "vector3", name="up"),
        "tangent of a normal map are not applied",
        True,
    ),
    (
        node("normalmap", "vector3", given("in", "0.9, 0.5, 0.9", "vector3")),
        "constant normal other than",
        False,
    ),
])  # fmt: skip
def test_frames_of_normal_maps_other_than_that_of_the_mesh_are_named(tmp_path, nodes, text, is_kept):
    material = warned_material(tmp_path, document(linked("normal", "N", "vector3"), nodes=nodes), text)
    assert (material.normal is not None) == is_kept


def test_volume_of_a_document_is_named_and_leaves_the_display_color(tmp_path):
    text = document("", nodes=node("volume", "volumeshader", name="fog")).replace(
        "</surfacematerial>", "</surfacematerial>" + node("volumematerial", "material",
        linked("volumeshader", "fog", "volumeshader"), name="Fog"))  # fmt: skip
    (tmp_path / "doc.mtlx").write_text(text)
    with pytest.warns(StageWarning, match=r"the volume of a material is not drawn: </Looks/Fog>"):
        description = read_stage(write(tmp_path, REFERENCE.replace("/Looks/Mat", "/Looks/Fog")))
    assert description.materials[0].prim_path == ""


def test_surface_of_the_back_is_named(tmp_path):
    text = document("").replace(
        "</surfacematerial>", linked("backsurfaceshader", "SR", "surfaceshader") + "</surfacematerial>"
    )
    assert warned_material(tmp_path, text, "the surface of the back of a material is not drawn").name == "Mat"
