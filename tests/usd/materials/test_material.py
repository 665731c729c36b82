# SPDX-License-Identifier: Apache-2.0
"""Material bindings, UsdPreviewSurface networks, textures, UDIM, displayColor."""

from __future__ import annotations

import shutil

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from tests.usd.helpers import QUAD, STAGES, problems_of, read, read_with_warning, write
from tiscene.scene.description import Material, TextureLookup
from tiscene.usd.read.stage_reader import read_stage

PIXELS = np.arange(2 * 3 * 4, dtype=np.uint8).reshape(2, 3, 4) * 10


@pytest.fixture
def textures(tmp_path):
    (tmp_path / "textures").mkdir()
    shutil.copy(STAGES / "textures" / "color.png", tmp_path / "textures")
    return tmp_path


def materials_of(description) -> dict[str, Material]:
    return {
        description.objects[i.object].name: description.materials[description.meshes[i.mesh].materials[0]]
        for i in description.instances
    }


@pytest.fixture
def description():
    return read_stage(STAGES / "materials.usda")


def test_bindings_by_inheritance_collection_and_purpose(description):
    names = {path: material.name for path, material in materials_of(description).items()}
    assert names == {
        "Inherits": "Plain",
        "Binds": "Textured",
        "Overruled": "Plain",
        "Bare": "displayColor",
        "Colored": "displayColor",
    }
    assert len(description.materials) == 4


def test_constant_inputs_are_read(description):
    plain = materials_of(description)["Inherits"]
    assert plain == Material(
        "Plain",
        diffuse_color=(0.75, 0.5, 0.25),
        use_specular_workflow=True,
        specular_color=(0.5, 0.25, 0.125),
        prim_path="/Looks/Plain",
    )


def test_network_of_textures_is_read(description):
    material = materials_of(description)["Binds"]
    assert material.diffuse_color == TextureLookup(
        0, "rgb", (0.5, 0.5, 0.5, 1.0), (0.25, 0.25, 0.25, 0.0), pytest.approx((0, -3, 0.5, 2, 0, 0.25))
    )
    assert material.opacity == TextureLookup(
        0, "a", (0.5, 0.5, 0.5, 1.0), (0.25, 0.25, 0.25, 0.0), material.diffuse_color.uv_transform
    )
    assert material.metallic == TextureLookup(1, "b")
    assert material.normal == TextureLookup(1, "rgb", (2.0, 2.0, 2.0, 1.0), (-1.0, -1.0, -1.0, 0.0))
    assert material.roughness == 0.25  # through the material's interface
    assert material.emissive_color == (1.0, 2.0, 3.0)
    assert (material.clearcoat, material.clearcoat_roughness, material.ior) == (0.5, 0.125, 1.25)
    assert (material.opacity_threshold, material.opacity_mode) == (0.5, "presence")


def test_materials_share_textures(description):
    color, raw = description.textures
    assert (color.encoding, color.wrap_s, color.wrap_t) == ("srgb", "repeat", "mirror")
    assert (raw.encoding, raw.wrap_s, raw.wrap_t) == ("raw", "black", "black")
    np.testing.assert_array_equal(color.pixels, PIXELS)
    assert raw.pixels is color.pixels


def test_mesh_has_uv_that_its_material_reads(description):
    by_name = {description.objects[i.object].name: description.meshes[i.mesh] for i in description.instances}
    np.testing.assert_array_equal(by_name["Binds"].uv, by_name["Binds"].positions[:, :2])
    assert not by_name["Bare"].uv.any()


def test_constant_display_color_becomes_material(description):
    assert materials_of(description)["Bare"] == Material("displayColor")
    assert materials_of(description)["Colored"] == Material(
        "displayColor", diffuse_color=(0.25, 0.5, 0.75), opacity=0.5, opacity_mode="presence"
    )


TWO_FACES = """
def Mesh "M"
{
    uniform token subdivisionScheme = "%s"
    int[] faceVertexCounts = [4, 3]
    int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0.5, 0)]
    %s
}
"""


@pytest.mark.parametrize("scheme", ["none", "catmullClark"])
@pytest.mark.parametrize(
    "lines",
    [
        'color3f[] primvars:displayColor = [(1, 0, 0), (0, 0, 1)] (interpolation = "uniform")',
        'color3f[] primvars:displayColor = [(0, 0, 1), (1, 0, 0)] (interpolation = "uniform")\n'
        "int[] primvars:displayColor:indices = [1, 0]",
    ],
)
def test_uniform_display_color_becomes_material_per_face(tmp_path, scheme, lines):
    opacity = 'float[] primvars:displayOpacity = [1, 0.5] (interpolation = "uniform")'
    description = read(tmp_path, TWO_FACES % (scheme, f"{lines}\n{opacity}"))
    (mesh,) = description.meshes
    middle = mesh.positions[mesh.triangles].mean(axis=1)
    for x, material in zip(middle[:, 0], (description.materials[row] for row in mesh.materials), strict=True):
        left = x < 1.0
        assert material.diffuse_color == ((1.0, 0.0, 0.0) if left else (0.0, 0.0, 1.0))
        assert (material.opacity, material.opacity_mode) == ((1.0, "transparent") if left else (0.5, "presence"))


