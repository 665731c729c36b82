# SPDX-License-Identifier: Apache-2.0
"""Joints in USD layers, for tiscene and for other programs."""

import math

import numpy as np
import pytest
from pxr import Gf, UsdGeom, UsdPhysics

import tiscene as ts
from tests.usd.helpers import write
from tiscene.errors import ScenarioError, StageWarning
from tiscene.scenario.edits import Spawn
from tiscene.usd.core.stage import open_stage
from tiscene.usd.scenario.read import read_scenario

PATH = ts.LinearWaypoints([ts.Waypoint((0, 3, 0)), ts.Waypoint((1, 3, 0))])
OBJECTS = [
    ts.Object("bob", "Cube", (0.3, 1, 0), (0, 0, 20), scale=(1, 2, 1)),
    ts.Object("other", "Ball 01", (0, 2, 0.1), (1, 0, 0, 0), dynamic=ts.RigidBody()),
    ts.Object("carrier", "Cube", (5, 5, 5), dynamic=PATH),
    ts.Object("Chair", "Chair 01", (1, 0, -1), (10, 20, 30)),
]
JOINTS = [
    ts.RevoluteJoint("bob", position=(0, 0.6, 0), axis="Z", lower_limit=-30, upper_limit=60.5),
    ts.FixedJoint("other", "bob", (0, 1, 0), (0, 0, 10), (1, 2, 0.1), (1, 0, 0, 0), collide=True),
    ts.DistanceJoint("Chair", "other", min_distance=0.1, max_distance=3.3),
    ts.SphericalJoint("Chair", "carrier", position=(0.1, 0.5, 0)),
]


SPAWN = Spawn(4, ts.Object("spawned", "Cube", dynamic=ts.RigidBody(), first_frame=4))


def scenario_of(joints=JOINTS, objects=OBJECTS, scene="object_view", **named):
    return ts.Scenario(scene, objects, joints=joints, physics=True, **named)


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_scenario_with_joints_is_the_same_after_a_round_trip(tmp_path, suffix):
    scenario = scenario_of([*JOINTS, ts.PrismaticJoint("spawned", upper_limit=0.7)], edits=[SPAWN])
    scenario.save(tmp_path / f"run{suffix}")
    assert ts.Scenario.load(tmp_path / f"run{suffix}").to_json() == scenario.to_json()


def frame_of(stage, relationship, position, rotation):
    """Return a local frame of a joint in the world as other programs compute it: the scale applies to the position."""
    world = Gf.Transform()
    for target in relationship.GetTargets():
        world = Gf.Transform(UsdGeom.Xformable(stage.GetPrimAtPath(target)).ComputeLocalToWorldTransform(0.0))
    scaled = Gf.CompMult(Gf.Vec3d(position.Get()), world.GetScale())
    turn = Gf.Rotation(world.GetRotation().GetQuat() * Gf.Quatd(rotation.Get()))
    place = world.GetTranslation() + world.GetRotation().TransformDir(scaled)
    return np.array([*place, *turn.TransformDir(Gf.Vec3d(1, 2, 3))])


def test_other_programs_find_both_frames_of_a_joint_in_the_same_place(tmp_path):
    scenario_of().save(tmp_path / "run.usda")
    stage = open_stage(tmp_path / "run.usda", None)
    joint = UsdPhysics.RevoluteJoint(stage.GetPrimAtPath("/Scenario/Joints/bob_RevoluteJoint"))
    assert (joint.GetAxisAttr().Get(), joint.GetLowerLimitAttr().Get(), joint.GetUpperLimitAttr().Get()) == (
        "Z",
        -30.0,
        60.5,
    )
    assert joint.GetBody0Rel().GetTargets() == []
    assert joint.GetBody1Rel().GetTargets() == ["/Scenario/Objects/bob"]
    first = frame_of(stage, joint.GetBody0Rel(), joint.GetLocalPos0Attr(), joint.GetLocalRot0Attr())
    second = frame_of(stage, joint.GetBody1Rel(), joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr())
    np.testing.assert_allclose(first, second, atol=1e-5)
    top = math.radians(20)
    pivot = (0.3 - 0.6 * math.sin(top), 1.0 + 0.6 * math.cos(top), 0.0)
    np.testing.assert_allclose(joint.GetLocalPos0Attr().Get(), pivot, atol=1e-6)


