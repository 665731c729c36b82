# SPDX-License-Identifier: Apache-2.0
"""MaterialX: documents that stages reference, and inline networks; where they are found, and which are preferred."""

from __future__ import annotations

import os
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from dynamics.lru_cache import LRUCache
from tests.usd.helpers import read_with_warning, write
from tests.usd.materials.test_materialx import (
    PIXELS,
    QUAD,
    REFERENCE,
    document,
    given,
    linked,
    material_of,
    node,
    picture,
    rounded,
    stage_of,
    warned_material,
)
from tiscene.errors import StageError, StageWarning
from tiscene.scene.description import Material, TextureLookup
from tiscene.usd.materials import materialx_document
from tiscene.usd.materials.materialx_document import layer_of_document
from tiscene.usd.read.stage_reader import read_stage


def test_old_documents_with_shader_references_are_read(tmp_path):
    text = """<?xml version="1.0"?>
<materialx version="1.36"><material name="Mat"><shaderref name="SR" node="standard_surface">
<bindinput name="base_color" type="color3" value="0.25, 0.5, 1" /><bindinput name="base" type="float" value="1" />
</shaderref></material></materialx>"""
    assert material_of(tmp_path, text).diffuse_color == (0.25, 0.5, 1.0)


def test_document_in_a_package_is_read(tmp_path):
    Image.fromarray(PIXELS).save(tmp_path / "p.png")
    root = write(tmp_path, REFERENCE.replace("./doc", "./looks/doc"))
    with zipfile.ZipFile(tmp_path / "packed.usdz", "w") as archive:
        archive.write(root, "stage.usda")
        surface = linked("base_color", "picture")
        archive.writestr("looks/doc.mtlx", document(surface, nodes=picture(file="../p.png")))
        archive.write(tmp_path / "p.png", "p.png")
    (material,) = read_stage(tmp_path / "packed.usdz").materials
    assert isinstance(material.diffuse_color, TextureLookup)


INLINE = """def Scope "Looks"
{
    def Material "Mat"
    {
        token outputs:mtlx:surface.connect = </Looks/Mat/S.outputs:out>
        def Shader "S"
        {
            uniform token info:id = "ND_UsdPreviewSurface_surfaceshader"
            color3f inputs:diffuseColor.connect = </Looks/Mat/T.outputs:out>
            float inputs:roughness = 0.25
            int inputs:opacityMode = 1
            float inputs:opacity = 0.5
            token outputs:out
        }
        def Shader "T"
        {
            uniform token info:id = "ND_multiply_color3FA"
            color3f inputs:in1 = (0.2, 0.4, 0.6)
            float inputs:in2 = 0.5
            color3f outputs:out
        }
    }
}
"""


def test_inline_network_is_read(tmp_path):
    (material,) = read_stage(write(tmp_path, INLINE + QUAD)).materials
    expected = Material("Mat", (0.1, 0.2, 0.3), roughness=0.25, opacity=0.5, opacity_mode="presence")
    assert rounded(material) == replace(expected, prim_path="/Looks/Mat")


def test_number_of_opacity_mode_is_read_without_other_nodes(tmp_path):
    """It became the mode "1" unless a MaterialX node was connected to the surface."""
    alone = INLINE.replace(
        "inputs:diffuseColor.connect = </Looks/Mat/T.outputs:out>", "inputs:diffuseColor = (1, 0, 0)"
    )
    (material,) = read_stage(write(tmp_path, alone + QUAD)).materials
    assert (material.diffuse_color, material.opacity_mode) == ((1.0, 0.0, 0.0), "presence")


BOTH = """def Scope "Looks"
{
    def Material "Mat"
    {
        token outputs:surface.connect = </Looks/Mat/P.outputs:surface>
        token outputs:mtlx:surface.connect = </Looks/Mat/S.outputs:out>
        def Shader "P"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (1, 0, 0)
            token outputs:surface
        }
        def Shader "S"
        {
            uniform token info:id = "MODEL"
            color3f inputs:base_color = (0.1, 0.2, 0.3)
            token outputs:out
        }
    }
}
"""


