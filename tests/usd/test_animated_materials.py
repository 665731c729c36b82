# SPDX-License-Identifier: Apache-2.0
"""Time samples of material inputs: values derived by hand, and how streams play them."""

from __future__ import annotations

import math

import numpy as np
import pytest

import tiscene as ts
from tests.usd.animated_stages import RANGE, SQUARE, stream
from tests.usd.helpers import preview_material, read, write
from tiscene.render.view import View

PAINTED = """
def Mesh "Wall" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    %s
    rel material:binding = </Paint>
}
""" + preview_material("/Paint", "%s")


def materials_at(description, seconds):
    """Return the animated materials at a time, by row."""
    return {
        track.row: track.applied(description.materials[track.row], track.moment(seconds))
        for track in description.material_tracks
    }


def material_at(description, seconds):
    (material,) = materials_at(description, seconds).values()
    return material


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
    def Shader "Turn" {
        uniform token info:id = "UsdTransform2d"
        float inputs:rotation.timeSamples = { 0: 0, 10: 90 }
        float2 outputs:result
    }
    def Shader "Map" {
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
    def Shader "Map" {
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


def test_instances_play_the_display_colors_that_they_inherit(tmp_path):
    colors = {"A": "{ 0: [(1, 0, 0)], 10: [(0, 0, 1)] }", "B": "{ 0: [(0, 1, 0)], 10: [(0, 1, 1)] }"}
    body = f'class "Proto"\n{{\ndef Mesh "Wall"\n{{\n{SQUARE}\n}}\n}}\n'
    for name, samples in colors.items():
        body += f"""def Xform "{name}" (
            inherits = </Proto>
            instanceable = true
        )\n{{\ncolor3f[] primvars:displayColor.timeSamples = {samples}\n}}\n"""
    description = read(tmp_path, body, more=RANGE)
    rows = [description.meshes[each.mesh].materials[0] for each in description.instances]
    first, second = (materials_at(description, 0.5)[row].diffuse_color for row in rows)
    assert (first, second) == (pytest.approx((0.5, 0, 0.5)), pytest.approx((0, 1, 0.5)))


def test_primvar_that_a_material_reads_plays(tmp_path):
    nodes = """color3f inputs:diffuseColor.connect = </Paint/Tint.outputs:result>
        token outputs:surface
    }
    def Shader "Tint" {
        uniform token info:id = "UsdPrimvarReader_float3"
        string inputs:varname = "tint"
        float3 outputs:result"""
    tints = ["{ 0: (1, 0, 0), 10: (0, 0, 1) }", "{ 0: (1, 0, 0), 10: (0, 1, 0) }"]
    lines = [f"{SQUARE}\ncolor3f primvars:tint.timeSamples = {each}" for each in tints]
    body = PAINTED % (lines[0], nodes)
    body += body[body.index("def Mesh") : body.index("def Material")].replace(lines[0], lines[1]).replace("Wall", "B")
    description = read(tmp_path, body, more=RANGE)
    first, second = materials_at(description, 0.5).values()
    assert first.diffuse_color == pytest.approx((0.5, 0, 0.5))
    assert second.diffuse_color == pytest.approx((0.5, 0.5, 0))


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


APPEARS = "timeSamples = { 0: 0, 3: 0, 4: 1, 6: 1, 7: 0 }"
BACK = f'def Mesh "Back"\n{{\n{SQUARE}\ndouble3 xformOp:translate = (0, 0, -2)\n'
BACK += 'uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
CARDS = {
    "threshold": PAINTED % (SQUARE, f"float inputs:opacityThreshold = 0.5\n float inputs:opacity.{APPEARS}"),
    "color": f'def Mesh "Wall"\n{{\n{SQUARE}\nfloat[] primvars:displayOpacity.{APPEARS}\n}}\n'.replace(
        APPEARS, APPEARS.replace(": 0", ": [0]").replace(": 1", ": [1]")
    ),
}


@pytest.mark.parametrize("behind", ["", BACK])
@pytest.mark.parametrize("card", CARDS)
def test_occlusion_follows_animated_opacity(tmp_path, card, behind):
    """A card is there at frames 4 to 6. It hides what is behind it, and is itself not visible before and after."""
    path = write(tmp_path, CARDS[card] + behind, more=RANGE)
    with stream(path, buffers=("instance", "forward_occlusion", "backward_occlusion"), frames=9) as frames:
        for frame in frames:
            k, seen = frame.index, frame.instance > 0
            assert seen.all() == (bool(behind) or 4 <= k <= 6)
            assert (frame.forward_occlusion == (not seen.any() or k in (3, 6))).all(), k
            assert (frame.backward_occlusion == (not seen.any() or k in (4, 7))).all(), k


@pytest.mark.parametrize("card", CARDS)
def test_points_are_occluded_while_their_surface_is_transparent(tmp_path, card):
    path = write(tmp_path, CARDS[card] + BACK, more=RANGE)
    with stream(path, buffers=("instance",)) as frames:
        states = {k: frames.world.state(k) for k in (4, 5, 8)}
        views = {k: View(*state.cameras[0], width=16, height=12) for k, state in states.items()}
        points = frames.surface_points(states[4].placement, views[4], np.arange(4, 8), np.full(4, 6))
        hidden = {k: frames.follow(points, states[k].placement, views[k])[1] for k in (5, 8)}
    assert not hidden[5].any()
    assert hidden[8].all()


FLOOR = """
def Mesh "Floor" {
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
    body = PAINTED % (SQUARE, glow % ".timeSamples = { 0: (0, 0, 0), 10: (10, 10, 10) }") + FLOOR
    steady = PAINTED % (SQUARE, glow % " = (10, 10, 10)") + FLOOR
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
    path = write(tmp_path, light + PAINTED % (SQUARE, inputs) + FLOOR, more=RANGE)
    with stream(path, buffers=("hdr",)) as frames:
        state = frames.world.state(3)
        assert state.movers.tolist() == [True, False]
        assert state.starting_lights
    fast, slow = (stream(path, buffers=("hdr",), incremental=each, spp=64)[5].hdr for each in (True, False))
    np.testing.assert_allclose(fast.mean(), slow.mean(), rtol=0.05)


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
