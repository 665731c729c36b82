"""What a prim is: its semantic label, and whether it is a thing with an identity of its own."""

from __future__ import annotations

from pxr import Kind, Usd, UsdSemantics

PREFERRED_TAXONOMIES = ("class", "category")


def direct_label(prim: Usd.Prim, time: Usd.TimeCode) -> str:
    """The label authored on this very prim by UsdSemanticsLabelsAPI, "" for none.

    The first label of taxonomy `class`, else of `category`, else of the first other taxonomy by name.
    """
    applied = UsdSemantics.LabelsAPI.GetDirectTaxonomies(prim)
    if not applied:
        return ""
    taxonomies = sorted(str(name) for name in applied)
    taxonomies.sort(key=lambda name: PREFERRED_TAXONOMIES.index(name) if name in PREFERRED_TAXONOMIES else 9)
    for taxonomy in taxonomies:
        labels = UsdSemantics.LabelsAPI(prim, taxonomy).GetLabelsAttr().Get(time)
        if labels:
            return str(labels[0])
    return ""


def inherited_label(prim: Usd.Prim, time: Usd.TimeCode) -> str:
    """The label of the nearest ancestor that has one, "" for none."""
    while prim and not prim.IsPseudoRoot():
        label = direct_label(prim, time)
        if label:
            return label
        prim = prim.GetParent()
    return ""


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
