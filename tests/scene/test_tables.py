# SPDX-License-Identifier: Apache-2.0
"""Tables of materials, textures and lights: rows, flags, packing."""

from dataclasses import replace

import numpy as np
import pytest

from tiscene.device.memory import upload
from tiscene.scene.description import DistantLight, DomeLight, Material, RectLight, SphereLight, Texture, TextureLookup
from tiscene.scene.lights.light_kinds import DOME, POINT, RECT, SPHERE
from tiscene.scene.lights.light_table import KIND, TEXTURE, TRANSFORM, LightTable
from tiscene.scene.lights.light_tree import (
    H_AREA_COUNT,
    H_DISTANT_ROW,
    H_DOME_END,
    H_DOME_ROW,
    H_PORTAL_ROW,
    H_ROWS,
    NODE_COLUMNS,
    ROWS,
    STRENGTH,
    UNIFORM,
    child_rows,
)
from tiscene.scene.material_table import (
    COVERAGE,
    DIFFUSE,
    FIRST_LOOKUP,
    FLAGS,
    GLASS,
    GLASS_INDEX,
    IOR,
    LOOKUP_CHANNEL,
    LOOKUP_COUNT,
    LOOKUP_INPUT,
    LOOKUP_SCALED_AREA,
    LOOKUP_TEXTURE,
    LOOKUP_TRANSFORM,
    NORMAL,
    ROUGHNESS,
    TEXTURED,
    UNIT_NORMAL,
    MaterialTable,
)
from tiscene.scene.textures.atlas import HEIGHT, IS_FLOAT, IS_SRGB, OFFSET, WIDTH, WRAP_S, TextureAtlas, linear_pixels

EYE = np.eye(4)


def test_upload_keeps_values_and_makes_a_row_for_empty_arrays() -> None:
    assert upload(np.arange(6).reshape(2, 3)).to_numpy().tolist() == [[0, 1, 2], [3, 4, 5]]
    assert upload(np.zeros((0, 3), np.float32)).to_numpy().tolist() == [[0.0, 0.0, 0.0]]


def test_appended_materials_refer_to_their_textures() -> None:
    table = MaterialTable()
    lookup = TextureLookup(1, "g", uv_transform=(2.0, 0.0, 0.25, 0.0, 3.0, 0.5))
    assert table.append([Material("a", diffuse_color=(0.1, 0.2, 0.3))], first_texture=0) == 0
    assert table.append([Material("b", roughness=lookup), Material("c", opacity=0.2, ior=1.3)], first_texture=7) == 1
    assert len(table) == 3
    values, info, lookups = (array.to_numpy() for array in table.arrays())
    assert values[0, DIFFUSE : DIFFUSE + 3] == pytest.approx([0.1, 0.2, 0.3])
    assert values[0, ROUGHNESS] == 0.5
    assert values[2, IOR] == pytest.approx(1.3)
    assert info[:, LOOKUP_COUNT].tolist() == [0, 1, 0]
    row = info[1, FIRST_LOOKUP]
    assert lookups[row, LOOKUP_INPUT] == ROUGHNESS
    assert lookups[row, LOOKUP_SCALED_AREA] == 6.0
    assert lookups[row, LOOKUP_TEXTURE] == 8
    assert lookups[row, LOOKUP_CHANNEL] == 2
    assert lookups[row, LOOKUP_TRANSFORM : LOOKUP_TRANSFORM + 6] == pytest.approx([2.0, 0.0, 0.25, 0.0, 3.0, 0.5])
    assert info[:, FLAGS].tolist() == [0, TEXTURED, GLASS]
    assert info[2, GLASS_INDEX] == 0
    assert table.glass_iors == [1.3]
    assert not table.any_coverage
    table.append([Material("d", opacity=TextureLookup(0, "a"))], first_texture=0)
    assert table.any_coverage
    assert table.flags[3] == TEXTURED | COVERAGE


def test_normal_maps_of_unit_length_are_recognized() -> None:
    table = MaterialTable()
    signed = TextureLookup(0, scale=(2.0, -2.0, 2.0, 1.0), bias=(-1.0, 1.0, -1.0, 0.0))
    weak = TextureLookup(0, scale=(0.5, 0.5, 1.0, 1.0), bias=(-0.25, -0.25, 0.0, 0.0))
    table.append([Material("a", normal=signed), Material("b", normal=weak)], first_texture=0)
    lookups = table.arrays().lookups.to_numpy()
    assert lookups[:, LOOKUP_INPUT].tolist() == [NORMAL, NORMAL]
    assert lookups[:, LOOKUP_CHANNEL].tolist() == [UNIT_NORMAL, 0]


