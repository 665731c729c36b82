# SPDX-License-Identifier: Apache-2.0
"""Texture files of materials, UDIM tiles and texture coordinates."""

from __future__ import annotations

import shutil

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from tests.usd.helpers import STAGES, read, read_with_warning
from tests.usd.materials.test_material import material, materials_of, only_material, shader


@pytest.fixture
def textures(tmp_path):
    (tmp_path / "textures").mkdir()
    shutil.copy(STAGES / "textures" / "color.png", tmp_path / "textures")
    return tmp_path


def texture(lines: str, read_by: str = "") -> str:
    surface = shader(
        "Surface", "UsdPreviewSurface", "color3f inputs:diffuseColor.connect = </Looks/L/Image.outputs:rgb>"
    )
    return material(surface + shader("Image", "UsdUVTexture", lines, "float3 outputs:rgb") + read_by)


ST = 'texCoord2f[] primvars:st = [(0, 0)] (interpolation = "constant")\n'
FALLBACK = "float4 inputs:fallback = (0.5, 0.25, 0, 1)\n"


@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("asset inputs:file = @./gone.png@", r"there is no texture @./gone.png@ \(named in .*stage.usda\)"),
        ("asset inputs:file = @./bad.png@", "texture @.*bad.png@ cannot be read .*"),
        ("asset inputs:file = @./tiles.<UDIM>.png@", "there are no tiles @./tiles.<UDIM>.png@.*"),
        ("", "a UsdUVTexture without a file"),
        ("asset inputs:file", "a UsdUVTexture without a file"),
        ("asset inputs:file = @@", "a UsdUVTexture without a file"),
    ],
)
def test_texture_that_cannot_be_read_gives_fallback_and_is_reported(tmp_path, file, expected):
    (tmp_path / "bad.png").write_bytes(b"\x89PNG\r\n\x1a\n but no more of it than this")
    expected += "; its fallback is used: </Looks/L/Image>"
    description = read_with_warning(tmp_path, texture(FALLBACK + file), expected)
    assert only_material(description).diffuse_color == (0.5, 0.25, 0.0)
    assert not description.textures


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("float inputs:{} = 0.5", (0.5, 0.5, 0.5, 0.5)),
        ("float2 inputs:{} = (0.5, 0.25)", (0.5, 0.25, None, None)),
        ("float3 inputs:{} = (0.5, 0.25, 2)", (0.5, 0.25, 2.0, None)),
        ("color3f inputs:{} = (0.5, 0.25, 2)", (0.5, 0.25, 2.0, None)),
        ("color4f inputs:{} = (0.5, 0.25, 2, 4)", (0.5, 0.25, 2.0, 4.0)),
    ],
)
@pytest.mark.parametrize(("name", "default"), [("scale", (1.0, 1.0, 1.0, 1.0)), ("bias", (0.0, 0.0, 0.0, 0.0))])
def test_scale_and_bias_of_any_width_are_read(textures, name, default, value, expected):
    lines = f"asset inputs:file = @./textures/color.png@\n{value.format(name)}"
    lookup = only_material(read(textures, texture(lines))).diffuse_color
    filled = tuple(own if own is not None else other for own, other in zip(expected, default, strict=True))
    assert getattr(lookup, name) == filled


def test_fallback_of_three_numbers_is_opaque(tmp_path):
    surface = shader("Surface", "UsdPreviewSurface", "float inputs:opacity.connect = </Looks/L/Image.outputs:a>")
    image = shader("Image", "UsdUVTexture", "float3 inputs:fallback = (0.5, 0.25, 0)", "float outputs:a")
    description = read_with_warning(tmp_path, material(surface + image), "without a file")
    assert only_material(description).opacity == 1.0


def test_scale_from_a_primvar_that_does_not_exist_is_reported(textures):
    lines = "asset inputs:file = @./textures/color.png@\nfloat4 inputs:scale.connect = </Looks/L/R.outputs:result>"
    reader = shader("R", "UsdPrimvarReader_float4", 'string inputs:varname = "s"', "float4 outputs:result")
    description = read_with_warning(
        textures, texture(lines, reader), "scale of a texture cannot be read from this shader"
    )
    assert only_material(description).diffuse_color.scale == (1.0, 1.0, 1.0, 1.0)


