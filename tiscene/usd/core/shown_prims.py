# SPDX-License-Identifier: Apache-2.0
"""Which prims of a stage are drawn at some time: objects and lights that a scenario moves are."""

from __future__ import annotations

from pxr import Usd, UsdGeom

from tiscene.usd.core.prims import DRAWN_PURPOSES, renders, with_ancestors
from tiscene.usd.core.value_times import is_time_varying


def is_shown(prim: Usd.Prim, time: Usd.TimeCode) -> bool:
    """Return whether a prim is read as one of the stage: visible at some time, and in no prototype of points.

    Args:
        prim: the prim.
        time: the time code that the stage is read at.
    """
    for each in with_ancestors(prim):
        if each.IsA(UsdGeom.PointInstancer):
            return False
        if each.IsA(UsdGeom.Imageable) and is_always_invisible(UsdGeom.Imageable(each), time):
            return False
    purpose = UsdGeom.Imageable(prim).ComputePurpose()
    return purpose in DRAWN_PURPOSES and (purpose != UsdGeom.Tokens.render or renders(prim))


def is_always_invisible(imageable: UsdGeom.Imageable, time: Usd.TimeCode) -> bool:
    """Return whether a prim's own visibility hides it at all times."""
    visibility = imageable.GetVisibilityAttr()
    return visibility.Get(time) == UsdGeom.Tokens.invisible and not is_time_varying(visibility)


def shows_geometry(prim: Usd.Prim, time: Usd.TimeCode) -> bool:
    """Return whether anything at or below a prim is drawn, unlike in rigs of lights and of cameras.

    Args:
        prim: the prim.
        time: the time code that the stage is read at.
    """
    if UsdGeom.ModelAPI(prim).ComputeModelDrawMode() == UsdGeom.Tokens.cards:
        return True
    inside = Usd.PrimRange(prim, Usd.TraverseInstanceProxies())
    return any(
        each.IsA(UsdGeom.PointInstancer) or (each.IsA(UsdGeom.Gprim) and is_shown(each, time)) for each in inside
    )
