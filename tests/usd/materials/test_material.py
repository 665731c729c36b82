# SPDX-License-Identifier: Apache-2.0
"""Material bindings, UsdPreviewSurface networks, displayColor."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from tests.usd.helpers import QUAD, STAGES, preview_material, problems_of, read, read_with_warning, write
from tiscene.scene.description import Material, TextureLookup
from tiscene.usd.read.stage_reader import read_stage

PIXELS = np.arange(2 * 3 * 4, dtype=np.uint8).reshape(2, 3, 4) * 10


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


@pytest.mark.parametrize(
    ("gprim", "interpolation"),
    [("Cone", "uniform"), ("Sphere", "vertex"), ("Cube", "constant"), ("Mesh", "constant")],
)
def test_mean_of_several_display_colors_is_reported_where_no_face_can_have_its_own(tmp_path, gprim, interpolation):
    lines = f'color3f[] primvars:displayColor = [(1, 0, 0), (0, 0, 1)] (interpolation = "{interpolation}")'
    body = f'def {gprim} "M"\n{{\n{QUAD if gprim == "Mesh" else ""}\n{lines}\n}}'
    description = read_with_warning(tmp_path, body, "'displayColor' varies over the surface, its mean is used: </M>")
    assert description.materials[0].diffuse_color == (0.5, 0.0, 0.5)


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


def test_bindings_to_what_is_no_material_are_reported(tmp_path):
    bound = "".join(f'def Cube "{name}"\n{{\nrel material:binding = <{to}>\n}}\n' for name, to in BROKEN_BINDINGS)
    text = (
        "a binding to a material that does not exist is not applied: </A> to </Looks/Gone>, </B> to </Looks/Gone>\n"
        "  a binding to a prim that is no material is not applied: </C> to </Looks>$"
    )
    found = read_with_warning(tmp_path, 'def Scope "Looks"\n{\n}\n' + bound, text)
    assert {material.name for material in materials_of(found).values()} == {"displayColor"}


BROKEN_BINDINGS = [("A", "/Looks/Gone"), ("B", "/Looks/Gone"), ("C", "/Looks")]


def test_binding_that_a_reference_leaves_behind_is_not_reported(tmp_path):
    body = 'def Xform "Asset"\n{\ndef Cube "C"\n{\nrel material:binding = </Looks/M>\n}\n}\n'
    write(tmp_path, body + 'def Scope "Looks"\n{\n' + preview_material("/Looks/M") + "}\n", name="asset.usda")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(read(tmp_path, 'def "A" (references = @asset.usda@</Asset>)\n{\n}\n').instances) == 1


@pytest.mark.parametrize(("value", "color"), [("", (0.18, 0.18, 0.18)), (" = (1, 0, 0)", (1.0, 0.0, 0.0))])
def test_input_connected_to_nothing_is_reported(tmp_path, value, color):
    lines = f"color3f inputs:diffuseColor{value}\ncolor3f inputs:diffuseColor.connect = </M/Graph.outputs:out>"
    graph = 'def NodeGraph "Graph"\n{\ncolor3f outputs:out.connect = </M/Gone.outputs:rgb>\n}\n'
    lost = "</M/Graph.outputs:out> to </M/Gone.outputs:rgb>"
    for shaders, expected in ((graph, lost), ("", "</M/Surface.inputs:diffuseColor> to </M/Graph.outputs:out>")):
        body = f'def Mesh "A"\n{{\n{QUAD}\nrel material:binding = </M>\n}}\n'
        text = f"does not exist keeps its own value, else its default: {expected}$"
        found = read_with_warning(tmp_path, body + preview_material("/M", lines, shaders=shaders), text)
        if not shaders:
            assert materials_of(found)["A"].diffuse_color == pytest.approx(color)


def test_surface_shader_without_an_id_is_named_as_such(tmp_path):
    body = f'def Mesh "A"\n{{\n{QUAD}\nrel material:binding = </M>\n}}\n'
    material = preview_material("/M").replace('uniform token info:id = "UsdPreviewSurface"', "")
    read_with_warning(tmp_path, body + material, "a surface shader without info:id; displayColor is used: </M>$")


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


def test_surface_connected_to_an_output_that_does_not_exist_is_reported(tmp_path):
    body = material(PREVIEW.replace("token outputs:surface", ""))
    text = "surface is connected to an output that does not exist; its UsdPreviewSurface is used: </Looks/L>"
    assert only_material(read_with_warning(tmp_path, body, text)).diffuse_color == (1.0, 0.0, 0.0)


READS_TINT = shader("Reader", "UsdPrimvarReader_float3", 'string inputs:varname = "tint"', "float3 outputs:result")
READS_TINT += shader(
    "Surface", "UsdPreviewSurface", "color3f inputs:diffuseColor.connect = </Looks/L/Reader.outputs:result>"
)


def test_primvar_of_a_material_is_read_where_the_gprim_has_none(tmp_path):
    body = material("color3f primvars:tint = (0.25, 0.5, 1)\n" + READS_TINT)
    assert only_material(read(tmp_path, body)).diffuse_color == (0.25, 0.5, 1.0)
    own = body.replace("displayColor = [", "other = [").replace(QUAD, QUAD + "\ncolor3f primvars:tint = (1, 0, 0)")
    assert only_material(read(tmp_path, own)).diffuse_color == (1.0, 0.0, 0.0)


def test_primvar_of_a_subset_is_named(tmp_path):
    subset = """
    def GeomSubset "S"
    {
        int[] indices = [0]
        uniform token familyName = "materialBind"
        color3f primvars:tint = (1, 0, 0)
    }"""
    body = material(READS_TINT).replace(QUAD, QUAD + "color3f primvars:tint = (0, 0, 1)" + subset)
    description = read_with_warning(tmp_path, body, "primvars:tint of a subset is not read: its mesh's is: </M/S>")
    assert only_material(description).diffuse_color == (0.0, 0.0, 1.0)


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


@pytest.mark.parametrize("value", ["0", "-1"])
def test_index_of_refraction_that_is_not_above_zero_is_a_problem(tmp_path, value):
    body = material(shader("Surface", "UsdPreviewSurface", f"float inputs:ior = {value}"))
    assert problems_of(tmp_path, body) == (f"</Looks/L/Surface> ior: {float(value)} is not above 0",)


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


@pytest.mark.parametrize(
    ("interpolation", "values"),
    [
        ("vertex", "(1, 0, 0), (1, 0, 0), (1, 0, 0)"),
        ("faceVarying", "(1, 0, 0), (1, 0, 0), (1, 0, 0)"),
        ("uniform", "(1, 0, 0), (0, 1, 0), (0, 0, 1)"),
    ],
)
def test_display_color_of_a_wrong_count_is_not_used(tmp_path, interpolation, values):
    line = f'color3f[] primvars:displayColor = [{values}] (interpolation = "{interpolation}")'
    body = f'def Mesh "M"\n{{\n{QUAD}\n{line}\n}}'
    description = read_with_warning(tmp_path, body, f"displayColor: 3 values, but {interpolation}.*is not used: </M>$")
    assert only_material(description).diffuse_color == (0.18, 0.18, 0.18)


@pytest.mark.parametrize(
    ("type_", "reader", "values"),
    [("float[]", "float", ("0.125", "0.75")), ("color4f[]", "float4", ("(0.125, 0, 0, 1)", "(0.75, 0, 0, 1)"))],
)
def test_meshes_that_share_a_material_have_their_own_primvars(tmp_path, type_, reader, values):
    source = "color3f inputs:diffuseColor.connect = </Looks/L/P.outputs:result>"
    read_by = shader("P", f"UsdPrimvarReader_{reader}", 'string inputs:varname = "tone"', f"{reader} outputs:result")
    body = material(shader("Surface", "UsdPreviewSurface", source) + read_by)
    start, end = body.index("def Mesh"), body.index("def Scope")
    meshes = ""
    for name, value in zip("AB", values, strict=True):
        line = f'{type_} primvars:tone = [{value}] (interpolation = "constant")\n'
        mesh = body[start:end].replace('"M"', f'"{name}"')
        meshes += mesh.replace("rel material:binding", line + "rel material:binding")
    found = materials_of(read(tmp_path, meshes + body[end:]))
    assert [found[name].diffuse_color[0] for name in "AB"] == [0.125, 0.75]


def test_whole_numbers_are_read_from_a_primvar(tmp_path):
    source = "int inputs:useSpecularWorkflow.connect = </Looks/L/P.outputs:result>"
    read_by = shader("P", "UsdPrimvarReader_int", 'string inputs:varname = "specular"', "int outputs:result")
    body = material(shader("Surface", "UsdPreviewSurface", source) + read_by, lines="int primvars:specular = 1")
    assert only_material(read(tmp_path, body)).use_specular_workflow
