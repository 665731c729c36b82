# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies in USD layers, for tiscene and for other programs."""

import math

import pytest
from pxr import Usd, UsdPhysics, UsdShade

import tiscene as ts
from tests.usd.helpers import write
from tiscene.errors import StageWarning
from tiscene.usd.scenario.read import read_scenario

BODY = ts.RigidBody(density=300, friction=0.4, restitution=0.7, velocity=(1, 0.1, 0), angular_velocity=(0, 2, 0))


def saved(path, **named):
    objects = [
        ts.Object("falling", "Cube", (0, 1, 0)),
        ts.Object("thrown", "Ball 01", (0, 2, 0), dynamic=BODY),
        ts.Object("fixed", "Cube", (1, 0, 0), dynamic=ts.Still()),
    ]
    scenario = ts.Scenario("object_view", objects, **named)
    scenario.save(path)
    return scenario


@pytest.mark.parametrize("physics", [False, True])
def test_scenario_with_rigid_bodies_is_the_same_after_a_round_trip(tmp_path, physics):
    scenario = saved(tmp_path / "run.usda", physics=physics)
    assert ts.Scenario.load(tmp_path / "run.usda").to_json() == scenario.to_json()


def test_other_programs_find_velocities_mass_and_material(tmp_path):
    saved(tmp_path / "run.usda", physics=True)
    stage = Usd.Stage.Open(str(tmp_path / "run.usda"))
    thrown = stage.GetPrimAtPath("/Scenario/Objects/thrown")
    body = UsdPhysics.RigidBodyAPI(thrown)
    assert thrown.HasAPI(UsdPhysics.RigidBodyAPI)
    assert not body.GetKinematicEnabledAttr().Get()
    assert tuple(body.GetVelocityAttr().Get()) == pytest.approx((1.0, 0.1, 0.0))
    assert tuple(body.GetAngularVelocityAttr().Get()) == pytest.approx((0.0, math.degrees(2.0), 0.0))
    assert UsdPhysics.MassAPI(thrown).GetDensityAttr().Get() == pytest.approx(300.0)
    material, _ = UsdShade.MaterialBindingAPI(thrown).ComputeBoundMaterial("physics")
    surface = UsdPhysics.MaterialAPI(material)
    assert surface.GetDynamicFrictionAttr().Get() == pytest.approx(0.4)
    assert surface.GetRestitutionAttr().Get() == pytest.approx(0.7)
    assert not stage.GetPrimAtPath("/Scenario/Objects/fixed").HasAPI(UsdPhysics.RigidBodyAPI)


CENTIMETERS = {"meters": 0.01, "more": "kilogramsPerUnit = 2"}
FOREIGN = """
def Cube "Box" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {{
    {kinematic}
    vector3f physics:velocity = (100, 0, -50)
    vector3f physics:angularVelocity = (0, 180, 0)
    float physics:density = 0.00025
}}
def Cube "Untouched" (prepend apiSchemas = ["PhysicsRigidBodyAPI"]) {{}}
"""


@pytest.mark.parametrize("kinematic", [False, True])
def test_object_that_another_program_made_a_rigid_body_is_one_in_meters_and_radians(tmp_path, kinematic):
    path = write(
        tmp_path, FOREIGN.format(kinematic="bool physics:kinematicEnabled = 1" if kinematic else ""), **CENTIMETERS
    )
    (box,) = read_scenario(path).content["objects"]
    if kinematic:
        assert box["dynamic"] is None
        return
    body = box["dynamic"]
    assert body["type"] == "RigidBody"
    assert body["velocity"] == pytest.approx([1.0, 0.0, -0.5])
    assert body["angular_velocity"] == pytest.approx([0.0, math.pi, 0.0])
    assert body["density"] == pytest.approx(500.0)
    assert set(body) == {"type", "velocity", "angular_velocity", "density"}


def test_kinematic_body_of_a_stage_whose_objects_are_rigid_bodies_stands_still(tmp_path):
    scenario = 'def Scope "Run" {\n    bool tiscene:scenario:physics = 1\n}\n'
    path = write(tmp_path, FOREIGN.format(kinematic="bool physics:kinematicEnabled = 1") + scenario, **CENTIMETERS)
    (box,) = ts.Scenario.load(path).objects
    assert box.dynamic == ts.Still()


