# SPDX-License-Identifier: Apache-2.0
"""Vertex colors and second uv sets: interpolation over faces, checked pixel by pixel."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from PIL import Image

import tiscene as ts
from tests.usd.helpers import primvar_reader, read, read_with_warning, write
from tiscene.scene.description import VERTEX_COLORS, TextureLookup

QUAD = """
def Mesh "M" (%s)
{
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    %s
}
"""
# Linear over the plane: red grows along +x, green along +y, blue falls along +x.
COLORS = 'color3f[] primvars:displayColor = [(0, 0, 1), (1, 0, 0), (1, 1, 0), (0, 1, 1)] (interpolation = "%s")'
READER = """
def Material "Look"
{
    token outputs:surface.connect = </Look/Surface.outputs:surface>
    def Shader "Surface"
    {
        uniform token info:id = "UsdPreviewSurface"
        token outputs:surface
        float inputs:roughness = 1
        %s
    }
    %s
}
"""
BOUND = 'prepend apiSchemas = ["MaterialBindingAPI"]'


def albedo(path, width=40, height=40, buffers=("albedo", "instance")):
    """Render the quad with an orthographic camera of height 2 m: pixel centers at -0.975 .. 0.975."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        camera = ts.Camera(position=(0, 0, 3), orthographic_height=2.0)
        return ts.Stream(path, width=width, height=height, buffers=buffers, camera=camera)[0]


def expected(size=40):
    at = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(at, at[::-1])
    return u, v


@pytest.mark.parametrize("interpolation", ["vertex", "varying", "faceVarying"])
def test_display_color_interpolates_over_faces(tmp_path, interpolation):
    frame = albedo(write(tmp_path, QUAD % ("", COLORS % interpolation)))
    u, v = expected()
    np.testing.assert_allclose(frame.albedo, np.stack([u, v, 1.0 - u], axis=-1), atol=1e-5)


def test_face_varying_display_color_keeps_sharp_edges(tmp_path):
    """Two faces share an edge and have different colors along it; neither bleeds across."""
    body = """
def Mesh "M"
{
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
    point3f[] points = [(-1, -1, 0), (0, -1, 0), (1, -1, 0), (-1, 1, 0), (0, 1, 0), (1, 1, 0)]
    color3f[] primvars:displayColor = [(1, 0, 0), (0, 0, 1)] (interpolation = "faceVarying")
    int[] primvars:displayColor:indices = [0, 0, 0, 0, 1, 1, 1, 1]
}
"""
    frame = albedo(write(tmp_path, body))
    np.testing.assert_allclose(frame.albedo[:, :20], np.broadcast_to((1, 0, 0), (40, 20, 3)), atol=1e-6)
    np.testing.assert_allclose(frame.albedo[:, 20:], np.broadcast_to((0, 0, 1), (40, 20, 3)), atol=1e-6)


def test_display_opacity_interpolates_over_faces(tmp_path):
    """Opacity is coverage; labels see a surface of opacity above 0.5."""
    opacity = 'float[] primvars:displayOpacity = [0, 1, 1, 0] (interpolation = "vertex")'
    path = write(tmp_path, QUAD % ("", opacity))
    (mesh,) = read(tmp_path, QUAD % ("", opacity)).meshes
    np.testing.assert_allclose(mesh.colors[:, :3], 0.18)
    frame = albedo(path)
    u, _ = expected()
    np.testing.assert_array_equal(frame.instance == 1, u > 0.5)


@pytest.mark.parametrize("interpolation", ["constant", "uniform"])
def test_opacity_applies_beside_colors_of_points(tmp_path, interpolation):
    """Labels see a surface of opacity above 0.5, and 0.25 is below."""
    opacity = f'float[] primvars:displayOpacity = [0.25] (interpolation = "{interpolation}")'
    path = write(tmp_path, QUAD % ("", COLORS % "vertex" + "\n    " + opacity))
    assert not albedo(path).instance.any()


def test_opacity_of_faces_applies_beside_colors_of_points(tmp_path):
    opacity = 'float[] primvars:displayOpacity = [0.25, 0.75] (interpolation = "uniform")'
    triangles = QUAD.replace("[4]", "[3, 3]").replace("[0, 1, 2, 3]", "[0, 1, 2, 0, 2, 3]")
    frame = albedo(write(tmp_path, triangles % ("", COLORS % "vertex" + "\n    " + opacity)))
    u, v = expected()
    np.testing.assert_array_equal(frame.instance[v > u + 0.01], 1)
    np.testing.assert_array_equal(frame.instance[v < u - 0.01], 0)


