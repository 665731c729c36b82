# SPDX-License-Identifier: Apache-2.0
"""Values of a room that its transform does not convert are those of the units and axes of the joined stage."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from tests.usd.joining.rooms import write_room
from tests.usd.joining.studio import ROOM, joined, stage_of, write_cellar, write_studio
from tiscene.errors import StageWarning
from tiscene.usd import RoomPlacement, join
from tiscene.usd.read.stage_reader import read_stage


def test_values_of_physics_are_in_the_units_of_the_joined_stage(tmp_path: Path) -> None:
    body = """
def Xform "Room" {
    def PhysicsScene "Scene" {
        vector3f physics:gravityDirection = (1, 0, -1)
        float physics:gravityMagnitude = 300
    }
    def Cube "Body" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {
        float physics:mass = 2000
        float physics:density = 0.5
        float3 physics:diagonalInertia = (1e7, 2e7, 3e7)
        point3f physics:centerOfMass = (1, 2, 3)
    }
    def PhysicsPrismaticJoint "Slide" (prepend apiSchemas = ["PhysicsDriveAPI:linear"]) {
        rel physics:body1 = </Room/Body>
        float physics:lowerLimit = -100
        float physics:upperLimit = inf
        point3f physics:localPos0 = (100, 200, 300)
        point3f physics:localPos1 = (1, 2, 3)
        float physics:breakForce = 3.4e38
        float physics:breakTorque = 1e7
        float drive:linear:physics:stiffness = 1000
        float drive:linear:physics:maxForce = 1e5
        float drive:linear:physics:targetPosition = 50
    }
    def PhysicsRevoluteJoint "Hinge" (prepend apiSchemas = ["PhysicsDriveAPI:angular"]) {
        rel physics:body0 = </Room/Body>
        float physics:lowerLimit = -90
        uniform token drive:angular:physics:type = "acceleration"
        float drive:angular:physics:stiffness = 7
    }
    def PhysicsDistanceJoint "Rope" {
        rel physics:body0 = </Room/Body>
        rel physics:body1 = </Room>
        float physics:minDistance = -1
        float physics:maxDistance = 150
        point3f physics:localPos1 = (1, 2, 3)
    }
}"""
    stage = stage_of(body, tmp_path, more="kilogramsPerUnit = 0.001")

    def value(name: str) -> Any:
        prim, _, attribute = name.partition(".")
        return stage.GetPrimAtPath(f"/Home/studio/{prim}").GetAttribute(attribute).Get()

    expected = {
        "Scene.physics:gravityMagnitude": 3.0,
        "Scene.physics:gravityDirection": (1, -1, 0),
        "Body.physics:mass": 2.0,
        "Body.physics:density": 500.0,
        "Body.physics:diagonalInertia": (1, 2, 3),
        "Body.physics:centerOfMass": (1, 2, 3),
        "Slide.physics:lowerLimit": -1.0,
        "Slide.physics:upperLimit": math.inf,
        "Slide.physics:localPos0": (2, 5, 1),
        "Slide.physics:localPos1": (1, 2, 3),
        "Slide.physics:breakForce": float(np.float32(3.4e38)),
        "Slide.physics:breakTorque": 1.0,
        "Slide.drive:linear:physics:stiffness": 1.0,
        "Slide.drive:linear:physics:maxForce": 1.0,
        "Slide.drive:linear:physics:targetPosition": 0.5,
        "Hinge.physics:lowerLimit": -90.0,
        "Hinge.physics:localPos1": (1, 2, 3),
        "Hinge.drive:angular:physics:stiffness": 7.0,
        "Rope.physics:minDistance": -1.0,
        "Rope.physics:maxDistance": 1.5,
        "Rope.physics:localPos1": (1, 2, 3),
    }
    for name, each in expected.items():
        assert value(name) == pytest.approx(each, rel=1e-6, abs=1e-6), name
    turn = Gf.Rotation(Gf.Vec3d(1, 0, 0), -90).GetQuat()
    for name in ("Slide.physics:localRot0", "Hinge.physics:localRot1"):
        assert Gf.IsClose(Gf.Vec3d(value(name).imaginary), turn.imaginary, 1e-6)
    assert UsdPhysics.GetStageKilogramsPerUnit(stage) == 1.0
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0


def test_first_room_gives_the_unit_of_mass(tmp_path: Path) -> None:
    stage = Usd.Stage.Open(str(joined(write_room(tmp_path, "room"), more="kilogramsPerUnit = 0.5")))
    assert UsdPhysics.GetStageKilogramsPerUnit(stage) == 0.5


def test_lights_and_lenses_that_depend_on_the_unit_are_converted_and_others_left(tmp_path: Path) -> None:
    body = """