MATERIAL = """
def Xform "Body" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI"]) {
    def Cube "Part" (prepend apiSchemas = ["PhysicsCollisionAPI", "MaterialBindingAPI"]) {
        rel material:binding:physics = </Ice>
    }
}
def Material "Ice" (prepend apiSchemas = ["PhysicsMaterialAPI"]) {
    float physics:dynamicFriction = 0.02
    float physics:density = 900
}
"""


def test_material_of_a_collider_is_that_of_its_body(tmp_path):
    path = write(tmp_path, MATERIAL)
    (body,) = ts.Scenario.load(path).objects
    assert (body.dynamic.friction, body.dynamic.density) == pytest.approx((0.02, 900.0))


TURNED = """
def Xform "Group" {
    double3 xformOp:rotateXYZ = (0, 90, 0)
    double3 xformOp:scale = (2, 2, 2)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ", "xformOp:scale"]
    def Cube "Box" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI"]) {
        vector3f physics:velocity = (0, 3, 1)
        vector3f physics:angularVelocity = (0, 90, 180)
        double3 xformOp:rotateXYZ = (90, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
    }
}
"""


def test_velocities_are_in_the_axes_of_the_prim_and_of_world_size(tmp_path):
    """As UsdPhysics says ("local space") and Newton reads them."""
    path = write(tmp_path, TURNED)
    (box,) = ts.Scenario.load(path).objects  # x is -z of the world, y is x, z is -y
    assert box.dynamic.velocity == pytest.approx((3, -1, 0), abs=1e-6)
    assert box.dynamic.angular_velocity == pytest.approx((math.pi / 2, -math.pi, 0), abs=1e-6)


def test_velocities_of_a_turned_object_are_saved_in_its_axes(tmp_path):
    objects = [ts.Object("thrown", "Cube", (0, 2, 0), (0, 90, 0), dynamic=BODY)]
    scenario = ts.Scenario("object_view", objects)
    scenario.save(tmp_path / "run.usda")
    assert ts.Scenario.load(tmp_path / "run.usda") == scenario
    stage = Usd.Stage.Open(str(tmp_path / "run.usda"))
    body = UsdPhysics.RigidBodyAPI(stage.GetPrimAtPath("/Scenario/Objects/thrown"))
    assert tuple(body.GetVelocityAttr().Get()) == pytest.approx((0, 0.1, 1), abs=1e-6)


UNREAD = """#usda 1.0
def Cube "Plain" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {
    float physics:density = 200
}
def Cube "Heavy" (
    prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI", "PhysicsMassAPI", "MaterialBindingAPI"]
) {
    float physics:mass = 3
    rel material:binding:physics = </Ice>
    bool physics:startsAsleep = 1
    def Sphere "Inner" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "MaterialBindingAPI"]) {
        rel material:binding:physics = </Stone>
    }
}
def Cube "Light" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {
    float3 physics:diagonalInertia = (1, 1, 3)
    def Sphere "Part" (prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsMassAPI"]) {
        float physics:mass = 2
    }
}
def Material "Ice" (prepend apiSchemas = ["PhysicsMaterialAPI"]) {
    float physics:dynamicFriction = 0.1
    float physics:staticFriction = 0.3
}
def Material "Stone" (prepend apiSchemas = ["PhysicsMaterialAPI"]) {}
"""


def test_what_is_not_simulated_of_a_rigid_body_is_named(tmp_path):
    path = tmp_path / "foreign.usda"
    path.write_text(UNREAD)
    with pytest.warns(StageWarning) as caught:
        read_scenario(path)
    (warning,) = caught
    found = [line.strip().rsplit(": ", 1)[::-1] for line in str(warning.message).splitlines()[1:]]
    expected = [
        ("</Heavy>", "2 physics materials"),
        ("</Heavy/Inner>", "within another"),
        ("</Ice>", "dynamicFriction, 0.1, counts"),
        ("</Light>", "diagonalInertia is not applied"),
        ("</Light/Part>", "mass of a part"),
    ]
    assert sorted(path for path, _ in found) == sorted(path for path, _ in expected)
    for path, word in expected:
        assert any(path == each and word in text for each, text in found), (path, word, found)


MASS = """
def Cube "Box" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {
    double3 xformOp:scale = (1, 2, 1)
    uniform token[] xformOpOrder = ["xformOp:scale"]
    float physics:mass = 3
    float physics:density = 0.00025
    point3f physics:centerOfMass = (10, 20, -10)
    float3 physics:diagonalInertia = (10000, 20000, 15000)
    quatf physics:principalAxes = (0.5, 0.5, 0.5, 0.5)
}
def Cube "Plain" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {}
"""