def test_instances_inherit_their_own_opacity_beside_colors_of_points(tmp_path):
    body = "class " + f'Xform "Proto"\n{{\n{QUAD % ("", COLORS % "vertex")}\n}}\n'
    for name, value in (("Solid", 0.75), ("Faint", 0.25)):
        body += f"""def Xform "{name}" (
    instanceable = true
    inherits = </Proto>
)
{{
    float[] primvars:displayOpacity = [{value}] (interpolation = "constant")
}}
"""
    description = read(tmp_path, body)
    found = [description.materials[description.meshes[each.mesh].materials[0]] for each in description.instances]
    assert [each.opacity for each in found] == [0.75, 0.25]


def test_opacity_that_varies_over_time_is_reported_beside_colors_of_points(tmp_path):
    opacity = "float[] primvars:displayOpacity.timeSamples = { 0: [1], 5: [0.5] }"
    body = QUAD % ("", COLORS % "vertex" + "\n    " + opacity)
    read_with_warning(tmp_path, body, "primvars:displayOpacity of a Mesh")


def test_display_color_interpolates_over_subdivided_mesh(tmp_path):
    body = (QUAD % ("", COLORS % "vertex")).replace('"none"', '"catmullClark"')
    frame = albedo(write(tmp_path, body))
    u, v = expected()
    hit = frame.instance == 1
    assert hit.mean() > 0.7
    inside = (np.abs(u - 0.5) < 0.3) & (np.abs(v - 0.5) < 0.3)
    assert np.corrcoef(frame.albedo[inside][:, 0], u[inside])[0, 1] > 0.999
    np.testing.assert_allclose(frame.albedo[hit][:, 0] + frame.albedo[hit][:, 2], 1.0, atol=1e-5)


@pytest.mark.parametrize(("kind", "type"), [("float3", "color3f"), ("float4", "color4f")])
def test_material_reads_varying_color_primvar(tmp_path, kind, type):
    surface = "color3f inputs:diffuseColor.connect = </Look/Reader.outputs:result>"
    reader = primvar_reader(kind, "Cd")
    values = [(0, 0, 1), (1, 0, 0), (1, 1, 0), (0, 1, 1)]
    values = [(*value, 1) for value in values] if kind == "float4" else values
    mesh = QUAD % (
        BOUND,
        f'{type}[] primvars:Cd = {values} (interpolation = "vertex")\n rel material:binding = </Look>',
    )
    frame = albedo(write(tmp_path, READER % (surface, reader) + mesh))
    u, v = expected()
    np.testing.assert_allclose(frame.albedo, np.stack([u, v, 1.0 - u], axis=-1), atol=1e-5)


@pytest.mark.parametrize(("interpolation", "count"), [("constant", 1), ("vertex", 4)])
def test_one_color_with_alpha_is_read_as_a_color(tmp_path, interpolation, count):
    """Blender writes color attributes as color4f, and reads them as float3."""
    surface = "color3f inputs:diffuseColor.connect = </Look/Reader.outputs:result>"
    reader = primvar_reader("float3", "Cd")
    color = f'color4f[] primvars:Cd = {[(0.5, 0.25, 0, 0.5)] * count} (interpolation = "{interpolation}")'
    mesh = QUAD % (BOUND, color + "\n rel material:binding = </Look>")
    description = read(tmp_path, READER % (surface, reader) + mesh)
    assert description.materials[0].diffuse_color == (0.5, 0.25, 0.0)


@pytest.mark.parametrize("interpolation", ["constant", "uniform"])
def test_display_color_with_alpha_is_read_as_a_color(tmp_path, interpolation):
    """The type that USD gives the attribute is that of its schema, color3f, whatever a file says."""
    color = f'color4f[] primvars:displayColor = [(0.5, 0.25, 0, 0.5)] (interpolation = "{interpolation}")'
    description = read(tmp_path, QUAD % ("", color))
    assert [description.materials[row].diffuse_color for row in description.meshes[0].materials] == [(0.5, 0.25, 0)] * 2


def test_display_color_of_two_numbers_is_named(tmp_path):
    text = "primvar 'displayColor' has no 3 numbers in each value; it is not used: </M>"
    mesh = QUAD % ("", "float2[] primvars:displayColor = [(1, 0)]")
    assert read_with_warning(tmp_path, mesh, text).materials[0].diffuse_color == (0.18, 0.18, 0.18)


