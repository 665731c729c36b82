# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies by the schemas of UsdPhysics, which other programs read and write too.

PhysicsRigidBodyAPI has the initial velocities, PhysicsMassAPI the density, PhysicsMaterialAPI friction and restitution.
Lengths are in stage units, masses in the stage's kilogramsPerUnit, angular velocities in degrees per second. Velocities
are in the axes of the prim, before its scale. The exact values of tiscene's own objects are in TisceneMotionAPI, in
meters and radians of the world, and take precedence.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdShade

from tiscene.usd.core import schema
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.units import Units
from tiscene.usd.read.object_builder import is_rigid_body


def write_rigid_body(prim: Usd.Prim, content: Mapping[str, Any] | None, units: Units) -> None:
    """Author what an object is for physics: a rigid body, or a kinematic one that others collide with.

    Args:
        prim: the object.
        content: the JSON object of its dynamic; None: it has none.
        units: unit of length of the stage.
    """
    if content is None or content["type"] != "RigidBody":
        if prim.HasAPI(UsdPhysics.RigidBodyAPI):  # of its template
            UsdPhysics.RigidBodyAPI(prim).CreateKinematicEnabledAttr(True)
        return
    body = UsdPhysics.RigidBodyAPI.Apply(prim)
    body.CreateRigidBodyEnabledAttr(True)
    body.CreateKinematicEnabledAttr(False)
    to_prim = _rotation(prim, Usd.TimeCode.Default()).GetInverse()
    velocity, spin = units.to_stage(content["velocity"], True), map(math.degrees, content["angular_velocity"])
    body.CreateVelocityAttr(Gf.Vec3f(to_prim.TransformDir(Gf.Vec3d(*velocity))))
    body.CreateAngularVelocityAttr(Gf.Vec3f(to_prim.TransformDir(Gf.Vec3d(*spin))))
    per_unit = UsdPhysics.GetStageKilogramsPerUnit(prim.GetStage())
    UsdPhysics.MassAPI.Apply(prim).CreateDensityAttr(content["density"] * units.meters**3 / per_unit)
    material = UsdShade.Material.Define(prim.GetStage(), prim.GetPath().AppendChild("PhysicsMaterial"))
    surface = UsdPhysics.MaterialAPI.Apply(material.GetPrim())
    surface.CreateStaticFrictionAttr(content["friction"])
    surface.CreateDynamicFrictionAttr(content["friction"])
    surface.CreateRestitutionAttr(content["restitution"])
    binding = UsdShade.MaterialBindingAPI.Apply(prim)
    binding.Bind(material, UsdShade.Tokens.weakerThanDescendants, "physics")


def read_rigid_body(
    prim: Usd.Prim, units: Units, physics: bool, time: Usd.TimeCode, report: StageReport
) -> dict[str, Any] | None:
    """Return the JSON object of a RigidBody that is authored by UsdPhysics; None if the prim is none.

    A value that is not authored, or that a RigidBody cannot have, is left out.

    Args:
        prim: the object.
        units: unit of length of the stage.
        physics: whether objects without a dynamic are rigid bodies; a kinematic one is Still then.
        time: time code at which transforms are read.
        report: receives what of the body is not simulated.
    """
    body = UsdPhysics.RigidBodyAPI(prim)
    if not is_rigid_body(prim):
        return None
    if body.GetKinematicEnabledAttr().Get():
        return {"type": "Still"} if physics else None
    _report_not_simulated(prim, report)
    content: dict[str, Any] = {"type": "RigidBody"}
    to_world = _rotation(prim, time)
    if body.GetVelocityAttr().HasAuthoredValue():
        velocity = to_world.TransformDir(Gf.Vec3d(body.GetVelocityAttr().Get()))
        content["velocity"] = [each * units.meters for each in velocity]
    if body.GetAngularVelocityAttr().HasAuthoredValue():
        spin = to_world.TransformDir(Gf.Vec3d(body.GetAngularVelocityAttr().Get()))
        content["angular_velocity"] = [math.radians(each) for each in spin]
    surface = _surface(prim)
    density = UsdPhysics.MassAPI(prim).GetDensityAttr().Get() if prim.HasAPI(UsdPhysics.MassAPI) else None
    density = density or (surface.GetDensityAttr().Get() if surface else None)
    if density:
        per_unit = UsdPhysics.GetStageKilogramsPerUnit(prim.GetStage())
        content["density"] = density * per_unit / units.meters**3
    if surface:
        for key, attribute, most in (
            ("friction", surface.GetDynamicFrictionAttr(), math.inf),
            ("restitution", surface.GetRestitutionAttr(), 0.95),
        ):
            if attribute.HasAuthoredValue():
                content[key] = min(max(float(attribute.Get()), 0.0), most)
    return content


def _surface(prim: Usd.Prim) -> UsdPhysics.MaterialAPI | None:
    """Return the physics material of a body, or of the first prim within it that has one; None: there is none."""
    for each in Usd.PrimRange(prim, Usd.TraverseInstanceProxies()):
        material, _ = UsdShade.MaterialBindingAPI(each).ComputeBoundMaterial("physics")
        if material and material.GetPrim().HasAPI(UsdPhysics.MaterialAPI):
            return UsdPhysics.MaterialAPI(material)
    return None


def _rotation(prim: Usd.Prim, time: Usd.TimeCode) -> Gf.Rotation:
    """Return the rotation from the axes of a prim to those of the world."""
    return Gf.Transform(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(time)).GetRotation()


def _report_not_simulated(prim: Usd.Prim, report: StageReport) -> None:
    """Report what other programs simulate of a rigid body, and of those within it."""
    path, body, mass = prim.GetPath(), UsdPhysics.RigidBodyAPI(prim), UsdPhysics.MassAPI(prim)
    own = (mass.GetMassAttr(), mass.GetCenterOfMassAttr(), mass.GetDiagonalInertiaAttr())
    if any(each and each.HasAuthoredValue() for each in own):
        text = "mass, center of mass and inertia of a rigid body follow from its shape and physics:density alone"
        report.omission(path, text)
    if schema.targets(prim, "physics:filteredPairs"):
        report.omission(path, "a rigid body collides with its physics:filteredPairs too")
    if body.GetStartsAsleepAttr().Get():
        report.omission(path, "a rigid body begins to fall at once, not when it is touched (physics:startsAsleep)")
    for each in itertools.islice(Usd.PrimRange(prim, Usd.TraverseInstanceProxies()), 1, None):
        if is_rigid_body(each):
            report.omission(each.GetPath(), "a rigid body within another one moves with it")
