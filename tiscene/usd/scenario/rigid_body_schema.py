# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies by the schemas of UsdPhysics, which other programs read and write too.

PhysicsRigidBodyAPI has the initial velocities, PhysicsMassAPI density, mass and inertia, PhysicsMaterialAPI friction
and restitution. Lengths are in stage units, masses in the stage's kilogramsPerUnit, angular velocities in degrees per
second. Velocities are in the axes of the prim, before its scale. The exact values of tiscene's own objects are in
TisceneMotionAPI, in meters and radians of the world, and take precedence.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdShade

from dynamics import ArgumentError, RigidBody
from dynamics.rotation import quaternion
from tiscene.errors import counted
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
    to_prim = _transform(prim, Usd.TimeCode.Default()).GetRotation().GetInverse()
    velocity, spin = units.to_stage(content["velocity"]), map(math.degrees, content["angular_velocity"])
    body.CreateVelocityAttr(Gf.Vec3f(to_prim.TransformDir(Gf.Vec3d(*velocity))))
    body.CreateAngularVelocityAttr(Gf.Vec3f(to_prim.TransformDir(Gf.Vec3d(*spin))))
    body.CreateStartsAsleepAttr(content["starts_asleep"])
    _write_mass(prim, content, units)
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
    surface = _surface(prim)
    _report_not_simulated(prim, surface, report)
    content: dict[str, Any] = {"type": "RigidBody"}
    to_world = _transform(prim, time).GetRotation()
    for key, attribute, factor in (
        ("velocity", body.GetVelocityAttr(), units.meters),
        ("angular_velocity", body.GetAngularVelocityAttr(), math.radians(1.0)),
    ):
        if attribute.HasAuthoredValue() and _is_finite(attribute, report):
            content[key] = [each * factor for each in to_world.TransformDir(Gf.Vec3d(attribute.Get()))]
    if body.GetStartsAsleepAttr().Get():
        content["starts_asleep"] = True
    content |= _read_mass(prim, surface, units, time, report)
    if surface:
        for key, attribute, most in (
            ("friction", surface.GetDynamicFrictionAttr(), math.inf),
            ("restitution", surface.GetRestitutionAttr(), 0.95),
        ):
            if attribute.HasAuthoredValue() and _is_finite(attribute, report):
                value = float(attribute.Get())
                content[key] = min(max(value, 0.0), most)
                if abs(content[key] - value) > 1e-6:  # USD stores it in single precision
                    text = f"{attribute.GetName()} is {value:g}, which counts as {content[key]:g}"
                    report.omission(surface.GetPath(), text)
    return content


def _is_finite(attribute: Usd.Attribute, report: StageReport) -> bool:
    """Return whether a number or a vector is finite; report one that is not, which is left out."""
    value = attribute.Get()
    if all(map(math.isfinite, (value,) if isinstance(value, float) else value)):
        return True
    report.omission(
        attribute.GetPrimPath(), f"{attribute.GetName()} is {value}, which is not finite: its default is used"
    )
    return False


def _write_mass(prim: Usd.Prim, content: Mapping[str, Any], units: Units) -> None:
    mass = UsdPhysics.MassAPI.Apply(prim)
    per_unit = UsdPhysics.GetStageKilogramsPerUnit(prim.GetStage())
    mass.CreateDensityAttr(content["density"] * units.meters**3 / per_unit)
    if content["mass"] is not None:
        mass.CreateMassAttr(content["mass"] / per_unit)
    if content["center_of_mass"] is not None:
        scale = _transform(prim, Usd.TimeCode.Default()).GetScale()
        center = units.to_stage(content["center_of_mass"])
        mass.CreateCenterOfMassAttr(Gf.Vec3f(*(each / size for each, size in zip(center, scale, strict=True))))
    if content["diagonal_inertia"] is not None:
        moments = [each / (per_unit * units.meters**2) for each in content["diagonal_inertia"]]
        mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*moments))
        mass.CreatePrincipalAxesAttr(Gf.Quatf(*quaternion(content["principal_axes"]).tolist()))


