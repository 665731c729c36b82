# SPDX-License-Identifier: Apache-2.0
"""Prims of a stage: which are traversed and drawn, their ancestors, and the instances that they are in."""

from __future__ import annotations

from collections.abc import Iterator

from pxr import Sdf, Tf, Usd, UsdGeom, UsdLux

_LOADED = Usd.PrimIsActive & Usd.PrimIsLoaded
DEFINED = Usd.TraverseInstanceProxies(_LOADED & Usd.PrimIsDefined & ~Usd.PrimIsAbstract)
ALSO_ABSTRACT = Usd.TraverseInstanceProxies(_LOADED)  # prototypes and templates may be below a class or an over
FALLBACK_TYPES = "fallbackPrimTypes"  # metadata of a root layer: types that replace those unknown to USD
DRAWN_PURPOSES = [UsdGeom.Tokens.default_, UsdGeom.Tokens.render]


def distinct_prims(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    """Yield the prims of a stage; those of a prototype once, however many instances it has."""
    for root in (stage.GetPseudoRoot(), *stage.GetPrototypes()):
        yield from Usd.PrimRange(root)


def ancestors(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """Yield the ancestors of a prim, from its parent up, without the pseudo-root."""
    return with_ancestors(prim.GetParent())


def with_ancestors(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """Yield a prim, then its `ancestors`."""
    while prim and not prim.IsPseudoRoot():
        yield prim
        prim = prim.GetParent()


def renders(prim: Usd.Prim, inherited: bool | None = None) -> bool:
    """Return whether prims of purpose "render" are shown at a prim, by renderVisibility of VisibilityAPI.

    Args:
        prim: the prim.
        inherited: the same of its parent, which holds where the prim has no opinion; None: it is found.
    """
    if prim.HasAPI(UsdGeom.VisibilityAPI):
        authored = UsdGeom.VisibilityAPI(prim).GetRenderVisibilityAttr().Get()
        if authored != UsdGeom.Tokens.inherited:
            return bool(authored != UsdGeom.Tokens.invisible)
    if inherited is not None:
        return inherited
    parent = prim.GetParent()
    return not parent or parent.IsPseudoRoot() or renders(parent)


def type_of(prim: Usd.Prim) -> str:
    """Return the type of a prim; for one that USD does not know, the first known one of its stage's `FALLBACK_TYPES`.

    "" for a prim without a type. A type without a known fallback is returned as it is authored.
    """
    return str(prim.GetPrimTypeInfo().GetSchemaTypeName() or prim.GetTypeName())


def prototypes_of(instancer: Usd.Prim) -> list[Usd.Prim]:
    """Return the prototypes of a point instancer that exist."""
    targets = UsdGeom.PointInstancer(instancer).GetPrototypesRel().GetForwardedTargets()
    return [prim for prim in map(instancer.GetStage().GetPrimAtPath, targets) if prim]


def is_light(prim: Usd.Prim) -> bool:
    """Return whether a prim is a UsdLux light or has LightAPI applied; portals are not lights."""
    return bool(prim.HasAPI(UsdLux.LightAPI)) and not prim.IsA(UsdLux.PortalLight)


def is_light_only(prim: Usd.Prim) -> bool:
    """Return whether a prim is a light and not a gprim: a mesh light is an object."""
    return is_light(prim) and not prim.IsA(UsdGeom.Gprim)


def identifier(text: str) -> str:
    """Return the name of a prim that is as close to a text as USD allows; letters of any script are kept."""
    return text if Sdf.Path.IsValidIdentifier(text) else str(Tf.MakeValidIdentifier(text))


def unused_path(stage: Usd.Stage, folder: Sdf.Path, name: str) -> Sdf.Path:
    """Return a path for a new prim below a folder, numbered if the name is taken."""
    path, number = folder.AppendChild(name), 1
    while stage.GetPrimAtPath(path):
        number += 1
        path = folder.AppendChild(f"{name}_{number}")
    return path


def outermost_instance(prim: Usd.Prim) -> Usd.Prim:
    """Return the instance that is, or holds, a prim and is in no other one; an invalid prim if there is none."""
    instances = (each for each in with_ancestors(prim) if each.IsInstance() and not each.IsInstanceProxy())
    return next(instances, Usd.Prim())
