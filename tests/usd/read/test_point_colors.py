# SPDX-License-Identifier: Apache-2.0
"""Point instancers whose points have their own colors, opacities and other primvars that materials read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import preview_material, primvar_reader, read, read_with_warning, write
from tests.usd.read.test_animation import RANGE, stream
from tiscene.scene.placement import CURRENT
from tiscene.usd.read.stage_reader import read_stage

RED, GREEN, BLUE, GRAY = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.5, 0.5, 0.5)
SQUARE = """
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-0.9, -0.9, 0), (0.9, -0.9, 0), (0.9, 0.9, 0), (-0.9, 0.9, 0)]"""
POINTS = """
def PointInstancer "P" {
    rel prototypes = [</P/Tile>]
    int[] protoIndices = [0, 0, 0]
    point3f[] positions = [(-2, 0, 0), (0, 0, 0), (2, 0, 0)]
    %s
    def Xform "Tile" {
        %s
        def Mesh "Square" {
            %s
        }
    }
}
"""
LIGHT = """
def DomeLight "Sky" {}
"""


def colors(values, kind="vertex", name="displayColor", samples="", more=""):
    """Return a primvar of colors as text, of time samples if `values` is a mapping."""
    if isinstance(values, dict):
        times = ", ".join(f"{time}: {list(each)}" for time, each in values.items())
        return f"""color3f[] primvars:{name} (interpolation = "{kind}")
        color3f[] primvars:{name}.timeSamples = {{ {times} }}{more}"""
    return f'color3f[] primvars:{name} = {list(values)} (interpolation = "{kind}"){more}'


def points(values, tile="", square=""):
    return LIGHT + POINTS % (values, tile, SQUARE + square)


def own_colors(description):
    return [None if each.color is None else each.color.tolist() for each in description.instances]


def shown(path, frame=0, buffer="albedo", **options):
    """Return a buffer's value at the center of each object of a frame, by instance id."""
    image = stream(path, buffers=("instance", buffer), **options)[frame]
    ids = np.unique(image.instance[image.instance > 0]).tolist()
    return {number: np.median(image[buffer][image.instance == number], axis=0).tolist() for number in ids}


def test_points_have_their_colors(tmp_path):
    path = write(tmp_path, points(colors((RED, GREEN, BLUE))))
    description = read_stage(path)
    np.testing.assert_array_equal(np.array(own_colors(description))[:, :3], (RED, GREEN, BLUE))
    assert np.isnan(np.array(own_colors(description))[:, 3]).all()  # opacity is the mesh's
    assert len(description.meshes) == len(description.materials) == 1
    assert description.color_tracks == ()
    assert shown(path) == {1: list(RED), 2: list(GREEN), 3: list(BLUE)}


def test_picture_equals_that_of_gprims_of_these_colors(tmp_path):
    """To the bit: an instance's color is no other path of light."""
    tiles = "".join(
        f"""
def Mesh "Tile{number}" {{
    {SQUARE}
    {colors((color,), "constant")}
    double3 xformOp:translate = ({2 * number - 2}, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}"""
        for number, color in enumerate((RED, GREEN, GRAY))
    )
    paths = [
        write(tmp_path, points(colors((RED, GREEN, GRAY)))),
        write(tmp_path, LIGHT + tiles, name="gprims.usda"),
    ]
    one, other = (stream(path, buffers=("hdr", "albedo"))[0] for path in paths)
    np.testing.assert_array_equal(one.albedo, other.albedo)
    np.testing.assert_array_equal(one.hdr, other.hdr)


@pytest.mark.parametrize("kind", ["vertex", "varying", "faceVarying"])
def test_interpolations_with_a_value_for_each_point(tmp_path, kind):
    description = read(tmp_path, points(colors((RED, GREEN, BLUE), kind)))
    assert [each[:3] for each in own_colors(description)] == [list(RED), list(GREEN), list(BLUE)]