def test_meshes_with_and_without_color_primvar_share_a_network(tmp_path):
    """Constant, uniform and vertex colors, and none: the primvar reader's fallback."""
    surface = "color3f inputs:diffuseColor.connect = </Look/Reader.outputs:result>"
    reader = primvar_reader("float3", "Cd", "float3 inputs:fallback = (0.1, 0.2, 0.3)")
    colors = [
        'color3f[] primvars:Cd = [(0.5, 0.25, 0)] (interpolation = "constant")',
        'color3f[] primvars:Cd = [(0.5, 0.25, 0)] (interpolation = "uniform")',
        'color3f[] primvars:Cd = [(0, 0, 1), (1, 0, 0), (1, 1, 0), (0, 1, 1)] (interpolation = "vertex")',
        "",
    ]
    bind = "\n rel material:binding = </Look>"
    meshes = "".join((QUAD % (BOUND, each + bind)).replace('"M"', f'"M{row}"') for row, each in enumerate(colors))
    description = read(tmp_path, READER % (surface, reader) + meshes)
    looks = [description.materials[description.meshes[each.mesh].materials[0]] for each in description.instances]
    assert [look.diffuse_color for look in looks] == [
        (0.5, 0.25, 0.0), (0.5, 0.25, 0.0), TextureLookup(VERTEX_COLORS), pytest.approx((0.1, 0.2, 0.3)),
    ]  # fmt: skip
    assert [description.meshes[each.mesh].colors is None for each in description.instances] == [True, True, False, True]


def test_material_reads_varying_float_primvar(tmp_path):
    surface = "float inputs:metallic.connect = </Look/Reader.outputs:result>"
    reader = primvar_reader("float", "wear")
    wear = 'float[] primvars:wear = [0, 1, 1, 0] (interpolation = "vertex")\n rel material:binding = </Look>'
    frame = albedo(write(tmp_path, READER % (surface, reader) + QUAD % (BOUND, wear)), buffers=("metallic",))
    np.testing.assert_allclose(frame.metallic, expected()[0], atol=1e-5)


SCALED = """
    def Shader "Image"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @./ramp.png@
        token inputs:sourceColorSpace = "raw"
        token inputs:wrapS = "repeat"
        token inputs:wrapT = "repeat"
        float4 inputs:scale.connect = </Look/Reader.outputs:result>
        %s
        float3 outputs:rgb
        float outputs:a
    }
    def Shader "Reader"
    {
        uniform token info:id = "UsdPrimvarReader_float4"
        string inputs:varname = "Cd"
        float4 outputs:result
    }"""


def scaled(folder, colors, interpolation, output="rgb", more=""):
    """Return a quad whose base color is a ramp from left to right, scaled by the primvar Cd."""
    ramp = np.tile(np.linspace(0, 255, 256).astype(np.uint8), (4, 1))
    Image.fromarray(np.dstack([ramp, ramp, ramp, ramp])).save(folder / "ramp.png")
    target = "color3f inputs:diffuseColor" if output == "rgb" else "float inputs:metallic"
    st = 'texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")'
    cd = f'color4f[] primvars:Cd = {colors} (interpolation = "{interpolation}")\n rel material:binding = </Look>'
    look = READER % (f"{target}.connect = </Look/Image.outputs:{output}>", SCALED % more)
    return look + QUAD % (BOUND, f"{st}\n {cd}")


def test_colors_of_vertices_scale_a_texture(tmp_path):
    colors = [(0, 0, 1, 1), (1, 0, 0, 1), (1, 1, 0, 1), (0, 1, 1, 1)]
    path = write(tmp_path, scaled(tmp_path, colors, "vertex"))
    u, v = expected()
    frame = albedo(path)
    inner = slice(1, -1)  # the ramp repeats
    np.testing.assert_allclose(frame.albedo[:, inner], np.dstack([u * u, u * v, u * (1 - u)])[:, inner], atol=0.004)


def test_constant_primvar_scales_a_texture(tmp_path):
    (material,) = read(tmp_path, scaled(tmp_path, [(0.5, 0.25, 1, 0.75)], "constant")).materials
    assert (material.diffuse_color.scale, material.diffuse_color.vertex_factor) == ((0.5, 0.25, 1.0, 0.75), "")


@pytest.mark.parametrize(("output", "more"), [("a", ""), ("rgb", "float4 inputs:bias = (0.5, 0, 0, 0)")])
def test_scale_by_colors_of_vertices_that_does_not_fit_is_reported(tmp_path, output, more):
    colors = [(0, 0, 1, 1), (1, 0, 0, 1), (1, 1, 0, 1), (0, 1, 1, 1)]
    body = scaled(tmp_path, colors, "vertex", output, more)
    read_with_warning(tmp_path, body, "scale of a texture cannot be read from this shader.*: </Look/Reader>")


