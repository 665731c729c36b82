# SPDX-License-Identifier: Apache-2.0
"""Objects with time samples wherever they are on a stage: hidden, nested, in instances; where USD places them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import tiscene as ts
from tests.usd.helpers import write
from tiscene.errors import CameraNotFound, StageWarning
from tiscene.usd.core.stage import open_stage

RANGE = 'startTimeCode = 0\n    endTimeCode = 10\n    timeCodesPerSecond = 10\n    defaultPrim = "Cart"'
MOVED = """double3 xformOp:translate.timeSamples = { 0: (-1, 0, 0), 10: (1, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]"""
COMPONENT = 'def Xform "%s" (\n kind = "component"\n)\n{\n %s\n def Cube "Body" {}\n}\n'
FLOOR = """
def Cube "Floor" {
    double3 xformOp:translate = (0, -9, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


def stream(path) -> ts.Stream:
    return ts.Stream(path, width=16, height=12, fps=10.0, buffers=("instance",), camera=ts.Camera((0, 0, 10)))


def middles(source: ts.Stream, frame: int) -> dict[str, list[float]]:
    """Return the middle of each object's box at a frame, by the object's path."""
    rows = [row for row in source[frame].objects if row.amodal_pixels]
    return {row.prim_path or row.template: np.mean(row.world_bounds, axis=0).round(4).tolist() for row in rows}


@pytest.mark.parametrize(
    "hidden", ['token visibility = "invisible"', 'uniform token purpose = "guide"', 'uniform token purpose = "proxy"']
)
@pytest.mark.parametrize("on_itself", [False, True])
def test_hidden_prim_stays_hidden_when_it_moves(tmp_path, hidden, on_itself):
    thing = COMPONENT % ("Thing", MOVED + ("\n" + hidden if on_itself else ""))
    path = write(tmp_path, f'def Xform "Rig"\n{{\n{"" if on_itself else hidden}\n{thing}}}' + FLOOR, more=RANGE)
    assert "/Rig/Thing" not in middles(stream(path), 0)
    assert ts.Scenario.load(path).objects == ()


@pytest.mark.parametrize("on_itself", [False, True])
def test_prim_is_hidden_by_constant_time_samples(tmp_path, on_itself):
    """Many programs author a sample at each frame, whether the visibility changes or not."""
    hidden = 'token visibility.timeSamples = { 0: "invisible", 5: "invisible" }'
    thing = COMPONENT % ("Thing", MOVED + ("\n" + hidden if on_itself else ""))
    path = write(tmp_path, f'def Xform "Rig"\n{{\n{"" if on_itself else hidden}\n{thing}}}' + FLOOR, more=RANGE)
    assert "/Rig/Thing" not in middles(stream(path), 0)
    assert ts.Scenario.load(path).objects == ()


@pytest.mark.parametrize(
    "content",
    ['def SphereLight "Lamp" {}', 'def Camera "Eye" {}', 'def Cube "Handle"\n{\n uniform token purpose = "guide"\n}'],
)
def test_moving_component_without_geometry_is_no_object(tmp_path, content):
    """Its light and its camera move, and nothing is left out."""
    rig = f'def Xform "Rig" (\n kind = "component"\n)\n{{\n {MOVED}\n {content}\n}}\n'
    path = write(tmp_path, FLOOR + 'def SphereLight "Other" {}\n' + rig, more=RANGE)
    scenario = ts.Scenario.load(path)
    assert scenario.objects == ()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        source = stream(path)
    for frame, x in ((0, -1.0), (10, 1.0)):
        lights = source.world.state(frame).placement.lights or ()
        assert [each.world_from_light[0, 3] for _, each in lights if each.name == "Lamp"] == [x] * ("Lamp" in content)
    moved = getattr(scenario.camera, "dynamic", None)
    assert (moved is not None) == ("Eye" in content)


def test_object_that_is_never_shown_has_no_warnings(tmp_path):
    """It is hidden by one group, then by another."""
    shown, group = (
        ("invisible", "inherited"),
        'def Xform "%s"\n{\n token visibility.timeSamples = { 0: "%s", 5: "%s" }\n %s}\n',
    )
    body = group % ("Late", *shown, group % ("Early", *reversed(shown), COMPONENT % ("Thing", MOVED)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        source = stream(write(tmp_path, body + FLOOR, more=RANGE))
        assert [list(middles(source, frame)) for frame in (0, 6)] == [["/Floor"]] * 2


def test_object_appears_with_a_group_above_a_prim_without_a_type(tmp_path):
    group = 'def Xform "Group"\n{\n token visibility.timeSamples = { 0: "invisible", 5: "inherited" }\n %s}'
    path = write(tmp_path, group % ('def "Plain"\n{\n%s}\n' % (COMPONENT % ("Thing", MOVED))) + FLOOR, more=RANGE)
    source = stream(path)
    assert ["/Group/Plain/Thing" in middles(source, frame) for frame in (0, 6)] == [False, True]


def test_object_within_an_object_moves(tmp_path):
    """By its own samples, and by those of a part of the outer object."""
    drawer = COMPONENT % ("Drawer", MOVED)
    door = f'def Xform "Door"\n{{\n{MOVED}\n{COMPONENT % ("Handle", "")}}}\n'
    source = stream(write(tmp_path, COMPONENT % ("Desk", drawer + door), more=RANGE))
    for path in ("/Desk/Drawer", "/Desk/Door/Handle"):
        assert [middles(source, frame)[path][0] for frame in (0, 5, 10)] == [-1.0, 0.0, 1.0]


@pytest.mark.parametrize("part", [f'def Cube "Part"\n{{\n{MOVED}\n}}\n', COMPONENT % ("Part", MOVED)])
def test_prim_below_a_gprim_moves(tmp_path, part):
    """USD's documentation advises against gprims that hold others; its imaging draws them."""
    source = stream(write(tmp_path, f'def Cube "Base"\n{{\n{part}}}\n', more=RANGE))
    assert [middles(source, frame)["/Base/Part"][0] for frame in (0, 5, 10)] == [-1.0, 0.0, 1.0]


GROWS = """double3 xformOp:translate.timeSamples = { 0: (-1, 0, 0), 10: (1, 0, 0) }
    float xformOp:rotateZ.timeSamples = { 0: 0, 10: 90 }
    float3 xformOp:scale.timeSamples = { 0: %s, 10: (1, 0.5, 2) }
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ", "xformOp:scale"]"""


@pytest.mark.parametrize("first", ["(0.1, 0.1, 0.1)", "(0, 0, 0)"])
@pytest.mark.parametrize("inside", [False, True])
def test_object_whose_scale_changes_has_the_size_that_usd_gives_it(tmp_path, first, inside):
    """It kept its first scale. One that was flattened at any time stood still, and a part of an object was an error."""
    thing = COMPONENT % ("Thing", GROWS % first)
    path = write(tmp_path, (COMPONENT % ("Desk", thing) if inside else thing) + FLOOR, more=RANGE)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        source = stream(path)
    assert source.scenario.objects == ()
    prim = "/Desk/Thing" if inside else "/Thing"
    stage = open_stage(path)
    for frame in (1, 5, 10, 0, 5):
        rows = [row for row in source[frame].objects if row.prim_path == prim]
        if frame == 0 and "(0," in first:
            assert rows == []  # it is flat
        else:
            np.testing.assert_allclose(rows[0].world_bounds, usd_bounds(stage, prim + "/Body", frame), atol=1e-5)


def usd_bounds(stage: Usd.Stage, path: str, frame: int) -> np.ndarray:
    """Return the bounds [2, 3] of the corners of a prim's box by USD's own cache."""
    cache = UsdGeom.BBoxCache(Usd.TimeCode(frame), [UsdGeom.Tokens.default_])
    box = cache.ComputeWorldBound(stage.GetPrimAtPath(path))
    corners = np.array([box.GetMatrix().Transform(box.GetRange().GetCorner(k)) for k in range(8)])
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def test_object_that_turns_below_an_uneven_scale_has_the_shape_that_usd_gives_it(tmp_path):
    turning = 'float xformOp:rotateZ.timeSamples = { 0: 0, 10: 90 }\nuniform token[] xformOpOrder = ["xformOp:rotateZ"]'
    scale = 'float3 xformOp:scale = (3, 1, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    group = f'def Xform "Group"\n{{\n{scale}\n{COMPONENT % ("Thing", turning)}}}\n'
    path = write(tmp_path, group + FLOOR, more=RANGE)
    source, stage = stream(path), open_stage(path)
    for frame in (0, 4, 10):
        (row,) = [row for row in source[frame].objects if row.prim_path == "/Group/Thing"]
        np.testing.assert_allclose(row.world_bounds, usd_bounds(stage, "/Group/Thing/Body", frame), atol=1e-5)


@pytest.mark.parametrize("motion", ["", MOVED])
def test_object_that_is_hidden_and_shown_again_is_absent_between(tmp_path, motion):
    blinking = 'token visibility.timeSamples = { 0: "inherited", 2: "invisible", 4: "inherited", 7: "invisible" }\n'
    path = write(tmp_path, COMPONENT % ("Thing", blinking + motion) + FLOOR, more=RANGE)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        source = stream(path)
    shown = [[row.id for row in source[frame].objects if row.prim_path == "/Thing"] for frame in range(9)]
    (number,) = shown[0]
    assert shown == [[number]] * 2 + [[]] * 2 + [[number]] * 3 + [[]] * 2


@pytest.mark.parametrize("fps", [10.0, 25.0])
@pytest.mark.parametrize("motion", ["", MOVED])
def test_object_appears_and_vanishes_at_its_time_at_any_frame_rate(tmp_path, motion, fps):
    visibility = 'token visibility.timeSamples = { 0: "invisible", 4: "inherited", 8: "invisible" }\n'
    path = write(tmp_path, COMPONENT % ("Thing", visibility + motion) + FLOOR, more=RANGE)
    source = ts.Stream(path, width=16, height=12, fps=fps, buffers=("instance",), camera=ts.Camera((0, 0, 10)))
    for frame in range(round(fps) + 1):
        rows = [row for row in source.world.state(frame).objects if row.name == "Thing"]
        assert len(rows) == (0.4 <= frame / fps < 0.8)
        if rows and motion:
            assert rows[0].position[0] == pytest.approx(2.0 * frame / fps - 1.0)


def test_prototype_of_points_moves_with_all_its_points(tmp_path):
    points = """
def PointInstancer "Points" {
    point3f[] positions = [(0, 0, 0), (0, 3, 0)]
    int[] protoIndices = [0, 0]
    rel prototypes = </Points/Thing>
    def Cube "Thing" {
        %s
    }
}
"""
    source = stream(write(tmp_path, points % MOVED, more=RANGE))
    assert middles(source, 0) == {"/Points[0]": [-1, 0, 0], "/Points[1]": [-1, 3, 0]}
    assert middles(source, 5) == {"/Points[0]": [0, 0, 0], "/Points[1]": [0, 3, 0]}


@pytest.fixture
def carts(tmp_path):
    """A stage with two instances of a file, of the kind assembly: an object, a gprim and a lamp that move."""
    gprim = f'def Cube "Loose"\n{{\n{MOVED}\n}}\n'
    lamp = f'def SphereLight "Lamp"\n{{\n{MOVED}\nfloat inputs:intensity.timeSamples = {{ 0: 1, 10: 3 }}\n}}\n'
    cart = f'def Xform "Cart" (\n kind = "assembly"\n)\n{{\n{COMPONENT % ("Thing", MOVED)}{gprim}{lamp}}}\n'
    write(tmp_path, cart, more=RANGE, name="cart.usda")
    placed = """
def "%s" (
    instanceable = true
    prepend references = @./cart.usda@
) {
    double3 xformOp:translate:own = (0, %g, 0)
    uniform token[] xformOpOrder = ["xformOp:translate:own"]
}
"""
    return write(tmp_path, placed % ("Near", 0) + placed % ("Far", 3), more=RANGE)


def test_objects_and_lights_in_an_instance_of_several_move(carts):
    source = stream(carts)
    for frame, x in ((0, -1), (5, 0)):
        found = middles(source, frame)
        assert {path: found[path] for path in ("/Near/Thing", "/Near/Loose")} == {
            path: [x, 0, 0] for path in ("/Near/Thing", "/Near/Loose")
        }
        assert found["/Far/Thing"] == [x, 3, 0]
        lights = {each.prim_path: each for each in source.world.state(frame).lights}
        assert lights["/Far/Lamp"].world_from_light[:3, 3].round(4).tolist() == [x, 3, 0]
        assert lights["/Far/Lamp"].radiance[0] == pytest.approx(1 + 0.2 * frame)


def test_edits_and_lights_in_instances_are_written_as_motion(carts, tmp_path):
    source = stream(carts)
    source.world.move("/Far/Thing", position=(0, 5, 0))
    source.to_usd(tmp_path / "motion.usda", frames=4)
    again = stream(tmp_path / "motion.usda")
    assert middles(again, 2)["/Far/Thing"][1] == 5
    assert set(middles(again, 2)) == set(middles(source, 2))
    assert not open_stage(tmp_path / "motion.usda").GetPrimAtPath("/Far").IsInstance()
    for frame in (0, 3):
        mine, other = ({each.prim_path: each for each in s.world.state(frame).lights} for s in (source, again))
        for path in ("/Near/Lamp", "/Far/Lamp"):
            np.testing.assert_allclose(mine[path].world_from_light, other[path].world_from_light, atol=1e-6)
            np.testing.assert_allclose(mine[path].radiance, other[path].radiance, rtol=1e-6)


def test_part_with_its_own_transform_stack_stays_where_it_is(tmp_path):
    """USD leaves it in place while its object moves; the box of the object holds both."""
    own = 'double3 xformOp:translate = (0, 5, 0)\nuniform token[] xformOpOrder = ["!resetXformStack!", %s]'
    part = '\ndef Cube "Part"\n{\n%s\n}\n' % (own % '"xformOp:translate"')
    path = write(tmp_path, COMPONENT % ("Thing", MOVED + part) + FLOOR, more=RANGE)
    for frame in (0, 10, 5):
        row = next(row for row in stream(path)[frame].objects if row.prim_path == "/Thing")
        x = -1 + frame / 5
        np.testing.assert_allclose(row.world_bounds, [(min(x, 0) - 1, -1, -1), (max(x, 0) + 1, 6, 1)], atol=1e-6)
    assert ts.Scenario.load(path).objects == ()


def test_component_that_is_a_scope_moves_with_its_group(tmp_path):
    thing = (COMPONENT % ("Thing", "")).replace("Xform", "Scope")
    source = stream(write(tmp_path, f'def Xform "Group"\n{{\n{MOVED}\n{thing}}}' + FLOOR, more=RANGE))
    assert [middles(source, frame)["/Group/Thing"] for frame in (0, 10)] == [[-1, 0, 0], [1, 0, 0]]


def test_object_moves_along_an_arc_about_a_turning_group(tmp_path):
    """Orientations of a group are interpolated as USD does, on every whole time code."""
    turned = """quatf xformOp:orient.timeSamples = { 0: (1, 0, 0, 0), 10: (0.70710678, 0, 0, 0.70710678) }
    uniform token[] xformOpOrder = ["xformOp:orient"]"""
    placed = 'double3 xformOp:translate = (4, 0, 0)\nuniform token[] xformOpOrder = ["xformOp:translate"]'
    path = write(tmp_path, f'def Xform "Arm"\n{{\n{turned}\n{COMPONENT % ("Hand", placed)}}}', more=RANGE)
    (middle,) = middles(stream(path), 5).values()
    np.testing.assert_allclose(middle, (8**0.5, 8**0.5, 0), atol=1e-3)


CAMERAS = """
def Camera "Still" {
    double3 xformOp:translate = (0, 0, 10)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Camera "Moving" {
    %s
}
def Xform "Cart" (kind = "component") {
    %s
    def Cube "Body" {}
    def Camera "OnCart" {
        double3 xformOp:translate = (0, 2, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""


def test_named_cameras_move_as_on_the_stage(tmp_path):
    """Also one within an object that moves, and several at once."""
    path = write(tmp_path, CAMERAS % (MOVED, MOVED) + FLOOR, more=RANGE)
    options = {"width": 8, "height": 6, "fps": 10.0, "buffers": ("instance",)}
    names = {"Still": ((0, 0, 10), (0, 0, 10)), "Moving": ((-1, 0, 0), (0, 0, 0)), "OnCart": ((-1, 2, 0), (0, 2, 0))}
    for name, expected in names.items():
        source = ts.Stream(path, camera=name, **options)
        assert [source[frame].camera.position for frame in (0, 5)] == [pytest.approx(each) for each in expected]
    views = ts.Stream(path, camera=list(names), **options)[5].views
    assert {name: views[name].camera.position for name in names} == {
        name: pytest.approx(expected[1]) for name, expected in names.items()
    }
    still = ts.Stream(path, camera="Moving", time_code=10.0, **options)
    assert [still[frame].camera.position[0] for frame in (0, 5)] == [1, 1]
    with pytest.raises(CameraNotFound, match="OnCart"):
        ts.Stream(path, camera="OnKart", **options)


def test_camera_below_a_prim_that_moves_by_the_schema_is_named(tmp_path):
    schema = 'prepend apiSchemas = ["TisceneMotionAPI"]\n kind = "component"'
    body = CAMERAS.replace('kind = "component"', schema) % (MOVED, 'uniform token tiscene:motion:type = "orbit"')
    with pytest.warns(
        StageWarning, match="a camera below a prim of TisceneMotionAPI does not follow it: </Cart/OnCart>"
    ):
        ts.Scenario.load(write(tmp_path, body, more=RANGE))


def test_objects_that_move_have_the_names_that_they_have_in_blender(tmp_path):
    body = "".join(
        f"""
def Xform "M_{row}" {{
    custom string userProperties:blender:object_name = "M.{row}"
    double3 xformOp:translate.timeSamples = {{0: (0, {row}, 0), 24: (1, {row}, 0)}}
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Cube "Suzanne" {{}}
}}"""
        for row in range(2)
    )
    assert [each.id for each in ts.Scenario.load(write(tmp_path, body)).objects] == ["M.0", "M.1"]
