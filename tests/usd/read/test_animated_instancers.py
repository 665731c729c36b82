# SPDX-License-Identifier: Apache-2.0
"""Animated points of instancers, and moving parts of their prototypes."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import tiscene as ts
from tests.usd.helpers import read, read_with_warning, write
from tests.usd.read.test_animation import RANGE, placed, stream
from tiscene.usd.read.stage_reader import read_stage

SCATTER = """
def PointInstancer "P" {
    rel prototypes = [</P/Ball>, </P/Box>]
    int[] protoIndices%s
    point3f[] positions%s
    %s
    def Sphere "Ball" {
        double radius = 0.5
    }
    def Cube "Box" {
        double size = 1
    }
}
"""


def test_animated_points_of_an_instancer_move(tmp_path):
    positions = ".timeSamples = { 0: [(-2, 0, 0), (2, 0, 0)], 10: [(-2, 0, 0), (2, 2, 0)] }"
    path = write(tmp_path, SCATTER % (" = [0, 1]", positions, ""), more=RANGE)
    description = read_stage(path)
    assert [each.name for each in description.objects] == ["P[0]", "P[1]"]
    (track,) = description.tracks
    assert track.instances.tolist() == [1]  # the other one is static
    frame = stream(path)[5]
    assert frame.objects[1].position == pytest.approx((2, 1, 0))
    assert frame.objects[1].velocity == pytest.approx((0, 2, 0))
    hit = frame.instance == 2
    np.testing.assert_allclose(frame.scene_flow[hit], np.tile((0, 0.2, 0), (hit.sum(), 1)), atol=1e-6)
    assert not frame.scene_flow[frame.instance == 1].any()


def test_points_appear_and_vanish_by_id(tmp_path):
    """A point keeps its id whatever its index in the arrays, and is the same object when it reappears."""
    ids = """
    int64[] ids.timeSamples = { 0: [7, 8], 4: [8, 9], 8: [7, 8, 9] }
    int64[] invisibleIds.timeSamples = { 0: [], 9: [8] }
"""
    chosen = ".timeSamples = { 0: [0, 1], 4: [1, 0], 8: [0, 1, 0] }"
    positions = """.timeSamples = {
        0: [(-3, 0, 0), (0, 0, 0)], 4: [(0, 0, 0), (3, 0, 0)], 8: [(-3, 1, 0), (0, 0, 0), (3, 0, 0)]
    }"""
    path = write(tmp_path, SCATTER % (chosen, positions, ids), more=RANGE)
    frames = stream(path, buffers=("instance",))
    names = {each.name: number + 1 for number, each in enumerate(frames.world.stage.objects)}
    assert sorted(names) == ["P[7]", "P[8]", "P[9]"]
    for k, expected in ((0, "78"), (3, "78"), (4, "89"), (7, "89"), (8, "789"), (9, "79"), (30, "79")):
        wanted = {names[f"P[{digit}]"] for digit in expected}
        assert set(np.unique(frames[k].instance).tolist()) - {0} == wanted, k
        assert {row.id for row in frames[k].objects} == wanted
    assert next(row for row in frames[8].objects if row.name == "P[7]").position == (-3.0, 1.0, 0.0)


def test_velocities_extrapolate_points_until_the_next_sample(tmp_path):
    """As in USD: from a sample until the next one, which may have other points."""
    more = """
    vector3f[] velocities.timeSamples = { 0: [(0, 10, 0)], 4: [(0, 0, 0), (5, 0, 0)] }
