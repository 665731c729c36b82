# SPDX-License-Identifier: Apache-2.0
"""Values of a prim that a transform of the prims above it does not convert to another stage's units and axes.

These are lengths that no transform scales (lenses of cameras, absorption of glass), what is divided by areas or volumes
(normalized lights, densities), and what is in the axes of the world (gravity, joints to the world). Points, widths,
sizes of lights, local frames of joints and velocities of points are in the axes of their prims.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade

from tiscene.usd.core.prims import type_of
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.value_times import is_time_varying, value_times
from tiscene.usd.lights.shaping import light_input
from tiscene.usd.materials.materialx_units import METERS, UNIT
from tiscene.usd.referencing.conversion import Conversion, scaled

RESET = "!resetXformStack!"
_PLACED = "xformOp:transform:placed"
_LENS = (  # whose defaults are in scene units, too
    *("focalLength", "focusDistance", "horizontalAperture", "verticalAperture"),
    *("horizontalApertureOffset", "verticalApertureOffset"),
)
_WITHOUT_AREA = ("DistantLight", "DomeLight", "DomeLight_1")  # normalized by their angle, or not at all
_DISTANCES = ("inputs:shadow:distance", "inputs:shadow:falloff", "physics:minDistance", "physics:maxDistance")
_DEPTHS = ("transmission_depth", "attenuation_distance", "subsurface_radius")  # inputs of MaterialX's surfaces
_PHYSICS = {  # powers of length and mass
    "physics:breakForce": (1, 1),
    "physics:breakTorque": (2, 1),
    "physics:density": (-3, 1),
    "physics:diagonalInertia": (2, 1),
    "physics:gravityMagnitude": (1, 0),
    "physics:mass": (0, 1),
    "physics:velocity": (1, 0),
}
_AXIS = re.compile(r"(limit|drive):(\w+):physics:(\w+)")  # of the schemas that are applied for each axis of a joint
_ANGULAR = ("angular", "rotX", "rotY", "rotZ")
_ALONG_AXIS = {  # for shifts; for angles `_ABOUT_AXIS`
    **dict.fromkeys(("low", "high", "targetPosition", "targetVelocity"), (1, 0)),
    "stiffness": (0, 1),
    "damping": (0, 1),
    "maxForce": (1, 1),
}
_ABOUT_AXIS = dict.fromkeys(("stiffness", "damping", "maxForce"), (2, 1))


@dataclass(frozen=True)
class ConvertedValue:
    """What an attribute is on the other stage.

    Attributes:
        kind: its type.
        default: its value without time; None: it has none.
        samples: its time samples by time code; None for a blocked one.
    """

    kind: Sdf.ValueTypeName
    default: Any = None
    samples: dict[float, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, attribute: Usd.Attribute, change: Callable[[Any], Any]) -> ConvertedValue:
        """Return the values of an attribute, changed by a function. A spline is followed at every whole time code."""

        def changed(time: Usd.TimeCode) -> Any:
            value = attribute.Get(time)
            return None if value is None else change(value)

        samples = {time: changed(Usd.TimeCode(time)) for time in value_times(attribute)}
        return cls(attribute.GetTypeName(), changed(Usd.TimeCode.Default()), samples)

    def author(self, prim: Usd.Prim, name: str) -> None:
        """Write the values to the stage's edit target."""
        attribute = prim.GetAttribute(name) or prim.CreateAttribute(name, self.kind, False)
        if self.default is not None:
            attribute.Set(self.default)
        for time, value in self.samples.items():
            attribute.Set(Sdf.ValueBlock() if value is None else value, time)


Values = Iterator[tuple[Sdf.Path, ConvertedValue]]


def converted_values(prim: Usd.Prim, conversion: Conversion, report: StageReport) -> Values:
    """Yield the attributes of a prim that change, by path. Of a shader, its interface's may be those of another prim.

    Args:
        prim: the prim.
        conversion: to the other stage.
        report: receives what cannot be converted.
    """
    if conversion.factor(1) != 1.0:
        yield from _lengths(prim, conversion, report)
    yield from _physics(prim, conversion)
    order = prim.GetAttribute("xformOpOrder").Get() if prim.IsA(UsdGeom.Xformable) else None
    if order and RESET in order:
        yield from _placed(prim, list(order), conversion)
    if conversion.turned_from:
        yield from _pole(prim, conversion.turned_from)
        if _hides_up_axis(prim):
            text = "cards of a model are left out across the up axis of the new stage, not of its own"
            report.omission(prim.GetPath(), text)


def _lengths(prim: Usd.Prim, conversion: Conversion, report: StageReport) -> Values:
    """Yield what depends on the unit of length of cameras, lights and materials."""
    if prim.IsA(UsdGeom.Camera):
        for name in _LENS:
            yield from _times(prim.GetAttribute(name), conversion.factor(1), has_fallback=True)
        yield from _times(prim.GetAttribute("clippingRange"), conversion.factor(1))
    if prim.HasAPI(UsdLux.LightAPI):
        yield from _normalized(prim, conversion, report)
    if prim.IsA(UsdShade.Shader):
        yield from _depths(UsdShade.Shader(prim), conversion, report)
    for name in _DISTANCES:
        attribute = prim.GetAttribute(name)
        if attribute and attribute.HasAuthoredValue():
            yield attribute.GetPath(), ConvertedValue.of(attribute, conversion.distance)


