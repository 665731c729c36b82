# SPDX-License-Identifier: Apache-2.0
"""Colliders and rigid bodies of UsdPhysics."""

from __future__ import annotations

import numpy as np
import pytest

from tests.usd.helpers import read, read_with_warning

COLLIDERS = """
def Xform "Chair" (kind = "component"%s) {
    def Cube "Drawn" {}
    def Cube "Proxy" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
        %s
    }
}
def Cube "Wall" {}
def Cube "Ghost" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
    bool physics:collisionEnabled = 0
}
"""


@pytest.mark.parametrize(
    ("line", "more", "expected"),
    [
        ("", "", [False, True, True, False]),
        ("bool physics:collisionEnabled = 0", "", [True, False, True, False]),
        ("", 'def PhysicsScene "Physics" {}\n', [False, True, False, False]),
    ],
)
def test_colliders_follow_usd_physics(tmp_path, line, more, expected):
    description = read(tmp_path, COLLIDERS % ("", line) + more)
    assert [each.collides for each in description.instances] == expected


HIDDEN = """
def Xform "Chair" (kind = "component") {
    def Cube "Drawn" {}
    def Cube "Hull" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
        uniform token purpose = "guide"
        double3 xformOp:scale = (2, 2, 2)
        uniform token[] xformOpOrder = ["xformOp:scale"]
    }
}
def Cube "Pane" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
    token visibility = "invisible"
}
def Cube "Hint" {
    uniform token purpose = "guide"
}
def Cube "Off" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
    token visibility = "invisible"
    bool physics:collisionEnabled = 0
}
def PointInstancer "Scatter" {
    int[] protoIndices = [0, 0]
    point3f[] positions = [(5, 0, 0), (9, 0, 0)]
    rel prototypes = </Scatter/Bush>
    def Xform "Bush" {
        def Sphere "Drawn" {}
        def Cube "Hull" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
            uniform token purpose = "proxy"
        }
    }
}
"""


def test_colliders_that_are_not_drawn_are_kept(tmp_path):
    description = read(tmp_path, HIDDEN)
    assert [each.name for each in description.objects] == ["Chair", "Scatter[0]", "Scatter[1]"]
    assert [(each.object, each.collides) for each in description.instances] == [(0, False), (1, False), (2, False)]
    found = {each.prim_path: each for each in description.colliders}
    assert {path: each.object for path, each in found.items()} == {
        "/Chair/Hull": 0, "/Pane": -1, "/Scatter[0]": 1, "/Scatter[1]": 2,
    }  # fmt: skip
    np.testing.assert_allclose(found["/Chair/Hull"].world_from_object, np.diag([2, 2, 2, 1]))
    np.testing.assert_allclose(found["/Scatter[1]"].world_from_object[:3, 3], (9, 0, 0))
    np.testing.assert_allclose(description.bounds(), [(-1, -1, -1), (10, 1, 1)])  # of drawn meshes only


def test_rigid_bodies_are_movable(tmp_path):
    body = COLLIDERS % (', prepend apiSchemas = ["PhysicsRigidBodyAPI"]', "")
    body = body.replace('(kind = "component", ', '(\nkind = "component"\n')
    assert [each.movable for each in read(tmp_path, body).objects] == [True, False, False]
    off = body.replace('def Cube "Drawn"', 'bool physics:rigidBodyEnabled = 0\ndef Cube "Drawn"')
    assert not read(tmp_path, off).objects[0].movable


@pytest.mark.parametrize("kind", ["component", "group"])
def test_moving_collider_that_is_not_drawn_is_named(tmp_path, kind):
    body = f"""def Cube "Floor" {{}}
    def Xform "Rig" (
        kind = "{kind}"
    ) {{
        double3 xformOp:translate.timeSamples = {{ 0: (0, 0, 0), 9: (1, 0, 0) }}
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Cube "Wall" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {{
            uniform token purpose = "guide"
        }}
    }}"""
    text = "a collider that moves and is not drawn stays where it is at the time read: </Rig/Wall>"
    description = read_with_warning(tmp_path, body, text)
    assert [each.prim_path for each in description.colliders] == ["/Rig/Wall"]
