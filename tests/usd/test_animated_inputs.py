# SPDX-License-Identifier: Apache-2.0
"""Time samples of material and light inputs: values derived by hand, and how streams play them."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import QUAD, preview_material, read, write

RANGE = "startTimeCode = 0\n    endTimeCode = 10\n    timeCodesPerSecond = 10"
SQUARE = QUAD.replace("(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)", "(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)")
PAINTED = """
def Mesh "Wall" (
    prepend apiSchemas = ["MaterialBindingAPI"]
)
{
    %s
    rel material:binding = </Paint>
}
""" + preview_material("/Paint", "%s")


def material_at(description, seconds):
    (track,) = description.material_tracks
    return track.applied(description.materials[track.row], track.moment(seconds))


def stream(path, **others):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        camera = ts.Camera(position=(0.0, 0.0, 6.0), exposure=0.0)
        options = {"width": 16, "height": 12, "fps": 10.0, "camera": camera, "spp": 4, "denoise": False} | others
        return ts.Stream(path, **options)


def test_material_inputs_are_interpolated_linearly_between_samples(tmp_path):
    inputs = """color3f inputs:diffuseColor.timeSamples = { 0: (0, 0.2, 0.4), 10: (1, 0.2, 0) }
        float inputs:roughness.timeSamples = { 5: 0.2, 10: 0.6 }
        float inputs:metallic = 0.25
        int inputs:useSpecularWorkflow.timeSamples = { 0: 0, 8: 1 }"""
    description = read(tmp_path, PAINTED % (SQUARE, inputs), more=RANGE)
    (track,) = description.material_tracks
    assert track.times.tolist() == [0.0, 0.5, 0.8, 1.0]
    assert [name for name, _ in track.inputs] == ["diffuse_color", "roughness", "use_specular_workflow"]
    for seconds, color, roughness, flag in (
        (-1.0, (0, 0.2, 0.4), 0.2, False),
        (0.25, (0.25, 0.2, 0.3), 0.2, False),
        (0.75, (0.75, 0.2, 0.1), 0.4, False),
        (0.9, (0.9, 0.2, 0.04), 0.52, True),
        (7.0, (1, 0.2, 0), 0.6, True),
    ):
        material = material_at(description, seconds)
        assert material.diffuse_color == pytest.approx(color, abs=1e-6)
        assert material.roughness == pytest.approx(roughness)
        assert material.use_specular_workflow is flag
        assert material.metallic == 0.25


def test_constant_material_samples_make_no_track(tmp_path):
    inputs = "float inputs:roughness.timeSamples = { 0: 0.5, 10: 0.5 }"
    assert read(tmp_path, PAINTED % (SQUARE, inputs), more=RANGE).material_tracks == ()


def test_rotation_of_texture_coordinates_plays_at_whole_time_codes(tmp_path):
    """A rotation is not linear in its angle: at 45 degrees the matrix has cosines of 45 degrees, not their chord."""
    nodes = """color3f inputs:diffuseColor.connect = </Paint/Map.outputs:rgb>
        token outputs:surface
    }
    def Shader "Turn"
    {
        uniform token info:id = "UsdTransform2d"
        float inputs:rotation.timeSamples = { 0: 0, 10: 90 }
        float2 outputs:result
    }
    def Shader "Map"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @white.png@
        token inputs:wrapS = "repeat"
        token inputs:wrapT = "repeat"
        float2 inputs:st.connect = </Paint/Turn.outputs:result>
        float3 outputs:rgb"""
    from PIL import Image

    Image.new("RGB", (2, 2), "white").save(tmp_path / "white.png")
    description = read(tmp_path, PAINTED % (SQUARE, nodes), more=RANGE)
    transform = material_at(description, 0.5).diffuse_color.uv_transform
    root = math.sqrt(0.5)
    assert transform == pytest.approx((root, -root, 0, root, root, 0), abs=1e-6)


def test_sequence_of_texture_files_plays_held(tmp_path):
    from PIL import Image

    for name, color in (("a", "red"), ("b", "lime")):
        Image.new("RGB", (1, 1), color).save(tmp_path / f"{name}.png")
    nodes = """color3f inputs:emissiveColor.connect = </Paint/Map.outputs:rgb>
        color3f inputs:diffuseColor = (0, 0, 0)
        token outputs:surface
    }
    def Shader "Map"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file.timeSamples = { 0: @a.png@, 5: @b.png@ }
        token inputs:wrapS = "repeat"
        token inputs:wrapT = "repeat"
        float3 outputs:rgb"""
    path = write(tmp_path, PAINTED % (SQUARE, nodes), more=RANGE)
    frames = stream(path, buffers=("hdr",))
    for k, color in ((0, (1, 0, 0)), (4, (1, 0, 0)), (5, (0, 1, 0)), (9, (0, 1, 0))):
        np.testing.assert_allclose(frames[k].hdr[6, 8], color, atol=1e-5)


def test_display_color_plays(tmp_path):
    body = f"""def Mesh "Wall"\n{{\n{SQUARE}
    color3f[] primvars:displayColor (
        interpolation = "constant"
    )
    color3f[] primvars:displayColor.timeSamples = {{ 0: [(1, 0, 0)], 10: [(0, 0, 1)] }}\n}}"""
    frames = stream(write(tmp_path, body, more=RANGE), buffers=("albedo",))
    np.testing.assert_allclose(frames[3].albedo[6, 8], (0.7, 0, 0.3), atol=1e-6)
    assert frames[10].albedo.tobytes() == frames[25].albedo.tobytes()


def test_animated_albedo_is_seen_by_cached_labels_and_seeks(tmp_path):
    """Static labels are kept between frames; a material that varies must not be."""
    inputs = "color3f inputs:diffuseColor.timeSamples = { 0: (0, 0, 0), 10: (1, 1, 1) }"
    path = write(tmp_path, PAINTED % (SQUARE, inputs), more=RANGE)
    frames = [frame.albedo.copy() for frame in stream(path, buffers=("albedo",), frames=6)]
    for k, albedo in enumerate(frames):
        np.testing.assert_allclose(albedo[6, 8], (k / 10.0,) * 3, atol=1e-6)
    other = stream(path, buffers=("albedo",))
    assert other[4].albedo.tobytes() == frames[4].tobytes()
    assert other[1].albedo.tobytes() == frames[1].tobytes()


def test_amodal_pixels_follow_animated_opacity(tmp_path):
    inputs = "float inputs:opacityThreshold = 0.5\n float inputs:opacity.timeSamples = { 0: 1, 4: 0 }"
    path = write(tmp_path, PAINTED % (SQUARE, inputs), more=RANGE)
    rows = [frame.objects.by_name("Wall") for frame in stream(path, buffers=("instance",), frames=4)]
    assert [row.amodal_mask.sum() for row in rows] == [row.visible_pixels for row in rows]
    assert [row.visible_pixels > 0 for row in rows] == [True, True, True, False]


SCREEN = """
def Mesh "Screen"
{
    %s
    %s
}
def Mesh "Floor"
{
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-2, -2, 0), (2, -2, 0), (2, -2, 2), (-2, -2, 2)]
}
"""


@pytest.mark.parametrize("incremental", [False, True])
def test_emission_of_a_screen_plays_in_proportion(tmp_path, incremental):
    """Light transport is linear: with the same random numbers a frame is its emission times that of a steady screen."""
    glow = "color3f inputs:emissiveColor%s\n        color3f inputs:diffuseColor = (0, 0, 0)"
    floor = SCREEN.split('def Mesh "Floor"')[1]
    body = PAINTED % (SQUARE, glow % ".timeSamples = { 0: (0, 0, 0), 10: (10, 10, 10) }") + 'def Mesh "Floor"' + floor
    steady = PAINTED % (SQUARE, glow % " = (10, 10, 10)") + 'def Mesh "Floor"' + floor
    camera = ts.Camera(position=(0.0, 0.0, 5.0), exposure=0.0)
    frames = stream(write(tmp_path, body, more=RANGE), buffers=("hdr",), camera=camera, incremental=incremental)
    whole = stream(write(tmp_path, steady, name="steady.usda"), buffers=("hdr",), camera=camera, incremental=False)
    for k in (3, 10):
        np.testing.assert_allclose(frames[k].hdr, whole[k].hdr * (k / 10.0), rtol=2e-4)
    assert frames[0].hdr.max() == 0.0
    assert not frames.world.state(3).starting_lights
    assert frames.world.state(0).starting_lights is False  # frame 1 is not like frame 0


def test_surfaces_of_varying_color_are_movers_of_incremental_rendering(tmp_path):
    inputs = "color3f inputs:diffuseColor.timeSamples = { 0: (0, 0, 0), 10: (1, 1, 1) }"
    light = 'def DistantLight "Sun"\n{\n float inputs:intensity = 1\n}\n'
    floor = 'def Mesh "Floor"' + SCREEN.split('def Mesh "Floor"')[1]
    path = write(tmp_path, light + PAINTED % (SQUARE, inputs) + floor, more=RANGE)
    with stream(path, buffers=("hdr",)) as frames:
        state = frames.world.state(3)
        assert state.movers.tolist() == [True, False]
        assert state.starting_lights
    fast, slow = (stream(path, buffers=("hdr",), incremental=each, spp=64)[5].hdr for each in (True, False))
    np.testing.assert_allclose(fast.mean(), slow.mean(), rtol=0.05)


LIGHT = """
def %s "Lamp"%s
{
    %s
}
def Mesh "Wall"
{
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
    body = f"""def PointInstancer "Lamps"
{{
    rel prototypes = </Lamps/Lamp>
    int[] protoIndices = [0]
    point3f[] positions = [(1, 2, 3)]
    float3[] scales = [(10, 10, 10)]
    {lamp}
}}
def Mesh "Wall"
{{
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
def Xform "Group"
{
    token visibility.timeSamples = { 0: "inherited", 6: "invisible" }
    def DistantLight "Sun"
    {
        float inputs:intensity = 1
        token visibility.timeSamples = { 0: "invisible", 3: "inherited" }
    }
}
def Mesh "Wall"
{
    %s
}
"""
    frames = stream(write(tmp_path, body % SQUARE, more=RANGE), buffers=("hdr",))
    assert [bool(frames[k].hdr.any()) for k in (0, 2, 3, 5, 6, 9)] == [False, False, True, True, False, False]
    assert not frames.world.state(4).starting_lights


def test_lights_in_prototypes_play_their_intensity(tmp_path):
    body = """
def PointInstancer "P"
{
    rel prototypes = [</P/Lamp>]
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 2), (1, 0, 2)]
    def SphereLight "Lamp"
    {
        float inputs:intensity.timeSamples = { 0: 0, 10: 10 }
    }
}
def Mesh "Wall"
{
    %s
}
"""
    description = read(tmp_path, body % SQUARE, more=RANGE)
    assert [track.row for track in description.light_tracks] == [0, 1]
    with stream(write(tmp_path, body % SQUARE, more=RANGE), buffers=("hdr",)) as frames:
        assert [light.radiance for light in frames.world.state(5).lights] == [(5.0, 5.0, 5.0)] * 2


def test_lights_in_prototypes_play_their_visibility_and_that_of_the_instancer(tmp_path):
    body = """
def PointInstancer "P"
{
    rel prototypes = [</P/Post>]
    int[] protoIndices = [0]
    point3f[] positions = [(0, 0, 2)]
    token visibility.timeSamples = { 0: "inherited", 6: "invisible" }
    def Xform "Post"
    {
        token visibility.timeSamples = { 0: "invisible", 3: "inherited" }
        def SphereLight "Lamp"
        {
        }
    }
}
def Mesh "Wall"
{
    %s
}
"""
    with stream(write(tmp_path, body % SQUARE, more=RANGE), buffers=("hdr",)) as frames:
        lit = [len(frames.world.state(frame).lights) for frame in range(9)]
    assert lit == [0, 0, 0, 1, 1, 1, 0, 0, 0]


def test_animated_lights_that_are_not_drawn_are_left_alone(tmp_path):
    body = """
def SphereLight "Hidden"
{
    token visibility = "invisible"
    float inputs:intensity.timeSamples = { 0: 0, 10: 10 }
}
def SphereLight "Guide"
{
    uniform token purpose = "guide"
    float inputs:intensity.timeSamples = { 0: 0, 10: 10 }
}
def SphereLight "Flat"
{
    float3 xformOp:scale.timeSamples = { 0: (0, 0, 0), 5: (1, 1, 1), 10: (2, 2, 2) }
    uniform token[] xformOpOrder = ["xformOp:scale"]
}
def Mesh "Wall"
{
    %s
}
"""
    path = write(tmp_path, body % SQUARE, more=RANGE)
    with pytest.warns(match="</Flat> light: its transform is singular"):
        frames = ts.Stream(path, width=16, height=12, fps=10.0, buffers=("depth",))
    assert frames.world.state(5).lights == ()


def test_mesh_light_plays_its_intensity(tmp_path):
    body = f"""
def Mesh "Panel" (
    prepend apiSchemas = ["MeshLightAPI"]
)
{{
    {SQUARE}
    float inputs:intensity.timeSamples = {{ 0: 2, 10: 4 }}
}}
"""
    frames = stream(write(tmp_path, body, more=RANGE), buffers=("hdr",))
    for k, radiance in ((0, 2.0), (5, 3.0), (10, 4.0)):
        np.testing.assert_allclose(frames[k].hdr[6, 8], (radiance,) * 3, rtol=1e-5)


def test_stage_at_a_time_code_has_no_tracks(tmp_path):
    from tiscene.usd.read.stage_reader import read_stage

    inputs = "color3f inputs:diffuseColor.timeSamples = { 0: (0, 0, 0), 10: (1, 1, 1) }"
    path = write(tmp_path, PAINTED % (SQUARE, inputs), more=RANGE)
    description = read_stage(path, time_code=5.0)
    assert description.material_tracks == ()
    assert description.materials[0].diffuse_color == pytest.approx((0.5, 0.5, 0.5))


def test_material_override_stops_the_input_that_it_sets(tmp_path):
    inputs = """color3f inputs:diffuseColor.timeSamples = { 0: (0, 0, 0), 10: (1, 1, 1) }
        float inputs:roughness.timeSamples = { 0: 0, 10: 1 }"""
    path = write(tmp_path, PAINTED % (SQUARE, inputs), more=RANGE)
    scenario = ts.Scenario(str(path), overrides=[ts.MaterialOverride("/Paint", color=(0.1, 0.2, 0.3))])
    with stream(scenario, buffers=("albedo", "roughness")) as frames:
        frame = frames[5]
        np.testing.assert_allclose(frame.albedo[6, 8], (0.1, 0.2, 0.3), atol=1e-6)
        assert frame.roughness[6, 8] == pytest.approx(0.5)


def test_inspect_counts_animated_materials_and_lights(tmp_path, capsys):
    from tiscene.cli import main as cli

    inputs = "float inputs:roughness.timeSamples = { 0: 0.2, 10: 0.6 }"
    lamp = 'def SphereLight "Lamp"\n{\n    float inputs:radius.timeSamples = { 0: 1, 10: 3 }\n}\n'
    assert cli.main(["inspect", str(write(tmp_path, lamp + PAINTED % (SQUARE, inputs), more=RANGE))]) == 0
    assert "1 animated material; 1 light of animated size or visibility" in capsys.readouterr().out
