# SPDX-License-Identifier: Apache-2.0
"""The codeless schema by which a stage says how its things move: data beside this file, made known to USD once.

`generatedSchema.usda` documents every attribute. Other USD programs learn of it by the environment variable
PXR_PLUGINPATH_NAME set to this folder (`python -c "import tiscene.usd.core.schema as s; print(s.FOLDER)"`); without
that they keep the attributes all the same.
"""

from __future__ import annotations

import difflib
import functools
from pathlib import Path
from typing import Any

from pxr import Plug, Sdf, Usd

from tiscene.usd.core.report import StageReport

FOLDER = Path(__file__).parent
SCENARIO, OBJECT, MOTION, CAMERA = "TisceneScenarioAPI", "TisceneObjectAPI", "TisceneMotionAPI", "TisceneCameraAPI"
NAMESPACES = {
    SCENARIO: "tiscene:scenario",
    OBJECT: "tiscene:object",
    MOTION: "tiscene:motion",
    CAMERA: "tiscene:camera",
}


def register() -> None:
    """Make the schema known. USD builds its registry when the first stage is opened, and learns nothing after that."""
    Plug.Registry().RegisterPlugins(str(FOLDER))


def has(prim: Usd.Prim, schema: str) -> bool:
    """Whether a schema is applied to a prim, or any of its properties authored.

    The properties alone count, since a program that does not know the schema may leave out to apply it.
    """
    return schema in prim.GetAppliedSchemas() or bool(prim.GetAuthoredPropertiesInNamespace(NAMESPACES[schema]))


def authored(prim: Usd.Prim, name: str) -> Any:
    """The authored value of an attribute, None if there is none. Defaults are those of the classes that read it."""
    attribute = prim.GetAttribute(name)
    return attribute.Get() if attribute and attribute.HasAuthoredValue() else None


def targets(prim: Usd.Prim, name: str) -> list[Sdf.Path]:
    """Where a relationship leads to."""
    relationship = prim.GetRelationship(name)
    return list(relationship.GetTargets()) if relationship else []


@functools.cache
def properties() -> frozenset[str]:
    """The names of all attributes and relationships of the schema."""
    layer = Sdf.Layer.OpenAsAnonymous(str(FOLDER / "generatedSchema.usda"))
    return frozenset(str(each.name) for schema in NAMESPACES for each in layer.GetPrimAtPath(f"/{schema}").properties)


def report_misspelt(prim: Usd.Prim, report: StageReport) -> None:
    """StageReport properties of a prim that are in the schema's namespaces, but not in the schema."""
    for each in prim.GetAuthoredPropertiesInNamespace("tiscene"):
        name = str(each.GetName())
        if name not in properties():
            nearest = difflib.get_close_matches(name, sorted(properties()), n=1)
            hint = f"; did you mean {nearest[0]!r}?" if nearest else ""
            report.problem(prim.GetPath(), "schema", f"there is no property {name!r}{hint}")
