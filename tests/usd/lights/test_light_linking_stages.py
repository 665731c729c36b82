# SPDX-License-Identifier: Apache-2.0
"""Light linking on stages: UsdLux's collections lightLink and shadowLink."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import read, read_with_warning, write
from tiscene.errors import StageWarning
from tiscene.usd.read.stage_reader import read_stage

BODY = """def Xform "Set" {
    def Cube "A" {
        double size = 0.5
        double3 xformOp:translate = (-1, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "B" {
        double size = 0.5
        double3 xformOp:translate = (1, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
def DistantLight "Sun" {
    float inputs:intensity = 50000
    %s
}
def Camera "C" {
    token projection = "orthographic"
    float horizontalAperture = 40
    float verticalAperture = 20
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
# Above the picture. Its sheen selects the variant of the shading kernel that other tests of links compile.
CLOTH = """def Cube "Cloth" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    double3 xformOp:translate = (0, 9, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    rel material:binding = </Cloth/Velvet>
    def Material "Velvet" {
        token outputs:mtlx:surface.connect = </Cloth/Velvet/Surface.outputs:surface>
        def Shader "Surface" {
            uniform token info:id = "ND_standard_surface_surfaceshader"
            float inputs:sheen = 1
            token outputs:surface
        }
    }
}
"""
ONLY_A = """uniform bool collection:lightLink:includeRoot = 0
    prepend rel collection:lightLink:includes = </Set/A>"""
ALL_BUT_A = "prepend rel collection:lightLink:excludes = </Set/A>"
EXPRESSION = """uniform bool collection:lightLink:includeRoot = 0
    uniform pathExpression collection:lightLink:membershipExpression = "//A" """


def classes(description):
    """Return by the object's name the link class of its mesh."""
    return {
        description.objects[each.object].name: description.meshes[each.mesh].link_class
        for each in description.instances
    }


@pytest.mark.parametrize(("lines", "lit"), [(ONLY_A, "A"), (ALL_BUT_A, "B"), (EXPRESSION, "A")])
def test_collections_decide_what_a_light_lights(tmp_path, lines, lit):
    description = read(tmp_path, BODY % lines)
    (light,) = description.lights
    found = classes(description)
    assert {name: light.lit[found[name]] for name in "AB"} == {"A": lit == "A", "B": lit == "B"}
    assert light.shadowing is None
    assert light.lit[0] is ("excludes" in lines)  # what is spawned is in the root
    assert len(description.meshes) == 2  # equal cubes of different classes


def test_shadow_links_are_read(tmp_path):
    description = read(tmp_path, BODY % ALL_BUT_A.replace("lightLink", "shadowLink"))
    (light,) = description.lights
    assert light.lit is None
    assert light.shadowing == (True, False)
    assert classes(description) == {"A": 1, "B": 0}


def test_collections_that_hold_everything_cost_nothing(tmp_path):
    description = read(tmp_path, BODY % "uniform bool collection:lightLink:includeRoot = 1")
    assert description.lights[0].lit is None
    assert len(description.meshes) == 1


def test_stream_shows_only_the_linked_cube_lit(tmp_path):
    path = write(tmp_path, BODY % ONLY_A + CLOTH)
    with ts.Stream(path, width=16, height=8, buffers=("hdr", "instance"), spp=4, camera="C") as stream:
        frame = stream[0]
        names = {row.name: row.id for row in frame.objects}
    assert frame.hdr[frame.instance == names["A"]].min() > 0.1
    assert not frame.hdr[frame.instance == names["B"]].any()


def test_instances_of_one_prototype_have_links_of_their_own(tmp_path):
    body = BODY.replace('def Xform "Set"', 'class Xform "Proto"')
    body += "".join(
        f'def "{name}" (\ninstanceable = true\nreferences = </Proto>\n) {{}}\n' for name in ("First", "Other")
    )
    description = read(tmp_path, body % ONLY_A.replace("/Set/A", "/First"))
    (light,) = description.lights
    lit = [light.lit[description.meshes[each.mesh].link_class] for each in description.instances]
    assert sorted(lit) == [False, False, True, True]
    paths = [description.objects[each.object].prim_path for each in description.instances]
    assert all(is_lit == path.startswith("/First") for is_lit, path in zip(lit, paths, strict=True))


def test_links_of_mesh_lights_are_named(tmp_path):
    body = BODY.replace("float inputs:intensity = 50000", "") % ""
    body += """def Cube "Lamp" (prepend apiSchemas = ["MeshLightAPI"]) {
    rel collection:lightLink:excludes = </Set/A>
}
"""
    read_with_warning(tmp_path, body, "lightLink is not applied to a mesh light or a template's light.*</Lamp>")


def test_more_combinations_than_there_are_classes_are_named(tmp_path):
    cubes = "".join(f'def Cube "C{row}" {{}}\n' for row in range(40))
    lights = "".join(
        f'def DistantLight "L{row}"\n{{\n{ALL_BUT_A.replace("/Set/A", f"/C{row}")}\n}}\n' for row in range(40)
    )
    path = write(tmp_path, cubes + lights)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        description = read_stage(path)
    assert [type(each.message) for each in caught] == [StageWarning]
    assert "a stage may combine them in 32 ways: </C31>, " in str(caught[0].message)
    assert max(mesh.link_class for mesh in description.meshes) == 31
    assert np.shape([light.lit for light in description.lights]) == (40, 32)
