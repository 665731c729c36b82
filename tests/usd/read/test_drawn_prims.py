# SPDX-License-Identifier: Apache-2.0
"""Which prims of a stage are drawn: visibility, purpose, and prims that are active and defined."""

from __future__ import annotations

from pxr import Usd, UsdGeom

import tiscene as ts
from tests.usd.helpers import read, read_with_warning, write
from tiscene.usd.read.stage_reader import read_stage


def test_visibility_is_inherited(tmp_path):
    body = """
    def Xform "Off" {
        token visibility = "invisible"
        def Cube "A" {
            token visibility = "inherited"
        }
        def SphereLight "L" {}
        def Camera "Eye" {}
    }
    def Cube "B" {}
    """
    description = read(tmp_path, body)
    assert [each.name for each in description.objects] == ["B"]
    assert not description.lights
    assert [camera.name for camera in description.cameras] == ["Eye"]  # an invisible camera can be rendered from


VISIBILITY = """
def Xform "Hidden" (prepend apiSchemas = ["VisibilityAPI"]) {
    uniform token renderVisibility = "invisible"
    def Cube "render" {
        uniform token purpose = "render"
    }
    def Cube "default" {}
    def Xform "Shown" (prepend apiSchemas = ["VisibilityAPI"]) {
        uniform token renderVisibility = "visible"
        uniform token purpose = "render"
        def Cube "inner" {}
        def Cube "inherits" (prepend apiSchemas = ["VisibilityAPI"]) {
            uniform token guideVisibility = "visible"
        }
        def Cube "moves" (
            prepend apiSchemas = ["VisibilityAPI"]
            kind = "component"
        ) {
            uniform token renderVisibility = "invisible"
            double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 9: (1, 0, 0) }
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }
    }
    def PointInstancer "Points" {
        uniform token purpose = "render"
        rel prototypes = </Hidden/Points/A>
        int[] protoIndices = [0]
        point3f[] positions = [(1, 2, 3)]
        def Cube "A" {}
    }
}
def PointInstancer "Others" (prepend apiSchemas = ["VisibilityAPI"]) {
    uniform token renderVisibility = "invisible"
    rel prototypes = </Others/B>
    int[] protoIndices = [0]
    point3f[] positions = [(1, 2, 3)]
    def Xform "B" {
        def Cube "part" {}
        def Cube "hidden" {
            uniform token purpose = "render"
        }
    }
}
"""


def test_render_visibility_hides_prims_of_purpose_render(tmp_path):
    """As UsdGeom.Imageable.ComputeEffectiveVisibility("render") says; it does not regard other purposes."""
    path = write(tmp_path, VISIBILITY)
    description = read_stage(path)
    drawn = {each.prim_path.rpartition("/")[2] for each in description.objects}
    assert drawn == {"default", "inner", "inherits", "Others[0]"}
    assert len(description.instances) == 4
    stage = Usd.Stage.Open(str(path))
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Cube) and "Others" not in str(prim.GetPath()):
            imageable = UsdGeom.Imageable(prim)
            hidden = imageable.ComputeEffectiveVisibility(imageable.ComputePurpose()) == "invisible"
            assert hidden == (prim.GetName() not in drawn), prim
    scenario = ts.Scenario.load(path)
    assert not scenario.objects


def test_render_visibility_without_its_schema_is_named(tmp_path):
    body = 'def Cube "C"\n{\n    uniform token purpose = "render"\n    uniform token renderVisibility = "invisible"\n}'
    text = "renderVisibility has no effect without VisibilityAPI: add it to the prim's apiSchemas: </C>"
    assert read_with_warning(tmp_path, body, text).instances


def test_only_default_and_render_purposes_are_drawn(tmp_path):
    body = "".join(
        f'def Xform "{p}"\n{{\nuniform token purpose = "{p}"\ndef Cube "{p}_cube" {{}}\n}}\n'
        for p in ("default", "render", "proxy", "guide")
    )
    description = read(tmp_path, body)
    assert [each.name for each in description.objects] == ["default_cube", "render_cube"]


def test_only_active_defined_prims_are_drawn(tmp_path):
    body = """
    def Cube "Off" (active = false) {}
    over "Over" {
        def Cube "A" {}
    }
    class "Class" {
        def Cube "B" {}
    }
    def Cube "On" {}
    """
    assert [each.name for each in read(tmp_path, body).objects] == ["On"]