def test_uniform_value_is_that_of_all_points(tmp_path):
    description = read(tmp_path, points(colors((BLUE,), "uniform")))
    assert [each[:3] for each in own_colors(description)] == [list(BLUE)] * 3


def test_constant_value_is_inherited_as_before(tmp_path):
    description = read(tmp_path, points(colors((BLUE,), "constant")))
    assert own_colors(description) == [None] * 3
    assert description.materials[0].diffuse_color == BLUE


def test_indexed_colors_and_hidden_points(tmp_path):
    lines = colors((RED, GREEN)) + "\nint[] primvars:displayColor:indices = [1, 0, 1]\nint64[] invisibleIds = [0]"
    assert [each[:3] for each in own_colors(read(tmp_path, points(lines)))] == [list(RED), list(GREEN)]


@pytest.mark.parametrize("place", ["tile", "square"])
def test_color_within_the_prototype_is_stronger(tmp_path, place):
    """As USD says, a point's value counts as if it were at the root of the prototype, and the nearest one wins."""
    description = read(tmp_path, points(colors((RED, GREEN, BLUE)), **{place: "\n" + colors((GRAY,), "constant")}))
    assert own_colors(description) == [None] * 3
    assert description.materials[0].diffuse_color == GRAY


def test_points_have_their_opacities(tmp_path):
    opacity = 'float[] primvars:displayOpacity = [1, 0.2, 1] (interpolation = "vertex")'
    path = write(tmp_path, points(opacity, square="\n" + colors((GREEN,), "constant")))
    description = read_stage(path)
    assert [each[3] for each in own_colors(description)] == pytest.approx([1.0, 0.2, 1.0])
    assert shown(path) == {1: list(GREEN), 3: list(GREEN)}  # labels pass what is less than half there


def test_opacity_of_points_joins_colors_of_vertices(tmp_path):
    opacity = 'float[] primvars:displayOpacity = [1, 1, 0] (interpolation = "vertex")'
    path = write(tmp_path, points(opacity, square="\n" + colors((RED, RED, BLUE, BLUE))))
    assert np.isnan(np.array(own_colors(read_stage(path)))[:, :3]).all()
    image = stream(path, buffers=("instance", "albedo"))[0]
    assert set(np.unique(image.instance).tolist()) == {0, 1, 2}
    column = image.albedo[:, 32][image.instance[:, 32] == 2]
    assert column[0, 2] > 0.9
    assert column[-1, 0] > 0.9  # blue above, red below


def test_material_reads_primvars_of_points(tmp_path):
    reader = primvar_reader("float3", "tint")
    tinted = preview_material("/L", "color3f inputs:diffuseColor.connect = </L/Reader.outputs:result>", shaders=reader)
    lines = "rel material:binding = </L>\n" + colors((RED, GREEN, BLUE), name="tint")
    path = write(tmp_path, tinted + points(lines + "\n" + colors((GRAY,) * 3)))  # displayColor is not read
    assert shown(path) == {1: list(RED), 2: list(GREEN), 3: list(BLUE)}


def test_material_reads_a_number_of_points(tmp_path):
    reader = primvar_reader("float", "wear", "float inputs:fallback = 0.9")
    worn = preview_material("/L", "float inputs:roughness.connect = </L/Reader.outputs:result>", shaders=reader)
    lines = 'rel material:binding = </L>\nfloat[] primvars:wear = [0.25, 0.5, 0.75] (interpolation = "varying")'
    found = shown(write(tmp_path, worn + points(lines)), buffer="roughness")
    assert found == {1: pytest.approx(0.25), 2: pytest.approx(0.5), 3: pytest.approx(0.75)}


def test_primvars_that_no_material_can_read_are_named(tmp_path):
    reader = primvar_reader("float2", "offset")
    moved = preview_material("/L", "float inputs:roughness.connect = </L/Reader.outputs:result>", shaders=reader)
    lines = """
    rel material:binding = </L>
    float2[] primvars:offset = [(1, 0), (0, 1), (0, 0)] (interpolation = "vertex")
    color3f[] primvars:unused = [(1, 0, 0), (0, 1, 0), (0, 0, 0)] (interpolation = "vertex")"""
    expected = r"authored:\n  offset of each point of an instancer is not applied: </P>$"
    read_with_warning(tmp_path, moved + points(lines), expected)


