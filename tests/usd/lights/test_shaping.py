# SPDX-License-Identifier: Apache-2.0
"""ShapingAPI, ShadowAPI, diffuse and specular multipliers, mesh lights."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.usd.helpers import QUAD, preview_material, problems_of, read_with_warning, write
from tests.usd.lights.test_ies import ies
from tiscene.scene.description import Light, Shaping, TextureLookup
from tiscene.usd.read.stage_reader import read_stage


def shaped(folder, kind: str, lines: str, apis: str = '"ShapingAPI", "ShadowAPI"') -> Light:
    body = f'def {kind} "L" (prepend apiSchemas = [{apis}])\n{{\n{lines}\n}}\n'
    (light,) = read_stage(write(folder, body)).lights
    return light


CONE = "float inputs:shaping:cone:angle = 30\nfloat inputs:shaping:cone:softness = 0.25"
FOCUS = "float inputs:shaping:focus = 4\ncolor3f inputs:shaping:focusTint = (1, 0.5, 0)"


@pytest.mark.parametrize("kind", ["RectLight", "DiskLight", "SphereLight"])
def test_cone_and_focus_are_read(tmp_path, kind):
    shaping = shaped(tmp_path, kind, CONE + "\n" + FOCUS).shaping
    assert shaping == Shaping(pytest.approx(math.radians(30.0)), 0.25, 4.0, (1.0, 0.5, 0.0))


def test_default_shaping_affects_only_round_lights(tmp_path):
    """The default cone of 90 degrees halves a sphere light and does not affect a flat light."""
    assert shaped(tmp_path, "SphereLight", "").shaping == Shaping(pytest.approx(math.pi / 2))
    assert shaped(tmp_path, "RectLight", "").shaping is None
    assert shaped(tmp_path, "DistantLight", CONE).shaping is None


LIGHT = '"LightAPI"'  # lights have it anyway
UNAPPLIED = [
    ("SphereLight", LIGHT, CONE, "inputs:shaping:cone:angle, inputs:shaping:cone:softness of a light: .* ShapingAPI"),
    ("RectLight", '"ShadowAPI"', "float inputs:shaping:focus = 2", "  inputs:shaping:focus of a light: no effect"),
    (
        "RectLight",
        LIGHT,
        "asset inputs:shaping:ies:file = @lamp.ies@",
        "  inputs:shaping:ies:file of a light: no effect",
    ),
    (
        "DomeLight",
        LIGHT,
        "bool inputs:shadow:enable = 0",
        "  inputs:shadow:enable of a light: no effect without ShadowAPI",
    ),
    (
        "RectLight",
        '"ShapingAPI"',
        "color3f inputs:shadow:color = (0, 0, 1)",
        "  inputs:shadow:color of a light: no effect",
    ),
    ("RectLight", LIGHT, "float shaping:cone:angle = 30", "  inputs:shaping:cone:angle of a light: no effect"),
]


@pytest.mark.parametrize(("kind", "apis", "lines", "expected"), UNAPPLIED)
def test_inputs_of_schemas_that_are_not_applied_have_no_effect_and_are_named(tmp_path, kind, apis, lines, expected):
    body = f'def {kind} "L" (prepend apiSchemas = [{apis}])\n{{\n{lines}\n}}\n'
    (light,) = read_with_warning(tmp_path, body, f"{expected}.*; add it to the prim's apiSchemas: </L>$").lights
    assert light.shaping is None
    assert light.casts_shadows


WITHOUT_EFFECT = """float inputs:shaping:cone:angle = %s
float inputs:shaping:cone:softness = %s
float inputs:shaping:focus = 0
color3f inputs:shaping:focusTint = (1, 1, 1)
asset inputs:shaping:ies:file = @@
float inputs:shaping:ies:angleScale = 1
bool inputs:shadow:enable = 1
color3f inputs:shadow:color = (0, 0, 0)
float inputs:shadow:distance = -1
float inputs:shadow:falloff = -1"""


@pytest.mark.parametrize("values", [(90, 0), (180, 0.5)], ids=["defaults", "a full sphere"])
def test_inputs_without_an_effect_are_not_named(tmp_path, values, recwarn):
    assert shaped(tmp_path, "SphereLight", WITHOUT_EFFECT % values, LIGHT).shaping is None
    assert shaped(tmp_path, "DistantLight", CONE, LIGHT).shaping is None
    assert not recwarn.list


def test_mistyped_inputs_of_schemas_that_are_not_applied_lose_no_light(tmp_path, recwarn):
    lines = 'string inputs:shaping:cone:angle = "wide"\nfloat inputs:shadow:color = 1'
    assert shaped(tmp_path, "SphereLight", lines, LIGHT).shaping is None


def test_shaping_and_shadows_of_mesh_lights_are_named(tmp_path):
    body = f"""def Mesh "Lamp" (prepend apiSchemas = ["MeshLightAPI", "ShapingAPI", "ShadowAPI"]) {{
{QUAD}
{CONE}
bool inputs:shadow:enable = 0
}}"""
    text = "shaping:cone:angle, shaping:cone:softness of a mesh light is not applied: </Lamp>\\n"
    read_with_warning(tmp_path, body, f"{text}  shadow:enable of a mesh light is not applied: </Lamp>$")


def test_shaping_values_are_clamped_or_problems(tmp_path):
    lines = "float inputs:shaping:cone:angle = 60\nfloat inputs:shaping:cone:softness = 7"
    assert shaped(tmp_path, "RectLight", lines).shaping == Shaping(pytest.approx(math.pi / 3), 1.0)
    body = 'def RectLight "L" (prepend apiSchemas = ["ShapingAPI"])\n{\nfloat inputs:shaping:focus = nan\n}\n'
    assert problems_of(tmp_path, body) == ("</L> shaping: it has values that are not finite numbers",)


def test_ies_profiles_become_textures(tmp_path):
    (tmp_path / "lamp.ies").write_bytes(ies([0, 90], [0], [[3, 3]]))
    body = """