def Xform "Room" {
    def RectLight "Normalized" {
        bool inputs:normalize = 1
        float inputs:exposure = 3
        float inputs:width = 10
    }
    def RectLight "Plain" (prepend apiSchemas = ["ShadowAPI"]) {
        float inputs:intensity = 5
        float inputs:shadow:distance = 200
    }
    def DistantLight "Sun" {
        bool inputs:normalize = 1
        float inputs:intensity = 5
    }
    def SphereLight "Flicker" {
        bool inputs:normalize = 1
        float inputs:intensity.spline = {
            bezier,
            0: 10000,
            10: 20000,
        }
    }
    def Camera "Lens" {
        float horizontalAperture = 36
        float2 clippingRange.timeSamples = { 0: (10, 1000), 5: None, 10: (20, 2000) }
    }
}"""
    stage = stage_of(body, tmp_path)
    room = stage.GetPrimAtPath(ROOM)
    value = {
        f"{prim.GetName()}.{attribute.GetName()}": attribute.Get()
        for prim in room.GetChildren()
        for attribute in prim.GetAttributes()
    }
    assert value["Normalized.inputs:intensity"] == pytest.approx(1e-4)
    assert (value["Normalized.inputs:exposure"], value["Normalized.inputs:width"]) == (3, 10)
    assert (value["Plain.inputs:intensity"], value["Plain.inputs:shadow:distance"]) == (5, 2)
    assert value["Sun.inputs:intensity"] == 5
    flicker = room.GetChild("Flicker").GetAttribute("inputs:intensity")
    assert [flicker.Get(time) for time in (0, 10)] == pytest.approx([1, 2])
    assert len(flicker.GetTimeSamples()) > 9
    assert value["Lens.horizontalAperture"] == pytest.approx(0.36)
    assert value["Lens.focalLength"] == pytest.approx(0.5)  # by default it is 50, in tenths of a unit
    clipping = room.GetChild("Lens").GetAttribute("clippingRange")
    assert clipping.Get(0) == pytest.approx((0.1, 10))
    assert clipping.Get(7) is None
    assert clipping.Get(10) == pytest.approx((0.2, 20))


def test_dome_keeps_the_pole_of_its_room(tmp_path: Path) -> None:
    body = 'def Xform "Room"\n{\n    def DomeLight_1 "Sky" {}\n}'
    assert stage_of(body, tmp_path).GetAttributeAtPath(f"{ROOM}/Sky.poleAxis").Get() == "Z"


def test_instances_that_hold_a_converted_value_stay_objects(tmp_path: Path) -> None:
    home = joined(write_studio(tmp_path, 0.01, "Z"))
    assert not Usd.Stage.Open(str(home)).GetPrimAtPath("/Home/studio/LampA").IsInstance()
    description = read_stage(home)
    lamp = next(row for row, each in enumerate(description.objects) if each.name == "LampA")
    assert sum(each.object == lamp for each in description.instances) == 2


def test_what_cannot_be_converted_is_named(tmp_path: Path) -> None:
    body = """