def test_materialx_is_preferred_to_a_universal_preview_surface(tmp_path):
    body = BOTH.replace("MODEL", "ND_open_pbr_surface_surfaceshader")
    (material,) = read_stage(write(tmp_path, body + QUAD)).materials
    assert material.diffuse_color == pytest.approx((0.1, 0.2, 0.3))


def test_preview_surface_replaces_a_materialx_model_that_is_not_read(tmp_path):
    expected = "shader 'ND_surface' is not supported; its UsdPreviewSurface is used"
    (material,) = read_with_warning(tmp_path, BOTH.replace("MODEL", "ND_surface") + QUAD, expected).materials
    assert material.diffuse_color == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("no xml", "doc.mtlx@ cannot be read: it is not a MaterialX document"),
        ("<usd/>", "doc.mtlx@ cannot be read: .* its root element is <usd>"),
        (document(linked("base", "N"), nodes=node("add", "float", linked("in1", "N"))), "connected to itself"),
    ],
)
def test_broken_documents_are_named_and_the_rest_is_drawn(tmp_path, text, expected):
    (tmp_path / "doc.mtlx").write_text(text)
    with pytest.warns(StageWarning, match=expected):
        description = read_stage(write(tmp_path, REFERENCE))
    assert len(description.instances) == 1


def test_value_of_another_type_keeps_the_default_of_its_input_alone(tmp_path):
    """A library of materials that gives OpenPBR's subsurface_radius three numbers lost 18 of 110 materials."""
    surface = given("base_color", "0.25, 0.5, 1", "color3") + given("subsurface_radius", "1, 2, 3")
    expected = (
        r"@.*doc\.mtlx@ has values of another type .*: subsurface_radius of SR \('1, 2, 3' is not a float\); left out"
    )
    material = warned_material(tmp_path, document(surface, "open_pbr_surface"), expected)
    assert material.diffuse_color == (0.25, 0.5, 1.0)


def test_many_values_of_another_type_share_a_line(tmp_path):
    surface = "".join(given(f"unknown_{row}", "?") for row in range(8))
    warned_material(tmp_path, document(surface), r"unknown_4 of SR .* and 3 more; left out")


def test_empty_value_is_the_default(tmp_path):
    """MaterialX's baker writes them."""
    surface = given("metallic", "0") + given("alpha_mode", "", "integer") + given("alpha", "0.5")
    assert material_of(tmp_path, document(surface, "gltf_pbr")).opacity == 1.0


INCLUDED = """<materialx version="1.38" colorspace="srgb_texture" fileprefix="maps/">
  <image name="picture" type="color3"><input name="file" type="filename" value="p.png" /></image>
  <constant name="C" type="float"><input name="value" type="float" value="0.25" /></constant>
</materialx>"""


def include(file: str) -> str:
    return f'<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="{file}" />'


def test_included_documents_are_read_with_their_own_folder_and_color_space(tmp_path):
    (tmp_path / "library" / "maps").mkdir(parents=True)
    Image.fromarray(PIXELS).save(tmp_path / "library" / "maps" / "p.png")
    (tmp_path / "library" / "nodes.mtlx").write_text(INCLUDED)
    (tmp_path / "all.mtlx").write_text(f'<materialx version="1.38">{include("library/nodes.mtlx")}</materialx>')
    surface = linked("base_color", "picture") + linked("metalness", "C", "float")
    description = stage_of(tmp_path, document(surface, nodes=include("all.mtlx")))
    assert description.materials[0].metallic == 0.25
    assert [each.encoding for each in description.textures] == ["srgb"]


