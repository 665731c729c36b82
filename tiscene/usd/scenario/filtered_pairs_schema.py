# SPDX-License-Identifier: Apache-2.0
"""Bodies that do not collide with each other, by the schemas of UsdPhysics.

PhysicsFilteredPairsAPI names pairs of bodies, colliders or groups of them. The colliders of a PhysicsCollisionGroup do
not collide with those of its filteredGroups; with invertFilteredGroups, only with those. Groups of one mergeGroup count
as one. Both are read as `Scenario.filtered_pairs`, which are written as PhysicsFilteredPairsAPI.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Any

from pxr import Sdf, Usd, UsdGeom, UsdPhysics

from tiscene.usd.core import schema
from tiscene.usd.core.report import StageReport

LATER = "tiscene:scenario:filteredPairs"  # pairs with objects that are spawned later, which have no prim
Predicate = Callable[[Sdf.Path], bool]


def write_filtered_pairs(
    root: Usd.Prim, pairs: Iterable[Sequence[str]], objects: Sequence[Mapping[str, Any]], prims: Sequence[Usd.Prim]
) -> None:
    """Author pairs as PhysicsFilteredPairsAPI of objects.

    Args:
        root: the prim of the scenario.
        pairs: ids of objects, or prim paths.
        objects: JSON objects of the scenario's objects.
        prims: their prims.
    """
    made = {content["id"]: prim for content, prim in zip(objects, prims, strict=True)}
    later = []
    for one, other in pairs:
        ends = sorted((one, other), key=lambda name: name not in made)
        if ends[0] not in made or not (ends[1] in made or ends[1].startswith("/")):
            later.append([one, other])
            continue
        target = made[ends[1]].GetPath() if ends[1] in made else Sdf.Path(ends[1])
        UsdPhysics.FilteredPairsAPI.Apply(made[ends[0]]).CreateFilteredPairsRel().AddTarget(target)
    if later:
        schema.author(root, LATER, json.dumps(later))


def read_filtered_pairs(
    stage: Usd.Stage,
    root: Usd.Prim | None,
    objects: Sequence[Mapping[str, Any]],
    paths: Sequence[str],
    rigid: Set[str],
    report: StageReport,
) -> dict[str, Any]:
    """Return the pairs of which one is a rigid body of the scenario, as a member `filtered_pairs`; {} for none.

    Args:
        stage: the stage.
        root: the prim of the scenario, if any.
        objects: JSON objects of the scenario's objects.
        paths: paths of their prims.
        rigid: ids of the objects that are rigid bodies.
        report: receives what is filtered otherwise.
    """
    later = schema.authored(root, LATER) if root else None
    if not rigid and not later:
        return {}
    names = _Names(stage, {Sdf.Path(path): each["id"] for path, each in zip(paths, objects, strict=True)}, report)
    found: set[tuple[str, str]] = set()
    for prim in stage.Traverse():
        if prim.HasAPI(UsdPhysics.FilteredPairsAPI):
            with report.guard(prim.GetPath()):
                targets = UsdPhysics.FilteredPairsAPI(prim).GetFilteredPairsRel().GetForwardedTargets()
                missing = [target for target in targets if not stage.GetPrimAtPath(target)]
                for target in missing:
                    report.omission(
                        prim.GetPath(), "a filtered pair with a prim that does not exist counts not", target
                    )
                others = [names.at(target) for target in targets if target not in missing]
                found |= _pairs(names.at(prim.GetPath()), set().union(*others))
    for group, other in _filters(stage):
        found |= _pairs(names.where(group), names.where(other))
    kept = [list(pair) for pair in sorted(found) if not rigid.isdisjoint(pair)]
    kept += json.loads(later) if later else []
    return {"filtered_pairs": kept} if kept else {}


def _pairs(some: Iterable[str], others: Iterable[str]) -> set[tuple[str, str]]:
    return {(min(one, other), max(one, other)) for one in some for other in others if one != other}


class _Names:
    """Names of what collides: ids of the scenario's objects, paths of the other prims of the stage.

    Args:
        stage: the stage.
        owners: ids of objects by the paths of their prims.
        report: receives objects of which a part is filtered.
    """

    def __init__(self, stage: Usd.Stage, owners: Mapping[Sdf.Path, str], report: StageReport) -> None:
        self._stage, self._owners, self._report = stage, owners, report

    def at(self, path: Sdf.Path) -> set[str]:
        """Return the objects that a prim belongs to or that are below it; its path, if it is none of them."""
        for each in path.GetPrefixes():
            if each in self._owners:
                if each != path and len(self._colliders(each)) > 1:
                    self._report_part(each)
                return {self._owners[each]}
        below = {name for each, name in self._owners.items() if each.HasPrefix(path)}
        return below or {str(path)}

    def where(self, is_member: Predicate) -> set[str]:
        """Return the objects with a collider in a set of prims, and the topmost other prims wholly in it."""
        found = set()
        for path, name in self._owners.items():
            colliders = self._colliders(path)
            members = [each for each in colliders if is_member(each)]
            if members and len(members) < len(colliders):
                self._report_part(path)
            if members:
                found.add(name)
        return found | set(self._stage_prims(self._stage.GetPseudoRoot(), is_member)[1])

    def _stage_prims(self, prim: Usd.Prim, is_member: Predicate) -> tuple[bool, list[str]]:
        """Return whether all that collides at and below a prim is in a set, and the topmost prims that are."""
        path = prim.GetPath()
        if path in self._owners:
            return True, []
        children = prim.GetFilteredChildren(Usd.TraverseInstanceProxies())
        results = [self._stage_prims(each, is_member) for each in children]
        own = is_member(path) if _may_collide(prim) else True
        parts = [name for _, names in results for name in names]
        if own and all(whole for whole, _ in results):
            has_some = bool(parts) or _may_collide(prim)
            return True, [str(path)] if has_some and not prim.IsPseudoRoot() else parts
        return False, [*parts, *([str(path)] if own and _may_collide(prim) else [])]

    def _colliders(self, path: Sdf.Path) -> list[Sdf.Path]:
        """Return the colliders of an object; its gprims if it has none, as it then collides as a whole."""
        prims = list(Usd.PrimRange(self._stage.GetPrimAtPath(path), Usd.TraverseInstanceProxies()))
        colliders = [each.GetPath() for each in prims if each.HasAPI(UsdPhysics.CollisionAPI)]
        return colliders or [each.GetPath() for each in prims if each.IsA(UsdGeom.Gprim)] or [path]

    def _report_part(self, path: Sdf.Path) -> None:
        text = "a collision filter of a part of a rigid body counts for the body as a whole"
        self._report.omission(path, text)


def _may_collide(prim: Usd.Prim) -> bool:
    return bool(prim.IsA(UsdGeom.Gprim) or prim.HasAPI(UsdPhysics.CollisionAPI))


@dataclass
class _Group:
    """Collision groups that count as one."""

    members: list[Usd.CollectionMembershipQuery] = field(default_factory=list)
    filtered: set[Sdf.Path] = field(default_factory=set)
    inverted: bool = False

    def holds(self, path: Sdf.Path) -> bool:
        return any(each.IsPathIncluded(path) for each in self.members)


def _filters(stage: Usd.Stage) -> list[tuple[Predicate, Predicate]]:
    """Return the sets of prims that do not collide with each other by collision groups, in pairs."""
    groups: dict[str, _Group] = {}
    keys: dict[Sdf.Path, str] = {}
    for prim in stage.Traverse():
        if prim.IsA(UsdPhysics.CollisionGroup):
            group = UsdPhysics.CollisionGroup(prim)
            key = group.GetMergeGroupNameAttr().Get() or str(prim.GetPath())
            keys[prim.GetPath()] = key
            whole = groups.setdefault(key, _Group())
            whole.members.append(group.GetCollidersCollectionAPI().ComputeMembershipQuery())
            whole.filtered |= set(group.GetFilteredGroupsRel().GetForwardedTargets())
            whole.inverted = whole.inverted or bool(group.GetInvertFilteredGroupsAttr().Get())
    result: list[tuple[Predicate, Predicate]] = []
    for group in groups.values():
        named = [groups[keys[path]] for path in sorted(group.filtered) if path in keys]
        others = [each.holds for each in named]
        result += [(group.holds, each) for each in ([_outside(others)] if group.inverted else others)]
    return result


def _outside(sets: Sequence[Predicate]) -> Predicate:
    """Return the set of all prims that are in none of some sets."""
    return lambda path: not any(is_member(path) for is_member in sets)
