# SPDX-License-Identifier: Apache-2.0
"""MaterialX: surface models and operations, folded or computed."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.usd.helpers import read_with_warning, write
from tiscene.errors import StageWarning
from tiscene.scene.description import Material, SceneDescription, TextureLookup
from tiscene.usd.read.stage_reader import read_stage

QUAD = """def Mesh "M" (prepend apiSchemas = ["MaterialBindingAPI"])
{
    rel material:binding = </Looks/Mat>
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
    texCoord2f[] primvars:other = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
    color3f[] primvars:tint = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)] (interpolation = "vertex")
}
"""
REFERENCE = 'def Scope "Looks" (references = @./doc.mtlx@</MaterialX/Materials>)\n{\n}\n' + QUAD
PIXELS = np.array([[[0, 64, 128], [255, 32, 16]], [[8, 200, 90], [128, 128, 255]]], np.uint8)


def document(surface: str, model: str = "standard_surface", nodes: str = "") -> str:
    """Return a MaterialX document with one material, given the inputs of its surface and further nodes."""
    return f"""<?xml version="1.0"?>
<materialx version="1.38" colorspace="lin_rec709">
  {nodes}
  <{model} name="SR" type="surfaceshader">{surface}</{model}>
  <surfacematerial name="Mat" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="SR" />
  </surfacematerial>