def test_colors_of_another_number_are_named_and_not_used(tmp_path):
    expected = r"primvars:displayColor: 2 values, but vertex interpolation needs 3, so that it is not used: </P>$"
    description = read_with_warning(tmp_path, points(colors((RED, GREEN))), expected)
    assert own_colors(description) == [None] * 3
    assert description.materials[0].diffuse_color == (0.18, 0.18, 0.18)


def test_one_mesh_with_two_colors_of_points_is_named(tmp_path):
    reader = primvar_reader("float3", "tint")
    tinted = preview_material("/L", "color3f inputs:diffuseColor.connect = </L/Reader.outputs:result>", shaders=reader)
    subset = """
            def GeomSubset "Half" {
                uniform token familyName = "materialBind"
                int[] indices = [0]
                rel material:binding = </L>
            }"""
    lines = colors((RED, GREEN, BLUE)) + "\n" + colors((RED, GREEN, BLUE), name="tint")
    expected = r"read displayColor and tint: all have displayColor of its points: </P/Tile/Square>$"
    read_with_warning(tmp_path, tinted + points(lines, square=subset), expected)


NESTED = (
    LIGHT
    + """
def PointInstancer "Outer" {
    rel prototypes = [</Outer/Row>]
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, -1, 0), (0, 1, 0)]
    %s
    def PointInstancer "Row" {
        rel prototypes = [</Outer/Row/Square>]
        int[] protoIndices = [0, 0]
        point3f[] positions = [(-1, 0, 0), (1, 0, 0)]
        %s
        def Mesh "Square" {
            %s
        }
    }
}
"""
)


def test_nested_instancers_give_the_nearest_color(tmp_path):
    outer, inner = colors((RED, GREEN)), colors((BLUE, GRAY))
    opacity = 'float[] primvars:displayOpacity = [1, 0.75] (interpolation = "vertex")'
    description = read(tmp_path, NESTED % (outer + "\n" + opacity, inner, SQUARE))
    expected = [[*BLUE, 1.0], [*GRAY, 1.0], [*BLUE, 0.75], [*GRAY, 0.75]]
    np.testing.assert_array_equal(own_colors(description), expected)
    description = read(tmp_path, NESTED % (outer, "", SQUARE))
    assert [each[:3] for each in own_colors(description)] == [list(each) for each in (RED, RED, GREEN, GREEN)]
    description = read(tmp_path, NESTED % (outer, colors((GRAY,), "constant"), SQUARE))
    assert own_colors(description) == [None] * 4
    assert {each.diffuse_color for each in description.materials} == {GRAY}


def test_animated_colors_of_a_nested_instancer_are_named(tmp_path):
    body = NESTED % ("", colors({0: (RED, GREEN), 10: (BLUE, BLUE)}), SQUARE)
    text = "the color of points of an instancer in a prototype of another has time samples, .*: </Outer/Row>"
    description = read_with_warning(tmp_path, body, text)
    assert [each[:3] for each in own_colors(description)] == [list(each) for each in (RED, GREEN, RED, GREEN)]


def test_animated_colors_of_an_outer_instancer_play_in_all_its_parts(tmp_path):
    body = NESTED % (colors({0: (RED, GREEN), 10: (BLUE, GREEN)}), "", SQUARE)
    (track,) = read(tmp_path, body, more=RANGE).color_tracks
    assert track.instances.tolist() == [0, 1]  # those of the second point keep their color
    np.testing.assert_allclose(track.at(0.25)[:, :3], [(0.75, 0, 0.25)] * 2)


