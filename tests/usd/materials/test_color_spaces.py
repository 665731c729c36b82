# SPDX-License-Identifier: Apache-2.0
"""Color spaces of constants, images and primvars, against the conversions of OpenUSD."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf

from tests.usd.helpers import read
from tests.usd.materials.test_materialx import PIXELS, document, given, material_of, picture, stage_of
from tests.usd.materials.test_vertex_colors import BOUND, QUAD, READER
from tiscene.usd.core.color_space import LINEAR, SRGB, color_space, to_linear_rec709

COLOR = (0.6, 0.3, 0.1)
SPACES = [  # of MaterialX, then USD's name of the same space
    ("acescg", "lin_ap1_scene"),
    ("lin_displayp3", "lin_p3d65_scene"),
    ("srgb_displayp3", "srgb_p3d65_scene"),
    ("g22_rec709", "g22_rec709_scene"),
    ("adobergb", "g22_adobergb_scene"),
]


def converted(color, space):
    """Return a color as linear Rec. 709, by OpenUSD, clipped at 0."""
    found = Gf.ColorSpace(LINEAR).Convert(Gf.ColorSpace(space), Gf.Vec3f(*color)).GetRGB()
    return tuple(max(each, 0.0) for each in found)


@pytest.mark.parametrize(("name", "space"), SPACES)
def test_constants_of_materialx_are_converted_from_their_color_space(tmp_path, name, space):
    base = given("base_color", "0.6, 0.3, 0.1", "color3").replace("<input", f'<input colorspace="{name}"')
    found = material_of(tmp_path, document(base + given("base", "1"))).diffuse_color
    assert found == pytest.approx(converted(COLOR, space), abs=1e-4)


@pytest.mark.parametrize(("name", "space"), SPACES)
def test_images_of_materialx_are_converted_from_their_color_space(tmp_path, name, space):
    nodes = picture(name="N").replace("srgb_texture", name)
    text = document('<input name="base_color" type="color3" nodename="N"/>' + given("base", "1"), nodes=nodes)
    description = stage_of(tmp_path, text)
    (texture,) = description.textures
    assert texture.encoding == "raw"
    for pixel, found in zip(PIXELS.reshape(-1, 3), texture.pixels.reshape(-1, 4), strict=True):
        np.testing.assert_allclose(found, [*converted((pixel / 255.0).tolist(), space), 1.0], atol=1e-4)


def test_names_without_a_space_of_their_own_are_srgb_or_linear():
    names = ("srgb_texture", "Utility - sRGB - Texture", "lin_srgb", "raw", "Raw", "data", "lin_rec709", "auto", "")
    assert [color_space(name) for name in names] == [SRGB, SRGB, *[LINEAR] * 7]


def test_colors_outside_of_rec_709_are_clipped_and_white_stays_white():
    found = to_linear_rec709(np.array([(0.0, 1.0, 0.0), (1.0, 1.0, 1.0)]), "lin_ap1_scene")
    np.testing.assert_allclose(found[0, 0], 0.0)
    np.testing.assert_allclose(found[1], 1.0, atol=1e-5)


def test_color_space_of_a_prim_holds_for_the_colors_below_it(tmp_path):
    """The color of a material, a constant displayColor and one of each face; a number of its own space stays."""
    own = f'color3f inputs:diffuseColor = {COLOR}\ncolor3f inputs:emissiveColor = {COLOR} (colorSpace = "lin_rec709")'
    uniform = f'color3f[] primvars:displayColor = [{COLOR}] (interpolation = "%s")'
    bodies = (
        READER % (own, ""),
        QUAD.replace('"M"', '"A"') % (BOUND, "rel material:binding = </Space/Look>"),
        QUAD.replace('"M"', '"B"') % ("", uniform % "constant"),
        QUAD.replace('"M"', '"C"') % ("", uniform % "uniform"),
    )
    space = 'def Xform "Space" (prepend apiSchemas = ["ColorSpaceAPI"])\n{\nuniform token colorSpace:name = "%s"\n%s\n}'
    body = space % ("lin_ap1_scene", "\n".join(bodies).replace("</Look", "</Space/Look"))
    look, *shown = read(tmp_path, body).materials
    assert look.emissive_color == pytest.approx(COLOR)
    assert shown
    for each in (look, *shown):
        assert each.diffuse_color == pytest.approx(converted(COLOR, "lin_ap1_scene"), abs=1e-4)
