# SPDX-License-Identifier: Apache-2.0
"""Time samples of light inputs: values derived by hand, and how streams play them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import tiscene as ts
from tests.usd.animated_stages import RANGE, SQUARE, stream
from tests.usd.helpers import read, read_with_warning, write

LIGHT = """
def %s "Lamp"%s {
    %s
}
def Mesh "Wall" {
    %s
}
"""


def light_at(description, seconds, row=0):
    (track,) = description.light_tracks
    return track.applied(description.lights[row], track.moment(seconds))


def test_sizes_of_lights_are_interpolated(tmp_path):
    inputs = "float inputs:radius.timeSamples = { 0: 1, 10: 3 }"
    description = read(tmp_path, LIGHT % ("SphereLight", "", inputs, SQUARE), more=RANGE)
    assert light_at(description, 0.5).radius == pytest.approx(2.0)
    rect = "float inputs:width.timeSamples = { 0: 1, 10: 3 }\nfloat inputs:height = 4"
    description = read(tmp_path, LIGHT % ("RectLight", "", rect, SQUARE), more=RANGE)
    assert (light_at(description, 0.25).width, light_at(description, 0.25).height) == (1.5, 4.0)


GROWING = """float3 xformOp:scale.timeSamples = { 0: (1, 1, 1), 8: (3, 5, 1), 10: (0, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:scale"]
    float inputs:width = 2
    float inputs:intensity = 6
    bool inputs:normalize = %d"""


@pytest.mark.parametrize("normalize", [False, True])
def test_animated_scale_of_a_light_sets_its_size_and_radiance(tmp_path, normalize):
    """As with UsdLux's area: radiance is intensity / (width · height) where it is normalized."""
    path = write(tmp_path, LIGHT % ("RectLight", "", GROWING % normalize, SQUARE), more=RANGE)
    with stream(path, buffers=("hdr",)) as frames:
        for k, width, height in ((0, 2.0, 1.0), (4, 4.0, 3.0), (8, 6.0, 5.0)):
            (light,) = frames.world.state(k).lights
            assert (light.width, light.height) == pytest.approx((width, height))
            assert light.radiance[0] == pytest.approx(6.0 / (width * height if normalize else 1.0))
        assert frames.world.state(10).lights == ()  # flattened


def test_light_in_a_prototype_grows_at_each_point(tmp_path):
    lamp = LIGHT.partition("def Mesh")[0] % ("SphereLight", "", (GROWING % 0).replace("(3, 5, 1)", "(3, 3, 3)"))
    body = f"""def PointInstancer "Lamps" {{
    rel prototypes = </Lamps/Lamp>
    int[] protoIndices = [0]
    point3f[] positions = [(1, 2, 3)]
    float3[] scales = [(10, 10, 10)]
    {lamp}
}}
def Mesh "Wall" {{
    {SQUARE}
}}"""
    description = read(tmp_path, body, more=RANGE)
    assert light_at(description, 0.4).radius == pytest.approx(0.5 * 10.0 * 2.0)


def test_cone_of_a_light_is_interpolated(tmp_path):
    api = ' (\n prepend apiSchemas = ["ShapingAPI"]\n)'
    inputs = "float inputs:shaping:cone:angle.timeSamples = { 0: 20, 10: 60 }"
    description = read(tmp_path, LIGHT % ("SphereLight", api, inputs, SQUARE), more=RANGE)
    assert light_at(description, 0.5).shaping.cone_angle == pytest.approx(math.radians(40.0))


def test_normalized_light_keeps_its_power_while_it_grows(tmp_path):
    """Radiance is intensity / (4 pi r²), so that pi L (4 pi r²) is the same at each frame."""
    inputs = "float inputs:radius.timeSamples = { 0: 1, 10: 3 }\nbool inputs:normalize = 1\nfloat inputs:intensity = 5"
    path = write(tmp_path, LIGHT % ("SphereLight", "", inputs, SQUARE), more=RANGE)
    with stream(path, buffers=("hdr",)) as frames:
        for k, radius in ((0, 1.0), (5, 2.0), (10, 3.0)):
            (light,) = frames.world.state(k).lights
            assert light.radius == pytest.approx(radius)
            assert light.radiance[0] == pytest.approx(5.0 / (4.0 * math.pi * radius**2))


def test_visibility_of_lights_and_their_groups_plays(tmp_path):
    body = """
def Xform "Group" {
    token visibility.timeSamples = { 0: "inherited", 6: "invisible" }
    def DistantLight "Sun" {
        float inputs:intensity = 1
        token visibility.timeSamples = { 0: "invisible", 3: "inherited" }
    }
}
def Mesh "Wall" {
    %s
}
"""
    frames = stream(write(tmp_path, body % SQUARE, more=RANGE), buffers=("hdr",))
    assert [bool(frames[k].hdr.any()) for k in (0, 2, 3, 5, 6, 9)] == [False, False, True, True, False, False]
    assert not frames.world.state(4).starting_lights


def test_lights_in_prototypes_play_their_intensity(tmp_path):
    body = """
def PointInstancer "P" {
    rel prototypes = [</P/Lamp>]
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 2), (1, 0, 2)]
    def SphereLight "Lamp" {
        float inputs:intensity.timeSamples = { 0: 0, 10: 10 }
    }
}
def Mesh "Wall" {
    %s
}
"""
    description = read(tmp_path, body % SQUARE, more=RANGE)
    assert [track.row for track in description.light_tracks] == [0, 1]
    with stream(write(tmp_path, body % SQUARE, more=RANGE), buffers=("hdr",)) as frames:
        assert [light.radiance for light in frames.world.state(5).lights] == [(5.0, 5.0, 5.0)] * 2


def test_lights_in_prototypes_play_their_visibility_and_that_of_the_instancer(tmp_path):
    body = """
def PointInstancer "P" {
    rel prototypes = [</P/Post>]
    int[] protoIndices = [0]
    point3f[] positions = [(0, 0, 2)]
    token visibility.timeSamples = { 0: "inherited", 6: "invisible" }
    def Xform "Post" {
        token visibility.timeSamples = { 0: "invisible", 3: "inherited" }
        def SphereLight "Lamp" {}
    }
}
def Mesh "Wall" {
    %s
}
"""
    with stream(write(tmp_path, body % SQUARE, more=RANGE), buffers=("hdr",)) as frames:
        lit = [len(frames.world.state(frame).lights) for frame in range(9)]
    assert lit == [0, 0, 0, 1, 1, 1, 0, 0, 0]


def test_animated_lights_that_are_not_drawn_are_left_alone(tmp_path):
    body = """
def SphereLight "Hidden" {
    token visibility = "invisible"
    float inputs:intensity.timeSamples = { 0: 0, 10: 10 }
}
def SphereLight "Guide" {
    uniform token purpose = "guide"
    float inputs:intensity.timeSamples = { 0: 0, 10: 10 }
}
def SphereLight "Flat" {
    float3 xformOp:scale.timeSamples = { 0: (0, 0, 0), 5: (1, 1, 1), 10: (2, 2, 2) }
    uniform token[] xformOpOrder = ["xformOp:scale"]
}
def Mesh "Wall" {
    %s
}
"""
    path = write(tmp_path, body % SQUARE, more=RANGE)
    with pytest.warns(match="</Flat> light: its transform is singular"):
        frames = ts.Stream(path, width=16, height=12, fps=10.0, buffers=("depth",))
    assert [each.name for each in frames.world.state(5).lights] == []  # a stage whose lights are off is dark


def test_mesh_light_plays_its_intensity(tmp_path):
    body = f"""
def Mesh "Panel" (prepend apiSchemas = ["MeshLightAPI"]) {{
    {SQUARE}
    float inputs:intensity.timeSamples = {{ 0: 2, 10: 4 }}
}}
"""
    frames = stream(write(tmp_path, body, more=RANGE), buffers=("hdr",))
    for k, radiance in ((0, 2.0), (5, 3.0), (10, 4.0)):
        np.testing.assert_allclose(frames[k].hdr[6, 8], (radiance,) * 3, rtol=1e-5)


GROWS = """float3 xformOp:scale.timeSamples = { 0: (1, 1, 1), 10: (3, 1, 1) }
    uniform token[] xformOpOrder = ["xformOp:scale"]"""
POINTS = "points = [(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)]"
WIDENS = f"points.timeSamples = {{ 0: {POINTS[9:]}, 10: [(-27, -9, 0), (27, -9, 0), (27, 9, 0), (-27, 9, 0)] }}"


@pytest.mark.parametrize("where", ["mesh", "parent", "points"])
def test_normalized_mesh_light_keeps_its_power_while_it_grows(tmp_path, where):
    body = f"""
def Xform "Group" {{
    {GROWS if where == "parent" else ""}
    def Mesh "Panel" (prepend apiSchemas = ["MeshLightAPI"]) {{
        {SQUARE.replace(POINTS, WIDENS) if where == "points" else SQUARE}
        {GROWS if where == "mesh" else ""}
        float inputs:intensity = 648
        bool inputs:normalize = 1
    }}
}}
"""
    description = read(tmp_path, body, more=RANGE)
    (track,), (material,) = description.material_tracks, description.materials
    for seconds, width in ((0.0, 1.0), (0.5, 2.0), (1.0, 3.0)):
        lit = track.applied(material, track.moment(seconds))
        assert lit.emissive_color == pytest.approx((2.0 / width,) * 3, rel=1e-5)


def test_normalized_mesh_light_that_only_moves_has_a_constant_radiance(tmp_path):
    moves = """float xformOp:rotateX.timeSamples = { 0: 0, 10: 300 }
    uniform token[] xformOpOrder = ["xformOp:rotateX"]"""
    body = f"""
def Xform "Group" (kind = "component") {{
    def Mesh "Panel" (prepend apiSchemas = ["MeshLightAPI"]) {{
        {SQUARE}
        {moves}
        bool inputs:normalize = 1
    }}
}}
"""
    assert not read(tmp_path, body, more=RANGE).material_tracks


LANTERN = """
%s
{
    double3 xformOp:translate.timeSamples = { 0: (-5, 0, 1), 10: (-6, 0, 1) }
    float xformOp:rotateY = 90
    float3 xformOp:scale = (2, 2, 2)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY", "xformOp:scale"]
    %s
}
"""
HANDLE = """def Cube "Body" {}
    def Xform "Arm" {
        float xformOp:rotateZ%s
        uniform token[] xformOpOrder = ["xformOp:rotateZ"]
        def RectLight "Light" {
            double3 xformOp:translate = (0, 1, 0)
            float xformOp:rotateX = -90
            uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
        }
    }"""
AS_COMPONENT = 'def Xform "Lantern" (\n    kind = "component"\n)'
AS_INSTANCE = 'def Xform "Lantern" (\n    instanceable = true\n    inherits = </_Lantern>\n)'


def assert_light_follows(path):
    """Compare the only light of a stream with the transform that USD gives its prim."""
    stage = Usd.Stage.Open(str(path))
    prim = UsdGeom.Xformable(stage.GetPrimAtPath("/Lantern/Arm/Light"))
    with stream(path, buffers=("instance",)) as frames:
        for k in (0, 3, 10):
            (light,) = frames.world.state(k).lights
            expected = np.array(prim.ComputeLocalToWorldTransform(k)).T
            expected[:3, :3] /= 2.0  # the scale is that of the light's size
            np.testing.assert_allclose(light.world_from_light, expected, atol=1e-6)
            assert light.width == pytest.approx(2.0)


@pytest.mark.parametrize("turn", [" = 30", ".timeSamples = { 0: 0, 10: 200 }"])
@pytest.mark.parametrize("header", [AS_COMPONENT, AS_INSTANCE])
def test_light_in_a_moving_object_keeps_its_place_in_it(tmp_path, header, turn):
    inside = HANDLE % turn
    body = f'class Xform "_Lantern"\n{{\n{inside}\n}}\n' + LANTERN % (header, "" if header == AS_INSTANCE else inside)
    assert_light_follows(write(tmp_path, body, more=RANGE))


def test_light_of_a_spawned_template_moves_within_it(tmp_path):
    """The lamp turns by 20 degrees a frame about the template's z axis, at twice its distance of 1 m."""
    inside = HANDLE % ".timeSamples = { 0: 0, 10: 200 }"
    lamp = write(
        tmp_path, f'def Xform "Lamp"\n{{\n{inside}\n}}', more=f'defaultPrim = "Lamp"\n    {RANGE}', name="l.usda"
    )
    room = write(tmp_path, f'def Mesh "Wall"\n{{\n{SQUARE}\n}}')
    scenario = ts.Scenario(room, [ts.Object("lamp", str(lamp), (5.0, 0.0, 0.0), scale=2.0)])
    with stream(scenario, buffers=("instance",)) as frames:
        for k in (0, 3, 10):
            (light,) = frames.world.state(k).lights
            angle = math.radians(20.0 * k)
            where = (5.0 - 2.0 * math.sin(angle), 2.0 * math.cos(angle), 0.0)
            np.testing.assert_allclose(light.world_from_light[:3, 3], where, atol=1e-6)


INSTANCER = """def PointInstancer "Lamps" {
    rel prototypes = </Lamps/Lamp>
    int[] protoIndices = [0]
    point3f[] positions%s
    float3[] scales = [(3, 3, 3)]
    def Xform "Lamp" {
        %s
    }
}"""


def test_light_of_a_prototype_moves_at_each_point(tmp_path):
    """The lamp turns by 20 degrees a frame about the point, at three times its distance of 1 m, in centimeters."""
    inside = HANDLE % ".timeSamples = { 0: 0, 10: 200 }"
    path = write(tmp_path, INSTANCER % (" = [(100, 200, 300)]", inside), more=RANGE, meters=0.01)
    with stream(path, buffers=("instance",)) as frames:
        for k in (0, 3, 10):
            (light,) = frames.world.state(k).lights
            angle = math.radians(20.0 * k)
            where = (1.0 - 0.03 * math.sin(angle), 2.0 + 0.03 * math.cos(angle), 3.0)
            np.testing.assert_allclose(light.world_from_light[:3, 3], where, atol=1e-6)
            assert light.width == pytest.approx(0.03)


def test_lights_at_points_that_move_are_named(tmp_path):
    positions = ".timeSamples = { 0: [(1, 2, 3)], 10: [(1, 2, 9)] }"
    body = INSTANCER % (positions, HANDLE % " = 30")
    read_with_warning(tmp_path, body, "place of the lights at the points of an instancer")