def RectLight "L" (prepend apiSchemas = ["ShapingAPI"]) {
    asset inputs:shaping:ies:file = @lamp.ies@
}
def SphereLight "M" (prepend apiSchemas = ["ShapingAPI"]) {
    asset inputs:shaping:ies:file = @lamp.ies@
    float inputs:shaping:cone:angle = 180
    bool inputs:shaping:ies:normalize = 1
}
"""
    description = read_stage(write(tmp_path, body))
    rect, sphere = (light.shaping for light in description.lights)
    plain, normalized = (description.textures[each.profile].pixels for each in (rect, sphere))
    assert (plain[:179] == 3.0).all()
    assert not plain[181:].any()
    np.testing.assert_allclose(normalized, plain / 3.0, rtol=1e-2)  # half a sphere of 3 cd


def test_unreadable_profile_is_reported(tmp_path):
    (tmp_path / "bad.ies").write_bytes(b"nothing")
    for name, expected in (("bad", "no line TILT="), ("gone", "there is no such file")):
        body = f"""
def RectLight "L" (prepend apiSchemas = ["ShapingAPI"]) {{
    asset inputs:shaping:ies:file = @{name}.ies@
}}
"""
        description = read_with_warning(tmp_path, body, f"IES profile @{name}.ies@ cannot be read .*{expected}.*</L>")
        assert description.lights[0].shaping is None


def test_multipliers_and_shadow_enable_are_read(tmp_path):
    light = shaped(tmp_path, "DiskLight", "float inputs:diffuse = 0.5\nfloat inputs:specular = 0")
    assert (light.diffuse, light.specular, light.casts_shadows) == (0.5, 0.0, True)
    assert not shaped(tmp_path, "DomeLight", "bool inputs:shadow:enable = 0").casts_shadows
    body = 'def DiskLight "L"\n{\nfloat inputs:diffuse = -1\n}\n'
    (problem,) = problems_of(tmp_path, body)
    assert problem == "</L> light: diffuse -1.0 and specular 1.0 must be finite, and not below 0"


UNRENDERED = [
    ("float inputs:shadow:distance = 2", "shadow:distance is not applied"),
    ("color3f inputs:shadow:color = (1, 0, 0)", "shadow:color is not applied"),
    (
        "float inputs:intensity.connect = </N.outputs:out>",
        "the connection of a light's inputs:intensity is not read",
    ),
]


@pytest.mark.parametrize(("lines", "expected"), UNRENDERED)
def test_unsupported_controls_of_lights_are_reported(tmp_path, lines, expected):
    body = f'def RectLight "L" (prepend apiSchemas = ["ShadowAPI"])\n{{\n{lines}\n}}\n'
    read_with_warning(tmp_path, body, f"{expected}.*</L>")


def test_dark_light_with_animated_intensity_is_kept(tmp_path):
    lines = "float inputs:intensity = 0\nfloat inputs:intensity.timeSamples = { 0: 0, 10: 5 }"
    assert shaped(tmp_path, "RectLight", lines).radiance == (0.0, 0.0, 0.0)


EMISSIVE = """
def Mesh "M" (prepend apiSchemas = ["MeshLightAPI", "MaterialBindingAPI"]) {
    %s
    float inputs:intensity = 2
    color3f inputs:color = (1, 0.5, 0)
    %s
    rel material:binding = </Look>
}
""" + preview_material(
    "/Look",
    "color3f inputs:diffuseColor = (0.1, 0.2, 0.3)",
    "color3f inputs:emissiveColor%s",
    shaders="""def Shader "Image" {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @emission.png@
        float4 inputs:bias = (1, 1, 1, 0)
        float3 outputs:rgb
    }""",
)


def read_emissive(folder, mode: str = "", emission: str = " = (3, 3, 3)"):
    from PIL import Image

    Image.new("RGB", (1, 1)).save(folder / "emission.png")
    line = f'uniform token light:materialSyncMode = "{mode}"' if mode else ""
    description = read_stage(write(folder, EMISSIVE % (QUAD, line, emission)))
    (mesh,) = description.meshes
    return description.materials[mesh.materials[0]]


def test_material_emission_tints_mesh_light(tmp_path):
    material = read_emissive(tmp_path)
    assert material.emissive_color == (6.0, 3.0, 0.0)
    assert material.diffuse_color == pytest.approx((0.1, 0.2, 0.3))
    textured = read_emissive(tmp_path, emission=".connect = </Look/Image.outputs:rgb>").emissive_color
    assert isinstance(textured, TextureLookup)
    assert textured.scale[:3] == textured.bias[:3] == (2.0, 1.0, 0.0)


def test_material_sync_mode_adds_to_or_replaces_material(tmp_path):
    assert read_emissive(tmp_path, "independent").emissive_color == (5.0, 4.0, 3.0)
    black = read_emissive(tmp_path, "noMaterialResponse")
    assert (black.emissive_color, black.diffuse_color) == ((2.0, 1.0, 0.0), (0.0, 0.0, 0.0))


def test_mesh_light_with_non_emissive_material_is_reported(tmp_path):
    body = EMISSIVE % (QUAD, "", " = (0, 0, 0)")
    description = read_with_warning(tmp_path, body, "has no emission, so that it does not tint the light: </M>")
    assert description.materials[description.meshes[0].materials[0]].emissive_color == (2.0, 1.0, 0.0)


def test_normalized_mesh_light_divides_by_its_area(tmp_path):
    lines = (
        'bool inputs:normalize = 1\nfloat3 xformOp:scale = (2, 3, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    )
    body = f'def Mesh "M" (prepend apiSchemas = ["MeshLightAPI"])\n{{\n{QUAD}\nfloat inputs:intensity = 12\n{lines}\n}}'
    (material,) = read_stage(write(tmp_path, body, meters=0.01)).materials
    assert material.emissive_color == (2.0, 2.0, 2.0)