def test_textures_are_packed_as_one_word_or_four_floats_a_pixel() -> None:
    atlas = TextureAtlas()
    small = Texture("small", np.arange(24, dtype=np.uint8).reshape(2, 3, 4), wrap_s="mirror")
    bright = Texture("bright", np.full((1, 2, 4), 9.5, np.float32), encoding="raw")
    assert atlas.append([small]) == 0
    assert atlas.append([bright, small]) == 1
    info, words, floats = (array.to_numpy() for array in atlas.arrays())
    assert info[:, OFFSET].tolist() == [0, 0, 6]
    assert info[0, [WIDTH, HEIGHT, IS_FLOAT, IS_SRGB, WRAP_S]].tolist() == [3, 2, 0, 1, 2]
    assert info[1, [WIDTH, HEIGHT, IS_FLOAT, IS_SRGB]].tolist() == [2, 1, 1, 0]
    assert words[1] == 4 + (5 << 8) + (6 << 16) + (7 << 24)
    assert floats[256:].tolist() == [9.5] * 8


def test_srgb_colors_are_decoded_and_alpha_is_not() -> None:
    pixels = np.full((1, 1, 4), 188, np.uint8)
    linear = linear_pixels(Texture("t", pixels))[0, 0]
    assert linear == pytest.approx([0.5029, 0.5029, 0.5029, 188 / 255], abs=1e-4)
    assert linear_pixels(Texture("t", pixels, encoding="raw"))[0, 0] == pytest.approx(188 / 255)


def lights() -> LightTable:
    table = LightTable()
    table.place(
        [
            (0, DomeLight("sky", "/sky", EYE, (1.0, 1.0, 1.0), 0)),
            (1, RectLight("lamp", "/lamp", EYE, (5.0, 5.0, 5.0), 1.0, 2.0, 1)),
            (1, DistantLight("sun", "/sun", EYE, (3.0, 3.0, 3.0), 0.01)),
            (1, SphereLight("bulb", "/bulb", EYE, (9.0, 9.0, 9.0), 0.1)),
            (1, SphereLight("spark", "/spark", EYE, (9.0, 9.0, 9.0), 0.0)),
        ],
        first_textures=[0, 1],
    )
    return table


def atlas() -> TextureAtlas:
    result = TextureAtlas()
    result.append([Texture(str(k), np.full((2, 4, 4), 255, np.uint8)) for k in range(3)])
    return result


def test_lights_that_rays_can_hit_come_first() -> None:
    arrays = lights().arrays(atlas())
    values, header = arrays.values.to_numpy(), arrays.nodes.to_numpy()[:ROWS].ravel()
    assert values[:, KIND].tolist() == [RECT, SPHERE, POINT, POINT + 1, DOME]
    assert values[0, TEXTURE] == 2
    assert values[4, TEXTURE] == 0
    assert header[H_AREA_COUNT] == 2
    assert header[[H_DISTANT_ROW, H_DOME_ROW, H_PORTAL_ROW, H_ROWS]].tolist() == [3, 4, 5, 5]


def test_empty_and_black_light_tables_are_valid() -> None:
    empty = LightTable().arrays(TextureAtlas()).nodes.to_numpy()[:ROWS].reshape(-1, NODE_COLUMNS)
    assert empty[0, H_DOME_END] == 0  # no entry
    dark = LightTable()
    dark.place([(0, RectLight("off", "/off", EYE, (0.0, 0.0, 0.0), 1.0, 1.0))] * 2, first_textures=[0])
    nodes = dark.arrays(TextureAtlas()).nodes.to_numpy()[: 2 * ROWS].reshape(-1, NODE_COLUMNS)
    assert not child_rows(nodes[1])[:, [STRENGTH, UNIFORM]].any()
    assert nodes[0, H_AREA_COUNT] == 2  # rays hit them nevertheless


def test_moving_a_light_keeps_texture_distributions_on_the_device() -> None:
    table, images = lights(), atlas()
    before = table.arrays(images)
    sky, lamp, *others = table.lights
    moved = EYE.copy()
    moved[0, 3] = 2.0
    placed = [(0, sky), (1, replace(lamp, world_from_light=moved)), *((1, each) for each in others)]
    table.place(placed, [0, 1])
    after = table.arrays(images)
    assert after.values.to_numpy()[0, TRANSFORM + 3] == 2.0
    assert after.distribution is before.distribution
    table.place([(1, each) for each in (lamp, *others)], [0, 1])
    without = table.arrays(images)
    assert without.distribution.shape < before.distribution.shape
