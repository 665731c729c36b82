# SPDX-License-Identifier: Apache-2.0
"""Prims that are extracted from the static scene as templates."""

from __future__ import annotations

import numpy as np
import pytest

from tests.usd.helpers import write
from tiscene.errors import StageError, StageWarning, TemplateNotFound
from tiscene.usd.read.stage_reader import read_stage

HOUSE = """
def Xform "House" (prepend apiSchemas = ["SemanticsLabelsAPI:class"]) {
    token[] semantics:labels:class = ["building"]
    double3 xformOp:translate = (0, 0, 10)
    float xformOp:rotateY = 90
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]
    def Xform "Lamp" (kind = "component") {
        token visibility = "invisible"
        float3 xformOp:scale = (1, 2, 1)
        double3 xformOp:translate = (1, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
        def Cube "Foot" {}
        def Sphere "Shade" {
            double3 xformOp:translate = (0, 3, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }
    }
    def Cube "Wall" {}
    def Xform "Nothing" {}
}
"""


def test_extracted_prim_is_a_template_and_not_in_the_scene(tmp_path):
    path = write(tmp_path, HOUSE, meters=0.5)
    stage = read_stage(path, extract=["/House/Lamp"])
    assert [each.name for each in stage.objects] == ["Wall"]
    (lamp,) = stage.templates
    assert (lamp.name, lamp.category) == ("/House/Lamp", "building")
    foot, shade = lamp.description.instances
    # In its own axes: its own scale stays, its place and its ancestors' do not. Though hidden, it is all there.
    np.testing.assert_allclose(foot.world_from_object, np.diag([1, 2, 1, 1]), atol=1e-12)
    np.testing.assert_allclose(shade.world_from_object[:3, 3], (0, 3, 0), atol=1e-12)


def test_single_gprim_can_be_extracted(tmp_path):
    stage = read_stage(write(tmp_path, HOUSE), extract=["/House/Wall"])
    assert [each.name for each in stage.objects] == []
    assert [each.name for each in stage.templates] == ["/House/Wall"]


@pytest.mark.parametrize("name", ["/House/Lmap", "/", "no path", "/House/Lamp.visibility"])
def test_extracting_an_unknown_path_raises_template_not_found(tmp_path, name):
    with pytest.raises(TemplateNotFound, match="on the stage"):
        read_stage(write(tmp_path, HOUSE), extract=[name])


def test_extracting_a_prim_without_geometry_is_a_problem(tmp_path):
    with pytest.raises(StageError, match="</House/Nothing> template: it holds no geometry"):
        read_stage(write(tmp_path, HOUSE), extract=["/House/Nothing"], strict=True)


def test_a_mesh_without_faces_that_moves_is_named_once(tmp_path):
    body = """
def Mesh "Empty" {}
def Cube "Box" {}"""
    with pytest.warns(StageWarning) as told:
        read_stage(write(tmp_path, body), extract=["/Empty"])
    (line,) = str(told[0].message).splitlines()[1:]
    assert line == "  a mesh without faces: </Empty>"