def test_udim_tiles_are_merged_side_by_side(tmp_path):
    """Tiles 1002 and 1011 span 2 x 2 units from (0, 0); the two missing tiles have the fallback color."""
    for number, value in ((1002, 100), (1011, 200)):
        Image.new("RGB", (4, 2), (value, 0, 0)).save(tmp_path / f"tile.{number}.png")
    body = texture(FALLBACK + "asset inputs:file = @./tile.<UDIM>.png@")
    description = read(tmp_path, body)
    (sheet,) = description.textures
    lookup = only_material(description).diffuse_color
    np.testing.assert_allclose(lookup.uv_transform, (0.5, 0, 0, 0, 0.5, 0))
    assert sheet.pixels.shape == (4, 8, 4)
    assert (sheet.pixels[2:, 4:, 0] == 100).all()  # u 1..2, v 0..1
    assert (sheet.pixels[:2, :4, 0] == 200).all()  # u 0..1, v 1..2
    np.testing.assert_array_equal(sheet.pixels[3, 0], (188, 137, 0, 255))  # sRGB codes of the fallback
    assert (sheet.wrap_s, sheet.wrap_t) == ("clamp", "clamp")  # as UDIM tiles are


def test_textures_of_the_same_udim_tiles_have_their_own_fallbacks(tmp_path):
    for number in (1001, 1003):
        Image.new("RGB", (2, 2), 7).save(tmp_path / f"tile.{number}.png")
    image = "asset inputs:file = @./tile.<UDIM>.png@\n" + 'token inputs:sourceColorSpace = "raw"\n'
    surface = shader(
        "Surface",
        "UsdPreviewSurface",
        "color3f inputs:diffuseColor.connect = </Looks/L/A.outputs:rgb>\n"
        "color3f inputs:emissiveColor.connect = </Looks/L/B.outputs:rgb>",
    )
    for name, red in (("A", 1), ("B", 0)):
        lines = f"{image}float4 inputs:fallback = ({red}, 0, 0, 1)"
        surface += shader(name, "UsdUVTexture", lines, "float3 outputs:rgb")
    description = read(tmp_path, material(surface))
    found = only_material(description)
    sheets = [description.textures[each.texture] for each in (found.diffuse_color, found.emissive_color)]
    assert [each.pixels[0, 2, 0] for each in sheets] == [255, 0]
    assert {each.name for each in sheets} == {"tile.<UDIM>.png"}


def test_udim_image_begins_at_first_tile(tmp_path):
    Image.new("L", (2, 2), 7).save(tmp_path / "t.1013.png")
    description = read(tmp_path, texture("asset inputs:file = @./t.<UDIM>.png@"))
    lookup = only_material(description).diffuse_color
    np.testing.assert_allclose(lookup.uv_transform, (1, 0, -2, 0, 1, -1))


def test_coordinates_outside_of_udim_tiles_are_reported(tmp_path):
    Image.new("L", (2, 2), 7).save(tmp_path / "t.1001.png")
    lines = "asset inputs:file = @./t.<UDIM>.png@\nfloat2 inputs:st.connect = </Looks/L/Reader.outputs:result>"
    read_by = shader("Reader", "UsdPrimvarReader_float2", 'string inputs:varname = "st"', "float2 outputs:result")
    st = 'texCoord2f[] primvars:st = [(0, 0), (%g, 0), (%g, 1), (0, 1)] (interpolation = "vertex")\n    '
    body = texture(lines, read_by)
    inside, outside = (body.replace("rel material:b", st % (u, u) + "rel material:b") for u in (1, 2))
    read(tmp_path, inside)
    expected = "leave the tiles of @./t.<UDIM>.png@; the colors of their edges are used: </M>"
    read_with_warning(tmp_path, outside, expected)


def test_udim_tiles_far_apart_are_reduced(tmp_path, monkeypatch):
    monkeypatch.setattr("tiscene.usd.materials.texture._MAX_SHEET", 100 * 8)
    for number, value in ((1001, 100), (1100, 200)):
        Image.new("L", (8, 4), value).save(tmp_path / f"t.{number}.png")
    body = texture("asset inputs:file = @./t.<UDIM>.png@")
    (sheet,) = read_with_warning(tmp_path, body, "far apart, in an area of 10x10: each is reduced to 4x2").textures
    assert sheet.pixels.shape == (20, 40, 4)
    assert (sheet.pixels[-1, 0, 0], sheet.pixels[0, -1, 0]) == (100, 200)


