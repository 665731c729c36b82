# SPDX-License-Identifier: Apache-2.0
"""What a prim is: its semantic label, and whether it is a thing with an identity of its own."""

from __future__ import annotations

from pathlib import Path

from pxr import Kind, Usd, UsdSemantics

from tiscene.errors import UnknownName
from tiscene.usd.core.package import split_package

PREFERRED_TAXONOMIES = ("class", "category")


def direct_label(prim: Usd.Prim, time: Usd.TimeCode, taxonomy: str | None = None) -> str:
    """The label authored on this very prim by UsdSemanticsLabelsAPI, "" for none.

    The first label of `taxonomy`; for None of `class`, else of `category`, else of the first other taxonomy by name.
    """
    applied = UsdSemantics.LabelsAPI.GetDirectTaxonomies(prim)
    if not applied:
        return ""
    taxonomies = sorted(str(name) for name in applied)
    if taxonomy is not None:
        taxonomies = [name for name in taxonomies if name == taxonomy]
    taxonomies.sort(key=lambda name: PREFERRED_TAXONOMIES.index(name) if name in PREFERRED_TAXONOMIES else 9)
    for name in taxonomies:
        labels = UsdSemantics.LabelsAPI(prim, name).GetLabelsAttr().Get(time)
        if labels:
            return str(labels[0])
    return ""


def inherited_label(prim: Usd.Prim, time: Usd.TimeCode, taxonomy: str | None = None) -> str:
    """The label of the nearest ancestor that has one, "" for none."""
    while prim and not prim.IsPseudoRoot():
        label = direct_label(prim, time, taxonomy)
        if label:
            return label
        prim = prim.GetParent()
    return ""


def taxonomies_of(stage: Usd.Stage) -> set[str]:
    """The taxonomies in which anything on a stage is labeled, in what may be instanced or spawned too."""
    found: set[str] = set()
    roots = [stage.GetPseudoRoot(), *stage.GetPrototypes()]
    for prim in (prim for root in roots for prim in Usd.PrimRange(root, Usd.PrimAllPrimsPredicate)):
        if prim.HasAPI(UsdSemantics.LabelsAPI):
            found.update(str(name) for name in UsdSemantics.LabelsAPI.GetDirectTaxonomies(prim))
    return found


def check_taxonomy(stage: Usd.Stage, taxonomy: str | None) -> None:
    """Raises UnknownName for a taxonomy that nothing on the stage is labeled in."""
    known = set() if taxonomy is None else taxonomies_of(stage)
    if taxonomy is not None and (not isinstance(taxonomy, str) or taxonomy not in known):
        hint = "" if known else "Nothing on the stage has a semantic label."
        raise UnknownName("taxonomy", taxonomy, known, where=f" in {stage.GetRootLayer().GetDisplayName()}", hint=hint)


def name_label(prim: Usd.Prim) -> str:
    """What a prim's name says it is: the name of its asset, else its own, without a number at the end."""
    name = str(Usd.ModelAPI(prim).GetAssetName() or prim.GetName())
    return name.rstrip("0123456789").rstrip("_- ") or name


def asset_name(prim: Usd.Prim) -> str:
    """The asset that a prim is of: the name in the assetInfo of the nearest prim at or above it, or made from the name
    of the file whose default prim that one refers to; "" for none."""
    while prim and not prim.IsPseudoRoot():
        name = Usd.ModelAPI(prim).GetAssetName() or _name_of_reference(prim)
        if name:
            return str(name)
        prim = prim.GetParent()
    return ""


def _name_of_reference(prim: Usd.Prim) -> str:
    if not (prim.HasAuthoredReferences() or prim.HasAuthoredPayloads()):
        return ""
    for spec in prim.GetPrimStack():
        for each in (*spec.referenceList.GetAppliedItems(), *spec.payloadList.GetAppliedItems()):
            if each.assetPath and each.primPath.isEmpty:
                path = str(spec.layer.ComputeAbsolutePath(each.assetPath))
                return readable_name(Path(split_package(path)[-1]))
    return ""


def readable_name(path: Path) -> str:
    """A name from a file's: that of the folder for `chair_01/template.usda`, "Chair 01"; else of the file itself."""
    return spaced(path.resolve().parent.name if path.stem == "template" else path.stem)


def spaced(name: str) -> str:
    """ "chair_01" as "Chair 01"."""
    return " ".join(word[:1].upper() + word[1:] for word in name.split("_") if word)


def is_component(prim: Usd.Prim) -> bool:
    """Whether the prim's kind is `component` (or derived from it): a thing, together with all below it."""
    return _is_of_kind(prim, Kind.Tokens.component)


def is_lone_instance(prim: Usd.Prim) -> bool:
    """Whether the prim is a native instance, and not of one of the kinds (group, assembly) that hold several things."""
    return bool(prim.IsInstance()) and not _is_of_kind(prim, Kind.Tokens.group)


def _is_of_kind(prim: Usd.Prim, kind: str) -> bool:
    if not prim.HasAuthoredMetadata("kind"):
        return False
    return bool(Kind.Registry.IsA(str(prim.GetMetadata("kind")), kind))