def test_changed_included_document_is_read_again(tmp_path):
    (tmp_path / "nodes.mtlx").write_text(INCLUDED)
    text = document(linked("metalness", "C", "float"), nodes=include("nodes.mtlx"))
    assert material_of(tmp_path, text).metallic == 0.25
    (tmp_path / "nodes.mtlx").write_text(INCLUDED.replace("0.25", "0.75"))
    assert material_of(tmp_path, text).metallic == 0.75


@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("gone.mtlx", r"doc\.mtlx@ cannot be read: it includes @.*gone\.mtlx@: .*No such file"),
        ("doc.mtlx", r"it includes @.*doc\.mtlx@, which includes it"),
        ("../nodes.mtlx", r"it includes @.*nodes\.mtlx@, which is outside of the root folder"),
    ],
)
def test_included_document_that_cannot_be_read_is_named(tmp_path, file, expected):
    (tmp_path / "nodes.mtlx").write_text(INCLUDED)
    (tmp_path / "inside").mkdir()
    (tmp_path / "inside" / "doc.mtlx").write_text(document(given("base", "1"), nodes=include(file)))
    with pytest.warns(StageWarning, match=expected):
        read_stage(write(tmp_path / "inside", REFERENCE), root=tmp_path / "inside")


def test_materials_and_shaders_inherit_inputs(tmp_path):
    nodes = node("standard_surface", "surfaceshader", given("metalness", "0.25"), given("base", "0.5"), name="Other")
    text = document(given("base", "1") + given("base_color", "1, 1, 1", "color3"), nodes=nodes)
    text = text.replace('name="SR"', 'name="SR" inherit="Other"').replace('name="Mat"', 'name="First"')
    inherited = '<surfacematerial name="Mat" type="material" inherit="First" />\n</materialx>'
    material = material_of(tmp_path, text.replace("</materialx>", inherited))
    assert (material.metallic, material.diffuse_color) == (0.25, (1.0, 1.0, 1.0))


def test_color_space_of_a_node_is_that_of_its_inputs(tmp_path):
    surface = linked("base_color", "C")
    color = node("constant", "color3", given("value", "0.5, 0.5, 0.5", "color3"), name="C")
    nodes = color.replace("<constant", '<constant colorspace="srgb_texture"')
    assert material_of(tmp_path, document(surface, nodes=nodes)).diffuse_color == pytest.approx((0.214,) * 3, abs=1e-3)


def test_node_is_implemented_by_the_definition_of_its_type(tmp_path):
    definitions = ""
    for kind, value in (("float", "0.25"), ("color3", "1, 0, 0")):
        definitions += f"""<nodedef name="ND_own_{kind}" node="own"><output name="out" type="{kind}" /></nodedef>
          <implementation name="I_{kind}" nodedef="ND_own_{kind}" nodegraph="G_{kind}" />
          <nodegraph name="G_{kind}"><constant name="c" type="{kind}">{given("value", value, kind)}</constant>
          <output name="out" type="{kind}" nodename="c" /></nodegraph>"""
    nodes = definitions + node("own", "float", name="A") + node("own", "color3", name="B")
    material = material_of(
        tmp_path, document(linked("metalness", "A", "float") + linked("base_color", "B"), nodes=nodes)
    )
    assert (material.metallic, material.diffuse_color) == (0.25, (1.0, 0.0, 0.0))


def test_displacement_of_a_document_is_named(tmp_path):
    shader = linked("displacementshader", "D", "displacementshader")
    text = document(given("base", "1"), nodes=node("displacement", "displacementshader", name="D"))
    warned_material(
        tmp_path, text.replace("</surfacematerial>", f"{shader}</surfacematerial>"), "displacement is not applied"
    )


def test_channels_of_an_input_are_read(tmp_path):
    surface = linked("base_color", "picture", more='channels="bbb" ') + linked(
        "metalness", "picture", "float", 'channels="g"'
    )
    material = material_of(tmp_path, document(surface, nodes=picture()))
    assert (material.diffuse_color.channel, material.metallic.channel) == ("b", "g")


