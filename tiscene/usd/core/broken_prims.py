# SPDX-License-Identifier: Apache-2.0
"""Prims whose bounds USD cannot compute: endless point instancers, which crash it, and transforms that it cannot read.

A point instancer is endless if one of its prototypes contains the instancer itself, directly or by other instancers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pxr import Sdf, Usd, UsdGeom

from tiscene.usd.core.prims import ALSO_ABSTRACT, outermost_instance, prototypes_of
from tiscene.usd.core.report import StageReport

ENDLESS = "one of its prototypes contains the instancer itself"


def has_bounds(prim: Usd.Prim) -> bool:
    """Return whether there is no endless point instancer at a prim, below it or in prototypes of instancers there."""
    return not any(_is_endless(each) for each in _instancers([prim]).values())


def deactivate_broken(root: Usd.Prim, report: StageReport) -> None:
    """Deactivate prims that have no bounds, in the session layer; instances around them become editable there.

    Args:
        root: they are looked for at this prim and below it.
        report: receives a problem for each.
    """
    stage = root.GetStage()
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        while broken := [prim.GetPath() for prim in _broken(root, report)]:
            for path in broken:
                prim = stage.GetPrimAtPath(path)
                if not prim:  # a prim above it was deactivated before
                    continue
                if prim.IsInstanceProxy():
                    outermost_instance(prim).SetInstanceable(False)
                else:
                    prim.SetActive(False)


def _broken(root: Usd.Prim, report: StageReport) -> Iterator[Usd.Prim]:
    """Yield the active prims at and below a prim that have no bounds, and report them."""
    for prim in _instancers([root]).values():
        if _is_endless(prim):
            report.problem(prim.GetPath(), "instancer", ENDLESS)
            yield prim
    for prim in Usd.PrimRange(root, ALSO_ABSTRACT):
        local = None
        with report.guard(prim):
            local = UsdGeom.Xformable(prim).GetLocalTransformation() if prim.IsA(UsdGeom.Xformable) else prim
        if local is None:
            yield prim


def _is_endless(instancer: Usd.Prim) -> bool:
    return instancer.GetPath() in _instancers(prototypes_of(instancer))


def _instancers(roots: Iterable[Usd.Prim]) -> dict[Sdf.Path, Usd.Prim]:
    """Return the point instancers at and below prims, and those in prototypes of these instancers, by path."""
    found: dict[Sdf.Path, Usd.Prim] = {}
    pending = list(roots)
    while pending:
        prims = iter(Usd.PrimRange(pending.pop(), ALSO_ABSTRACT))
        for prim in prims:
            if prim.IsA(UsdGeom.PointInstancer):
                prims.PruneChildren()  # only those that are prototypes are drawn
                if prim.GetPath() not in found:
                    found[prim.GetPath()] = prim
                    pending += prototypes_of(prim)
    return found
