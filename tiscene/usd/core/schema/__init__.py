# SPDX-License-Identifier: Apache-2.0
"""The codeless USD schema of scenarios: TisceneScenarioAPI, and one for objects, motion, joints and cameras each.

`generatedSchema.usda` in this folder documents every attribute. tiscene registers it with USD when it first opens a
stage. Other USD programs find it through the environment variable PXR_PLUGINPATH_NAME, set to this folder
(`python -c "import tiscene.usd.core.schema as s; print(s.FOLDER)"`); without it they keep the attributes unchanged.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

from pxr import Plug, Sdf, Usd

from tiscene.errors import did_you_mean
from tiscene.usd.core.report import StageReport

FOLDER = Path(__file__).parent
SCENARIO, OBJECT, MOTION, CAMERA = "TisceneScenarioAPI", "TisceneObjectAPI", "TisceneMotionAPI", "TisceneCameraAPI"
JOINT = "TisceneJointAPI"
NAMESPACES = {
    SCENARIO: "tiscene:scenario",
    OBJECT: "tiscene:object",
    MOTION: "tiscene:motion",
    CAMERA: "tiscene:camera",
    JOINT: "tiscene:joint",
}


def register() -> None:
    """Register the schema with USD, which takes note of it until the first stage of the process is opened."""
    Plug.Registry().RegisterPlugins(str(FOLDER))


def has(prim: Usd.Prim, *schemas: str) -> bool:
    """Return whether one of some schemas is applied to a prim, or any of its properties is authored.

    Properties alone count, since a program that does not know the schema cannot apply it.
    """
    if not set(schemas).isdisjoint(_applied(prim)):
        return True
    return any(prim.GetAuthoredPropertiesInNamespace(NAMESPACES[each]) for each in schemas)


def _applied(prim: Usd.Prim) -> list[str]:
    """Return the names of the schemas that are applied to a prim, also where USD does not know them."""
    if _is_known():
        return list(prim.GetAppliedSchemas())
    names = prim.GetMetadata("apiSchemas")
    return [] if names is None else list(names.ApplyOperations([]))


@functools.cache
def _is_known() -> bool:
    """Return whether USD knows the schema. It does not if this process has used USD before it was registered."""
    return Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(OBJECT) is not None


def authored(prim: Usd.Prim, name: str) -> Any:
    """Return the authored value of an attribute, None if there is none; defaults are up to the reader."""
    attribute = prim.GetAttribute(name)
    return attribute.Get() if attribute and attribute.HasAuthoredValue() else None


def author(prim: Usd.Prim, name: str, value: Any) -> None:
    """Author a value of the schema, unless the attribute has it already, by default or from a reference.

    Lists and tuples become the vectors and arrays of the attribute's type.
    """
    kind = properties()[name]
    assert kind is not None
    value = kind.type.pythonClass(value) if isinstance(value, list | tuple) else value
    if not prim.HasAttribute(name) or prim.GetAttribute(name).Get() != value:
        prim.CreateAttribute(name, kind, False, Sdf.VariabilityUniform).Set(value)


def token(class_name: str) -> str:
    """Return the token that stands for a class: "lookAt" for "LookAt"."""
    return class_name[0].lower() + class_name[1:]


def targets(prim: Usd.Prim, name: str) -> list[Sdf.Path]:
    """Return the targets of a relationship, none if it does not exist."""
    relationship = prim.GetRelationship(name)
    return list(relationship.GetTargets()) if relationship else []


@functools.cache
def properties() -> dict[str, Sdf.ValueTypeName | None]:
    """Return the types of all attributes of the schema by name, None for relationships."""
    layer = Sdf.Layer.OpenAsAnonymous(str(FOLDER / "generatedSchema.usda"))
    specs = [each for schema in NAMESPACES for each in layer.GetPrimAtPath(f"/{schema}").properties]
    return {str(each.name): each.typeName if isinstance(each, Sdf.AttributeSpec) else None for each in specs}


def report_invalid_properties(prim: Usd.Prim, report: StageReport) -> None:
    """Report the properties of a prim in tiscene's namespace that the schema does not have, or of another type."""
    for each in prim.GetAuthoredPropertiesInNamespace("tiscene"):
        name = str(each.GetName())
        if name not in properties():
            report.refuse(prim.GetPath(), "schema", f"there is no property {name!r}{did_you_mean(name, properties())}")
            continue
        expected, spec = properties()[name], each.GetPropertyStack()[0]
        found = spec.typeName if isinstance(spec, Sdf.AttributeSpec) else None
        if (found and _form(found)) != (expected and _form(expected)):
            kinds = [str(kind or "relationship") for kind in (found, expected)]
            report.refuse(prim.GetPath(), "schema", f"{name} is of the type {kinds[0]}; it must be {kinds[1]}")
        elif found and each.GetNumTimeSamples():
            report.omission(prim.GetPath(), f"time samples of {name} are ignored, which has one value")


def _form(kind: Sdf.ValueTypeName) -> tuple[bool, str]:
    """Return whether a type is one of arrays, and of what; numbers of any precision are alike, and so are texts."""
    value = kind.scalarType.defaultValue
    if isinstance(value, bool | int | float):
        return kind.isArray, "number"
    return kind.isArray, "text" if isinstance(value, str) else type(value).__name__.rstrip("dfhi")
