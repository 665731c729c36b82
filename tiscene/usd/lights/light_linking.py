# SPDX-License-Identifier: Apache-2.0
"""Light and shadow linking: which lights light which prims, and which prims cast shadows in their light.

UsdLux's LightAPI has two collections, lightLink and shadowLink. `prepare_links` finds the lights that they restrict and
sorts the stage's prims into link classes: prims of one class are in the same of these collections.
"""

from __future__ import annotations

from typing import Any

from pxr import Sdf, Usd, UsdGeom, UsdLux

from tiscene.usd.core.prims import ALSO_ABSTRACT
from tiscene.usd.core.report import StageReport

LINKS = {"lightLink": "lit", "shadowLink": "shadowing"}  # fields of `Light` by collection
MAX_CLASSES = 32  # a path's state has five bits for the class
_SPAWNED = Sdf.Path("/__spawned")  # stands for prims that are not on the stage


class LightLinks:
    """The link classes of a stage's prims.

    Args:
        queries: Of each restricting collection, by the light's path and the collection's name, what it includes.
        stage: The stage.
        report: Receives an omission if there are too many classes.
    """

    def __init__(self, queries: dict[tuple[Sdf.Path, str], Any], stage: Usd.Stage, report: StageReport) -> None:
        self._columns = {key: column for column, key in enumerate(queries)}
        self._class_of: dict[Sdf.Path, int] = {}
        self._classes: dict[tuple[bool, ...], int] = {}
        self._number(_SPAWNED, queries)
        for prim in Usd.PrimRange(stage.GetPseudoRoot(), ALSO_ABSTRACT):
            if prim.IsA(UsdGeom.Gprim):
                number = self._number(prim.GetPath(), queries)
                if number is None:
                    text = f"its light links are not applied: a stage may combine them in {MAX_CLASSES} ways"
                    report.omission(prim.GetPath(), text)
                elif number:
                    self._class_of[prim.GetPath()] = number

    def _number(self, path: Sdf.Path, queries: dict[tuple[Sdf.Path, str], Any]) -> int | None:
        members = tuple(bool(query.IsPathIncluded(path)) for query in queries.values())
        if members not in self._classes and len(self._classes) == MAX_CLASSES:
            return None
        return self._classes.setdefault(members, len(self._classes))

    def class_of(self, prim: Usd.Prim) -> int:
        """Return the link class of a gprim; 0 is that of what is spawned."""
        return self._class_of.get(prim.GetPath(), 0)

    def of_light(self, prim: Usd.Prim) -> dict[str, tuple[bool, ...]]:
        """Return the fields `lit` and `shadowing` of a light, without those that are not restricted."""
        result = {}
        for name, field in LINKS.items():
            column = self._columns.get((prim.GetPath(), name))
            if column is not None:
                result[field] = tuple(members[column] for members in self._classes)
        return result


def prepare_links(stage: Usd.Stage, report: StageReport) -> None:
    """Find the restricting collections of a stage, for `links_of`. A stage without any costs one traversal."""
    queries = {}
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), ALSO_ABSTRACT):
        if prim.HasAPI(UsdLux.LightAPI) and not prim.IsA(UsdGeom.Gprim):
            for name in LINKS:
                if is_restricted(prim, name):
                    with report.guard(prim.GetPath()):
                        query = Usd.CollectionAPI(prim, name).ComputeMembershipQuery()
                        queries[prim.GetPath(), name] = query
    if queries:
        report.budget.links = LightLinks(queries, stage, report)


def is_restricted(prim: Usd.Prim, name: str) -> bool:
    """Return whether a light's collection, lightLink or shadowLink, may leave out a prim."""
    collection = Usd.CollectionAPI(prim, name)
    return bool(collection) and (
        collection.GetIncludeRootAttr().Get() is False
        or bool(collection.GetExcludesRel().GetTargets())
        or collection.GetMembershipExpressionAttr().HasAuthoredValue()
    )


def links_of(report: StageReport) -> LightLinks | None:
    """Return the links that `prepare_links` found; None: no light is restricted, or the file is a template."""
    found: LightLinks | None = report.budget.links
    return found