def test_udim_path_without_dot_slash_is_relative_to_layer(tmp_path):
    (tmp_path / "maps").mkdir()
    Image.new("L", (2, 2), 7).save(tmp_path / "maps" / "t.1001.png")
    assert len(read(tmp_path, texture("asset inputs:file = @maps/t.<UDIM>.png@")).textures) == 1


def test_srgb_float_texture_is_decoded(tmp_path):
    """The renderer decodes 8-bit textures only, so the reader decodes floats."""
    values = np.array([[[0.5, 0.02, 1.0, 0.5]]], np.float32)
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGBA": values}) as file:
        file.write(str(tmp_path / "a.exr"))
    file_line = 'asset inputs:file = @./a.exr@\ntoken inputs:sourceColorSpace = "sRGB"'
    (read_texture,) = read(tmp_path, texture(file_line)).textures
    assert read_texture.encoding == "raw"
    np.testing.assert_allclose(read_texture.pixels[0, 0], (0.2140411, 0.02 / 12.92, 1.0, 0.5), rtol=1e-5)


def test_unknown_wrap_modes_and_color_spaces_are_reported(textures):
    lines = "asset inputs:file = @./textures/color.png@\n"
    lines += 'token inputs:wrapS = "weird"\ntoken inputs:sourceColorSpace = "ACES"'
    description = read_with_warning(textures, texture(lines), "(?s)color space 'ACES'.*wrap mode 'weird'")
    assert (description.textures[0].wrap_s, description.textures[0].encoding) == ("black", "srgb")


def test_missing_uv_primvar_is_reported(textures):
    lines = "asset inputs:file = @./textures/color.png@\nfloat2 inputs:st.connect = </Looks/L/Reader.outputs:result>"
    reader = shader("Reader", "UsdPrimvarReader_float2", 'string inputs:varname = "UVMap"', "float2 outputs:result")
    st = 'texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")'
    body = texture(lines, reader).replace("rel material:binding", st + "\n    rel material:binding")
    description = read_with_warning(textures, body, r"no primvar 'UVMap'.* are \(0, 0\): </M>")
    assert description.meshes[0].uv is None  # as USD says, others are not used instead


def test_fallback_of_a_reader_replaces_missing_texture_coordinates(textures):
    """One material on a mesh without texture coordinates and on one that has them."""
    lines = "asset inputs:file = @./textures/color.png@\nfloat2 inputs:st.connect = </Looks/L/Reader.outputs:result>"
    given = 'string inputs:varname = "map"\nfloat2 inputs:fallback = (0.25, 0.75)'
    reader = shader("Reader", "UsdPrimvarReader_float2", given, "float2 outputs:result")
    body = texture(lines, reader)
    mesh = body[body.index("def Mesh") : body.index("def Scope")]
    st = 'texCoord2f[] primvars:%s = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")\n'
    other = mesh.replace('"M"', '"N"').replace("rel material:binding", st % "map" + "rel material:binding")
    mesh = mesh.replace("rel material:binding", st % "st" + "rel material:binding")
    expected = r"no primvar 'map', .* its texture coordinates are \(0\.25, 0\.75\): </M>$"
    found = materials_of(read_with_warning(textures, mesh + other + body[body.index("def Scope") :], expected))
    assert found["M"].diffuse_color.uv_transform == (0, 0, 0.25, 0, 0, 0.75)
    assert found["N"].diffuse_color.uv_transform == (1, 0, 0, 0, 1, 0)


def test_cyclic_uv_transforms_are_reported(textures):
    lines = "asset inputs:file = @./textures/color.png@\nfloat2 inputs:st.connect = </Looks/L/Turn.outputs:result>"
    around = "float2 inputs:in.connect = </Looks/L/Turn.outputs:result>"
    turn = shader("Turn", "UsdTransform2d", around, "float2 outputs:result")
    expected = "is connected to itself; 'st' is used: </Looks/L/Turn>"
    description = read_with_warning(textures, texture(lines, turn), expected)
    assert len(description.textures) == 1


