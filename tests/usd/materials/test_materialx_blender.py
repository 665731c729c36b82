# SPDX-License-Identifier: Apache-2.0
"""MaterialX networks in the manner of Blender's exporter: of MaterialX 1.39, vectors without color spaces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.usd.helpers import write
from tests.usd.materials.test_materialx import PIXELS, QUAD, rounded
from tiscene.errors import StageWarning
from tiscene.scene.description import ExtendedLobes, Material, SceneDescription, TextureLookup
from tiscene.usd.read.stage_reader import read_stage


def shader(name: str, kind: str, *inputs: str) -> str:
    """Return a shader prim; inputs are written as "color3f base_color = ...", without "inputs:"."""
    lines = [" inputs:".join(each.split(" ", 1)) for each in inputs]
    lines += [f'uniform token info:id = "{kind}"', "token outputs:out"]
    return f'def Shader "{name}"\n{{\n' + "\n".join(lines) + "\n}\n"


def link(name: str, node: str) -> str:
    return f"{name}.connect = </Looks/Mat/{node}.outputs:out>"


def read(folder: Path, *shaders: str) -> SceneDescription:
    """Read a stage with a quad of a material whose surface shader is S."""
    Image.fromarray(PIXELS).save(folder / "p.png")
    output = "token outputs:mtlx:surface.connect = </Looks/Mat/S.outputs:out>\n"
    text = f'def Scope "Looks"\n{{\ndef Material "Mat"\n{{\n{output}{"".join(shaders)}}}\n}}\n'
    other = QUAD.replace("primvars:other = [(0, 0), (1, 0), (1, 1)", "primvars:other = [(0, 0), (0.5, 0), (0.5, 0.5)")
    return read_stage(write(folder, text + other))


def surface(*inputs: str) -> str:
    return shader("S", "ND_open_pbr_surface_surfaceshader", *inputs)


VECTORS = shader("image", "ND_image_vector4", "asset file = @p.png@")


def test_image_of_vectors_without_a_color_space_is_not_decoded(tmp_path):
    part = shader("part", "ND_extract_vector4", link("float4 in", "image"), "int index = 1")
    description = read(tmp_path, surface(link("float specular_roughness", "part")), part, VECTORS)
    roughness = description.materials[0].roughness
    assert isinstance(roughness, TextureLookup)
    assert roughness.channel == "g"
    assert description.textures[roughness.texture].encoding == "raw"


def test_normal_map_named_by_the_type_of_its_scale_has_three_components(tmp_path):
    three = shader("three", "ND_convert_vector4_vector3", link("float4 in", "image"))
    bumps = shader("bumps", "ND_normalmap_float", link("float3 in", "three"), "float scale = 0.5")
    description = read(tmp_path, surface(link("float3 geometry_normal", "bumps")), bumps, three, VECTORS)
    normal = description.materials[0].normal
    assert normal.channel == "rgb"
    assert normal.scale[:3] == (1.0, 1.0, 2.0)
    assert description.textures[normal.texture].encoding == "raw"


@pytest.mark.parametrize(
    ("turn", "expected"),  # MaterialX turns clockwise
    [(0.0, (2.0, 0.0, 0.25, 0.0, 3.0, 0.5)), (90.0, (0.0, 3.0, 0.25, -2.0, 0.0, 0.5))],
)
def test_mapping_of_points_is_a_map_of_the_texture_coordinates(tmp_path, turn, expected):
    description = read(
        tmp_path,
        surface(link("color3f base_color", "image")),
        shader("image", "ND_image_color3", "asset file = @p.png@", link("float2 texcoord", "uv")),
        shader("uv", "ND_convert_vector3_vector2", link("float3 in", "moved")),
        shader("moved", "ND_add_vector3", link("float3 in1", "z"), "float3 in2 = (0.25, 0.5, 0)"),
        shader("z", "ND_rotate3d_vector3", link("float3 in", "x"), f"float amount = {turn}", "float3 axis = (0, 0, 1)"),
        shader("x", "ND_rotate3d_vector3", link("float3 in", "scaled"), "float amount = 0", "float3 axis = (1, 0, 0)"),
        shader("scaled", "ND_multiply_vector3", link("float3 in1", "point"), "float3 in2 = (2, 3, 1)"),
        shader("point", "ND_convert_vector2_vector3", link("float2 in", "st")),
        shader("st", "ND_texcoord_vector2"),
    )
    color = description.materials[0].diffuse_color
    assert isinstance(color, TextureLookup)
    np.testing.assert_allclose(color.uv_transform, expected, atol=1e-6)


def test_texture_coordinates_as_a_color_have_no_blue_and_keep_their_set(tmp_path):
    description = read(
        tmp_path,
        surface(link("color3f base_color", "color")),
        shader("color", "ND_convert_vector3_color3", link("float3 in", "point")),
        shader("point", "ND_convert_vector2_vector3", link("float2 in", "st")),
        shader("st", "ND_geompropvalue_vector2", 'string geomprop = "other"'),
    )
    color = description.materials[0].diffuse_color
    assert isinstance(color, TextureLookup)
    assert (description.textures[color.texture].pixels[..., 2] == 0).all()
    np.testing.assert_array_equal(description.meshes[0].uv[:3], [(0, 0), (0.5, 0), (0.5, 0.5)])


@pytest.mark.parametrize("kind", ["heighttonormal", "bump"])
def test_heights_become_normals_by_their_slope(tmp_path, kind):
    """A wave along u, twice over the unit square by a mapping."""
    u = (np.arange(128) + 0.5) / 128
    wave = np.broadcast_to(np.rint(65535 * (0.5 + 0.5 * np.sin(2 * np.pi * u))).astype(np.uint16), (128, 128))
    Image.fromarray(np.ascontiguousarray(wave)).save(tmp_path / "wave.png")
    height = link("float in" if kind == "heighttonormal" else "float height", "image")
    bumps = shader("B", f"ND_{kind}_vector3", height, "float scale = 0.5")
    place = shader("P", "ND_place2d_vector2", link("float2 texcoord", "st"), "float2 scale = (0.5, 1)")
    description = read(
        tmp_path,
        surface(link("float3 geometry_normal", "N" if kind == "heighttonormal" else "B")),
        shader("N", "ND_normalmap_float", link("float3 in", "B")) + bumps + place + shader("st", "ND_texcoord_vector2"),
        shader("image", "ND_image_float", "asset file = @wave.png@", link("float2 texcoord", "P")),
    )
    normal = description.materials[0].normal
    pixels = description.textures[normal.texture].pixels[..., :3] * normal.scale[:3] + normal.bias[:3]
    slope = 2.0 * np.pi * np.cos(2 * np.pi * u) * 0.5 / 16.0
    np.testing.assert_allclose(-pixels[..., 0] / pixels[..., 2], np.broadcast_to(slope, (128, 128)), atol=2e-3)
    np.testing.assert_allclose(pixels[..., 1], 0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("node", "expected"),
    [
        (
            shader("B", "ND_oren_nayar_diffuse_bsdf", "color3f color = (0.5, 0.25, 1)", "float roughness = 0"),
            Material("Mat", (0.5, 0.25, 1.0), roughness=0.3, ior=1.0),
        ),
        (
            shader("B", "ND_conductor_bsdf", link("color3f ior", "metal"), "float2 roughness = (0.25, 0.25)")
            + shader("metal", "ND_artistic_ior", "color3f reflectivity = (0.5, 0.25, 1)"),
            Material("Mat", (0.5, 0.25, 1.0), metallic=1.0, roughness=0.5),
        ),
        (
            shader(
                "B",
                "ND_dielectric_bsdf",
                "float ior = 1.25",
                "color3f tint = (0.5, 0.25, 1)",
                'string scatter_mode = "RT"',
                link("float2 roughness", "alphas"),
            )
            + shader("alphas", "ND_roughness_anisotropy", "float roughness = 0.5", "float anisotropy = 0"),
            Material(
                "Mat",
                (0.0, 0.0, 0.0),
                roughness=0.5,
                opacity=0.0,
                ior=1.25,
                lobes=ExtendedLobes(transmission_color=(0.5, 0.25, 1.0)),
            ),
        ),
    ],
)
def test_surface_of_one_bsdf_has_its_lobe(tmp_path, node, expected):
    surface = shader("S", "ND_surface", link("token bsdf", "B"), "token edf", "float opacity")
    (material,) = read(tmp_path, surface, node).materials
    assert rounded(material) == replace(expected, clearcoat_roughness=0.0, prim_path="/Looks/Mat")


def test_surface_of_emission_emits(tmp_path):
    surface = shader("S", "ND_surface", link("token edf", "E"), "float opacity = 0.5")
    product = shader("P", "ND_multiply_color3FA", "color3f in1 = (0.5, 0.25, 1)", "float in2 = 4")
    (material,) = read(tmp_path, surface, shader("E", "ND_uniform_edf", link("color3f color", "P")), product).materials
    assert material.emissive_color == (2.0, 1.0, 4.0)
    assert material.diffuse_color == (0.0, 0.0, 0.0)
    assert (material.opacity, material.opacity_mode) == (0.5, "presence")


@pytest.mark.parametrize("kind", ["ND_mix_bsdf", "ND_chiang_hair_bsdf"])
def test_unknown_bsdfs_and_mixtures_of_nothing_are_reported(tmp_path, kind):
    surface = shader("S", "ND_surface", link("token bsdf", "B"))
    with pytest.warns(StageWarning, match=f"shader '{kind}' is not supported; displayColor is used"):
        read(tmp_path, surface, shader("B", kind, "float roughness = 0"))