def test_joint_that_another_program_changes_is_read_as_changed(tmp_path):
    scenario_of(JOINTS[:2]).save(tmp_path / "run.usda")
    stage = open_stage(tmp_path / "run.usda", None)
    joint = UsdPhysics.RevoluteJoint(stage.GetPrimAtPath("/Scenario/Joints/bob_RevoluteJoint"))
    joint.GetUpperLimitAttr().Set(45.0)
    UsdPhysics.Joint(stage.GetPrimAtPath("/Scenario/Joints/other_FixedJoint")).CreateJointEnabledAttr(False)
    stage.GetRootLayer().Save()
    (read,) = ts.Scenario.load(tmp_path / "run.usda").joints
    assert read.upper_limit == 45.0
    assert read.position == pytest.approx((0.0, 0.6, 0.0), abs=1e-6)
    assert read.parent is None
    assert read.parent_position[1] == pytest.approx(1.0 + 0.6 * math.cos(math.radians(20)), abs=1e-6)


FOREIGN = """
def Xform "World" {
    double3 xformOp:translate = (0, 100, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Cube "Frame" {
        double3 xformOp:translate = (0, 50, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Door" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI"]) {
        double3 xformOp:translate = (50, 0, 0)
        double3 xformOp:scale = (40, 80, 2)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
    def Cube "Knob" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI"]) {
        double3 xformOp:translate = (80, 0, 5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def PhysicsRevoluteJoint "Hinge" (prepend apiSchemas = ["PhysicsDriveAPI:angular"]) {
        rel physics:body0 = </World/Door>
        rel physics:body1 = </World/Frame>
        point3f physics:localPos0 = (-1, 0, 0)
        point3f physics:localPos1 = (10, -50, 0)
        uniform token physics:axis = "Y"
        float physics:lowerLimit = -20
        float physics:upperLimit = 90
        float physics:breakForce = 5
        float physics:breakTorque = 3.4028235e38
    }
    def PhysicsDistanceJoint "Rope" {
        rel physics:body0 = </World/Door>
        rel physics:body1 = </World/Knob>
        float physics:maxDistance = 30
    }
    def PhysicsJoint "Free" {
        rel physics:body1 = </World/Knob>
    }
    def PhysicsFixedJoint "Elsewhere" {
        rel physics:body1 = </World/Frame>
    }
}
"""


def test_joints_of_another_program_are_read_in_meters_and_their_omissions_are_named(tmp_path):
    path = write(tmp_path, FOREIGN, meters=0.01)
    with pytest.warns(StageWarning) as warned:
        content = read_scenario(path).content
    text = str(warned[0].message)
    for part in ("breakForce", "PhysicsDriveAPI", "PhysicsJoint is not simulated"):
        assert part in text
    assert "breakTorque" not in text  # the largest float
    hinge, rope = content["joints"]
    assert (hinge["type"], hinge["body"], hinge["parent"], hinge["axis"]) == ("RevoluteJoint", "Door", None, "Y")
    assert (hinge["lower_limit"], hinge["upper_limit"]) == (-90.0, 20.0)  # of the door in the frame
    assert hinge["position"] == pytest.approx([-0.4, 0.0, 0.0])
    assert hinge["parent_position"] == pytest.approx([0.1, 1.0, 0.0])
    assert (rope["type"], rope["body"], rope["parent"], rope["max_distance"]) == ("DistanceJoint", "Knob", "Door", 0.3)
    with pytest.warns(StageWarning):
        joints = ts.Scenario.load(path).joints
    assert [type(each) for each in joints] == [ts.RevoluteJoint, ts.DistanceJoint]


def test_limits_in_loops_and_joints_that_contradict_themselves_are_left_out_and_named(tmp_path):
    """A door on two hinges with limits; a joint whose limits exclude each other."""
    second = """    def PhysicsRevoluteJoint "Second" {
        rel physics:body1 = </World/Door>
        uniform token physics:axis = "Y"
        float physics:lowerLimit = -20
    }
    def PhysicsPrismaticJoint "Third" {
        rel physics:body0 = </World/Knob>
        float physics:lowerLimit = 3
        float physics:upperLimit = 2
    }
    def PhysicsPrismaticJoint "Fourth" {
        rel physics:body1 = </World/Door>
    }
    def PhysicsFixedJoint "Elsewhere" {
"""
    path = write(tmp_path, FOREIGN.replace('    def PhysicsFixedJoint "Elsewhere" {\n', second), meters=0.01)
    with pytest.warns(StageWarning) as warned:
        joints = ts.Scenario.load(path).joints
    text = str(warned[0].message)
    for part in (
        "limits of a joint",
        "</World/Second>",
        "a joint is left out: its least value -0.02 is above",
        "</World/Third>",
        "</World/Fourth>",
    ):
        assert part in text
    assert [type(each) for each in joints] == [ts.RevoluteJoint, ts.DistanceJoint, ts.RevoluteJoint]
    assert joints[0].upper_limit == 20.0
    assert joints[2].lower_limit is None