def test_colors_are_quantized_to_a_limited_number_of_materials():
    from tiscene.usd.geometry.display_color import quantize_colors

    values = np.random.default_rng(3).random((20000, 4))
    colors, groups = quantize_colors(values)
    assert len(colors) <= 4096
    assert sorted(np.concatenate(groups).tolist()) == list(range(20000))
    worst = max(np.abs(values[group] - color).max() for color, group in zip(colors, groups, strict=True))
    assert worst < 0.2


def test_display_color_is_inherited(tmp_path):
    body = 'def Xform "X"\n{\ncolor3f[] primvars:displayColor = [(1, 0.5, 0)]\ndef Cube "C"\n{\n}\n}'
    assert read(tmp_path, body).materials[0].diffuse_color == (1.0, 0.5, 0.0)


def material(shaders: str, connect: str = "Surface.outputs:surface", lines: str = "") -> str:
    """Return a stage body: a quad with one material."""
    return f"""
def Mesh "M" (prepend apiSchemas = ["MaterialBindingAPI"])
{{
    {QUAD}
    {lines}
    rel material:binding = </Looks/L>
    color3f[] primvars:displayColor = [(0, 0.5, 0)]
}}
def Scope "Looks"
{{
    def Material "L"
    {{
        token outputs:surface.connect = </Looks/L/{connect}>
        {shaders}
    }}
}}
"""


def shader(name: str, id_: str, lines: str = "", output: str = "token outputs:surface") -> str:
    return f'def Shader "{name}"\n{{\nuniform token info:id = "{id_}"\n{lines}\n{output}\n}}\n'


PREVIEW = shader("Surface", "UsdPreviewSurface", "color3f inputs:diffuseColor = (1, 0, 0)")


def only_material(description) -> Material:
    (result,) = description.materials
    return result


def test_unknown_shader_falls_back_to_display_color(tmp_path):
    description = read_with_warning(tmp_path, material(shader("Surface", "MyToon")), "shader 'MyToon' is not supported")
    assert only_material(description).diffuse_color == (0.0, 0.5, 0.0)


def test_unknown_shader_falls_back_to_preview_surface_of_material(tmp_path):
    body = material(shader("Toon", "MyToon") + PREVIEW, "Toon.outputs:surface")
    description = read_with_warning(
        tmp_path, body, "'MyToon' is not supported; its UsdPreviewSurface is used: </Looks/L>"
    )
    assert only_material(description).diffuse_color == (1.0, 0.0, 0.0)


def test_universal_surface_output_is_read(tmp_path):
    body = material(shader("Ri", "PxrSurface") + PREVIEW).replace(
        "token outputs:surface.connect", "token outputs:ri:surface.connect = </Looks/L/Ri.outputs:surface>\n"
        "        token outputs:surface.connect", 1
    )  # fmt: skip
    path = write(tmp_path, body)
    assert only_material(read_stage(path)).diffuse_color == (1.0, 0.0, 0.0)


def test_material_without_surface_shader_is_reported(tmp_path):
    body = material("").replace("token outputs:surface.connect = </Looks/L/Surface.outputs:surface>", "")
    description = read_with_warning(tmp_path, body, "a material without a surface shader")
    assert only_material(description).diffuse_color == (0.0, 0.5, 0.0)


def test_materialx_names_of_preview_nodes_are_read(tmp_path):
    body = material(shader("Surface", "ND_UsdPreviewSurface_surfaceshader", "float inputs:roughness = 0.125"))
    assert only_material(read(tmp_path, body)).roughness == 0.125


def test_displacement_is_reported(tmp_path):
    body = material(shader("Surface", "UsdPreviewSurface", "float inputs:displacement = 0.5"))
    read_with_warning(tmp_path, body, "displacement is not applied: </Looks/L/Surface>")


def test_constant_primvar_gives_color(tmp_path):
    reader = shader(
        "Reader", "UsdPrimvarReader_float3", 'string inputs:varname = "displayColor"', "float3 outputs:result"
    )
    surface = shader(
        "Surface", "UsdPreviewSurface", "color3f inputs:diffuseColor.connect = </Looks/L/Reader.outputs:result>"
    )
    body = material(reader + surface)
    body += body[: body.index("def Scope")].replace('"M"', '"N"').replace("(0, 0.5, 0)", "(0, 0, 1)")
    colors = {name: m.diffuse_color for name, m in materials_of(read(tmp_path, body)).items()}
    assert colors == {"M": (0.0, 0.5, 0.0), "N": (0.0, 0.0, 1.0)}


def test_missing_primvar_gives_reader_fallback(tmp_path):
    reader = shader(
        "Reader",
        "UsdPrimvarReader_float",
        'string inputs:varname = "shine"\nfloat inputs:fallback = 0.75',
        "float outputs:result",
    )
    surface = shader(
        "Surface", "UsdPreviewSurface", "float inputs:roughness.connect = </Looks/L/Reader.outputs:result>"
    )
    assert only_material(read(tmp_path, material(reader + surface))).roughness == 0.75