"""
    positions = ".timeSamples = { 0: [(0, 0, 0)], 4: [(0, 4, 0), (1, 0, 0)] }"
    chosen = ".timeSamples = { 0: [0], 4: [0, 1] }"
    path = write(tmp_path, SCATTER % (chosen, positions, more), more=RANGE)
    description = read_stage(path)
    (track,) = description.tracks
    assert placed(track, 0.3)[0][0] == pytest.approx([0, 3, 0])
    assert placed(track, 0.2)[1] == [True, False]
    assert placed(track, 0.4)[1] == [True, True]


def test_velocities_that_do_not_lead_to_the_next_sample_carry_points_until_it(tmp_path):
    more = "vector3f[] velocities.timeSamples = { 0: [(0, 10, 0)], 4: [(0, 10, 0)], 8: [(0, 10, 0)] }"
    positions = ".timeSamples = { 0: [(0, 0, 0)], 4: [(0, 0, 0)], 8: [(0, 4, 0)] }"
    (track,) = read_stage(write(tmp_path, SCATTER % (" = [0]", positions, more), more=RANGE)).tracks
    assert placed(track, 0.39)[0][0] == pytest.approx([0, 3.9, 0])
    assert placed(track, 0.4)[0][0] == pytest.approx([0, 0, 0])
    assert len(track.times) == 21 + 1  # two steps a time code; none before the sample at 8, which they lead to


@pytest.mark.parametrize(
    ("samples", "more"),
    [
        ("2: [(0, 0, 0)]", ""),
        ("2: [(0, 0, 0)]", "vector3f[] accelerations.timeSamples = { 2: [(-20, 0, 0)] }"),
        ("2: [(0, 0, 0)], 4: [(0, 5, 0)]", ""),
    ],
    ids=["one sample", "accelerations", "two samples"],
)
def test_velocities_carry_points_beyond_their_samples_within_the_range_of_the_stage(tmp_path, samples, more):
    """One sample did nothing, and points stopped at the last of several."""
    velocities = samples.replace("(0, 0, 0)", "(10, 20, 0)").replace("(0, 5, 0)", "(0, 0, -5)")
    more += f"\nvector3f[] velocities.timeSamples = {{ {velocities} }}"
    path = write(tmp_path, SCATTER % (" = [0]", f".timeSamples = {{ {samples} }}", more), more=RANGE)
    stage = Usd.Stage.Open(str(path))
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath("/P"))
    frames = stream(path, buffers=("instance",))
    for k in (0, 2, 3, 5, 9, 10, 15):
        expected = instancer.ComputeInstanceTransformsAtTime(min(k, 10), min(k, 10))[0].ExtractTranslation()
        assert frames[k].objects[0].position == pytest.approx(tuple(expected), abs=1e-6), k


def test_moving_parts_of_a_prototype_move_in_each_point(tmp_path):
    body = """
def PointInstancer "Mills" {
    rel prototypes = [</Mills/Mill>]
    int[] protoIndices = [0, 0]
    point3f[] positions = [(-3, 0, 0), (3, 0, 0)]
    def Xform "Mill" (kind = "component") {
        def Cube "Tower" {}
        def Xform "Wings" {
            float xformOp:rotateZ.timeSamples = { 0: 0, 10: 90 }
            uniform token[] xformOpOrder = ["xformOp:rotateZ"]
            def Cube "Wing" {
                double3 xformOp:translate = (0, 2, 0)
                uniform token[] xformOpOrder = ["xformOp:translate"]
            }
        }
    }
}
"""
    description = read(tmp_path, body, more=RANGE)
    assert len(description.objects) == 2
    (track,) = description.tracks
    assert len(track.instances) == 2
    at, _ = placed(track, 1.0)
    np.testing.assert_allclose(at, [(-5, 0, 0), (1, 0, 0)], atol=1e-12)
    at, _ = placed(track, 0.5)
    root = np.sqrt(2)
    np.testing.assert_allclose(at, [(-3 - root, root, 0), (3 - root, root, 0)], atol=1e-12)


def test_an_instancer_in_a_prototype_moves_and_vanishes_with_its_time_samples(tmp_path):
    """It moves below a group that moves, and its points have a part that moves in them."""
    body = """
def PointInstancer "Fleet" {
    rel prototypes = [</Fleet/Ship>]
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 0), (0, 0, 100)]
    def Xform "Ship" {
        double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 10: (10, 0, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def PointInstancer "Sails" {
            token visibility.timeSamples = { 0: "inherited", 8: "invisible" }
            double xformOp:translateY.timeSamples = { 0: 0, 10: 4 }
            uniform token[] xformOpOrder = ["xformOp:translateY"]
            rel prototypes = [</Fleet/Ship/Sails/Sail>]
            int[] protoIndices = [0, 0]
            point3f[] positions = [(1, 0, 0), (2, 0, 0)]
            float3[] scales = [(1, 1, 1), (3, 3, 3)]
            def Cube "Sail" {
                double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 10: (0, 0, 1) }
                uniform token[] xformOpOrder = ["xformOp:translate"]
            }
        }
    }
}
"""
    (track,) = read(tmp_path, body, more=RANGE).tracks
    at, present = placed(track, 0.5)
    np.testing.assert_allclose(at, [(6, 2, 0.5), (7, 2, 1.5), (6, 2, 100.5), (7, 2, 101.5)], atol=1e-12)
    assert present == [True] * 4
    assert placed(track, 0.85)[1] == [False] * 4


def test_points_keep_a_prim_of_their_prototype_that_moves_on_the_stage_too(tmp_path):
    """On the stage it is an object of the scenario, in the prototype a part of each point."""
    body = """
