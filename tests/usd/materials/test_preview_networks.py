# SPDX-License-Identifier: Apache-2.0
"""UsdPreviewSurface behind interfaces, node graphs and arcs, and which of several bindings counts."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from tests.usd.helpers import write
from tiscene.scene.description import Material, TextureLookup
from tiscene.usd.read.stage_reader import read_stage

RED, GREEN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
SURFACE = """def Shader "S"
{{
    uniform token info:id = "UsdPreviewSurface"
    color3f inputs:diffuseColor{color}
    float inputs:roughness = 0.25
    token outputs:surface
}}
"""
READER = """def Shader "R"
{
    uniform token info:id = "UsdPrimvarReader_float2"
    token inputs:varname.connect = </A.inputs:frame:stPrimvarName>
    float2 outputs:result
}
"""


def material(name: str, color: str, more: str = "", kind: str = "def") -> str:
    output = f"token outputs:surface.connect = </{name}/S.outputs:surface>"
    return f'{kind} Material "{name}"\n{{\n{output}\n{more}\n{SURFACE.format(color=color)}}}\n'


def mesh(metadata: str = "", lines: str = "") -> str:
    return f"""def Mesh "M" (
    {metadata}
    prepend apiSchemas = ["MaterialBindingAPI"]
)
{{
    {lines}
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
    texCoord2f[] primvars:half = [(0, 0), (0.5, 0), (0.5, 1), (0, 1)] (interpolation = "vertex")
}}
"""


BOTH = material("A", " = (1, 0, 0)") + material("B", " = (0, 1, 0)")
DIRECT = "rel material:binding = </A>"
STRONGER = ' (bindMaterialAs = "strongerThanDescendants")'
COLLECTION = """rel material:binding:collection:c = [</G.collection:c>, </B>]{strength}
    rel collection:c:includes = </G>
"""


def bound(tmp_path, text: str) -> Material:
    (found,) = read_stage(write(tmp_path, text)).materials
    return found


@pytest.mark.parametrize(("group", "own", "color"), [
    ("rel material:binding = </B>", "", GREEN),
    ("rel material:binding = </B>", DIRECT, RED),
    (f"rel material:binding = </B>{STRONGER}", DIRECT, GREEN),
    (COLLECTION.format(strength=""), DIRECT, RED),
    (COLLECTION.format(strength=STRONGER), DIRECT, GREEN),
    (f"{DIRECT}\n{COLLECTION.format(strength='')}", "", GREEN),
    ("rel material:binding:full = </B>", "", GREEN),
    ("rel material:binding:full = </B>", DIRECT, RED),
    ("rel material:binding:preview = </B>", DIRECT, GREEN),
])  # fmt: skip
def test_strength_of_bindings_is_that_of_usd(tmp_path, group, own, color):
    """A collection comes before a direct binding of the same prim, and preview before all purposes before full."""
    apis = 'prepend apiSchemas = ["MaterialBindingAPI", "CollectionAPI:c"]'
    text = f'{BOTH}def Xform "G" ({apis})\n{{\n{group}\n{mesh(lines=own)}}}\n'
    assert bound(tmp_path, text).diffuse_color == color


def test_binding_of_a_class_is_inherited(tmp_path):
    parent = 'class "C" (prepend apiSchemas = ["MaterialBindingAPI"])\n{\nrel material:binding = </B>\n}\n'
    assert bound(tmp_path, BOTH + parent + mesh("prepend inherits = </C>")).diffuse_color == GREEN


@pytest.mark.parametrize("arc", ["inherits", "specializes"])
def test_material_of_a_class_is_overridden(tmp_path, arc):
    over = 'over "S"\n{\ncolor3f inputs:diffuseColor = (0, 1, 0)\n}\n'
    own = f'def Material "A" (prepend {arc} = </Base>)\n{{\n{over}}}\n'
    text = material("Base", " = (1, 0, 0)", kind="class") + own + mesh(lines=DIRECT)
    found = bound(tmp_path, text)
    assert (found.diffuse_color, found.roughness) == (GREEN, 0.25)


def test_value_of_an_interface_passes_a_node_graph(tmp_path):
    graph = f"""def Material "A"
{{
    color3f inputs:tint = (0, 1, 0)
    token outputs:surface.connect = </A/Graph.outputs:surface>
    def NodeGraph "Graph"
    {{
        color3f inputs:tint.connect = </A.inputs:tint>
        token outputs:surface.connect = </A/Graph/S.outputs:surface>
        {SURFACE.format(color=".connect = </A/Graph.inputs:tint>")}
    }}
}}
"""
    assert bound(tmp_path, graph + mesh(lines=DIRECT)).diffuse_color == GREEN


def test_file_primvar_and_transform_come_from_the_interface(tmp_path):
    """Twice as large, a quarter of a turn, then moved: (u, v) to (1/4 - 2 v, 1/2 + 2 u)."""
    Image.new("RGB", (2, 2), (255, 128, 0)).save(tmp_path / "p.png")
    nodes = """
    asset inputs:image = @p.png@
    token inputs:frame:stPrimvarName = "half"
    float2 inputs:size = (2, 2)
    def Shader "T"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file.connect = </A.inputs:image>
        token inputs:wrapS = "repeat"
        token inputs:wrapT = "mirror"
        float2 inputs:st.connect = </A/X.outputs:result>
        color3f outputs:rgb
    }
    def Shader "X"
    {
        uniform token info:id = "UsdTransform2d"
        float2 inputs:in.connect = </A/R.outputs:result>
        float inputs:rotation = 90
        float2 inputs:scale.connect = </A.inputs:size>
        float2 inputs:translation = (0.25, 0.5)
        float2 outputs:result
    }
    """
    text = material("A", ".connect = </A/T.outputs:rgb>", nodes + READER) + mesh(lines=DIRECT)
    description = read_stage(write(tmp_path, text))
    lookup = description.materials[0].diffuse_color
    assert isinstance(lookup, TextureLookup)
    np.testing.assert_allclose(lookup.uv_transform, (0.0, -2.0, 0.25, 2.0, 0.0, 0.5), atol=1e-6)
    (texture,) = description.textures
    assert (texture.wrap_s, texture.wrap_t, texture.encoding) == ("repeat", "mirror", "srgb")
    assert description.meshes[0].uv[:, 0].max() == 0.5


@pytest.mark.parametrize(("space", "encoding"), [("raw", "raw"), ("sRGB", "srgb"), ("auto", "srgb")])
def test_texture_beside_a_node_of_materialx_keeps_its_color_space(tmp_path, space, encoding):
    """One node of MaterialX makes the whole network one of MaterialX; raw colors were decoded as sRGB there."""
    Image.new("RGB", (2, 2), (255, 128, 0)).save(tmp_path / "p.png")
    nodes = f"""
    def Shader "N"
    {{
        uniform token info:id = "ND_constant_color3"
        color3f inputs:value = (1, 0, 0)
        color3f outputs:out
    }}
    def Shader "T"
    {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @p.png@
        token inputs:sourceColorSpace = "{space}"
        float outputs:g
    }}
    """
    text = material("A", ".connect = </A/N.outputs:out>", nodes) + mesh(lines=DIRECT)
    text = text.replace("inputs:roughness = 0.25", "inputs:roughness.connect = </A/T.outputs:g>")
    description = read_stage(write(tmp_path, text))
    assert description.materials[0].diffuse_color == RED
    assert [each.encoding for each in description.textures] == [encoding]