def _read_mass(
    prim: Usd.Prim, surface: UsdPhysics.MaterialAPI | None, units: Units, time: Usd.TimeCode, report: StageReport
) -> dict[str, Any]:
    """Return what is authored of the mass of a body; its own density counts before that of its material."""
    own, content = UsdPhysics.MassAPI(prim), {}
    per_unit = UsdPhysics.GetStageKilogramsPerUnit(prim.GetStage())
    mass, density = (_not_negative(each, report) for each in (own.GetMassAttr(), own.GetDensityAttr()))
    if mass > 0.0:
        content["mass"] = mass * per_unit
    if not density and surface:
        density = _not_negative(surface.GetDensityAttr(), report)
    if density > 0.0:
        content["density"] = density * per_unit / units.meters**3
    center = own.GetCenterOfMassAttr().Get()
    if own.GetCenterOfMassAttr().HasAuthoredValue() and all(map(math.isfinite, center)):
        scale = _transform(prim, time).GetScale()
        content["center_of_mass"] = [each * units.meters * size for each, size in zip(center, scale, strict=True)]
    moments = [each * per_unit * units.meters**2 for each in own.GetDiagonalInertiaAttr().Get() or (0.0,)]
    if any(moments):
        axes = own.GetPrincipalAxesAttr().Get()
        try:
            x, y, z = moments
            RigidBody(diagonal_inertia=(x, y, z))
        except ArgumentError as error:
            report.omission(prim.GetPath(), f"physics:diagonalInertia is not applied: {error}")
        else:
            content["diagonal_inertia"] = moments
            if axes.GetLength() > 0.0:
                content["principal_axes"] = [axes.GetReal(), *axes.GetImaginary()]
    return content


def _not_negative(attribute: Usd.Attribute, report: StageReport) -> float:
    """Return a number; 0, which stands for none, for one that is not authored or, with a report, not valid."""
    value = float(attribute.Get() or 0.0)
    if 0.0 <= value < math.inf:
        return value
    report.omission(attribute.GetPrimPath(), f"{attribute.GetName()} is {value:g}, which is ignored")
    return 0.0


def _surface(prim: Usd.Prim) -> UsdPhysics.MaterialAPI | None:
    """Return the physics material of a body, or of the first prim within it that has one; None: there is none."""
    found = map(_material, Usd.PrimRange(prim, Usd.TraverseInstanceProxies()))
    return next((each for each in found if each is not None), None)


def _material(prim: Usd.Prim) -> UsdPhysics.MaterialAPI | None:
    """Return the physics material that is bound to a prim; None: there is none."""
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
    has_one = material and material.GetPrim().HasAPI(UsdPhysics.MaterialAPI)
    return UsdPhysics.MaterialAPI(material) if has_one else None


def _transform(prim: Usd.Prim, time: Usd.TimeCode) -> Gf.Transform:
    """Return the transform from the axes of a prim to those of the world."""
    return Gf.Transform(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(time))


def _report_not_simulated(prim: Usd.Prim, surface: UsdPhysics.MaterialAPI | None, report: StageReport) -> None:
    """Report what other programs simulate of a rigid body with a physics material, and of those within it."""
    path = prim.GetPath()
    materials = set()
    has_mass = bool(UsdPhysics.MassAPI(prim).GetMassAttr().Get())
    for each in Usd.PrimRange(prim, Usd.TraverseInstanceProxies()):
        if each != prim and is_rigid_body(each):
            report.omission(each.GetPath(), "a rigid body within another one moves with it")
        part = UsdPhysics.MassAPI(each)
        if each != prim and not has_mass and any((part.GetMassAttr().Get(), part.GetDensityAttr().Get())):
            text = "the mass of a part of a rigid body is not applied; give the body its mass (PhysicsMassAPI)"
            report.omission(each.GetPath(), text)
        material = _material(each)
        if material is not None:
            materials.add(material.GetPath())
    if len(materials) > 1:
        report.omission(path, f"of {counted(len(materials), 'physics material')} of a rigid body only the first counts")
    if surface and surface.GetStaticFrictionAttr().HasAuthoredValue():
        resting, sliding = surface.GetStaticFrictionAttr().Get(), surface.GetDynamicFrictionAttr().Get()
        if not math.isclose(resting, sliding, rel_tol=1e-6):
            text = f"physics:dynamicFriction, {sliding:g}, counts for a body at rest too, not physics:staticFriction"
            report.omission(surface.GetPath(), text)