def _times(attribute: Usd.Attribute, factor: float, *, has_fallback: bool = False) -> Values:
    """Yield a number or a vector times a factor; the schema's default too if it `has_fallback` that depends on it."""
    if attribute and factor != 1.0 and (attribute.HasAuthoredValue() or (has_fallback and attribute.Get())):
        yield attribute.GetPath(), ConvertedValue.of(attribute, lambda value: scaled(value, factor))


def _normalized(prim: Usd.Prim, conversion: Conversion, report: StageReport) -> Values:
    """Yield the intensity of a light that is divided by its area, which is in the units of its stage."""
    if type_of(prim) in _WITHOUT_AREA or not light_input(prim, "normalize", Usd.TimeCode.EarliestTime(), False):
        return
    if is_time_varying(prim.GetAttribute("inputs:normalize")):
        report.omission(prim.GetPath(), "a light whose inputs:normalize varies is converted as at its start")
    names = ("inputs:intensity", "intensity")  # the second in old files
    intensity = next((each for each in map(prim.GetAttribute, names) if each and each.HasAuthoredValue()), None)
    yield from _times(intensity or prim.GetAttribute(names[0]), conversion.factor(2), has_fallback=True)


def _depths(shader: UsdShade.Shader, conversion: Conversion, report: StageReport) -> Values:
    """Yield depths of absorption and scattering in scene units; those that name a unit of their own stay."""
    for name in _DEPTHS:
        given = shader.GetInput(name)
        for attribute in UsdShade.Utils.GetValueProducingAttributes(given) if given else ():
            if attribute.GetName().startswith("outputs:"):
                text = f"its input {name}, a length, comes from another node and keeps its number"
                report.omission(shader.GetPath(), text)
            elif attribute.GetCustomDataByKey(UNIT) not in METERS:
                yield from _times(attribute, conversion.factor(1))


def _physics(prim: Usd.Prim, conversion: Conversion) -> Values:
    """Yield what depends on the units of length and mass, or is in the world's axes, of UsdPhysics."""
    for attribute in prim.GetAuthoredAttributes():
        name = attribute.GetName()
        if name in _PHYSICS:
            yield from _times(attribute, conversion.factor(*_PHYSICS[name]))
        elif name in ("physics:lowerLimit", "physics:upperLimit") and prim.IsA(UsdPhysics.PrismaticJoint):
            yield from _times(attribute, conversion.factor(1))
        elif match := _AXIS.fullmatch(name):
            yield from _times(attribute, conversion.factor(*_powers(prim, *match.groups())))
        elif name == "physics:gravityDirection" and conversion.rotation.GetAngle() != 0.0:
            yield attribute.GetPath(), ConvertedValue.of(attribute, conversion.direction)
    joint = UsdPhysics.Joint(prim)
    if joint and conversion.world != Gf.Matrix4d(1.0):
        yield from _world_ends(joint, conversion)


def _powers(prim: Usd.Prim, schema: str, axis: str, name: str) -> tuple[int, int]:
    """Return the powers of length and mass of a limit or a drive along or about an axis."""
    is_acceleration = prim.GetAttribute(f"{schema}:{axis}:physics:type").Get() == UsdPhysics.Tokens.acceleration
    if is_acceleration and name in ("stiffness", "damping"):
        return 0, 0
    return (_ABOUT_AXIS if axis in _ANGULAR else _ALONG_AXIS).get(name, (0, 0))


def _world_ends(joint: UsdPhysics.Joint, conversion: Conversion) -> Values:
    """Yield the frames of a joint at the ends that hold on to the world."""
    ends = (
        (joint.GetBody0Rel(), joint.GetLocalPos0Attr(), joint.GetLocalRot0Attr()),
        (joint.GetBody1Rel(), joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr()),
    )
    if not any(body.GetTargets() for body, _, _ in ends):
        return
    for body, position, rotation in ends:
        if not body.GetTargets():
            yield position.GetPath(), ConvertedValue.of(position, conversion.point)
            yield rotation.GetPath(), ConvertedValue.of(rotation, conversion.orientation)


def _placed(prim: Usd.Prim, order: list[str], conversion: Conversion) -> Values:
    """Yield the operations of a prim that does not follow those above it: it is placed on its own."""
    if conversion.world == Gf.Matrix4d(1.0):
        return
    name, number = _PLACED, 1
    while name in order:  # placed before, in a room that was joined of others
        number += 1
        name = f"{_PLACED}{number}"
    last = len(order) - order[::-1].index(RESET)
    yield prim.GetPath().AppendProperty(name), ConvertedValue(Sdf.ValueTypeNames.Matrix4d, conversion.world)
    new = [*order[:last], name, *order[last:]]
    yield prim.GetPath().AppendProperty("xformOpOrder"), ConvertedValue(Sdf.ValueTypeNames.TokenArray, new)


def _pole(prim: Usd.Prim, up_axis: str) -> Values:
    """Yield the pole of a dome that follows the up axis of its stage."""
    attribute = prim.GetAttribute("poleAxis") if type_of(prim) == "DomeLight_1" else None
    if attribute and attribute.Get() in (None, "scene"):
        yield attribute.GetPath(), ConvertedValue(attribute.GetTypeName(), up_axis)


def _hides_up_axis(prim: Usd.Prim) -> bool:
    """Return whether a model is drawn as cards, but for those across the up axis of the stage."""
    return bool(
        prim.GetAttribute("model:drawMode").Get() == "cards"
        and prim.GetAttribute("model:cardVisibility").Get() == "simple"
    )