@pytest.mark.parametrize("definition", ["", 'nodedef="ND_surface_unlit"'])
def test_unlit_surface_emits_and_reflects_nothing(tmp_path, definition):
    surface = given("emission", "2") + linked("emission_color", "picture") + given("opacity", "0.5")
    text = document(surface, "surface_unlit", picture()).replace("<surface_unlit", f"<surface_unlit {definition}")
    material = material_of(tmp_path, text)
    assert material.emissive_color.scale[:3] == (2.0, 2.0, 2.0)
    assert (material.diffuse_color, material.ior, material.clearcoat) == ((0.0, 0.0, 0.0), 1.0, 0.0)
    assert (material.opacity, material.opacity_mode) == (0.5, "presence")


def test_standard_surface_of_the_first_version_has_its_own_defaults(tmp_path):
    text = document(given("specular_anisotropy", "0.5"))
    text = text.replace("<standard_surface ", '<standard_surface nodedef="ND_standard_surface_surfaceshader_100" ')
    material = rounded(material_of(tmp_path, text))
    assert (material.diffuse_color, material.lobes.anisotropy) == ((0.8, 0.8, 0.8), pytest.approx(0.5))


def test_definition_of_several_outputs_is_found_by_the_types_of_its_inputs(tmp_path):
    definitions = ""
    for kind, value in (("color3", "0.25"), ("float", "0.75")):
        definitions += f"""<nodedef name="ND_parts_{kind}" node="parts"><input name="in" type="{kind}" />
          <output name="a" type="float" /><output name="b" type="float" /></nodedef>
          <nodegraph name="G_{kind}" nodedef="ND_parts_{kind}"><constant name="c" type="float">
          {given("value", value)}</constant><output name="a" type="float" nodename="c" />
          <output name="b" type="float" nodename="c" /></nodegraph>"""
    nodes = definitions + node("parts", "multioutput", given("in", "0"))
    material = material_of(tmp_path, document(linked("metalness", "N", "float", 'output="b"'), nodes=nodes))
    assert material.metallic == 0.75


def test_node_of_the_library_beside_a_definition_of_its_name_stays_that_of_the_library(tmp_path):
    """Such a definition, of another type and of that node itself, was expanded without end."""
    definition = """<nodedef name="ND_invert_own" node="invert"><input name="in" type="color3" />
      <output name="out" type="color3" /></nodedef><nodegraph name="G" nodedef="ND_invert_own">
      <invert name="i" type="float"><input name="in" type="float" value="0.25" /></invert>
      <convert name="c" type="color3"><input name="in" type="float" nodename="i" /></convert>
      <output name="out" type="color3" nodename="c" /></nodegraph>"""
    nodes = definition + node("invert", "color3", given("in", "1, 0, 0", "color3"))
    material = material_of(tmp_path, document(linked("base_color", "N") + given("base", "1"), nodes=nodes))
    assert material.diffuse_color == (0.75, 0.75, 0.75)


def test_inputs_of_own_definitions_have_texture_coordinates_by_default(tmp_path):
    definition = """<nodedef name="ND_left" node="left"><input name="at" type="vector2" defaultgeomprop="UV0" />
      <output name="out" type="float" /></nodedef><nodegraph name="G" nodedef="ND_left">
      <extract name="u" type="float"><input name="in" type="vector2" interfacename="at" /></extract>
      <output name="out" type="float" nodename="u" /></nodegraph>"""
    description = stage_of(
        tmp_path, document(linked("metalness", "N", "float"), nodes=definition + node("left", "float"))
    )
    pixels = description.textures[description.materials[0].metallic.texture].pixels
    np.testing.assert_allclose(pixels[0, :, 0] / 255.0, (np.arange(512) + 0.5) / 512, atol=0.003)


