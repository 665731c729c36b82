# SPDX-License-Identifier: Apache-2.0
"""A room and a template as USD, and the check that a scenario survives a file."""

from __future__ import annotations

from pathlib import Path

from tiscene.scenario.scenario import Scenario

ROOM = """
def Xform "Room" {
    def Camera "Door" {
        double3 xformOp:translate = (0, 1, 5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Camera "Window" {}
    def Cube "Floor" {
        double3 xformOp:translate = (0, -1, 0)
        double3 xformOp:scale = (4, 0.1, 4)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
    def Xform "Chair" (kind = "component") {
        double3 xformOp:translate = (1, 0, 2)
        float3 xformOp:rotateXYZ = (10, 20, 30)
        float3 xformOp:scale = (1, 2, 1)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
        def Cube "Seat" {}
    }
}
class "Templates" {
    def Sphere "Ball" {}
}
"""
BLOCK = """
def Cube "Block" (kind = "component") {
    double3 xformOp:translate = (7, 8, 9)
    float3 xformOp:scale = (2, 1, 1)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
}
"""


def assert_kept(scenario: Scenario, path: Path) -> None:
    scenario.save(path)
    loaded = Scenario.load(path)
    assert loaded == scenario
    assert repr(loaded) == repr(scenario)
    first = path.read_bytes()
    loaded.save(path)
    assert path.read_bytes() == first
