# SPDX-License-Identifier: Apache-2.0
"""Poses and boxes of objects: those of their prims or points, whatever their meshes are and however they move."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import tiscene as ts
from tests.usd.helpers import write

RANGE = "startTimeCode = 0\n    endTimeCode = 10\n    timeCodesPerSecond = 10"
LEG = """def Cube "Leg" {
    double size = 0.1
    double3 xformOp:translate = (-0.3, 0.2, 0)
    float xformOp:rotateZ%s
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ"]
}
"""
TOP = """def Cube "Top" {
    double size = 0.1
    double3 xformOp:translate = (0.3, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
STILL, TURNS = " = 30", ".timeSamples = { 0: 0, 10: 180 }"
PLACED = "double3 xformOp:translate%s\n    uniform token[] xformOpOrder = [%s]"
AT = PLACED % (" = (1, 0, 0)", '"xformOp:translate"')
MOVES = PLACED % (".timeSamples = { 0: (1, 0, 0), 10: (1, 1, 0) }", '"xformOp:translate"')


def table(leg: str = STILL) -> str:
    return LEG % leg + TOP


def objects(path, frame: int = 0) -> dict[str, ts.ObjectRow]:
    source = ts.Stream(path, width=16, height=12, fps=10.0, buffers=("instance",))
    return {row.name: row for row in source[frame].objects}


def prim(name: str, lines: str, kind: str = 'kind = "component"', body: str = "") -> str:
    return f'def Xform "{name}" (\n{kind}\n)\n{{\n{lines}\n{body}}}\n'


@pytest.mark.parametrize("frame", [0, 5])
def test_copies_of_one_asset_have_one_box_and_the_poses_of_their_prims(tmp_path, frame):
    """Those that stood still, instances and points had the pose of their first mesh."""
    shared = 'def Xform "Table"\n{\n' + table() + "}\n"
    instancer = """def PointInstancer "Points" {
    int[] protoIndices = [0]
    point3f[] positions = [(1, 0, 0)]
    rel prototypes = </Library/Table>
}
"""
    library = f'class "Library"\n{{\n{shared}}}\n'
    referring = "instanceable = true\nprepend references = </Library/Table>"
    desk = prim("Desk", "", body=prim("Inner", MOVES, body=table()))
    text = library + prim("Still", AT, body=table()) + prim("Moves", MOVES, body=table()) + instancer
    path = write(tmp_path, text + prim("Native", AT, referring) + desk, more=RANGE)
    rows = objects(path, frame)
    assert set(rows) == {"Still", "Moves", "Points[0]", "Native", "Inner"}
    cache = UsdGeom.XformCache(frame)
    stage = Usd.Stage.Open(str(path))
    for row in rows.values():
        matrix = cache.GetLocalToWorldTransform(
            stage.GetPrimAtPath((row.prim_path or f"/{row.name}").partition("[")[0])
        )
        world = np.array(matrix).T if row.name != "Points[0]" else rows["Still"].world_from_object
        np.testing.assert_allclose(row.world_from_object, world, atol=1e-9)
        np.testing.assert_allclose(row.box_3d.size, (0.7183, 0.3183, 0.1), atol=1e-4)
        np.testing.assert_allclose(row.world_bounds.mean(axis=0), row.box_3d.center, atol=1e-6)


def test_part_that_turns_does_not_turn_the_object_that_it_is_the_first_part_of(tmp_path):
    path = write(tmp_path, prim("Fan", AT, body=table(TURNS)), more=RANGE)
    for frame in (0, 3):
        row = objects(path, frame)["Fan"]
        np.testing.assert_array_equal(row.world_from_object[:3], np.c_[np.eye(3), (1, 0, 0)])
        assert row.velocity == (0.0, 0.0, 0.0)
        np.testing.assert_allclose(row.box_3d.size, (0.7, 0.3, 0.1), atol=0.03)  # around the blade at all times
        assert row.box_3d.rotation == (1.0, 0.0, 0.0, 0.0)


def test_box_of_an_object_whose_scale_changes_is_as_large_as_the_object(tmp_path):
    grows = (
        'float3 xformOp:scale.timeSamples = { 0: (1, 1, 1), 10: (3, 1, 2) }\n token[] xformOpOrder = ["xformOp:scale"]'
    )
    path = write(tmp_path, prim("Thing", grows.replace(" token", "uniform token"), body=table()), more=RANGE)
    for frame in (0, 5, 10):
        row = objects(path, frame)["Thing"]
        np.testing.assert_allclose(row.box_3d.size, np.ptp(row.world_bounds, axis=0), atol=1e-6)
        np.testing.assert_allclose(row.box_3d.center, row.world_bounds.mean(axis=0), atol=1e-6)


def test_override_and_move_place_the_prim(tmp_path):
    path = write(tmp_path, prim("Table", AT, body=table()), more=RANGE)
    override = ts.ObjectOverride("/Table", (0, 2, 0), (0, 0, 90))
    source = ts.Stream(ts.Scenario(scene=str(path), overrides=(override,)), width=16, height=12, buffers=("instance",))
    assert source[0].objects.by_name("Table").position == (0.0, 2.0, 0.0)
    source.world.move("/Table", (0, 0, 3))
    frame = next(source)
    row = frame.objects.by_name("Table")
    assert row.position == (0.0, 0.0, 3.0)
    np.testing.assert_allclose(row.box_3d.center, row.world_bounds.mean(axis=0), atol=1e-6)