def Scope "Library" {
    def Xform "Lamp" {
        def Cube "Foot" {}
        def Cube "Shade" {
            double3 xformOp:translate.timeSamples = { 0: (0, 2, 0), 10: (0, 3, 0) }
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }
    }
}
def PointInstancer "Lamps" {
    rel prototypes = [</Library/Lamp>]
    int[] protoIndices = [0]
    point3f[] positions = [(4, 0, 0)]
}
"""
    frame = stream(write(tmp_path, body, more=RANGE))[5]
    boxes = {row.name: row.world_bounds.tolist() for row in frame.objects}
    assert boxes["Shade"] == [[-1.0, 1.5, -1.0], [1.0, 3.5, 1.0]]
    assert boxes["Lamps[0]"] == [[3.0, -1.0, -1.0], [5.0, 3.5, 1.0]]


CAR = """
def %s "Car" (kind = "component") {
    double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 10: (1, 0, 0) }
    double xformOp:rotateY.timeSamples = { 0: 0, 10: 90 }
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]
%s
}
"""
WHEELS = """
    rel prototypes = <%s/Ball>
    int[] protoIndices = [0, 0]
    point3f[] positions = [(-1, 1, 0), (1, 1, 0)]
    def Sphere "Ball" {
        double radius = 0.3
        %s
    }
"""


@pytest.mark.parametrize("kind", ["Xform", "PointInstancer"])
def test_points_of_a_component_that_moves_have_ids_of_their_own(tmp_path, kind):
    """Those within another prim shared the id of the component; those of one that is the component stood still."""
    body = WHEELS % ("/Car", "")
    if kind == "Xform":
        body = f'    def PointInstancer "P"\\n    {{{WHEELS % ("/Car/P", "")}}}'.replace("\\n", "\n")
    frame = stream(write(tmp_path, CAR % (kind, body), more=RANGE))[5]
    name = "P" if kind == "Xform" else "Car"
    rows = {row.name: row for row in frame.objects}
    assert set(rows) == {f"{name}[0]", f"{name}[1]"}
    for number, side in enumerate((-1.0, 1.0)):
        row = rows[f"{name}[{number}]"]
        half = np.sqrt(0.5)
        assert row.position == pytest.approx((0.5 + side * half, 1, -side * half))
        assert (frame.instance == row.id).any()


def test_component_with_lights_at_points_moves_as_a_whole(tmp_path):
    """The place of lights at points does not play, while all of an object's lights go along with it."""
    lamp = 'def SphereLight "Lamp" {}'
    body = f'    def PointInstancer "P"\n    {{{WHEELS % ("/Car/P", lamp)}}}'
    stage = ts.Stream(str(write(tmp_path, CAR % ("Xform", body), more=RANGE)), width=8, height=6, buffers=("instance",))
    assert [row.name for row in stage[3].objects] == ["Car"]


def test_prototype_whose_transform_is_not_finite_at_some_time_is_left_out(tmp_path):
    body = """def PointInstancer "P" {
        rel prototypes = </P/A>
        int[] protoIndices = [0]
        point3f[] positions = [(1, 2, 3)]
        def Xform "A" {
            def Cube "Good" {}
            def Cube "Bad" {
                double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 5: (nan, 0, 0) }
                uniform token[] xformOpOrder = ["xformOp:translate"]
            }
        }
    }"""
    text = "</P/A/Bad> transform: its transform holds numbers that are not finite; left out"
    assert len(read_with_warning(tmp_path, body, text).instances) == 1
