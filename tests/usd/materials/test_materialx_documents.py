# SPDX-License-Identifier: Apache-2.0
"""MaterialX: documents that stages reference, and inline networks; where they are found, and which are preferred."""

from __future__ import annotations

import os
import zipfile
from dataclasses import replace

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
    picture,
    rounded,
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
        (document(given("base", "one")), "material 'Mat': could not convert string to float: 'one'"),
    ],
)
def test_broken_documents_are_named_and_the_rest_is_drawn(tmp_path, text, expected):
    (tmp_path / "doc.mtlx").write_text(text)
    with pytest.warns(StageWarning, match=expected):
        description = read_stage(write(tmp_path, REFERENCE))
    assert len(description.instances) == 1


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


def test_document_used_least_recently_is_dropped_first(tmp_path, monkeypatch):
    monkeypatch.setattr(materialx_document, "_layers", LRUCache(2))
    paths = [str(tmp_path / f"{number}.mtlx") for number in range(3)]
    for path in paths:
        with open(path, "w", encoding="utf-8") as file:
            file.write(document(given("base", "1")))
    first, second = (layer_of_document(path)[0] for path in paths[:2])
    assert layer_of_document(paths[0])[0] is first
    layer_of_document(paths[2])
    assert layer_of_document(paths[0])[0] is first
    assert layer_of_document(paths[1])[0] is not second


def test_changed_document_is_read_again(tmp_path):
    first = material_of(tmp_path, document(given("metalness", "0.25")))
    (tmp_path / "doc.mtlx").write_text(document(given("metalness", "0.75")))
    os.utime(tmp_path / "doc.mtlx", (1, 1))
    second = read_stage(tmp_path / "stage.usda").materials[0]
    assert (first.metallic, second.metallic) == (0.25, 0.75)
    with pytest.raises(StageError, match="missing"):
        read_stage(write(tmp_path, 'def "A" (references = @./missing.usda@)\n{\n}'))