def Xform "Room" (prepend apiSchemas = ["TisceneScenarioAPI"]) {
    uniform string tiscene:scenario:edits = "[1]"
    def Shader "Glass" {
        uniform token info:id = "ND_standard_surface_surfaceshader"
        float inputs:transmission_depth.connect = </Room/Depth.outputs:out>
    }
    def Shader "Depth" {
        uniform token info:id = "ND_constant_float"
        float outputs:out
    }
    def Xform "Tree" (kind = "component") {
        uniform token model:drawMode = "cards"
        uniform token model:cardVisibility = "simple"
    }
    def Xform "Own" (prepend apiSchemas = ["TisceneMotionAPI"]) {
        uniform token tiscene:motion:type = "stepped"
    }
    def Cube "Walker" (prepend apiSchemas = ["TisceneMotionAPI"]) {
        uniform token tiscene:motion:type = "linearWaypoints"
        uniform token tiscene:motion:interpolation = "euler"
        uniform point3d[] tiscene:motion:positions = [(1, 2, 3)]
    }
    def SphereLight "Odd" {
        bool inputs:normalize.timeSamples = { 0: 1, 5: 0 }
    }
}"""
    with pytest.warns(StageWarning) as caught:
        stage_of(body, tmp_path)
    text = "\n".join(str(each.message) for each in caught)
    for path, part in (
        ("", "tiscene:scenario:edits is in meters"),
        ("/Glass", "its input transmission_depth, a length, comes from another node"),
        ("/Tree", "cards of a model"),
        ("/Own", "the fields of a trajectory of type stepped"),
        ("/Walker", "Euler angles of a trajectory become quaternions"),
        ("/Odd", "inputs:normalize varies"),
    ):
        line = next(each for each in text.splitlines() if part in each)
        assert f"</Home/studio{path}>" in line


def test_depth_with_a_unit_of_its_own_is_left(tmp_path: Path) -> None:
    body = """
def Xform "Room" {
    def Shader "Glass" {
        uniform token info:id = "ND_standard_surface_surfaceshader"
        float inputs:transmission_depth = 5 (
            customData = {
                string unit = "millimeter"
            }
        )
        float inputs:subsurface_radius = 5
    }
}"""
    stage = stage_of(body, tmp_path)
    assert stage.GetAttributeAtPath(f"{ROOM}/Glass.inputs:transmission_depth").Get() == 5
    assert stage.GetAttributeAtPath(f"{ROOM}/Glass.inputs:subsurface_radius").Get() == pytest.approx(0.05)


def test_prim_that_resets_transforms_is_placed_by_each_stage_that_holds_its_room(tmp_path: Path) -> None:
    body = """
def Xform "Room" {
    def Cube "Loose" {
        double3 xformOp:translate = (100, 200, 300)
        uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:translate"]
    }
}"""
    inner = stage_of(body, tmp_path)
    loose = UsdGeom.Xformable(inner.GetPrimAtPath(f"{ROOM}/Loose"))
    assert loose.ComputeLocalToWorldTransform(0).ExtractTranslation() == pytest.approx((2, 5, 1))
    (tmp_path / "outer").mkdir()
    home = RoomPlacement(inner.GetRootLayer().realPath, (10.0, 0.0, 0.0), name="home")
    path = join([(write_cellar(tmp_path / "outer", 0.1), (0, -90, 0)), home], tmp_path / "outer" / "house.usda")
    outer = Usd.Stage.Open(str(path))
    loose = UsdGeom.Xformable(outer.GetPrimAtPath("/House/home/studio/Loose"))
    assert loose.ComputeLocalToWorldTransform(0).ExtractTranslation() == pytest.approx((120, 50, 10))


def test_frustum_of_a_scenario_keeps_its_depth(tmp_path: Path) -> None:
    body = """
def Xform "Room" (prepend apiSchemas = ["TisceneScenarioAPI"]) {
    uniform double tiscene:scenario:frustumFar = 700
}"""
    assert stage_of(body, tmp_path).GetAttributeAtPath(f"{ROOM}.tiscene:scenario:frustumFar").Get() == 7.0
