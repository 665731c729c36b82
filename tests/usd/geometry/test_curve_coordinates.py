# SPDX-License-Identifier: Apache-2.0
"""Texture coordinates of UsdGeomBasisCurves and UsdGeomPoints."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from tests.usd.geometry.test_curves import POINTS, STRAIGHT
from tests.usd.helpers import preview_material, read, read_with_warning

ST = "[(0, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0.5, 1)]"


@pytest.mark.parametrize(("values", "interpolation"), [(ST, "vertex"), ("[(0.25, 0.75), (0.5, 0.5)]", "uniform")])
def test_curves_have_texture_coordinates(tmp_path, values, interpolation):
    """At z = 0 and 4 of the first curve; at x = 5, 6, 7 of the second one."""
    line = f'texCoord2f[] primvars:st = {values} (interpolation = "{interpolation}")'
    (mesh,) = read(tmp_path, STRAIGHT % ("[1]", line)).meshes
    first = mesh.positions[:, 0] < 2.0
    at = np.where(first, mesh.positions[:, 2] / 4.0, (mesh.positions[:, 0] - 5.0) / 2.0).clip(0.0, 1.0)
    expected = np.stack([np.where(first, 0.0, 0.5), at], axis=-1)
    if interpolation == "uniform":
        expected = np.where(first[:, None], (0.25, 0.75), (0.5, 0.5))
    np.testing.assert_allclose(mesh.uv, expected, atol=1e-6)
    assert mesh.colors is None


def test_spheres_of_points_have_texture_coordinates(tmp_path):
    line = '    texCoord2f[] primvars:st = [(0, 1), (0.5, 0.25), (9, 9)] (interpolation = "vertex")\n    color3f'
    (mesh,) = read(tmp_path, POINTS.replace("    color3f", line)).meshes
    np.testing.assert_array_equal(mesh.uv, np.where(mesh.positions[:, :1] < 2.0, (0.0, 1.0), (0.5, 0.25)))


def test_spheres_of_points_have_colors_that_their_material_reads(tmp_path):
    reader = """def Shader "Reader"
    {
        uniform token info:id = "UsdPrimvarReader_float3"
        string inputs:varname = "displayColor"
        float3 outputs:result
    }"""
    look = preview_material("/L", "color3f inputs:diffuseColor.connect = </L/Reader.outputs:result>", shaders=reader)
    body = POINTS.replace('"P"', '"P" (prepend apiSchemas = ["MaterialBindingAPI"])', 1)
    body = body.replace("    color3f", "    rel material:binding = </L>\n    color3f") + look
    (mesh,) = read(tmp_path, body).meshes
    np.testing.assert_array_equal(mesh.colors[:, :3], np.where(mesh.positions[:, :1] < 2.0, (1, 0, 0), (0, 0, 1)))


def test_texture_coordinates_that_curves_lack_are_named(tmp_path):
    reader = """def Shader "Reader"
    {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "UVMap"
        float2 outputs:result
    }
    def Shader "Image"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @p.png@
        float2 inputs:st.connect = </L/Reader.outputs:result>
        float3 outputs:rgb
    }"""
    Image.new("RGB", (2, 2)).save(tmp_path / "p.png")
    look = preview_material("/L", "color3f inputs:diffuseColor.connect = </L/Image.outputs:rgb>", shaders=reader)
    body = STRAIGHT.replace('"C"', '"C" (prepend apiSchemas = ["MaterialBindingAPI"])') + look
    expected = "has no primvar 'UVMap', which its material reads; its texture coordinates are .0, 0.: </C>"
    read_with_warning(tmp_path, body % ("[1]", "rel material:binding = </L>"), expected)