TEXTURES = """
    def Shader "A"
    {
        uniform token info:id = "UsdUVTexture"
        float4 inputs:scale = (0.4, 1, 1, 1)
        asset inputs:file = @./ramp.png@
        token inputs:sourceColorSpace = "raw"
        token inputs:wrapS = "clamp"
        token inputs:wrapT = "clamp"
        float2 inputs:st.connect = </Look/%s.outputs:result>
        float outputs:r
    }
    def Shader "B"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @./ramp.png@
        token inputs:sourceColorSpace = "raw"
        token inputs:wrapS = "clamp"
        token inputs:wrapT = "clamp"
        float2 inputs:st.connect = </Look/%s.outputs:result>
        float outputs:r
    }
    def Shader "One"
    {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }
    def Shader "Two"
    {
        uniform token info:id = "UsdPrimvarReader_float2"
        token inputs:varname = "st1"
        float2 outputs:result
    }"""
TWO_INPUTS = """float inputs:metallic.connect = </Look/A.outputs:r>
        float inputs:roughness.connect = </Look/B.outputs:r>"""
UVS = """
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
    texCoord2f[] primvars:st1 = [(0, 0), (0, 1), (1, 1), (1, 0)] (interpolation = "faceVarying")
    rel material:binding = </Look>"""


@pytest.mark.parametrize(("a", "b"), [("One", "Two"), ("Two", "One"), ("Two", "Two")])
def test_two_textures_read_two_uv_sets(tmp_path, a, b):
    """The ramp runs left to right in the first uv set and bottom to top in the second, which is transposed."""
    Image.fromarray(np.tile(np.linspace(0, 255, 256).astype(np.uint8), (4, 1))).save(tmp_path / "ramp.png")
    surface = TWO_INPUTS
    body = READER.replace("float inputs:roughness = 1", "") % (surface, TEXTURES % (a, b)) + QUAD % (BOUND, UVS)
    frame = albedo(write(tmp_path, body), buffers=("metallic", "roughness"))
    u, v = expected()
    ramp = {"One": u, "Two": v}
    np.testing.assert_allclose(frame.metallic, 0.4 * ramp[a], atol=0.005)
    np.testing.assert_allclose(frame.roughness, ramp[b], atol=0.005)


def test_deforming_mesh_keeps_its_vertex_colors(tmp_path):
    moving = """point3f[] points.timeSamples = {
        0: [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], 24: [(-3, -1, 0), (1, -1, 0), (1, 1, 0), (-3, 1, 0)] }"""
    body = (QUAD % ("", COLORS % "vertex")).replace(
        "point3f[] points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]", moving
    )
    path = write(tmp_path, body)
    camera = ts.Camera(position=(0, 0, 3), orthographic_height=2.0)
    frame = ts.Stream(path, width=40, height=40, buffers=("albedo",), camera=camera, fps=24.0)[24]
    u, v = expected()
    np.testing.assert_allclose(frame.albedo[..., 0], 0.5 + 0.5 * u, atol=1e-5)
    np.testing.assert_allclose(frame.albedo[..., 1], v, atol=1e-5)


def test_third_uv_set_is_reported(tmp_path):
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / "ramp.png")
    third = TEXTURES % ("One", "Two") + (
        TEXTURES[: TEXTURES.index('    def Shader "B"')].replace('"A"', '"C"') % "Three"
        + TEXTURES[TEXTURES.index('    def Shader "Two"') :].replace('"Two"', '"Three"').replace("st1", "st2")
    )
    surface = TWO_INPUTS + "\n float inputs:clearcoat.connect = </Look/C.outputs:r>"
    body = READER.replace("float inputs:roughness = 1", "") % (surface, third) + QUAD % (BOUND, UVS)
    read_with_warning(tmp_path, body, "textures read the uv sets 'st', 'st1' and 'st2'; 'st' is used for the third")


def test_path_pass_shades_with_vertex_colors(tmp_path):
    """The path pass reads vertex colors as the label pass does: a floor under a uniform sky shows them."""
    sky = 'def DomeLight "Sky"\n{\n float inputs:intensity = 1\n}\n'
    path = write(tmp_path, sky + QUAD % ("", COLORS % "vertex"))
    camera = ts.Camera(position=(0, 0, 3), orthographic_height=2.0)
    stream = ts.Stream(path, width=8, height=8, buffers=("hdr",), camera=camera, spp=256, max_depth=2)
    u, v = expected(8)
    hdr = stream[0].hdr
    for channel, value in enumerate((u, v, 1.0 - u)):
        slope, offset = np.polyfit(value.ravel(), hdr[..., channel].ravel(), 1)
        assert slope == pytest.approx(1.0, rel=0.06)  # with the specular reflection
        assert 0.0 <= offset < 0.1
