# SPDX-License-Identifier: Apache-2.0
"""White furnace: white MaterialX surfaces, as they are read, return all light, and never more."""

from __future__ import annotations

import numpy as np
import pytest

from tests.render.bsdfs.test_bsdfs import outgoing
from tests.render.bsdfs.test_extended_lobes import albedo
from tests.render.extended_shading import ExtendedBsdf
from tests.render.shading import Bsdf
from tests.usd.materials.test_materialx import document, given, material_of
from tests.usd.materials.test_materialx_blender import link, shader
from tests.usd.materials.test_materialx_folding import folded, layer, mixed
from tiscene.scene.description import Material

WHITE = "color3f color = (1, 1, 1)"
ROUGH = "float2 roughness = (0.25, 0.25)"
COLORS = ("base_color", "specular_color", "transmission_color", "subsurface_color", "sheen_color", "coat_color")
PARTS = {
    "diffuse": shader("diffuse", "ND_oren_nayar_diffuse_bsdf", WHITE),
    "metal": shader("metal", "ND_generalized_schlick_bsdf", "color3f color0 = (1, 1, 1)", ROUGH),
    "glass": shader("glass", "ND_dielectric_bsdf", 'string scatter_mode = "RT"', ROUGH),
    "sheet": shader("sheet", "ND_translucent_bsdf", WHITE),
    "gloss": shader("gloss", "ND_dielectric_bsdf", ROUGH),
    "sheen": shader("sheen", "ND_sheen_bsdf", WHITE),
}


def returned(material: Material) -> np.ndarray:
    """Return the reflected and transmitted share of light at four angles, where it is largest by channel."""
    lobes = material.lobes
    bsdf = Bsdf(material) if lobes is None else ExtendedBsdf(material)
    is_solid = material.opacity != 1.0 and not (lobes is not None and lobes.thin_walled)
    eta = material.ior if is_solid else 1.0
    cosines = (0.2, 0.5, 0.8, 1.0)
    return np.array([albedo(bsdf, outgoing(each, 1)[0], 20_000, eta).max() for each in cosines])


def white(model: str, **numbers: float) -> str:
    names = [each.replace("sheen", "fuzz") if model == "open_pbr_surface" else each for each in COLORS]
    text = "".join(given(each, "1, 1, 1", "color3") for each in names)
    if model == "standard_surface":
        text += given("base", "1")
    return document(text + "".join(given(name, str(value)) for name, value in numbers.items()), model)


@pytest.mark.parametrize("roughness", [pytest.param(0.1, marks=pytest.mark.slow), 0.5, 1.0])
@pytest.mark.parametrize("further", [
    {}, {"metalness": 0.5}, {"metalness": 1.0}, {"coat": 1.0}, {"coat": 1.0, "metalness": 1.0}, {"sheen": 1.0},
    {"transmission": 0.5}, {"transmission": 1.0}, {"sheen": 0.5, "coat": 0.5, "metalness": 0.5},
])  # fmt: skip
def test_white_standard_surface_returns_all_light(tmp_path, roughness, further):
    text = white("standard_surface", specular_roughness=roughness, **further)
    np.testing.assert_allclose(returned(material_of(tmp_path, text)), 1.0, atol=0.012)


@pytest.mark.parametrize("further", [
    {}, {"base_metalness": 0.5}, {"base_metalness": 1.0}, {"coat_weight": 1.0}, {"fuzz_weight": 1.0},
    {"coat_weight": 1.0, "base_metalness": 1.0}, {"transmission_weight": 1.0},
    {"fuzz_weight": 0.5, "coat_weight": 0.5, "base_metalness": 0.5},
])  # fmt: skip
def test_white_openpbr_returns_all_light(tmp_path, further):
    text = white("open_pbr_surface", specular_roughness=0.5, **further)
    np.testing.assert_allclose(returned(material_of(tmp_path, text)), 1.0, atol=0.012)


@pytest.mark.parametrize("coat", [0.0, 1.0])
def test_metal_of_openpbr_returns_its_specular_weight_below_a_coat_too(tmp_path, coat):
    """Below a coat it is darker, for the light that the coat reflects back to it, and returned 0.56."""
    text = white("open_pbr_surface", base_metalness=1.0, specular_weight=0.25, specular_roughness=0.3, coat_weight=coat)
    found = returned(material_of(tmp_path, text))
    assert found[-1] == pytest.approx(0.25 if coat == 0.0 else 0.16, abs=0.02)


@pytest.mark.parametrize("weight", [0.25, 0.75])
@pytest.mark.parametrize(("background", "foreground"), [
    ("diffuse", "metal"), ("diffuse", "glass"), ("diffuse", "sheet"), ("metal", "glass"), ("metal", "sheet"),
])  # fmt: skip
def test_white_mixtures_return_all_light(tmp_path, background, foreground, weight):
    nodes = mixed(background, foreground, weight), PARTS[background], PARTS[foreground]
    np.testing.assert_allclose(returned(folded(tmp_path, *nodes)), 1.0, atol=0.02)


@pytest.mark.parametrize("weight", [0.25, 0.75])
def test_glass_mixed_with_a_sheet_keeps_its_light(tmp_path, weight):
    """But for what a rough pane loses at grazing angles. It lost up to a quarter, at all angles."""
    found = returned(folded(tmp_path, mixed("glass", "sheet", weight), PARTS["glass"], PARTS["sheet"]))
    assert (found > 0.92).all()
    assert found[1:].min() > 0.98
    assert found.max() < 1.012


@pytest.mark.parametrize("top", ["gloss", "sheen"])
@pytest.mark.parametrize("base", ["diffuse", "metal", "glass", "sheet"])
def test_white_layers_return_all_light(tmp_path, top, base):
    np.testing.assert_allclose(
        returned(folded(tmp_path, layer("B", top, base), PARTS[top], PARTS[base])), 1.0, atol=0.02
    )


def test_added_white_parts_return_no_more_light_than_falls_on_them(tmp_path):
    added = shader("B", "ND_add_bsdf", link("token in1", "diffuse"), link("token in2", "metal"))
    with pytest.warns(UserWarning, match="reflect more light than falls on them"):
        material = folded(tmp_path, added, PARTS["diffuse"], PARTS["metal"])
    np.testing.assert_allclose(returned(material), 1.0, atol=0.012)
