# SPDX-License-Identifier: Apache-2.0
"""Convert a referenced prim to the stage that references it: author what its transform does not convert."""

from __future__ import annotations

from collections.abc import Iterator

from pxr import Sdf, Usd

from tiscene.usd.core.prims import ALSO_ABSTRACT
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import uninstance
from tiscene.usd.referencing.conversion import Conversion
from tiscene.usd.referencing.converted_values import ConvertedValue, converted_values
from tiscene.usd.referencing.motion_values import motion_values, relative_parts

_Found = dict[Sdf.Path, ConvertedValue]
_VariantSet = tuple[Sdf.Path, str]  # prim and name


def convert(root: Usd.Prim, conversion: Conversion, report: StageReport) -> None:
    """Author the values of a prim and of those below it for the units, axes and place of another stage.

    They are written to the stage's edit target. Where a value differs between variants, it is written to these.
    Instances that hold a value become editable, and stay objects of their own.

    Args:
        root: the prim, which references a stage; its transform is converted by the caller.
        conversion: from that stage to the prim's.
        report: receives what cannot be converted.
    """
    if conversion.is_identity:
        return
    stage, path = root.GetStage(), root.GetPath()
    values = _find(stage, path, conversion, report)
    in_variants: dict[Sdf.Path, _VariantSet] = {}  # the innermost set on which a value depends
    choices: dict[_VariantSet, dict[str, _Found]] = {}
    for each in _variant_sets(root):
        found: dict[str, _Found] = {}
        selected: dict[str, dict[_VariantSet, str]] = {}  # in the other sets, for each variant
        for variant in _each_variant(stage, each):
            found[variant] = _find(stage, each[0], conversion, report)
            selected[variant] = {
                other: stage.GetPrimAtPath(other[0]).GetVariantSet(other[1]).GetVariantSelection()
                for other in choices
                if stage.GetPrimAtPath(other[0])
            }
        choices[each] = found
        own = {attribute for attribute in values if attribute.HasPrefix(each[0])}
        for attribute in sorted(own.union(*found.values())):
            if all(result.get(attribute) == values.get(attribute) for result in found.values()):
                continue
            inner = in_variants.setdefault(attribute, each)
            if inner != each and any(
                choices[inner].get(selected[variant].get(inner, ""), {}).get(attribute) != result.get(attribute)
                for variant, result in found.items()
            ):
                text = f"{attribute.name} depends on two variant sets, {inner[1]} and {each[1]}"
                text += f": it is converted for those of {inner[1]}"
                report.omission(attribute.GetPrimPath(), text)
    _author(stage, {name: value for name, value in values.items() if name not in in_variants})
    for each, found in choices.items():
        for variant in _each_variant(stage, each):
            held = {name: value for name, value in found[variant].items() if in_variants.get(name) == each}
            if held:
                with stage.GetPrimAtPath(each[0]).GetVariantSet(each[1]).GetVariantEditContext():
                    _author(stage, held)


def _find(stage: Usd.Stage, path: Sdf.Path, conversion: Conversion, report: StageReport) -> _Found:
    """Return the values that change at and below a prim; the instances that hold them become editable."""
    found: _Found = {}

    def held_by_instances() -> list[Usd.Prim]:
        found.clear()
        prims = list(Usd.PrimRange(stage.GetPrimAtPath(path), ALSO_ABSTRACT))
        relative = relative_parts(prims)
        for prim in prims:
            with report.guard(prim):
                found.update(converted_values(prim, conversion, report))
                found.update(motion_values(prim, conversion, prim.GetPath() in relative, report))
        holders = map(stage.GetPrimAtPath, {each.GetPrimPath() for each in found})
        return [prim for prim in holders if prim.IsInstanceProxy()]

    uninstance(stage, held_by_instances)
    return found


def _variant_sets(root: Usd.Prim) -> list[_VariantSet]:
    """Return the variant sets at and below a prim that have a choice, the innermost first."""
    sets = [
        (prim.GetPath(), name)
        for prim in Usd.PrimRange(root, ALSO_ABSTRACT)
        if prim.HasVariantSets() and not prim.IsInstanceProxy()
        for name in prim.GetVariantSets().GetNames()
        if prim.GetVariantSet(name).GetVariantNames()
    ]
    return sorted(sets, key=lambda each: -each[0].pathElementCount)


def _each_variant(stage: Usd.Stage, variant_set: _VariantSet) -> Iterator[str]:
    """Yield the variants of a set, each while it is selected; the selection is made in the session layer."""
    path, name = variant_set
    session = stage.GetSessionLayer()
    for variant in stage.GetPrimAtPath(path).GetVariantSet(name).GetVariantNames():
        Sdf.CreatePrimInLayer(session, path).variantSelections[name] = variant
        yield variant
    del session.GetPrimAtPath(path).variantSelections[name]


def _author(stage: Usd.Stage, values: _Found) -> None:
    for attribute, value in values.items():
        value.author(stage.GetPrimAtPath(attribute.GetPrimPath()), attribute.name)
