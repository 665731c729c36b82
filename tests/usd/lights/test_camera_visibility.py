# SPDX-License-Identifier: Apache-2.0
"""Lights that the camera does not see, by the attributes of renderers, and lights in prototypes of instancers."""

from __future__ import annotations

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import preview_material, read, write

LAMP = """def RectLight "Lamp" {
    float inputs:intensity = 4
    float inputs:width = 2
    float inputs:height = 2
    %s
    double3 xformOp:translate = (0, 0, -2)
    float3 xformOp:rotateXYZ = (0, 180, 0)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
}
def Camera "C" {}
"""
WALL = """def Mesh "Wall" {
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-9, -9, -3), (9, -9, -3), (9, 9, -3), (-9, 9, -3)]
    color3f[] primvars:displayColor = [(0, 0, 0)]
}
"""
HIDDEN = [
    "bool visibleInPrimaryRay = 0",
    "int primvars:ri:attributes:visibility:camera = 0",
    "bool primvars:arnold:visibility:camera = 0",
    "float primvars:arnold:camera = 0",
    "bool primvars:karma:light:renderlightgeo = 0",
    'string primvars:karma:object:rendervisibility = "* & -primary"',
    "bool primvars:cycles:object:visibility:camera = 0",
]
SEEN = ["", "bool visibleInPrimaryRay = 1", 'string primvars:karma:object:rendervisibility = "*"']


@pytest.mark.parametrize(("line", "seen"), [*((each, False) for each in HIDDEN), *((each, True) for each in SEEN)])
def test_attributes_of_renderers_decide_whether_the_camera_sees_a_light(tmp_path, line, seen):
    (light,) = read(tmp_path, LAMP % line).lights
    assert light.seen_by_camera is seen


@pytest.mark.parametrize("line", [each for each in HIDDEN if "primvars:" in each])
def test_primvars_that_hide_lights_and_meshes_are_inherited(tmp_path, line):
    description = read(tmp_path, f'def Xform "Above"\n{{\n{line}\n{LAMP % ""}\n{WALL}\n}}')
    assert not description.lights[0].seen_by_camera
    assert [each.seen_by_camera for each in description.materials] == [True, False]  # as bound, and as used
    own = LAMP % line.replace(" = 0", " = 1").replace('"* & -primary"', '"*"')
    assert read(tmp_path, f'def Xform "Above"\n{{\n{line}\n{own}\n{WALL}\n}}').lights[0].seen_by_camera


@pytest.fixture(scope="module")
def centers(tmp_path_factory):
    """The radiance at the center of images with a light seen, hidden, and hidden but shown by a mirror."""
    folder = tmp_path_factory.mktemp("lamps")
    mirror = """def Mesh "Mirror" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </Silver>
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-9, -9, -4), (9, -9, -4), (9, 9, -4), (-9, 9, -4)]
}
"""
    mirror += preview_material(
        "/Silver", "color3f inputs:diffuseColor = (1, 1, 1)", "float inputs:metallic = 1", "float inputs:roughness = 0"
    )
    hidden = LAMP % HIDDEN[0]
    back = hidden.replace('"Lamp"', '"Back"').replace("(0, 180, 0)", "(0, 0, 0)")
    dome = 'def DomeLight "Sky"\n{\nfloat inputs:intensity = 2\nbool visibleInPrimaryRay = %d\n}\ndef Camera "C" {}\n'
    far = WALL.replace("-3)", "3)")
    stages = {"seen": LAMP % "" + WALL, "hidden": hidden + WALL, "mirrored": back + mirror}
    stages |= {"sky": dome % 1 + far, "no sky": dome % 0 + far}
    found = {}
    for name, body in stages.items():
        path = write(folder, body, name=f"{name}.usda")
        options = {"width": 9, "height": 9, "buffers": ("hdr",), "camera": "C", "spp": 16, "incremental": False}
        with ts.Stream(path, **options) as stream:
            found[name] = np.asarray(stream[0].hdr[4, 4])
    return found


def test_camera_sees_a_light_or_what_is_behind_it(centers):
    np.testing.assert_allclose(centers["seen"], 4.0, rtol=1e-5)
    assert centers["hidden"].max() < 0.5  # a black wall, lit, with 4 % of specular reflection