def test_animated_colors_play_while_the_points_stand_still(tmp_path):
    path = write(tmp_path, points(colors({0: (RED, GREEN, BLUE), 10: (BLUE, GREEN, RED)})), more=RANGE)
    description = read_stage(path)
    (track,) = description.color_tracks
    assert (track.instances.tolist(), track.times.tolist(), description.tracks) == ([0, 2], [0.0, 1.0], ())
    frames = stream(path, buffers=("instance", "albedo", "hdr"))
    for k, t in ((0, 0.0), (5, 0.5), (10, 1.0), (12, 1.0), (5, 0.5)):
        frame = frames[k]
        found = [np.median(frame.albedo[frame.instance == number], axis=0) for number in (1, 2, 3)]
        np.testing.assert_allclose(found, [(1 - t, 0, t), GREEN, (t, 0, 1 - t)], atol=1e-6)
    assert [each.position for each in frames[5].objects] == [each.position for each in frames[0].objects]


def test_frames_with_animated_colors_are_the_same_however_they_are_rendered(tmp_path):
    """Incremental rendering and the cache of labels count an instance that changes color as one that changes."""
    path = write(tmp_path, points(colors({0: (RED, GREEN, BLUE), 10: (BLUE, GREEN, RED)})), more=RANGE)
    buffers = ("albedo", "coverage", "forward_occlusion", "depth")
    whole = stream(path, buffers=buffers)
    expected = {k: stream(path, buffers=buffers)[k] for k in (3, 4, 7)}
    for k in range(8):
        frame = whole[k]
        for name in buffers if k in expected else ():
            np.testing.assert_array_equal(frame[name], expected[k][name], err_msg=f"{name} {k}")
    fast = ts.Stream(
        path, width=64, height=48, fps=10.0, quality="preview", camera=ts.Camera(position=(0.0, 0.0, 10.0))
    )
    plain = ts.Stream(
        path, width=64, height=48, fps=10.0, quality="preview", camera=ts.Camera(position=(0.0, 0.0, 10.0)),
        incremental=False,
    )  # fmt: skip
    for k in (0, 1, 9):
        np.testing.assert_allclose(fast[k].rgb.mean((0, 1)), plain[k].rgb.mean((0, 1)), atol=4.0)
    red = fast[9].rgb[24, 42].astype(int)  # the third tile, blue at the start
    assert red[0] > 2 * red[2]


def test_points_keep_their_colors_by_id(tmp_path):
    lines = """
    int64[] ids.timeSamples = { 0: [7, 8, 9], 5: [9, 7, 8] }
    """
    path = write(tmp_path, points(lines + colors((RED, GREEN, BLUE))), more=RANGE)
    (track,) = read_stage(path).color_tracks
    np.testing.assert_array_equal(track.at(0.0)[:, :3], (RED, GREEN, BLUE))
    np.testing.assert_array_equal(track.at(0.6)[:, :3], (GREEN, BLUE, RED))  # of the points with the ids 7, 8 and 9


def test_colors_and_places_of_points_may_have_samples_at_different_times(tmp_path):
    lines = colors({0: (RED, GREEN, BLUE), 2.5: (BLUE, GREEN, RED), 10: (BLUE, GREEN, RED)})
    body = points(lines).replace(
        "positions = [(-2, 0, 0), (0, 0, 0), (2, 0, 0)]",
        "positions.timeSamples = { 0: [(-2, 0, 0), (0, 0, 0), (2, 0, 0)], 10: [(-2, 9, 0), (0, 0, 0), (2, 0, 0)] }",
    )
    description = read(tmp_path, body, more=RANGE)
    (track,) = description.tracks
    (color_track,) = description.color_tracks
    assert (track.instances.tolist(), color_track.instances.tolist()) == ([0], [0, 2])
    np.testing.assert_allclose(color_track.at(0.125)[:, :3], [(0.5, 0, 0.5)] * 2)
    np.testing.assert_allclose(color_track.at(0.25)[:, :3], [BLUE, RED])
    assert track.at(0.5)[0][0, 1, 3] == pytest.approx(4.5)


