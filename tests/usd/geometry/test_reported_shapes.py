# SPDX-License-Identifier: Apache-2.0
"""Values of shapes that are not drawn as they are authored: named with their prim."""

from __future__ import annotations

import re

import pytest

from tests.usd.helpers import QUAD, read, read_with_warning

SMOOTH = QUAD.replace('uniform token subdivisionScheme = "none"', "")
SUBSET = """
    def GeomSubset "Part" (prepend apiSchemas = ["MaterialBindingAPI"])
    {
        uniform token familyName = "materialBind"
        int[] indices = [0]
        rel material:binding = </Paint>
    }"""
LINE = """
    uniform token type = "linear"
    int[] curveVertexCounts = [2]
    point3f[] points = [(0, 0, 0), (1, 0, 0)]
"""


@pytest.mark.parametrize(
    ("kind", "body", "expected"),
    [
        ("Mesh", QUAD.replace("none", "smooth"), "subdivisionScheme 'smooth' is not known; 'catmullClark' is used"),
        (
            "Mesh",
            SMOOTH + 'uniform token interpolateBoundary = "all"',
            "interpolateBoundary 'all' is not known; 'edgeAndCorner' is used",
        ),
        (
            "Mesh",
            SMOOTH + 'uniform token faceVaryingLinearInterpolation = "some"',
            "faceVaryingLinearInterpolation 'some' is not known; 'cornersPlus1' is used",
        ),
        ("Mesh", QUAD + 'uniform token orientation = "left"', "orientation 'left' is not known; 'rightHanded' is used"),
        ("Cone", 'uniform token axis = "-Z"', "axis '-Z' is not known; 'Z' is used"),
        (
            "BasisCurves",
            LINE + 'float[] widths = [1]\n uniform token wrap = "closed"',
            "wrap 'closed' is not known; 'nonperiodic' is used",
        ),
        ("BasisCurves", LINE + "float[] widths = [1, -1]", "widths below 0 count as 0"),
        ("Points", "point3f[] points = [(0, 0, 0), (1, 0, 0)]\n float[] widths = [1, -1]", "widths below 0 count as 0"),
        ("Cube", SUBSET, "a material of a part of a Cube is not applied"),
        (
            "Mesh",
            SMOOTH + "int[] cornerIndices = [0]\n float[] cornerSharpnesses.timeSamples = { 0: [0], 5: [9] }",
            "cornerSharpnesses of a Mesh has time samples, and is drawn as it is at the time read",
        ),
    ],
)
def test_values_that_are_not_drawn_as_authored_are_named(tmp_path, kind, body, expected):
    path = "/S/Part" if body is SUBSET else "/S"
    paint = 'def Material "Paint"\n{\n}\n' * (body is SUBSET)
    text = f'{paint}def {kind} "S"\n{{\n{body}\n}}\n'
    assert len(read_with_warning(tmp_path, text, f"{re.escape(expected)}: <{path}>$").meshes) == 1


def test_unknown_scheme_is_drawn_as_the_default(tmp_path):
    body = 'def Mesh "A"\n{\n%s\n}\n'
    read_one = read_with_warning(tmp_path, body % QUAD.replace('"none"', '"smooth"'), "is not known")
    default = read(tmp_path, body % SMOOTH)
    assert (read_one.meshes[0].positions == default.meshes[0].positions).all()