def test_mirror_shows_a_light_that_the_camera_does_not_see(centers):
    np.testing.assert_allclose(centers["mirrored"], 4.0, rtol=1e-3)


def test_sky_that_the_camera_does_not_see_is_black(centers):
    np.testing.assert_allclose(centers["sky"], 2.0, rtol=1e-5)
    np.testing.assert_array_equal(centers["no sky"], 0.0)


SET = """def Mesh "Front" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    %s
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-9, -9, -1), (9, -9, -1), (9, 9, -1), (-9, 9, -1)]
    color3f[] primvars:displayColor = [(1, 0, 0)]
}
def Sphere "Ball" {
    double radius = 0.5
    color3f[] primvars:displayColor = [(0, 1, 0)]
    double3 xformOp:translate = (0.03, 0.02, -2)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def DistantLight "Sun" {
    float inputs:intensity = 50000
    %s
}
def Camera "C" {}
"""
AWAY = 'float3 xformOp:rotateXYZ = (0, 180, 0)\nuniform token[] xformOpOrder = ["xformOp:rotateXYZ"]'


@pytest.mark.parametrize("behind", [False, True])
def test_mesh_that_the_camera_does_not_see_has_no_labels_and_casts_shadows(tmp_path, behind):
    """A panel before the ball shades it, or reflects the light of a sun behind the ball to it."""
    body = SET % ("bool primvars:arnold:visibility:camera = 0", AWAY if behind else "")
    options = {"width": 9, "height": 9, "camera": "C", "spp": 4}
    buffers = ("hdr", "instance", "depth", "coverage", "albedo")
    with ts.Stream(write(tmp_path, body), buffers=buffers, **options) as stream:
        frame = stream[0]
        names = {row.name: row for row in frame.objects}
    ball = frame.instance == names["Ball"].id
    assert ball[4, 4]
    assert set(np.unique(frame.instance)) == {0, names["Ball"].id}
    assert frame.depth[4, 4] == pytest.approx(1.5, abs=5e-3)
    np.testing.assert_allclose(frame.albedo[4, 4], (0, 1, 0), atol=1e-6)
    assert names["Front"].id not in frame.coverage[..., 0]
    assert bool(frame.hdr[ball].any()) is behind
    with ts.Stream(write(tmp_path, SET % ("", "")), buffers=("instance", "hdr"), **options) as stream:
        seen = stream[0]
    assert (seen.instance == names["Front"].id).all()
    assert seen.hdr.min() > 0.1


def test_animated_material_of_a_hidden_mesh_keeps_playing(tmp_path):
    animated = "color3f[] primvars:displayColor.timeSamples = { 0: [(1, 0, 0)], 9: [(0, 0, 1)] }"
    body = SET.replace("color3f[] primvars:displayColor = [(1, 0, 0)]", animated) % ("int visibleInPrimaryRay = 0", "")
    description = read(tmp_path, body, more="startTimeCode = 0\nendTimeCode = 9")
    row = int(description.meshes[0].materials[0])
    assert not description.materials[row].seen_by_camera
    assert row in [track.row for track in description.material_tracks]


STREET = """def PointInstancer "Street" {
    rel prototypes = </Street/Post>
    int[] protoIndices = [0, 0]
    int64[] ids = [7, 9]
    point3f[] positions = [(10, 0, 0), (20, 0, 0)]
    quath[] orientations = [(1, 0, 0, 0), (0.70710678, 0, 0, 0.70710678)]
    double3 xformOp:translate = (0, 5, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Xform "Post" {
        def Cube "Pole" {}
        def SphereLight "Bulb" {
            double3 xformOp:translate = (1, 0, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }
    }
}
"""


def test_lights_of_prototypes_are_at_each_point(tmp_path):
    lights = read(tmp_path, STREET).lights
    places = [light.world_from_light[:3, 3].tolist() for light in lights]
    np.testing.assert_allclose(places, [(11, 5, 0), (20, 6, 0)], atol=1e-3)  # half-precision quarter turn about z
    assert [light.name for light in lights] == ["Bulb[Street 7]", "Bulb[Street 9]"]
    assert len({light.prim_path for light in lights}) == 2