def test_missing_second_uv_primvar_is_reported(textures):
    file = "asset inputs:file = @./textures/color.png@\n"
    shaders = (
        shader(
            "Surface",
            "UsdPreviewSurface",
            "color3f inputs:diffuseColor.connect = </Looks/L/A.outputs:rgb>\n"
            "color3f inputs:emissiveColor.connect = </Looks/L/B.outputs:rgb>",
        )
        + shader(
            "A", "UsdUVTexture", file + "float2 inputs:st.connect = </Looks/L/R.outputs:result>", "float3 outputs:rgb"
        )
        + shader(
            "B", "UsdUVTexture", file + "float2 inputs:st.connect = </Looks/L/S.outputs:result>", "float3 outputs:rgb"
        )
        + shader("R", "UsdPrimvarReader_float2", 'string inputs:varname = "st"', "float2 outputs:result")
        + shader("S", "UsdPrimvarReader_float2", 'string inputs:varname = "map2"', "float2 outputs:result")
    )
    expected = "has no primvar 'map2', which its material reads; its texture coordinates are \\(0, 0\\): </M>"
    read_with_warning(textures, material(shaders, lines=ST), expected)


def test_subsets_read_different_uv_primvars(textures):
    """Each face carries the texture coordinates that its own material reads."""
    wraps = 'token inputs:wrapS = "repeat"\ntoken inputs:wrapT = "repeat"\n'
    file = f"asset inputs:file = @./textures/color.png@\n{wraps}"

    def look(name: str, primvar: str) -> str:
        path = f"/Looks/{name}"
        surface = shader("S", "UsdPreviewSurface", f"color3f inputs:diffuseColor.connect = <{path}/T.outputs:rgb>")
        image = shader(
            "T", "UsdUVTexture", file + f"float2 inputs:st.connect = <{path}/R.outputs:result>", "float3 outputs:rgb"
        )
        reader = shader("R", "UsdPrimvarReader_float2", f'string inputs:varname = "{primvar}"', "float2 outputs:result")
        output = f"token outputs:surface.connect = <{path}/S.outputs:surface>"
        return f'def Material "{name}"\n{{\n{output}\n{surface}{image}{reader}}}\n'

    body = f"""
def Mesh "M" (prepend apiSchemas = ["MaterialBindingAPI"])
{{
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    texCoord2f[] primvars:st = [(2, 2)] (interpolation = "constant")
    texCoord2f[] primvars:b = [(3, 3), (4, 4)] (interpolation = "uniform")
    rel material:binding = </Looks/A>
    def GeomSubset "S" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{
        uniform token familyName = "materialBind"
        int[] indices = [1]
        rel material:binding = </Looks/B>
    }}
}}
def Scope "Looks"
{{
{look("A", "st")}{look("B", "b")}
}}
"""
    (mesh,) = read(textures, body).meshes
    np.testing.assert_array_equal(mesh.uv[mesh.triangles[0]], np.full((3, 2), 2.0))
    np.testing.assert_array_equal(mesh.uv[mesh.triangles[1]], np.full((3, 2), 4.0))


IMAGE = 'asset inputs:file = @./textures/color.png@\ntoken inputs:wrapS = "clamp"\ntoken inputs:wrapT = "clamp"\n'


@pytest.mark.parametrize("name", ["st", "map1"])
def test_mesh_without_the_texture_coordinates_that_its_material_reads_is_named(textures, name):
    reader = shader("Reader", "UsdPrimvarReader_float2", f'string inputs:varname = "{name}"', "float2 outputs:result")
    body = texture(IMAGE + "float2 inputs:st.connect = </Looks/L/Reader.outputs:result>", reader)
    text = f"has no primvar '{name}', which its material reads; %s: </M>"
    read_with_warning(textures, body, text % r"its texture coordinates are \(0, 0\)")


@pytest.mark.parametrize("inside", [False, True])
def test_constant_texture_coordinates_read_one_point(textures, inside):
    point = "float2 inputs:%s = (0.25, 0.75)"
    transform = shader(
        "Move", "UsdTransform2d", point % "in" + "\nfloat2 inputs:scale = (2, 1)", "float2 outputs:result"
    )
    st = "float2 inputs:st.connect = </Looks/L/Move.outputs:result>" if inside else point % "st"
    lookup = only_material(read(textures, texture(IMAGE + st, transform if inside else ""))).diffuse_color
    assert lookup.uv_transform == (0, 0, 0.5 if inside else 0.25, 0, 0, 0.75)