def test_mass_of_another_program_is_read_in_kilograms_and_meters(tmp_path):
    path = write(tmp_path, MASS, **CENTIMETERS)
    box, plain = ts.Scenario.load(path).objects
    assert box.dynamic.mass == pytest.approx(6.0)
    assert box.dynamic.density == pytest.approx(500.0)
    assert box.dynamic.center_of_mass == pytest.approx((0.1, 0.4, -0.1))  # the scale counts, as for joints
    assert box.dynamic.diagonal_inertia == pytest.approx((2.0, 4.0, 3.0))
    assert box.dynamic.principal_axes == (0.5, 0.5, 0.5, 0.5)
    assert plain.dynamic == ts.RigidBody()


def test_mass_survives_a_round_trip_and_is_found_by_other_programs(tmp_path):
    body = ts.RigidBody(
        mass=6.5, center_of_mass=(0.1, 0.4, -0.1), diagonal_inertia=(2, 4, 3), principal_axes=(0.5, 0.5, 0.5, 0.5)
    )
    scenario = ts.Scenario("object_view", [ts.Object("a", "Cube", (0, 1, 0), scale=(1, 2, 1), dynamic=body)])
    scenario.save(tmp_path / "run.usda")
    assert ts.Scenario.load(tmp_path / "run.usda") == scenario
    stage = Usd.Stage.Open(str(tmp_path / "run.usda"))
    mass = UsdPhysics.MassAPI(stage.GetPrimAtPath("/Scenario/Objects/a"))
    assert mass.GetMassAttr().Get() == pytest.approx(6.5)
    assert tuple(mass.GetCenterOfMassAttr().Get()) == pytest.approx((0.1, 0.2, -0.1))
    assert tuple(mass.GetDiagonalInertiaAttr().Get()) == pytest.approx((2, 4, 3))
    assert tuple(mass.GetPrincipalAxesAttr().Get().imaginary) == (0.5, 0.5, 0.5)


def test_sleep_is_read_and_survives_a_round_trip(tmp_path):
    path = tmp_path / "foreign.usda"
    path.write_text(UNREAD)
    with pytest.warns(StageWarning):
        plain, heavy, _ = read_scenario(path).content["objects"]
    assert ("starts_asleep" in plain["dynamic"], heavy["dynamic"]["starts_asleep"]) == (False, True)
    scenario = ts.Scenario("object_view", [ts.Object("a", "Cube", dynamic=ts.RigidBody(starts_asleep=True))])
    scenario.save(tmp_path / "run.usda")
    assert ts.Scenario.load(tmp_path / "run.usda") == scenario


INVALID = """
def Cube "Box" (
    prepend apiSchemas = [
        "TisceneObjectAPI", "PhysicsRigidBodyAPI", "PhysicsMassAPI", "PhysicsCollisionAPI", "MaterialBindingAPI"
    ]
) {{
    rel material:binding:physics = </Surface>
    {box}
}}
def Material "Surface" (prepend apiSchemas = ["PhysicsMaterialAPI"]) {{
    {surface}
}}
"""


@pytest.mark.parametrize(
    ("box", "surface", "message", "expected"),
    [
        ("", "float physics:restitution = 1", "restitution is 1, which counts as 0.95", {"restitution": 0.95}),
        ("", "float physics:dynamicFriction = -1", "dynamicFriction is -1, which counts as 0", {"friction": 0.0}),
        ("", "float physics:dynamicFriction = inf", "dynamicFriction is inf, which is not finite", {}),
        ("", "float physics:density = -2", "density is -2, which is ignored", {}),
        ("float physics:mass = nan", "", "mass is nan, which is ignored", {}),
        ("float physics:density = inf", "", "density is inf, which is ignored", {}),
        ("vector3f physics:velocity = (nan, 0, 0)", "", "velocity is .*, which is not finite", {}),
    ],
)
def test_values_that_a_rigid_body_cannot_have_are_named(tmp_path, box, surface, message, expected):
    path = write(tmp_path, INVALID.format(box=box, surface=surface))
    with pytest.warns(StageWarning, match=message):
        (read,) = ts.Scenario.load(path).objects
    assert read.dynamic == ts.RigidBody(**expected)


@pytest.mark.parametrize("enabled", [True, False])
def test_body_whose_colliders_are_disabled_touches_nothing(tmp_path, enabled):
    path = write(tmp_path, INVALID.format(box=f"bool physics:collisionEnabled = {int(enabled)}", surface=""))
    assert ts.Scenario.load(path).objects[0].collide is enabled