def test_interface_of_another_type_is_named(tmp_path):
    """USD's error refused the whole stage."""
    graph = '<nodegraph name="G"><input name="c" type="color3" value="1, 1, 1" /><multiply name="m" type="float">'
    graph += (
        '<input name="in1" type="float" interfacename="c" /></multiply><output name="out" type="float" nodename="m" />'
    )
    surface = '<input name="metalness" type="float" nodegraph="G" output="out" />' + given("coat", "1")
    material = warned_material(tmp_path, document(surface, nodes=graph + "</nodegraph>"), "c of G_m .*is not a float")
    assert material.clearcoat == 1.0


def test_missing_texture_is_named_with_its_document(tmp_path):
    """The warning had the address of a layer in memory, which differs from run to run."""
    text = document(linked("base_color", "picture"), nodes=picture(file="gone.png"))
    (tmp_path / "doc.mtlx").write_text(text)
    description = read_with_warning(tmp_path, REFERENCE, r"there is no texture @.*gone\.png@ \(named in .*/doc\.mtlx\)")
    assert len(description.instances) == 1


def test_missing_document_is_named(tmp_path):
    description = read_with_warning(tmp_path, REFERENCE, r"</Looks> composition: .*doc\.mtlx.*left out")
    assert len(description.instances) == 1


def test_document_outside_the_root_is_not_read(tmp_path):
    (tmp_path / "inside").mkdir()
    (tmp_path / "doc.mtlx").write_text(document(given("base", "1")))
    path = write(tmp_path / "inside", REFERENCE.replace("./doc", "../doc"))
    with pytest.warns(StageWarning, match=r"composition: .*doc\.mtlx"):
        read_stage(path, root=tmp_path / "inside")


def anything(_: str) -> bool:
    return True


def test_document_used_least_recently_is_dropped_first(tmp_path, monkeypatch):
    monkeypatch.setattr(materialx_document, "_layers", LRUCache(2))
    paths = [str(tmp_path / f"{number}.mtlx") for number in range(3)]
    for path in paths:
        with open(path, "w", encoding="utf-8") as file:
            file.write(document(given("base", "1")))
    first, second = (layer_of_document(path, anything)[0] for path in paths[:2])
    assert layer_of_document(paths[0], anything)[0] is first
    layer_of_document(paths[2], anything)
    assert layer_of_document(paths[0], anything)[0] is first
    assert layer_of_document(paths[1], anything)[0] is not second


def test_changed_document_is_read_again(tmp_path):
    first = material_of(tmp_path, document(given("metalness", "0.25")))
    (tmp_path / "doc.mtlx").write_text(document(given("metalness", "0.75")))
    os.utime(tmp_path / "doc.mtlx", (1, 1))
    second = read_stage(tmp_path / "stage.usda").materials[0]
    assert (first.metallic, second.metallic) == (0.25, 0.75)
    with pytest.raises(StageError, match="missing"):
        read_stage(write(tmp_path, 'def "A" (references = @./missing.usda@)\n{\n}'))


def test_definition_that_inherits_its_output_comes_before_that_of_the_older_version(tmp_path):
    """As the library's file of standard_surface, whose version 1.0.1 only has other defaults."""
    nodes = (
        '<nodedef name="ND_dye" node="dye" inherit="ND_dye_100">' + given("gain", "0.25") + "</nodedef>"
        '<nodedef name="ND_dye_100" node="dye">' + given("gain", "0.5")
        + '<output name="out" type="color3" /></nodedef>'
        '<implementation name="I1" nodedef="ND_dye" nodegraph="NG_dye" />'
        '<implementation name="I2" nodedef="ND_dye_100" nodegraph="NG_dye" />'
        '<nodegraph name="NG_dye"><multiply name="both" type="color3">' + given("in1", "1, 1, 1", "color3")
        + '<input name="in2" type="float" interfacename="gain" /></multiply>'
        + '<output name="out" type="color3" nodename="both" /></nodegraph><dye name="N" type="color3" />'
    )  # fmt: skip
    surface = linked("base_color", "N") + given("base", "1")
    assert material_of(tmp_path, document(surface, nodes=nodes)).diffuse_color == (0.25, 0.25, 0.25)