def test_opacity_that_changes_occludes_at_the_other_frame_only(tmp_path):
    """A point that is gone at the next frame is occluded there, and one that is there now is labeled."""
    opacity = """float[] primvars:displayOpacity (interpolation = "vertex")
    float[] primvars:displayOpacity.timeSamples = { 0: [1, 1, 1], 4: [1, 1, 1], 5: [1, 0, 1] }"""
    path = write(tmp_path, points(opacity), more=RANGE)
    frames = stream(path, buffers=("instance", "forward_occlusion", "backward_occlusion"))
    for k, gone in ((3, False), (4, True)):
        frame = frames[k]
        for number in (1, 2, 3):
            here = frame.forward_occlusion[frame.instance == number]
            assert here.mean() == pytest.approx(float(gone and number == 2), abs=0.05), (k, number)
    assert set(np.unique(frames[5].instance).tolist()) == {0, 1, 3}


def test_amodal_pixels_are_those_of_the_opacity_at_the_frame(tmp_path):
    opacity = """float[] primvars:displayOpacity (interpolation = "vertex")
    float[] primvars:displayOpacity.timeSamples = { 0: [1, 1, 1], 4: [1, 1, 1], 5: [1, 0, 1] }"""
    path = write(tmp_path, points(opacity), more=RANGE)
    played = stream(path, frames=6)
    before, after = ([each.amodal_pixels for each in played[frame].objects] for frame in (4, 5))
    assert min(before) > 0
    assert after == [before[0], 0, before[2]]


def test_templates_keep_the_colors_of_their_points(tmp_path):
    body = (
        """
def Xform "Rack" (
    kind = "component"
)
{"""
        + (POINTS % (colors({0: (RED, GREEN, BLUE), 10: (BLUE, GREEN, RED)}), "", SQUARE)).replace("</P", "</Rack/P")
        + "}"
    )
    file = write(tmp_path, body, more=RANGE + '\n    defaultPrim = "Rack"', name="rack.usda")
    room = write(tmp_path, LIGHT + 'def Cube "Floor"\n{\n    double3 xformOp:translate = (0, -9, 0)\n'
                 '    uniform token[] xformOpOrder = ["xformOp:translate"]\n}')  # fmt: skip
    scenario = ts.Scenario(str(room), [ts.Object("rack", str(file), (0.0, 0.0, 0.0))])
    camera = ts.Camera(position=(0.0, 0.0, 10.0))
    world = ts.Stream(scenario, width=64, height=48, fps=10.0, camera=camera, buffers=("albedo", "part"))
    for k, expected in ((0, (RED, GREEN, BLUE)), (10, (BLUE, GREEN, RED))):
        frame = world[k]
        found = [np.median(frame.albedo[frame.part == number], axis=0).tolist() for number in (1, 2, 3)]
        assert found == [list(each) for each in expected]


def test_removing_an_object_keeps_the_colors_of_the_others(tmp_path):
    path = write(tmp_path, points(colors({0: (RED, GREEN, BLUE), 10: (BLUE, GREEN, RED)})), more=RANGE)
    scenario = ts.Scenario(str(path), overrides=[ts.ObjectOverride("/P[0]", visible=False)])
    camera = ts.Camera(position=(0.0, 0.0, 10.0))
    frame = ts.Stream(scenario, width=64, height=48, fps=10.0, camera=camera, buffers=("instance", "albedo"))[10]
    found = {n: np.median(frame.albedo[frame.instance == n], axis=0).tolist() for n in np.unique(frame.instance) if n}
    assert sorted(found.values()) == sorted([list(GREEN), list(RED)])


def test_placements_of_several_frames_join_their_colors(tmp_path):
    path = write(tmp_path, points(colors({0: (RED, GREEN, BLUE), 10: (BLUE, GREEN, RED)})), more=RANGE)
    placement = stream(path).world.state(4).placement
    assert placement.color_varies
    earlier = stream(path).world.state(1).placement
    np.testing.assert_array_equal(placement.since(earlier).color[0], earlier.color[CURRENT])
    assert not replace(placement, color=None).color_varies
