# SPDX-License-Identifier: Apache-2.0
"""Textures without wrap mode: reported where texture coordinates make them black, silent elsewhere."""

from __future__ import annotations

import pytest
from PIL import Image

from tests.usd.helpers import preview_material, problems_of, read, read_with_warning

MESH = """
def Mesh "M" (prepend apiSchemas = ["MaterialBindingAPI"])
{
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    texCoord2f[] primvars:st = %s
    rel material:binding = </Look>
    %s
}
"""
NODES = """
    def Shader "Image"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @./wood.png@
        %s
        float2 inputs:st.connect = </Look/Map.outputs:result>
        float3 outputs:rgb
    }
    def Shader "Map"
    {
        uniform token info:id = "UsdTransform2d"
        float2 inputs:scale = %s
        float2 inputs:in.connect = </Look/Reader.outputs:result>
        float2 outputs:result
    }
    def Shader "Reader"
    {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }
"""
TEXTURED = "color3f inputs:diffuseColor.connect = </Look/Image.outputs:rgb>"
STAGE = MESH + preview_material("/Look", TEXTURED, shaders=NODES) + preview_material("/Plain")
UNIT = '[(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")'
WIDE = '[(0, 0), (2, 0), (2, 1), (0, 1)] (interpolation = "vertex")'
SECOND_FACE_WIDE = '[(0, 0), (1, 0), (1, 1), (0, 0), (2, 1), (0, 1)] (interpolation = "faceVarying")'
REPEAT_S, REPEAT_T = 'token inputs:wrapS = "repeat"', 'token inputs:wrapT = "repeat"'
EXPECTED = "texture @./wood.png@ has no wrap mode, so that it is black where texture coordinates leave 0..1: </M>$"


@pytest.fixture
def folder(tmp_path):
    Image.new("RGB", (2, 2)).save(tmp_path / "wood.png")
    return tmp_path


def subset(face: int, material: str) -> str:
    return f"""def GeomSubset "S" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{
        uniform token familyName = "materialBind"
        int[] indices = [{face}]
        rel material:binding = </{material}>
    }}"""


@pytest.mark.parametrize(
    ("uv", "wraps", "scale"),
    [
        (WIDE, "", "(1, 1)"),
        (WIDE, REPEAT_T, "(1, 1)"),
        (WIDE, 'token inputs:wrapS = "useMetadata"', "(1, 1)"),
        (UNIT, "", "(3, 1)"),
        (UNIT, "", "(1, -1)"),
        (SECOND_FACE_WIDE, "", "(1, 1)"),
        ('[(0.5, 1.5)] (interpolation = "constant")', "", "(1, 1)"),
    ],
)
def test_missing_wrap_mode_is_reported_where_coordinates_leave_unit_square(folder, uv, wraps, scale):
    assert len(read_with_warning(folder, STAGE % (uv, "", wraps, scale), EXPECTED).textures) == 1


@pytest.mark.parametrize(
    ("uv", "wraps", "scale"),
    [
        (UNIT, "", "(1, 1)"),
        (WIDE, REPEAT_S, "(1, 1)"),
        (WIDE, f"{REPEAT_S}\n{REPEAT_T}", "(1, 1)"),
        (WIDE, "", "(0.5, 1)"),
        (WIDE, 'token inputs:wrapS = "black"', "(1, 1)"),
    ],
)
def test_missing_wrap_mode_is_silent_inside_unit_square(folder, uv, wraps, scale):
    assert len(read(folder, STAGE % (uv, "", wraps, scale)).textures) == 1


@pytest.mark.parametrize(("face", "material"), [(1, "Plain"), (0, "Look")])
def test_only_faces_of_the_material_count(folder, face, material):
    """The second face leaves 0..1: it counts for the texture's material alone."""
    body = STAGE % (SECOND_FACE_WIDE, subset(face, material), "", "(1, 1)")
    if material == "Plain":
        read(folder, body)
    else:
        read_with_warning(folder, body, EXPECTED)


def test_subset_is_reported_for_its_own_faces(folder):
    body = STAGE.replace("binding = </Look>\n    %s", "binding = </Plain>\n    %s")
    read_with_warning(folder, body % (SECOND_FACE_WIDE, subset(1, "Look"), "", "(1, 1)"), EXPECTED)
    read(folder, body % (SECOND_FACE_WIDE, subset(0, "Look"), "", "(1, 1)"))


@pytest.mark.parametrize(
    ("line", "replacement"), [("[0, 1, 2, 0, 2, 3]", "[0, 1, 2, 0, 2, 9]"), ("[3, 3]", "[3, -3]"), ("[3, 3]", "[3, 9]")]
)
def test_contradictory_mesh_has_one_problem(folder, line, replacement):
    (problem,) = problems_of(folder, (STAGE % (WIDE, "", "", "(1, 1)")).replace(line, replacement))
    assert problem.startswith("</M> mesh: ")
