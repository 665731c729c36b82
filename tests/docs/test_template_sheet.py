# SPDX-License-Identifier: Apache-2.0
"""The studio of the template sheet: templates fit the picture and show the requested colors."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from docs.tools import template_sheet
from tiscene.catalog import find_template, template_name
from usd_scenes.author import studio
from usd_scenes.author.templates import TEMPLATES


@pytest.mark.parametrize("folder", TEMPLATES)
def test_template_stands_on_the_table_and_fits_the_picture(folder: str, tmp_path: Path) -> None:
    path = tmp_path / "studio.usda"
    studio.write(find_template(template_name(folder)), path, yaw=-40.0)
    stage = Usd.Stage.Open(str(path))
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    box = cache.ComputeWorldBound(stage.GetPrimAtPath("/Studio/Template"))
    lows = box.ComputeAlignedRange().GetMin()
    assert lows[1] == pytest.approx(0.0, abs=2e-4)
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/Studio/Main")).GetCamera(Usd.TimeCode.Default())
    projection = camera.frustum.ComputeViewMatrix() * camera.frustum.ComputeProjectionMatrix()
    meshes = [UsdGeom.Mesh(p) for p in Usd.PrimRange(stage.GetPrimAtPath("/Studio/Template")) if p.IsA(UsdGeom.Mesh)]
    extent = 0.0  # of the projected boxes; 1 is the edge of the picture
    for mesh in meshes:
        to_world = UsdGeom.Xformable(mesh).ComputeLocalToWorldTransform(Usd.TimeCode.Default())
        low, high = mesh.GetExtentAttr().Get()
        for corner in product(*zip(low, high, strict=True)):
            projected = projection.Transform(to_world.Transform(Gf.Vec3d(*corner)))
            extent = max(extent, abs(projected[0]), abs(projected[1]))
    assert 0.4 < extent < 1.25


@pytest.mark.slow
def test_photograph_shows_the_requested_color() -> None:
    red, blue = (
        template_sheet.photograph("cube", 24, spp=2, variants={"color": color})[12, 12] for color in ("red", "blue")
    )
    assert int(red[0]) > int(red[2]) + 40
    assert int(blue[2]) > int(blue[0]) + 40


def test_table_of_templates_matches_code() -> None:
    (table,) = template_sheet.TABLE.findall((template_sheet.DOCS / "templates.md").read_text(encoding="utf-8"))
    assert table == template_sheet.table(), "run `python -m docs.tools.template_sheet table`"


def test_sheet_has_one_tile_per_picture() -> None:
    tiles = [(str(index), np.full((32, 32, 3), 40 * index, dtype=np.uint8)) for index in range(5)]
    sheet = template_sheet.sheet_of(tiles, 3)
    assert sheet.shape == (2 * (32 + 20 + 4) + 4, 3 * 36 + 4, 3)
    assert sheet[20, 20 + 36].tolist() == [40, 40, 40]
    assert sheet[20 + 56, 20 + 36].tolist() == [160, 160, 160]
