# SPDX-License-Identifier: Apache-2.0
"""MaterialX networks in the manner of Blender's exporter: of MaterialX 1.39, vectors without color spaces."""

from __future__ import annotations

import warnings
from pathlib import Path

from PIL import Image

from tests.usd.helpers import write
from tests.usd.materials.test_materialx import PIXELS, QUAD
from tiscene.errors import StageWarning
from tiscene.scene.description import SceneDescription, TextureLookup
from tiscene.usd.read.stage_reader import read_stage


def shader(name: str, kind: str, *inputs: str) -> str:
    """Return a shader prim; inputs are written as "color3f base_color = ...", without "inputs:"."""
    lines = [" inputs:".join(each.split(" ", 1)) for each in inputs]
    lines += [f'uniform token info:id = "{kind}"', "token outputs:out"]
    return f'def Shader "{name}"\n{{\n' + "\n".join(lines) + "\n}\n"


def link(name: str, node: str) -> str:
    return f"{name}.connect = </Looks/Mat/{node}.outputs:out>"


def read(folder: Path, *shaders: str) -> SceneDescription:
    """Read a stage with a quad of a material whose surface shader is S; any warning fails."""
    Image.fromarray(PIXELS).save(folder / "p.png")
    output = "token outputs:mtlx:surface.connect = </Looks/Mat/S.outputs:out>\n"
    text = f'def Scope "Looks"\n{{\ndef Material "Mat"\n{{\n{output}{"".join(shaders)}}}\n}}\n'
    with warnings.catch_warnings():
        warnings.simplefilter("error", StageWarning)
        return read_stage(write(folder, text + QUAD))


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