UNLIMITED = """#usda 1.0
def Cube "Box" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI"]) {{}}
def PhysicsRevoluteJoint "Hinge" {{
    rel physics:body1 = </Box>
    float physics:lowerLimit = -{most}
    float physics:upperLimit = {most}
}}
def PhysicsDistanceJoint "Rope" {{
    rel physics:body1 = </Box>
    float physics:maxDistance = {most}
}}
"""


@pytest.mark.parametrize("most", ["inf", "3.4028235e38"])
def test_infinite_and_largest_limits_are_none(tmp_path, most):
    """A rope of infinite length refused the whole stage."""
    path = tmp_path / "foreign.usda"
    path.write_text(UNLIMITED.format(most=most))
    with pytest.warns(StageWarning, match="it has neither a least nor a greatest distance: </Rope>"):
        (hinge,) = ts.Scenario.load(path).joints
    assert hinge.lower_limit is hinge.upper_limit is None


SOCKET = """#usda 1.0
def Cube "Arm" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI"]) {{}}
def PhysicsSphericalJoint "Socket" {{
    rel physics:body1 = </Arm>
    uniform token physics:axis = "Z"
    float physics:coneAngle0Limit = {0:g}
    float physics:coneAngle1Limit = {1:g}
}}
"""


@pytest.mark.parametrize(
    ("angles", "read"),
    [((40, 40), 40.0), ((-1, -1), None), ((40, -1), "named"), ((40, 50), "named"), ((0, 0), "named")],
)
def test_round_cones_of_spherical_joints_are_read_and_others_named(tmp_path, angles, read):
    path = tmp_path / "socket.usda"
    path.write_text(SOCKET.format(*angles))
    if read == "named":
        with pytest.warns(StageWarning, match="not simulated unless they are two equal angles above 0 .*: </Socket>"):
            (joint,) = read_scenario(path).content["joints"]
        read = None
    else:
        (joint,) = read_scenario(path).content["joints"]
    assert (joint["axis"], joint["cone_angle"]) == ("Z", read)


def test_cone_of_a_spherical_joint_survives_a_round_trip_and_is_found_by_other_programs(tmp_path):
    joints = [ts.SphericalJoint("bob", axis="Y", cone_angle=33.3)]
    scenario_of(joints).save(tmp_path / "run.usda")
    assert ts.Scenario.load(tmp_path / "run.usda").joints == tuple(joints)
    stage = open_stage(tmp_path / "run.usda", None)
    joint = UsdPhysics.SphericalJoint(stage.GetPrimAtPath("/Scenario/Joints/bob_SphericalJoint"))
    found = [each.Get() for each in (joint.GetConeAngle0LimitAttr(), joint.GetConeAngle1LimitAttr())]
    assert found == pytest.approx([33.3, 33.3])
    assert joint.GetAxisAttr().Get() == "Y"


@pytest.mark.parametrize("cone_angle", [0.0, -5.0, 180.0])
def test_wrong_cone_is_an_error(cone_angle):
    with pytest.raises(ScenarioError, match="cone_angle"):
        ts.SphericalJoint("bob", cone_angle=cone_angle)


def test_sleep_of_a_body_that_a_joint_holds_is_named(tmp_path):
    path = tmp_path / "socket.usda"
    path.write_text(
        SOCKET.format(-1, -1).replace('BodyAPI"]) {', 'BodyAPI"]) {\n    bool physics:startsAsleep = 1\n', 1)
    )
    with pytest.warns(StageWarning, match="a joint holds is awake from the start .*: </Arm>"):
        read_scenario(path)


BROKEN = """#usda 1.0
def Cube "Arm" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI"]) {{}}
def PhysicsFixedJoint "Weld" {{
    rel physics:body1 = </Arm>
    {line}
}}
"""


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("point3f physics:localPos0 = (nan, 0, 0)", "physics:localPos0 or physics:localRot0 is not valid"),
        ("quatf physics:localRot1 = (0, 0, 0, 0)", "physics:localPos1 or physics:localRot1 is not valid"),
        ("rel physics:body0 = </Gone>", "</Gone>, which it holds, does not exist"),
        ("rel physics:body0 = </Arm>", "both of its ends are in one object"),
    ],
)
def test_broken_joints_are_left_out_and_named(tmp_path, line, message):
    path = tmp_path / "foreign.usda"
    path.write_text(BROKEN.format(line=line))
    with pytest.warns(StageWarning, match=f"a joint is left out: {message}: </Weld>"):
        assert ts.Scenario.load(path).joints == ()