def test_unknown_nodes_are_reported(tmp_path):
    surface = shader(
        "Surface", "UsdPreviewSurface", "color3f inputs:diffuseColor.connect = </Looks/L/Noise.outputs:result>"
    )
    noise = shader("Noise", "PerlinNoise", output="float3 outputs:result")
    description = read_with_warning(
        tmp_path, material(surface + noise), "'PerlinNoise'.*diffuseColor keeps its default.*</Looks/L/Noise>"
    )
    assert only_material(description).diffuse_color == (0.18, 0.18, 0.18)


def test_non_finite_inputs_are_problems(tmp_path):
    body = material(shader("Surface", "UsdPreviewSurface", "float inputs:roughness = nan"))
    assert problems_of(tmp_path, body) == ("</Looks/L/Surface> roughness: nan is not a finite number",)


def texture(lines: str, read_by: str = "") -> str:
    surface = shader(
        "Surface", "UsdPreviewSurface", "color3f inputs:diffuseColor.connect = </Looks/L/Image.outputs:rgb>"
    )
    return material(surface + shader("Image", "UsdUVTexture", lines, "float3 outputs:rgb") + read_by)


FALLBACK = "float4 inputs:fallback = (0.5, 0.25, 0, 1)\n"


def test_missing_texture_file_gives_fallback(tmp_path):
    body = texture(FALLBACK + "asset inputs:file = @./gone.png@")
    expected = r"there is no texture @./gone.png@ \(named in .*stage.usda\); its fallback is used: </Looks/L/Image>"
    assert only_material(read_with_warning(tmp_path, body, expected)).diffuse_color == (0.5, 0.25, 0.0)


def test_damaged_texture_file_gives_fallback(tmp_path):
    (tmp_path / "bad.png").write_bytes(b"\x89PNG\r\n\x1a\n but no more of it than this")
    body = texture(FALLBACK + "asset inputs:file = @./bad.png@")
    expected = "texture @.*bad.png@ cannot be read .*; its fallback is used: </Looks/L/Image>"
    assert only_material(read_with_warning(tmp_path, body, expected)).diffuse_color == (0.5, 0.25, 0.0)


@pytest.mark.parametrize("file", ["", "asset inputs:file", "asset inputs:file = @@"])
def test_texture_without_file_gives_fallback_and_is_reported(tmp_path, file):
    expected = "a UsdUVTexture without a file; its fallback is used: </Looks/L/Image>"
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


def test_connected_scale_is_reported(textures):
    lines = "asset inputs:file = @./textures/color.png@\nfloat4 inputs:scale.connect = </Looks/L/R.outputs:result>"
    reader = shader("R", "UsdPrimvarReader_float4", 'string inputs:varname = "s"', "float4 outputs:result")
    description = read_with_warning(textures, texture(lines, reader), "scale of a texture cannot come from a shader")
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


def test_udim_image_begins_at_first_tile(tmp_path):
    Image.new("L", (2, 2), 7).save(tmp_path / "t.1013.png")
    description = read(tmp_path, texture("asset inputs:file = @./t.<UDIM>.png@"))
    lookup = only_material(description).diffuse_color
    np.testing.assert_allclose(lookup.uv_transform, (1, 0, -2, 0, 1, -1))


def test_udim_path_without_dot_slash_is_relative_to_layer(tmp_path):
    (tmp_path / "maps").mkdir()
    Image.new("L", (2, 2), 7).save(tmp_path / "maps" / "t.1001.png")
    assert len(read(tmp_path, texture("asset inputs:file = @maps/t.<UDIM>.png@")).textures) == 1


def test_udim_without_tiles_is_reported(tmp_path):
    body = texture(FALLBACK + "asset inputs:file = @./tiles.<UDIM>.png@")
    description = read_with_warning(tmp_path, body, "there are no tiles @./tiles.<UDIM>.png@.*its fallback is used")
    assert only_material(description).diffuse_color == (0.5, 0.25, 0.0)


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
    description = read_with_warning(textures, body, "no primvar 'UVMap'.*</M>")
    np.testing.assert_array_equal(description.meshes[0].uv, description.meshes[0].positions[:, :2])


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
    read_with_warning(
        textures, material(shaders), "has no primvar 'map2', which its material reads; 'st' is used instead: </M>"
    )


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


def test_mesh_light_emits(tmp_path):
    body = f"""
def Mesh "M" (prepend apiSchemas = ["MeshLightAPI"])
{{
    {QUAD}
    float inputs:intensity = 2
    float inputs:exposure = 1
    color3f inputs:color = (1, 0.5, 0)
}}
"""
    emitter = only_material(read(tmp_path, body))
    assert emitter.emissive_color == (4.0, 2.0, 0.0)
    assert emitter.diffuse_color == (0.0, 0.0, 0.0)
