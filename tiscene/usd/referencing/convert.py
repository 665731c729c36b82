# SPDX-License-Identifier: Apache-2.0
"""Convert a referenced prim to the stage that references it: author what its transform does not convert."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

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
    if not conversion.is_identity:
        _UnitConverter(root.GetStage(), conversion, report).convert(root.GetPath(), frozenset(), frozenset())


@dataclass(frozen=True)
class _VariantValues:
    """What a variant set changes.

    Attributes:
        found: the values that change, for each variant.
        selected: the selections in sets farther inside, for each variant.
        opening: variants that have variant sets of their own.
    """

    found: dict[str, _Found] = field(default_factory=dict)
    selected: dict[str, dict[_VariantSet, str]] = field(default_factory=dict)
    opening: set[str] = field(default_factory=set)

    def follows(self, inner: _VariantSet, other: _VariantValues, attribute: Sdf.Path) -> bool:
        """Return whether an attribute differs between the variants as these select variants of a set inside."""
        return all(
            other.found.get(self.selected[variant].get(inner, ""), {}).get(attribute) == found.get(attribute)
            for variant, found in self.found.items()
        )


@dataclass(frozen=True)
class _UnitConverter:
    """Converts prims of a stage, on which it selects one variant after the other."""

    stage: Usd.Stage
    conversion: Conversion
    report: StageReport

    def convert(self, path: Sdf.Path, known: frozenset[_VariantSet], done: frozenset[Sdf.Path]) -> set[Sdf.Path]:
        """Author the values at and below a prim, in the edit target and in variants within it.

        Args:
            path: the prim.
            known: variant sets that are handled elsewhere; the edit target is in a variant of one.
            done: attributes that are handled elsewhere.

        Returns:
            The attributes that change.
        """
        values = self._find(path)
        sets = [each for each in self._variant_sets(path) if each not in known]
        known = known.union(sets)
        choices: dict[_VariantSet, _VariantValues] = {}
        for each in sets:
            choices[each] = self._values_of_variants(each, list(choices), known)
        owners = self._owners(values, choices, done)
        self._author({name: value for name, value in values.items() if name not in done and name not in owners})
        seen = set(values).union(*(found for each in choices.values() for found in each.found.values()))
        for each, choice in choices.items():
            held = {attribute for attribute, owner in owners.items() if owner == each}
            new = set[Sdf.Path]()
            for variant in self._each_variant(each):
                if variant in choice.opening or not held.isdisjoint(choice.found[variant]):
                    with self._set(each).GetVariantEditContext():
                        new |= self.convert(each[0], known, done.union(seen - held))
            seen |= new
        return seen

    def _values_of_variants(
        self, variant_set: _VariantSet, inside: list[_VariantSet], known: frozenset[_VariantSet]
    ) -> _VariantValues:
        """Return what a variant set changes; `inside`: sets of the same prim and farther inside."""
        choice = _VariantValues()
        for variant in self._each_variant(variant_set):
            there = (each for each in inside if self.stage.GetPrimAtPath(each[0]))
            choice.selected[variant] = {each: self._set(each).GetVariantSelection() for each in there}
            choice.found[variant] = self._find(variant_set[0])
            if not known.issuperset(self._variant_sets(variant_set[0])):
                choice.opening.add(variant)
        return choice

    def _owners(
        self, values: _Found, choices: Mapping[_VariantSet, _VariantValues], done: frozenset[Sdf.Path]
    ) -> dict[Sdf.Path, _VariantSet]:
        """Return the innermost variant set that each attribute depends on; report those that depend on two."""
        owners: dict[Sdf.Path, _VariantSet] = {}
        for each, choice in choices.items():
            inside = {attribute for attribute in values if attribute.HasPrefix(each[0])}
            for attribute in sorted(inside.union(*choice.found.values()) - done):
                if all(found.get(attribute) == values.get(attribute) for found in choice.found.values()):
                    continue
                inner = owners.setdefault(attribute, each)
                if inner != each and not choice.follows(inner, choices[inner], attribute):
                    text = f"{attribute.name} depends on the variant sets {inner[1]} and {each[1]}"
                    self.report.omission(attribute.GetPrimPath(), f"{text}: it is converted for those of {inner[1]}")
        return owners

    def _find(self, path: Sdf.Path) -> _Found:
        """Return the values that change at and below a prim; the instances that hold them become editable."""
        found: _Found = {}

        def held_by_instances() -> list[Usd.Prim]:
            found.clear()
            prims = list(Usd.PrimRange(self.stage.GetPrimAtPath(path), ALSO_ABSTRACT))
            relative = relative_parts(prims)
            for prim in prims:
                with self.report.guard(prim):
                    found.update(converted_values(prim, self.conversion, self.report))
                    found.update(motion_values(prim, self.conversion, prim.GetPath() in relative, self.report))
            holders = map(self.stage.GetPrimAtPath, dict.fromkeys(each.GetPrimPath() for each in found))
            return [prim for prim in holders if prim.IsInstanceProxy()]

        uninstance(self.stage, held_by_instances)
        return found

    def _variant_sets(self, path: Sdf.Path) -> list[_VariantSet]:
        """Return the variant sets at and below a prim, the innermost first."""
        sets = [
            (prim.GetPath(), name)
            for prim in Usd.PrimRange(self.stage.GetPrimAtPath(path), ALSO_ABSTRACT)
            if prim.HasVariantSets() and not prim.IsInstanceProxy()
            for name in prim.GetVariantSets().GetNames()
        ]
        return sorted(sets, key=lambda each: -each[0].pathElementCount)

    def _set(self, variant_set: _VariantSet) -> Usd.VariantSet:
        path, name = variant_set
        return self.stage.GetPrimAtPath(path).GetVariantSet(name)

    def _each_variant(self, variant_set: _VariantSet) -> Iterator[str]:
        """Yield the variants of a set, each while it is selected; the selection is made in the session layer."""
        session, (path, name) = self.stage.GetSessionLayer(), variant_set
        spec = Sdf.CreatePrimInLayer(session, path)
        for variant in self._set(variant_set).GetVariantNames():
            spec.variantSelections[name] = variant
            yield variant
        if name in spec.variantSelections:
            del spec.variantSelections[name]

    def _author(self, values: _Found) -> None:
        for attribute, value in values.items():
            value.author(self.stage.GetPrimAtPath(attribute.GetPrimPath()), attribute.name)