</materialx>
"""


def given(name: str, value: str, kind: str = "float") -> str:
    return f'<input name="{name}" type="{kind}" value="{value}" />'


def linked(name: str, node: str, kind: str = "color3", more: str = "") -> str:
    return f'<input name="{name}" type="{kind}" nodename="{node}" {more}/>'


def node(category: str, kind: str, *inputs: str, name: str = "N") -> str:
    return f'<{category} name="{name}" type="{kind}">{"".join(inputs)}</{category}>'


def picture(kind: str = "color3", name: str = "picture", file: str = "p.png", more: str = "") -> str:
    """Return an image node; color files are sRGB."""
    space = 'colorspace="srgb_texture"' if kind == "color3" else ""
    return node("image", kind, f'<input name="file" type="filename" value="{file}" {space}/>{more}', name=name)


def stage_of(folder: Path, text: str) -> SceneDescription:
    """Write a document and a stage that references it, and read the stage; any warning fails."""
    Image.fromarray(PIXELS).save(folder / "p.png")
    (folder / "doc.mtlx").write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("error", StageWarning)
        return read_stage(write(folder, REFERENCE))


def material_of(folder: Path, text: str) -> Material:
    (material,) = stage_of(folder, text).materials
    return material


def warned_material(folder: Path, text: str, expected: str) -> Material:
    Image.fromarray(PIXELS).save(folder / "p.png")
    (folder / "doc.mtlx").write_text(text)
    (material,) = read_with_warning(folder, REFERENCE, expected).materials
    return material


def color_from(folder: Path, nodes: str, kind: str = "color3") -> tuple[TextureLookup, np.ndarray]:
    """Return the lookup of the base color that comes from node N, and the decoded pixels that it reads."""
    text = document(linked("base_color", "N", kind) + given("base", "1"), nodes=nodes)
    description = stage_of(folder, text)
    lookup = description.materials[0].diffuse_color
    assert isinstance(lookup, TextureLookup)
    texture = description.textures[lookup.texture]
    pixels = texture.pixels.astype(float) / (255.0 if texture.pixels.dtype == np.uint8 else 1.0)
    if texture.encoding == "srgb":
        pixels = np.where(pixels <= 0.04045, pixels / 12.92, ((pixels + 0.055) / 1.055) ** 2.4)
    return lookup, pixels[..., :3] * lookup.scale[:3] + lookup.bias[:3]


def linear() -> np.ndarray:
    values = PIXELS / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def test_numbers_of_standard_surface_are_those_of_a_preview_surface(tmp_path):
    surface = (
        given("base", "0.5") + given("base_color", "0.8, 0.4, 0.2", "color3") + given("metalness", "0.25")
        + given("specular_roughness", "0.3") + given("specular_IOR", "1.4") + given("coat", "0.75")
        + given("coat_roughness", "0.05") + given("emission", "2") + given("emission_color", "1, 0.5, 0", "color3")
        + given("transmission", "0.25")
    )  # fmt: skip
    expected = Material(
        "Mat",
        diffuse_color=(0.4, 0.2, 0.1),
        emissive_color=(1.94, 0.97, 0.0),  # the coat reflects 0.04 back where it is
        metallic=0.25,
        roughness=0.3,
        clearcoat=0.75,
        clearcoat_roughness=0.05,
        opacity=0.75,
        ior=1.4,
        prim_path="/Looks/Mat",
    )
    assert rounded(material_of(tmp_path, document(surface))) == expected


def test_constant_color_in_srgb_is_decoded(tmp_path):
    spaced = given("base_color", "0.5, 0, 1", "color3").replace("<input", '<input colorspace="srgb_texture"')
    assert material_of(tmp_path, document(spaced)).diffuse_color == pytest.approx((0.2140411, 0, 1), rel=1e-5)


def rounded(material: Material) -> Material:
    """Round to the precision of the files, which is single."""
    values = {
        name: tuple(round(each, 6) for each in value) if isinstance(value, tuple) else round(value, 6)
        for name, value in vars(material).items()
        if isinstance(value, float) or (isinstance(value, tuple) and isinstance(value[0], float))
    }
    return replace(material, **values)


@pytest.mark.parametrize(
    ("model", "surface", "expected"),
    [
        (
            "open_pbr_surface",
            given("base_weight", "0.5") + given("base_color", "1, 0, 0", "color3") + given("base_metalness", "1")
            + given("coat_weight", "0.5") + given("emission_luminance", "100") + given("geometry_opacity", "0.5"),
            {"diffuse_color": (0.5, 0.0, 0.0), "metallic": 1.0, "roughness": 0.3, "clearcoat": 0.5,
             "clearcoat_roughness": 0.0, "emissive_color": (97.337278,) * 3, "opacity": 0.5,
             "opacity_mode": "presence"},
        ),
        (
            "gltf_pbr",
            given("base_color", "0, 1, 0", "color3") + given("roughness", "0.5") + given("alpha", "0.25")
            + given("emissive", "1, 2, 3", "color3") + given("emissive_strength", "2")
            + given("alpha_mode", "1", "integer"),
            {"diffuse_color": (0.0, 1.0, 0.0), "metallic": 1.0, "roughness": 0.5, "opacity": 0.25,
             "opacity_mode": "presence", "opacity_threshold": 0.5, "emissive_color": (2.0, 4.0, 6.0)},
        ),
        ("gltf_pbr", given("transmission", "1") + given("ior", "1.25"), {"opacity": 0.0, "ior": 1.25,
                                                                        "opacity_mode": "transparent"}),
    ],
)  # fmt: skip
def test_models_have_their_own_names_and_defaults(tmp_path, model, surface, expected):
    material = rounded(material_of(tmp_path, document(surface, model)))
    assert {name: getattr(material, name) for name in expected} == expected


@pytest.mark.parametrize(
    ("mode", "expected"), [("", (1.0, "transparent", 0.0)), ("0", (1.0, "transparent", 0.0)),
                           ("1", (0.25, "presence", 0.5)), ("2", (0.25, "presence", 0.0))],
)  # fmt: skip
def test_alpha_of_gltf_pbr_counts_where_its_mode_says_so(tmp_path, mode, expected):
    """The default of alpha_mode is 0, opaque."""
    surface = given("alpha", "0.25") + (given("alpha_mode", mode, "integer") if mode else "")
    material = material_of(tmp_path, document(surface, "gltf_pbr"))
    assert (material.opacity, material.opacity_mode, material.opacity_threshold) == expected


@pytest.mark.parametrize(
    ("color", "expected"), [("1, 0, 0", 0.2126), ("0.2, 0.5, 0.9", 0.4651), ("0.25, 0.25, 0.25", 0.25)]
)
def test_colored_opacity_counts_by_its_luminance(tmp_path, color, expected):
    material = material_of(tmp_path, document(given("opacity", color, "color3")))
    assert material.opacity == pytest.approx(expected)


def test_colored_picture_of_opacity_counts_by_its_luminance(tmp_path):
    description = stage_of(tmp_path, document(linked("opacity", "picture"), nodes=picture()))
    lookup = description.materials[0].opacity
    pixels = description.textures[lookup.texture].pixels[..., 0] / 255.0
    np.testing.assert_allclose(pixels, linear() @ (0.2126, 0.7152, 0.0722), atol=0.5 / 255.0 + 1e-6)


def test_gray_picture_of_opacity_stays_the_texture(tmp_path):
    Image.fromarray(np.repeat(PIXELS[..., :1], 3, axis=2)).save(tmp_path / "gray.png")
    description = stage_of(tmp_path, document(linked("opacity", "picture"), nodes=picture(file="gray.png")))
    lookup = description.materials[0].opacity
    assert (lookup.channel, description.textures[lookup.texture].name) == ("r", "gray.png")


def test_weight_of_the_specular_lobe_scales_the_reflectance(tmp_path):
    """At ior 1.5 a surface reflects 4 % at normal incidence; a quarter of that is 1 %: (n - 1) / (n + 1) = 0.1."""
    material = material_of(tmp_path, document(given("specular", "0.25")))
    assert material.ior == pytest.approx(1.1 / 0.9)


def test_files_are_relative_to_the_document_and_colors_are_decoded(tmp_path):
    lookup, pixels = color_from(tmp_path, picture(name="N"))
    assert (lookup.channel, lookup.uv_transform) == ("rgb", (1.0, 0.0, 0.0, 0.0, 1.0, 0.0))
    np.testing.assert_allclose(pixels, linear(), atol=1e-6)


@pytest.mark.parametrize(
    ("nodes", "factor", "summand"),
    [
        (node("multiply", "color3", linked("in1", "picture"), given("in2", "0.5, 1, 2", "color3")), (0.5, 1, 2), 0),
        (node("multiply", "color3", given("in1", "2"), linked("in2", "picture")), 2, 0),
        (node("add", "color3", linked("in1", "picture"), given("in2", "0.1, 0.2, 0.3", "color3")), 1, (0.1, 0.2, 0.3)),
        (node("subtract", "color3", given("in1", "1, 1, 1", "color3"), linked("in2", "picture")), -1, 1),
        (node("invert", "color3", linked("in", "picture")), -1, 1),
        (node("contrast", "color3", linked("in", "picture"), given("amount", "2")), 2, -0.5),
        (
            node("mix", "color3", linked("bg", "picture"), given("fg", "1, 0, 0", "color3"), given("mix", "0.25")),
            0.75,
            (0.25, 0, 0),
        ),
    ],
)
def test_operations_with_constants_keep_the_file_as_the_texture(tmp_path, nodes, factor, summand):
    lookup, pixels = color_from(tmp_path, picture() + nodes)
    np.testing.assert_allclose(lookup.scale[:3], np.broadcast_to(factor, 3), rtol=1e-6)
    np.testing.assert_allclose(lookup.bias[:3], np.broadcast_to(summand, 3), rtol=1e-6)
    np.testing.assert_allclose(pixels, linear() * factor + summand, atol=1e-6)


@pytest.mark.parametrize(
    ("nodes", "function"),
    [
        (node("multiply", "color3", linked("in1", "picture"), linked("in2", "picture")), lambda c: c * c),
        (node("power", "color3", linked("in1", "picture"), given("in2", "0.5")), lambda c: c**0.5),
        (node("clamp", "color3", linked("in", "picture"), given("high", "0.25")), lambda c: np.clip(c, 0, 0.25)),
        (
            node("saturate", "color3", linked("in", "picture"), given("amount", "0"))
            .replace("</saturate>", given("lumacoeffs", "0.25, 0.5, 0.25", "color3") + "</saturate>"),
            lambda c: np.repeat(c @ [[0.25], [0.5], [0.25]], 3, axis=2),
        ),
        (
            node("mix", "color3", given("bg", "1, 0, 0", "color3"), given("fg", "0, 0, 1", "color3"),
                 linked("mix", "red", "float"))
            + node("extract", "float", linked("in", "picture"), given("index", "0", "integer"), name="red"),
            lambda c: np.array([1, 0, 0]) * (1 - c[..., :1]) + np.array([0, 0, 1]) * c[..., :1],
        ),
        (
            node("combine3", "color3", linked("in1", "parts", "float", 'output="outb"'), given("in2", "0"),
                 given("in3", "1"))
            + node("separate3", "multioutput", linked("in", "picture"), name="parts"),
            lambda c: np.stack([c[..., 2], 0 * c[..., 0], 0 * c[..., 0] + 1], axis=-1),
        ),
        (
            node("hsvadjust", "color3", linked("in", "picture"), given("amount", "0.3333333, 1, 1", "vector3")),
            lambda c: np.roll(c, 1, axis=-1),  # a third of the circle turns red to green
        ),
        (
            node("remap", "color3", linked("in", "picture"), given("inhigh", "2"), given("outlow", "0.5"),
                 given("outhigh", "0.75")),
            lambda c: 0.5 + c / 8,
        ),
        (
            node("ifgreater", "color3", linked("value1", "red", "float"), given("value2", "0.5"),
                 given("in1", "1, 1, 1", "color3"), given("in2", "0, 0, 0", "color3"))
            + node("extract", "float", linked("in", "picture"), given("index", "0", "integer"), name="red"),
            lambda c: np.repeat((c[..., :1] > 0.5) * 1.0, 3, axis=2),
        ),
        (
            node("smoothstep", "color3", linked("in", "picture"), given("low", "0.5"), given("high", "0.5")),
            lambda c: (c >= 0.5) * 1.0,
        ),
        (
            node("colorcorrect", "color3", linked("in", "picture"), given("saturation", "0.5"), given("gain", "0.5")),
            lambda c: 0.25 * (c + c @ [[0.2722287], [0.6740818], [0.0536895]]),
        ),
        (
            node("overlay", "color3", linked("fg", "picture"), given("bg", "0.75, 0.75, 0.75", "color3")),
            lambda c: 1 - 0.5 * (1 - c),
        ),
        (
            node("difference", "color3", linked("fg", "picture"), given("bg", "0.5, 0.5, 0.5", "color3"),
                 given("mix", "0.5")),
            lambda c: 0.25 + 0.5 * np.abs(c - 0.5),
        ),
        (
            node("burn", "color3", given("fg", "0.5, 1, 1", "color3"), linked("bg", "picture")),
            lambda c: c @ np.diag([2, 1, 1]) - [1, 0, 0],
        ),
        (
            node("dodge", "color3", given("fg", "0.5, 0.5, 0", "color3"), linked("bg", "picture")),
            lambda c: c @ np.diag([2, 2, 1]),
        ),
        (node("fract", "color3", linked("in", "N3")) + node("multiply", "color3", linked("in1", "picture"),
                                                            given("in2", "5"), name="N3"), lambda c: 5 * c % 1),
        (node("atan2", "color3", linked("iny", "picture"), given("inx", "2, 2, 2", "color3")),
         lambda c: np.arctan2(c, 2)),
        (node("not", "boolean", linked("in", "high", "boolean"))
         + node("ifgreater", "boolean", linked("value1", "red", "float"), given("value2", "0.5"),
                given("in1", "true", "boolean"), given("in2", "false", "boolean"), name="high")
         + node("extract", "float", linked("in", "picture"), given("index", "0", "integer"), name="red"),
         lambda c: np.repeat((c[..., :1] <= 0.5) * 1.0, 3, axis=2)),
    ],
)  # fmt: skip
def test_other_operations_are_computed_per_texel(tmp_path, nodes, function):
    _, pixels = color_from(tmp_path, picture() + nodes)
    assert pixels.shape == (2, 2, 3)
    np.testing.assert_allclose(pixels, function(linear()), atol=0.005)  # stored in 8 bits


def test_tiling_and_placement_become_a_map_of_the_coordinates(tmp_path):
    """tiledimage: uv * 2 - (0.5, 0); place2d scales and turns about its pivot, then subtracts its offset."""
    tiled = picture(name="N", more=given("uvtiling", "2, 3", "vector2") + given("uvoffset", "0.5, 0", "vector2"))
    lookup, _ = color_from(tmp_path, tiled.replace("<image", "<tiledimage").replace("</image", "</tiledimage"))
    assert lookup.uv_transform == (2.0, 0.0, -0.5, 0.0, 3.0, 0.0)
    place = node(
        "place2d", "vector2", given("pivot", "0.5, 0.5", "vector2"), given("scale", "0.5, 0.5", "vector2"),
        given("rotate", "90"), given("offset", "0.25, 0", "vector2"), linked("texcoord", "at", "vector2"), name="place",
    )  # fmt: skip
    at = node("geompropvalue", "vector2", given("geomprop", "other", "string"), name="at")
    lookup, _ = color_from(tmp_path, at + place + picture(name="N", more=linked("texcoord", "place", "vector2")))
    # (u, v) -> 2 (u - 1/2, v - 1/2) -> clockwise: (2 v - 1, 1 - 2 u) -> minus offset, plus pivot
    np.testing.assert_allclose(lookup.uv_transform, (0.0, 2.0, -0.75, -2.0, 0.0, 1.5), atol=1e-6)


def test_normal_maps_and_two_uv_sets(tmp_path):
    at = node("geompropvalue", "vector2", given("geomprop", "other", "string"), name="at")
    bumps = node("normalmap", "vector3", linked("in", "bumps", "vector3"), given("scale", "0.5"), name="N")
    nodes = at + picture("vector3", name="bumps", more=linked("texcoord", "at", "vector2")) + bumps + picture()
    text = document(linked("normal", "N", "vector3") + linked("base_color", "picture"), nodes=nodes)
    description = stage_of(tmp_path, text)
    normal, color = description.materials[0].normal, description.materials[0].diffuse_color
    assert normal.scale[:3] == (1.0, 1.0, 2.0)
    assert normal.bias[:3] == (-0.5, -0.5, -1.0)
    assert description.textures[normal.texture].encoding == "raw"
    assert normal.uv_set == 0
    assert isinstance(color, TextureLookup)


def test_vertex_colors_are_read(tmp_path):
    nodes = node("geompropvalue", "color3", given("geomprop", "tint", "string"), name="N")
    text = document(linked("base_color", "N") + given("base", "1"), nodes=nodes)
    description = stage_of(tmp_path, text)
    assert description.materials[0].diffuse_color == TextureLookup(-1)
    np.testing.assert_array_equal(description.meshes[0].colors[0, :3], (1.0, 0.0, 0.0))


def test_node_graphs_interfaces_and_definitions_are_expanded(tmp_path):
    graph = (
        '<nodedef name="ND_dye" node="dye">' + given("tone", "1, 1, 1", "color3") + given("gain", "0.5")
        + '<output name="out" type="color3" /></nodedef>'
        + '<nodegraph name="NG_dye" nodedef="ND_dye">'
        + '<multiply name="both" type="color3"><input name="in1" type="color3" interfacename="tone" />'
        + '<input name="in2" type="float" interfacename="gain" /></multiply>'
        + '<output name="out" type="color3" nodename="both" /></nodegraph>'
        + '<dye name="mine" type="color3">' + given("tone", "0.2, 0.4, 0.8", "color3") + "</dye>"
        + '<nodegraph name="NG"><input name="c" type="color3" nodename="mine" />'
        + '<dot name="d" type="color3"><input name="in" type="color3" interfacename="c" /></dot>'
        + '<output name="result" type="color3" nodename="d" /></nodegraph>'
    )  # fmt: skip
    surface = '<input name="base_color" type="color3" nodegraph="NG" output="result" />' + given("base", "1")
    material = rounded(material_of(tmp_path, document(surface, nodes=graph)))
    assert material.diffuse_color == (0.1, 0.2, 0.4)


@pytest.mark.parametrize(
    ("surface", "nodes", "text"),
    [
        (given("coat_anisotropy", "1"), "", "MaterialX inputs that are not applied: coat_anisotropy: </Looks/Mat/SR>"),
        (given("transmission_dispersion", "40"), "", "not applied: transmission_dispersion: </Looks/Mat/SR>"),
        (given("coat_affect_roughness", "1"), "", "not applied: coat_affect_roughness: </Looks/Mat/SR>"),
        (given("subsurface", "1"), "", "subsurface scattering is drawn as diffuse"),
        (linked("base_color", "N"), node("fractal3d", "color3"), "'fractal3d' is not computed; its mean"),
        (linked("base_color", "N"), node("toon", "color3"), "'ND_toon_color3' is not supported; it counts as 0.5"),
        (linked("base_color", "N"), picture(name="N", file="gone.png"), "there is no texture|cannot be read"),
        (linked("specular_IOR", "N", "float"), picture("float", name="N"), "specular_IOR cannot come from a texture"),
        (linked("base_color", "N"), node("multiply", "color3", linked("in1", "N")), "connected to itself counts as 0"),
    ],
)
def test_what_is_not_drawn_is_named(tmp_path, surface, nodes, text):
    assert warned_material(tmp_path, document(surface, nodes=nodes), text).name == "Mat"
