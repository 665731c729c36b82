# SPDX-License-Identifier: Apache-2.0
"""Variant sets of a prim that select the variants of prims below it, which reference other stages."""

from __future__ import annotations

from collections.abc import Mapping

from pxr import Sdf, Usd


def forward_variants(root: Usd.Prim, sources: Mapping[Sdf.Path, Usd.Prim]) -> dict[str, list[str]]:
    """Give a prim the variant sets of others; each of its variants selects that of the same name in all of them.

    A set without variants is left out. The first selection of each set is that of the prim.

    Args:
        root: the prim; variants are written to the root layer of its stage.
        sources: prims with variant sets, by the path below `root` at which they are selected.

    Returns:
        The variants of each set.
    """
    holders: dict[str, dict[str, list[Sdf.Path]]] = {}  # paths by variant set and variant
    selected: dict[str, str] = {}
    for path, prim in sources.items():
        sets = prim.GetVariantSets()
        for name in sets.GetNames():
            for variant in sets.GetVariantSet(name).GetVariantNames():
                holders.setdefault(name, {}).setdefault(variant, []).append(path)
            selected[name] = selected.get(name) or sets.GetVariantSelection(name)
    for name in holders:
        root.GetVariantSets().AddVariantSet(name)
    layer = root.GetStage().GetRootLayer()
    with Sdf.ChangeBlock():  # the stage is composed once
        for name, variants in holders.items():
            for variant, paths in variants.items():
                inside = root.GetPath().AppendVariantSelection(name, variant)
                for path in paths:
                    spec = Sdf.CreatePrimInLayer(layer, path.ReplacePrefix(root.GetPath(), inside))
                    spec.variantSelections[name] = variant
    for name in holders:
        root.GetVariantSet(name).SetVariantSelection(selected[name])  # "": none
    return {name: list(variants) for name, variants in holders.items()}
